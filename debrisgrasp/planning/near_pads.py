"""What was seen of an object between open fingers, for many poses at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from debrisgrasp._arrays import BoolArray, Float32Array, FloatArray, IntArray, bounded

__all__ = ["ROOM_ERROR", "SAME", "SIDES", "NearPads"]

_LEAST_CURVED = 6
"""Fewer points between the fingers don't tell where the hidden side is."""
_FLAT = 0.01
"""Variance of the normals along the closing axis that comes from noise alone."""
_CURVED = 0.04
"""Variance of the normals along the closing axis of what shows more than one face."""
_EVEN = 0.001
"""Variance of the normals along the palm's axis that comes from noise alone."""
_LEAST_FACE = 0.02**2 / 12
"""Variance of the heights of what goes down by 2 cm: less may be a rounded edge."""
_LEAST_RADIUS = 0.005
"""What curves more sharply than this is an edge [m]."""
_STRIPS = 4
"""The outline of what was seen is told by the farthest point in each of so many strips
across the fingers."""
SIDES = (-1.0, 1.0)
"""Of the closing axis: the thumb's, and the pair's."""
SAME = 0.01
"""Points whose places along the closing axis differ by less are equally far out [m]."""
_BLUR = 0.004
"""By so much the farthest of noisy points lie outside of what they are of [m]."""
ROOM_ERROR = 0.008
"""Standard deviation of where a hidden side is expected [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class NearPads:
    """Points between the open fingers of some poses, m pairs of both."""

    pose: IntArray
    """Index of the pose, ascending, shape (m,)."""
    point: IntArray
    """Index of the point, shape (m,)."""
    x: Float32Array
    """Along the closing axis [m], palm frame, shape (m,)."""
    y: Float32Array
    """Across the fingers, from the edge of the zone of the pads [m], shape (m,)."""
    z: Float32Array
    """Along the palm's axis [m], shape (m,)."""
    along: Float32Array
    """Cosine of the normal to the closing axis, shape (m,)."""
    facing: Float32Array
    """Cosine between the normal and the way back to the palm, shape (m,)."""
    n_poses: int
    _begin: IntArray = field(init=False)
    """Where the points of each pose begin, and the last of them end, (k + 1,)."""

    def __post_init__(self) -> None:
        begin = np.searchsorted(self.pose, np.arange(self.n_poses + 1))
        object.__setattr__(self, "_begin", begin)

    def picked(self, which: BoolArray) -> NearPads:
        """Pick some of the pairs (m,)."""
        return replace(
            self,
            pose=self.pose[which],
            point=self.point[which],
            x=self.x[which],
            y=self.y[which],
            z=self.z[which],
            along=self.along[which],
            facing=self.facing[which],
        )

    @property
    def n_each(self) -> IntArray:
        """How many points each pose has, shape (k,)."""
        return np.diff(self._begin)

    def count(self, which: BoolArray) -> IntArray:
        """How many of some points (m,) each pose has, shape (k,)."""
        return np.asarray(self._each(np.add, which, 0, np.int64))

    def greatest(self, values: Float32Array, initial: float) -> Float32Array:
        """Greatest of the values (m,) of each pose, and ``initial``, shape (k,)."""
        found = self._each(np.maximum, values, initial, np.float32)
        return np.asarray(np.maximum(found, np.float32(initial)))

    def _each(
        self, ufunc: np.ufunc, values: NDArray[Any], none: float, dtype: type
    ) -> NDArray[Any]:
        """Reduce the values (m,) of each pose; ``none`` where it has none, shape (k,).

        Several times as fast as `bincount` and ``ufunc.at``, for poses ascend.
        """
        begin = self._begin
        # One more, for a pose without points may begin past the last.
        padded: NDArray[Any] = np.append(values.astype(dtype), np.asarray(none, dtype))
        found = ufunc.reduceat(padded, begin[:-1])
        found[begin[:-1] == begin[1:]] = none
        return np.asarray(found)

    def straightened(self, slope: FloatArray, width: Float32Array) -> NearPads:
        """Shift the points along the closing axis so that what lies askew does not.

        Parameters
        ----------
        slope
            Of x over y, shape (k,).
        width
            Of the zone of the pads [m], shape (k,), in whose middle nothing moves.
        """
        off = self.y - (0.5 * width).take(self.pose)
        return replace(self, x=self.x - slope.astype(np.float32)[self.pose] * off)

    def slope(
        self, out: Float32Array, is_behind: BoolArray, width: Float32Array
    ) -> FloatArray:
        """Slope over y of the outline of what was seen between the fingers, (k,).

        Where that is a corner, hidden sides below it lean as much. Zero where the
        outline itself is hidden.

        Parameters
        ----------
        out
            How far out each point is on that side [m], shape (m,).
        is_behind
            Which points may go on behind something nearer, shape (m,).
        width
            Of the zone of the pads [m], shape (k,).
        """
        step = width / np.float32(_STRIPS)
        strip = (self.y / step.take(self.pose)).astype(np.int64)
        strip = bounded(strip, 0, _STRIPS - 1)
        cell = self.pose * _STRIPS + strip
        farthest = np.full(self.n_poses * _STRIPS, -np.inf, dtype=np.float32)
        np.maximum.at(farthest, cell, out)
        is_last = is_behind & (out > (farthest - np.float32(SAME)).take(cell))
        farthest[cell[is_last]] = -np.inf
        outline = farthest.reshape(-1, _STRIPS)
        is_known = np.isfinite(outline)
        n = np.maximum(is_known.sum(axis=1, keepdims=True), 1)
        place = np.where(is_known, np.arange(_STRIPS), 0.0)
        place = np.where(is_known, place - place.sum(axis=1, keepdims=True) / n, 0.0)
        slope = (place * np.where(is_known, outline, 0.0)).sum(axis=1) / step
        slope /= np.maximum((place * place).sum(axis=1), 1.0)
        return np.where(n[:, 0] > 2, slope, 0.0)

    def _mean(self, values: Float32Array, n: IntArray) -> FloatArray:
        sums: FloatArray = self._each(np.add, values, 0.0, np.float64)
        return sums / n

    def face(self, step: float, least: int) -> tuple[NearPads, Float32Array]:
        """Leave out strays; and how far from the palm a face goes on [m], shape (k,).

        Single points between an edge and what lies behind it belong to neither. Where
        there are too few to tell, all of them count.

        Parameters
        ----------
        step
            Of the levels along the palm's axis [m]; the face ends where one is empty.
        least
            So many points of a level are no strays.
        """
        level = np.maximum(self.z / np.float32(step), 0.0).astype(np.intp)
        n = int(level.max(initial=0)) + 1
        counts = np.bincount(self.pose * n + level, minlength=self.n_poses * n)
        is_some = counts.reshape(self.n_poses, n) >= least
        begun = np.maximum.accumulate(is_some, axis=1)
        ended = np.maximum.accumulate(begun & ~is_some, axis=1)
        ended[~begun[:, -1]] = False
        is_beyond = ended[self.pose, level]
        depth = self.greatest(np.where(is_beyond, 0.0, self.z), 0.0)
        return self.picked(~is_beyond | is_some[self.pose, level]), depth

    def bulge(self, most: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Height over the palm and radius of what is round [m], (k,) each.

        Least squares of z = middle - radius * facing; of a box the middle is that of
        its sides. Last, whether it is round, shape (k,).

        Parameters
        ----------
        most
            That the radius can be [m], shape (k,). Normals of what is thin are smoothed
            over its sides, so that it seems flatter than it is.
        """
        count = self.n_each
        n = np.maximum(count, 1)
        mean_z, mean_facing = self._mean(self.z, n), self._mean(self.facing, n)
        covariance = mean_z * mean_facing - self._mean(self.z * self.facing, n)
        variance = self._mean(self.facing * self.facing, n) - mean_facing**2
        radius = np.maximum(covariance / (variance + _EVEN), _LEAST_RADIUS)
        radius = np.minimum(radius, np.maximum(most, _LEAST_RADIUS))
        is_round = (count >= _LEAST_CURVED) & (radius > _LEAST_RADIUS)
        return mean_z + radius * mean_facing, radius, is_round

    def turned_below(
        self, cosine: Float32Array, is_face: BoolArray, height: Float32Array
    ) -> FloatArray:
        """Cosine that a face has at a height that it was not seen at, shape (k,).

        Flat faces go on as they are, and those of round things grow steeper. NaN where
        too little was seen to tell.

        Parameters
        ----------
        cosine
            Of each point's normal to the way outwards, shape (m,).
        is_face
            Which points are of the face, shape (m,).
        height
            Over the palm [m], shape (k,).
        """
        face = self.picked(is_face)
        cosine, count = cosine[is_face], face.n_each
        n = np.maximum(count, 1)
        mean_z, mean = face._mean(face.z, n), face._mean(cosine, n)
        spread = face._mean(face.z * face.z, n) - mean_z**2
        steepens = face._mean(face.z * cosine, n) - mean_z * mean
        steepens /= np.maximum(spread, _LEAST_FACE)
        known = (count >= _LEAST_CURVED) & (spread > _LEAST_FACE)
        found = bounded(mean + steepens * (height - mean_z), 0.0, 1.0)
        return np.where(known, found, np.nan)

    def curve(self) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Middle and half width [m] that the points have, NaN if unknown, (k,) each.

        Least squares of x = middle + half width * normal. Last, whether the normals
        turn so much that this tells the side that nothing was seen of, shape (k,).
        """
        count = self.n_each
        n = np.maximum(count, 1)
        mean_x, mean_along = self._mean(self.x, n), self._mean(self.along, n)
        covariance = self._mean(self.x * self.along, n) - mean_x * mean_along
        variance = self._mean(self.along * self.along, n) - mean_along**2
        radius = np.maximum(covariance, 0.0) / (variance + _FLAT)
        radius = np.where(count >= _LEAST_CURVED, radius, np.nan)
        turns = (count >= _LEAST_CURVED) & (variance > _CURVED)
        return mean_x - radius * mean_along, radius, turns

    def extents(
        self,
        slopes: Sequence[FloatArray],
        is_seen: Sequence[BoolArray],
        is_open: Sequence[BoolArray],
        width: Float32Array,
        sight: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """How far to both sides of the middle what was seen goes [m], (2, k) each.

        As expected, infinite where nothing tells; and the outline that was seen. What
        lies askew, so that both outlines lean the same way, is no thicker for that.
        Normals of what is thin are smoothed over its sides, and its curve seems wider
        than it is. But where both outlines stand out against what lies farther, of what
        is round at most one half is hidden, seen from the side.

        Parameters
        ----------
        slopes
            Of the outline of each side, outwards, shape (k,) each.
        is_seen
            Whether the face of each side was seen, shape (k,) each.
        is_open
            Whether it may go on out of sight, shape (k,) each.
        width
            Of the zone of the pads [m], shape (k,).
        sight
            From the camera to the hand, palm frame [m], shape (k, 3).
        """
        low, high = -slopes[0], slopes[1]
        askew = np.where(low * high > 0.0, np.minimum(np.abs(low), np.abs(high)), 0.0)
        straight = self.straightened(np.copysign(askew, high), width)
        middle, radius, _ = straight.curve()
        outline, expected = np.empty((2, 2, self.n_poses))
        for k, side in enumerate(SIDES):
            outline[k] = straight.greatest(np.float32(side) * straight.x, -1.0)
            hidden = np.fmax(outline[k], side * middle + radius)
            expected[k] = np.where(is_seen[k], outline[k], hidden)
        seen = np.maximum(outline.sum(axis=0) - 2.0 * _BLUR, 0.0)
        across, along = np.abs(sight[:, ::2]).T
        most = 2.0 * seen / (1.0 + along / np.maximum(np.hypot(across, along), 1e-9))
        is_hidden, ends = ~np.stack(is_seen), ~np.stack(is_open)
        over = np.where(ends.all(axis=0), expected.sum(axis=0) - most, 0.0)
        shared = is_hidden | ~is_hidden.any(axis=0)
        expected -= np.maximum(over, 0.0) * shared / shared.sum(axis=0)
        expected[~ends & is_hidden] = np.inf
        return expected, outline - _BLUR
