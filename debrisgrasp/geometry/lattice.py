"""Points at every combination of places along three axes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import FloatArray

__all__ = ["lattice"]


def lattice(x: ArrayLike, y: ArrayLike, z: ArrayLike) -> FloatArray:
    """Points of a grid, given its places along each axis, shape (nx, ny, nz, 3)."""
    lines = [np.asarray(line, dtype=np.float64) for line in (x, y, z)]
    points = np.empty((*map(len, lines), 3))
    for axis, line in enumerate(np.ix_(*lines)):
        points[..., axis] = line
    return points
