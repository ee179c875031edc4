"""What is felt at a hand, and what is watched so as to feel it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray

__all__ = ["GROUND", "HELD", "PALM", "Guard", "Spring", "Watch", "blended"]

GROUND = -1
"""Stands for a body where the ground is touched."""
PALM = 0
"""Owner of the points of the palm; fingers follow from 1."""
HELD = -1
"""Owner of the points of what the hand holds."""
_EDGE = 3e-4
"""So near to an edge both of its sides push: nothing jumps on the way around it [m]."""


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


@dataclass(slots=True, eq=False)
class Guard:
    """Points of a body that are near a solid of the palm or of what is held."""

    owner: int
    body: int
    rows: IntArray
    normals: FloatArray
    offsets: FloatArray


def blended(normals: FloatArray, beyond: FloatArray) -> FloatArray:
    """Direction in which a body pushes a point out, smooth around its edges.

    Parameters
    ----------
    normals, beyond
        Of the sides, shapes (s, 3) and (s,) [m], negative inside.
    """
    nearest = int(beyond.argmax())
    mean = np.exp((beyond - beyond[nearest]) / _EDGE) @ normals
    size = float(np.linalg.norm(mean))
    return np.asarray(mean / size if size > 0.5 else normals[nearest])
