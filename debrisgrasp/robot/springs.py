"""What is felt at a hand, and what is watched so as to feel it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, sqrt
from typing import NamedTuple

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray

__all__ = [
    "GROUND",
    "HELD",
    "PALM",
    "Guard",
    "Spring",
    "Stand",
    "Watch",
    "blended",
    "shifting",
    "yielded",
]

GROUND = -1
"""Stands for a body where the ground is touched."""
PALM = 0
"""Owner of the points of the palm; fingers follow from 1."""
HELD = -1
"""Owner of the points of what the hand holds."""
_EDGE = 3e-4
"""So near to an edge both of its sides push: nothing jumps on the way around it [m]."""
_SHIFTS = 0.004
"""So far does the middle of a contact go from one look to the next at most [m]: from
one part of a body to another the load goes over bit by bit."""


class Stand(NamedTuple):
    """How a hand stands."""

    R: FloatArray
    """In odom, shape (3, 3) ..."""
    p: FloatArray
    """... and (3,) [m]."""
    openings: tuple[float, ...]
    """Of its fingers [m]."""

    def way_to(self, other: Stand, reach: float, gain: float) -> float:
        """How far any of its points is from where it is in another stand, at most [m].

        Parameters
        ----------
        reach
            Of its points from its origin [m].
        gain
            How far a point moves per change of its finger's opening, at most.
        """
        gap, turn = other.p - self.p, (other.R - self.R).ravel()
        moved = sqrt(float(gap @ gap)) + reach * sqrt(float(turn @ turn))
        if other.openings != self.openings:
            moved += gain * max(
                abs(a - b) for a, b in zip(other.openings, self.openings, strict=True)
            )
        return moved


class Spring(NamedTuple):
    """A contact that pushes."""

    owner: int
    """`PALM`, `HELD`, or the number of a finger from 1."""
    body: int
    """Number of the body, or `GROUND`."""
    point: FloatArray
    """Where, frame odom [m], shape (3,)."""
    force: FloatArray
    """On the hand, axes of odom [N], shape (3,)."""
    depth: float
    """[m]."""


@dataclass(slots=True, eq=False)
class Watch:
    """Points of the hand that are near one part of a body, or near the ground."""

    body: int
    part: slice | None
    rows: IntArray
    """Which points of the hand, shape (m,)."""
    owners: IntArray
    """Whose each of them is, shape (m,)."""
    points: FloatArray
    """Frame of the hand [m], shape (m, 3)."""
    free_until: float = -inf
    """None of them touches before the hand has gone so far [m] ..."""
    place: FloatArray | None = None
    """... while the body is here, frame odom [m], shape (3,)."""


@dataclass(slots=True, eq=False)
class Guard:
    """Points of a body that are near a solid of the palm or of what is held."""

    owner: int
    body: int
    rows: IntArray
    normals: FloatArray
    offsets: FloatArray
    is_covered: BoolArray


def shifting(spring: Spring, before: FloatArray) -> Spring:
    """Contact whose middle was (3,) at the last look."""
    way = spring.point - before
    far = float(np.linalg.norm(way))
    if far <= _SHIFTS:
        return spring
    return spring._replace(point=before + _SHIFTS / far * way)


def blended(normals: FloatArray, beyond: FloatArray) -> FloatArray:
    """Directions in which a body pushes points out, smooth around its edges, (n, 3).

    Parameters
    ----------
    normals, beyond
        Of the sides, shapes (s, 3) and (n, s) [m], negative inside.
    """
    nearest = beyond.max(axis=1, keepdims=True)
    means = np.exp((beyond - nearest) / _EDGE) @ normals
    sizes = np.linalg.norm(means, axis=1, keepdims=True)
    own = normals[beyond.argmax(axis=1)]
    return np.asarray(np.where(sizes > 0.5, means / np.maximum(sizes, 0.5), own))


def yielded(springs: Sequence[Spring], stiffness: float) -> list[Spring]:
    """Let an arm give way to all that pushes its hand, as much as its structure does.

    It is softer than any contact, and in series with all of them together: however
    many touch, the hand is pushed no more stiffly than the arm bends. What only
    squeezes the hand from both sides does not bend it.

    Parameters
    ----------
    stiffness
        Of the arm at the hand [N/m].
    """
    pressed = list(springs)
    while pressed:
        forces = np.array([spring.force for spring in pressed])
        sizes = np.linalg.norm(forces, axis=1)
        depths = np.array([spring.depth for spring in pressed])
        ways = forces / sizes[:, None]
        bend = np.linalg.solve(
            stiffness * np.eye(3) + (ways * (sizes / depths)[:, None]).T @ ways,
            sizes @ ways,
        )
        shares = 1.0 - ways @ bend / depths
        if (shares > 0.0).all():
            return [
                spring._replace(force=share * spring.force)
                for spring, share in zip(pressed, shares.tolist(), strict=True)
            ]
        # The hand is bent away from some of them.
        pressed = [s for s, share in zip(pressed, shares, strict=True) if share > 0.0]
    return []
