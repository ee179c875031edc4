"""What is felt at a hand, and what is watched so as to feel it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, sqrt
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray

from .config import FakeConfig

__all__ = [
    "GROUND",
    "HELD",
    "PALM",
    "REACH",
    "Guard",
    "Near",
    "Spring",
    "Stand",
    "Watch",
    "yielded",
]

GROUND = -1
"""Stands for a body where the ground is touched."""
PALM = 0
"""Owner of the points of the palm; fingers follow from 1."""
HELD = -1
"""Owner of the points of what the hand holds."""
REACH = 0.004
"""So far at most is a hand bent against what it would not reach [m]."""
_NO_LAG: FloatArray = np.zeros(3)


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
    """How deep it would be pressed in by an arm that does not bend [m]; negative where
    only a bent one reaches it."""
    lag: FloatArray = _NO_LAG
    """See `Near.lag`."""

    def seen_from(self, R: FloatArray, p: FloatArray) -> Spring:
        """Return the same in the frame of a hand whose pose in odom is (R, p)."""
        return self._replace(point=(self.point - p) @ R, force=self.force @ R)


class Near(NamedTuple):
    """A place where a hand is in a body, or nearly so."""

    owner: int
    body: int
    point: FloatArray
    normal: FloatArray
    """Away from what is there, frame odom, shape (3,); shorter where sides differ."""
    depth: float
    """How deep it is in there, negative outside [m]."""
    lag: FloatArray = _NO_LAG
    """So far beyond that point it really is, frame odom [m], shape (3,): a hand feels
    a push go over to another place bit by bit."""

    def spring(self, stiffness: float) -> Spring:
        """How it pushes with so many N/m."""
        force = stiffness * self.depth * self.normal
        return Spring(*self[:3], force, self.depth)


@dataclass(slots=True, eq=False)
class Watch:
    """Points of the hand that are near one part of a body, or near the ground."""

    body: int
    part: slice | None
    rows: IntArray
    """Which points of the hand, shape (m,)."""
    owners: IntArray
    """Whose each of them is, shape (m,); parts of what is held from `HELD` down."""
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


def yielded(near: Sequence[Near], p: FloatArray, config: FakeConfig) -> list[Spring]:
    """Let an arm give way to all that pushes its hand, as much as its structure does.

    It is softer than any contact, and in series with all of them together: however
    many touch, the hand is pushed no more stiffly than the arm bends; and less so far
    beside the hand, for it turns. What only squeezes the hand from both sides does not
    bend the arm. What it is bent against pushes it too, though it would not reach it
    unbent.

    Parameters
    ----------
    p
        Where the hand is, frame odom [m], shape (3,).
    """
    if not any(place.depth > 0.0 for place in near):
        return []
    stiffness = config.contact_stiffness
    ways = np.array([place.normal for place in near])
    sizes = np.sqrt((ways * ways).sum(axis=1))
    ways /= sizes[:, None]
    turns = np.cross([place.point - p for place in near], ways)
    depths = np.array([place.depth for place in near])
    # Forces f >= 0 with f / k = depth - way . bend where f > 0, and their sum bends
    # the arm: the quadratic program min f'Qf / 2 - f'depth, as least squares.
    give = ways @ ways.T / config.arm_stiffness
    give += turns @ turns.T / config.turn_stiffness
    root = np.linalg.cholesky(stiffness * give + np.diag(1.0 / sizes))
    pressed, _ = nnls(root.T, np.linalg.solve(root, depths))
    return [
        Spring(*place[:3], force * way, place.depth, place.lag)
        for place, force, way in zip(
            near, (stiffness * pressed).tolist(), ways, strict=True
        )
        if force > 0.0
    ]
