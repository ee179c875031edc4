"""What is known to be free: where the camera looked through, and where a hand was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import minimum_filter

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray
from debrisgrasp.geometry import Bounds, DepthSight

__all__ = ["KnownSpace"]

_CLEAR = 0.03
"""A point so far in front of what was measured behind it was seen to be free [m]."""
_AROUND = 15
"""Side of the patch of pixels that says what a pixel without depth may show."""
_CELL = 0.05
"""Where a part of a hand has been, so much around is free [m]."""
_BESIDE = 0.15
"""With so much room a robot drives past things [m]."""
_NEW_SHARE, _NEW_LEAST = 0.1, 50
"""Fewer measurements in free space are errors of a camera."""
_HALF = 1 << 20
"""Cells on each side of the origin, more than any arm reaches."""
_MOST = 20
"""Looks that are remembered, the latest."""


class KnownSpace:
    """Space that was seen to be free, or was passed by a hand, base frame.

    It holds as long as the base stands; then a new one is begun. What was put down
    since, or fell, is known otherwise.
    """

    def __init__(self) -> None:
        self._sights: list[DepthSight] = []
        self._stirred: list[tuple[Bounds, DepthSight]] = []
        """Where things moved, and the last look before that."""
        self._cells = np.zeros(0, dtype=np.int64)
        self._behind: Bounds | None = None

    @property
    def is_new(self) -> bool:
        """Whether nobody has looked around since the base moved."""
        return self._behind is None

    def stands(self, boxes: Sequence[Bounds]) -> None:
        """Take note of how large the robot is: what is behind it, it came through.

        Behind is what lies behind the origin of its base.
        """
        low = np.min([box.lower for box in boxes], axis=0) - _BESIDE
        high = np.max([box.upper for box in boxes], axis=0) + _BESIDE
        low[0], high[0] = low[0] - 1.0, max(low[0], 0.0)
        self._behind = Bounds(low, high)

    def saw(self, sight: DepthSight) -> None:
        """Take note of a look.

        Where nothing came back there is nothing nearer than around it: that is the sky,
        or an edge that only one of two eyes has seen.
        """
        depth = np.where(sight.depth > 0.0, sight.depth, np.inf)
        around = minimum_filter(depth, size=_AROUND)
        filled = np.where(np.isfinite(depth), depth, around).astype(np.float32)
        self._sights = [*self._sights[1 - _MOST :], replace(sight, depth=filled)]

    def passed(self, points: FloatArray) -> None:
        """Take note of where parts of a hand were without touching, (..., 3) [m]."""
        self._cells = np.union1d(self._cells, _cells(points))

    def stirred(self, box: Bounds) -> None:
        """Take note that things moved in a box: there only later looks count."""
        self._cells = self._cells[~box.contains(_middles(self._cells))]
        if self._sights:
            self._stirred = [*self._stirred[1 - _MOST :], (box, self._sights[-1])]

    def is_contradicted(self, points: FloatArray) -> bool:
        """Whether so many points (n, 3) [m] of surfaces lie in what was free.

        Then the world has changed, and what else was known of it may be wrong, too.
        """
        n = int(np.count_nonzero(self.is_free(points)))
        return n > max(_NEW_SHARE * len(points), _NEW_LEAST)

    def is_free(self, points: FloatArray) -> BoolArray:
        """Which points (..., 3) [m] are known to be free, shape (...)."""
        flat = points.reshape(-1, 3)
        free: BoolArray = np.isin(_cells(flat), self._cells)
        if self._behind is not None:
            free |= self._behind.contains(flat)
        doubtful = np.zeros(len(flat), dtype=bool)
        for sight in reversed(self._sights):
            for box, last in self._stirred:
                if last is sight:
                    doubtful |= box.contains(flat)
            rows = np.flatnonzero(~free & ~doubtful)
            if not len(rows):
                break
            ahead = sight.clearance(*flat[rows].T.astype(np.float32))
            free[rows] = ahead > _CLEAR  # NaN, nothing measured, is not
        return free.reshape(points.shape[:-1])


def _cells(points: FloatArray) -> IntArray:
    """One number for the cell of each point (..., 3), shape (n,)."""
    at = np.floor(points.reshape(-1, 3) / _CELL).astype(np.int64) + _HALF
    return np.asarray((at[:, 0] << 42) | (at[:, 1] << 21) | at[:, 2])


def _middles(cells: IntArray) -> FloatArray:
    """Middle of each cell [m], shape (n, 3)."""
    low = (1 << 21) - 1
    at = np.stack([cells >> 42, cells >> 21 & low, cells & low], axis=-1)
    middles: FloatArray = (at - _HALF + 0.5) * _CELL
    return middles
