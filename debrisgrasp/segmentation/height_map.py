"""A smooth map of how high the local ground lies over its plane."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.ndimage import (
    gaussian_filter,
    gaussian_filter1d,
    grey_dilation,
    grey_erosion,
    uniform_filter,
)

from debrisgrasp._arrays import FloatArray, IntArray

__all__ = ["DEEP", "HeightMap", "fitted_height_map", "raised_limits"]

DEEP = 0.10
"""Points farther below the ground than this [m] are not counted to it."""
_MAP_CELL = 0.08
"""Edge of a cell of the height map [m]."""
_MAP_SMOOTHING = 1.5
"""Width of the Gaussian over the height map, in cells."""
_MAX_SLOPE = 0.04
"""Steepest slope of the first guess of the ground, relative to its plane: steeper, and
it would climb wide boards. Hills that are steeper are won back later."""
_ENVELOPE_CELLS = 6
"""How far one cell of the height map limits others, in cells."""
_CORRELATED = 4.0
"""Points that share their noise: that of a stereo camera spans about two pixels."""
_MAX_RISES = (0.006, 0.006, 0.01, 0.01, 0.01, 0.011, 0.011)
"""Mean heights of a cell over the surface that make it a thing on the ground [m], fit
by fit: strict while the surface may cut through hills and boards alike, then wide
enough to win the hills back."""
_MAX_POINT_RISE = 0.01
"""The same for a single point without noise [m]."""
_MEAN_BAND = 0.03
"""Points as near to the surface as this count in the mean of their cell [m]: if those
alone did that are ground by themselves, boards in noise would seem lower."""
_MAX_MAP = 1e7
"""Largest height map, in cells; beyond it the plane alone has to do."""
_MAX_MATRIX = 400
"""Longest side of a map that is smoothed by matrices, in cells."""


@dataclass(frozen=True, slots=True, eq=False)
class HeightMap:
    """Height of the local ground over its plane, on a grid in x and y."""

    lower: FloatArray
    """Corner of the grid in cells, shape (2,)."""
    heights: FloatArray
    """Heights at the middles of the cells [m]."""
    noise: float
    """Standard deviation of height per distance from the viewpoint.

    Depth noise grows with the square of the range r; along a ray that falls to the
    ground from height H it moves a point by H / r of itself in height, so that the
    noise in height is proportional to r H."""

    @property
    def refinement(self) -> int:
        """How many cells of a raster fit along the edge of one of the map."""
        return 4 if self.heights.size < _MAX_MAP / 16 else 1

    @property
    def raster_shape(self) -> tuple[int, int]:
        """Rows and columns of a raster over the map."""
        rows, columns = self.heights.shape
        return rows * self.refinement, columns * self.refinement

    def raster_cells(self, points: FloatArray) -> IntArray:
        """Flat index of the raster cell under each of the points (n, 3), shape (n,).

        Places beyond the map take its border.
        """
        scale = self.refinement / _MAP_CELL
        lower = self.lower * self.refinement
        rows, columns = self.raster_shape
        # Tables are read several times faster with indices of the machine's width.
        cells: IntArray = np.zeros(len(points), dtype=np.intp)
        for i, size in enumerate((rows, columns)):
            place = points[:, i] * scale
            place -= lower[i]
            np.maximum(place, 0, out=place)
            np.minimum(place, size - 1, out=place)
            cells *= size
            cells += place.astype(np.intp)
        return cells

    def raster_middles(self) -> FloatArray:
        """x, y and height over the plane of the middles of raster cells [m], (3, c)."""
        index = np.indices(self.raster_shape).reshape(2, -1) + 0.5
        x, y = (index / self.refinement + self.lower[:, None]) * _MAP_CELL
        places = np.stack([x, y], axis=1)
        corners, weights = _bilinear(places, self.lower, self.heights.shape)
        return np.stack([x, y, _interpolated(self.heights, corners, weights)])


def fitted_height_map(
    points: FloatArray, over_plane: FloatArray, viewpoint: FloatArray
) -> HeightMap:
    """Fit a smooth surface to points (n, 3), most of which lie near the plane.

    Parameters
    ----------
    over_plane
        Height of each point over the fitted plane [m], shape (n,).
    """
    near = np.abs(over_plane) < DEEP
    points, over_plane = points[near], over_plane[near]
    # Sums along rows of three are slow, and NumPy keeps the order of what it is given.
    offset = np.subtract(points.T, viewpoint[:, None], order="C")
    reach = np.sqrt(np.square(offset).sum(axis=0))
    inside = np.abs(over_plane) < 0.5 * DEEP
    scaled = points[:, :2] / _MAP_CELL - 0.5
    lower = np.floor(scaled.min(axis=0)) - 1
    rows, columns = np.floor(scaled.max(axis=0)) - lower + 3
    if rows * columns > _MAX_MAP:
        return HeightMap(lower, np.zeros((2, 2)), _spread(over_plane, reach))
    shape = (int(rows), int(columns))
    corners, weights = _bilinear(points, lower, shape)
    surface = _lower_envelope(
        _cell_means(corners[0][inside], over_plane[inside], shape)
    )
    for max_rise in _MAX_RISES:
        local = over_plane - _interpolated(surface, corners, weights)
        # Things that lie on the ground would lift the surface, so the limits are tight;
        # means tell thin boards from ground where single points don't.
        noise = _spread(local[inside], reach[inside])
        limit = np.maximum(_MAX_POINT_RISE, 2.5 * noise * reach)
        away = np.abs(local)
        counts = away < np.maximum(_MEAN_BAND, limit)
        rise = _cell_means(corners[0][counts], local[counts], shape).ravel()
        inside = (away < limit) & ~(rise > max_rise)[corners[0]]
        if not inside.any():
            break
        surface = _smoothed(_cell_means(corners[0][inside], over_plane[inside], shape))
    return HeightMap(lower, surface, noise)


def raised_limits(
    count: FloatArray,
    total: FloatArray,
    deviation: FloatArray,
    clearance: float,
) -> FloatArray:
    """Height from which points belong to thin things that averages show [m].

    Parameters
    ----------
    count, total
        Points close to the ground in each cell, and the sum of their heights over it
        [m], shape (rows, columns).
    deviation
        Standard deviation of the height of a point there [m], same shape.
    clearance
        Least mean height of a thing [m].

    Returns
    -------
    FloatArray
        Same shape; infinite where no thing shows.
    """
    n_around = np.maximum(9.0 * uniform_filter(count, 3, mode="constant"), 1e-9)
    mean = 9.0 * uniform_filter(total, 3, mode="constant") / n_around
    error = deviation * np.sqrt(_CORRELATED / n_around)
    is_core = (n_around > 7.5) & (mean > np.maximum(clearance, 3.0 * error))
    is_core &= total > 0.8 * clearance * count
    # Rims of raised things share cells with the ground beside them.
    level = grey_dilation(np.where(is_core, mean, 0.0), size=(3, 3))
    limits = np.where(is_core, 0.3 * mean, np.maximum(0.6 * level, 2.0 * deviation))
    limits[level == 0.0] = np.inf
    return limits


def _spread(local: FloatArray, reach: FloatArray) -> float:
    """Robust standard deviation of height per distance."""
    return 1.4826 * float(np.median(np.abs(local) / reach))


def _bilinear(
    points: FloatArray, lower: FloatArray, shape: tuple[int, ...]
) -> tuple[list[IntArray], list[FloatArray]]:
    """Flat indices of the four cells around each place, and their weights.

    Places beyond the grid take its border.
    """
    x = np.clip(points[:, 0] / _MAP_CELL - (0.5 + lower[0]), 0, shape[0] - 1.001)
    y = np.clip(points[:, 1] / _MAP_CELL - (0.5 + lower[1]), 0, shape[1] - 1.001)
    row, column = x.astype(np.intp), y.astype(np.intp)
    fx, fy = x - row, y - column
    corner = row * shape[1] + column
    both = fx * fy
    corners = [corner, corner + 1, corner + shape[1], corner + (shape[1] + 1)]
    return corners, [1 - fx - fy + both, fy - both, fx - both, both]


def _interpolated(
    heights: FloatArray, corners: list[IntArray], weights: list[FloatArray]
) -> FloatArray:
    flat = heights.ravel()
    total = weights[0] * flat[corners[0]]
    for corner, weight in zip(corners[1:], weights[1:], strict=True):
        total += weight * flat[corner]
    return total


def _cell_means(
    flat: IntArray, heights: FloatArray, shape: tuple[int, int]
) -> FloatArray:
    """Mean height per cell of the map [m]; NaN where fewer than five points fell."""
    n_cells = shape[0] * shape[1]
    count = np.bincount(flat, minlength=n_cells)
    total = np.bincount(flat, weights=heights, minlength=n_cells)
    mean = np.where(count >= 5, total / np.maximum(count, 1), np.nan)
    return mean.reshape(shape)


def _lower_envelope(mean: FloatArray) -> FloatArray:
    """Highest surface under the means that is nowhere steeper than ground is."""
    reach = _MAX_SLOPE * _MAP_CELL * np.arange(-_ENVELOPE_CELLS, _ENVELOPE_CELLS + 1)
    cone = np.hypot(reach[:, None], reach)
    lowest = grey_erosion(
        np.nan_to_num(mean, nan=1.0), structure=-cone, mode="constant", cval=1.0
    )
    return _smoothed(np.where(lowest < 0.5, lowest, np.nan))


def _blurred(maps: FloatArray, width: float) -> FloatArray:
    """Gaussian smoothing of maps (k, rows, columns) with nothing around them."""
    if max(maps.shape) > _MAX_MATRIX:
        wide: FloatArray = gaussian_filter(maps, (0.0, width, width), mode="constant")
        return wide
    # Several times faster than the filter on maps of the usual size.
    rows, columns = (_gaussian(n, width) for n in maps.shape[1:])
    smooth: FloatArray = rows @ maps @ columns.T
    return smooth


@lru_cache(maxsize=32)
def _gaussian(n: int, width: float) -> FloatArray:
    """Matrix that smooths a line of n values, shape (n, n)."""
    kernels: FloatArray = gaussian_filter1d(np.eye(n), width, axis=0, mode="constant")
    kernels.flags.writeable = False
    return kernels


def _smoothed(mean: FloatArray) -> FloatArray:
    """Gaussian smoothing that fills gaps from afar; without any data the plane."""
    seen_and_mean = np.stack([np.isfinite(mean), np.nan_to_num(mean)])
    surface = np.zeros(mean.shape)
    missing = np.ones(mean.shape)
    for width in (_MAP_SMOOTHING, 3 * _MAP_SMOOTHING, 9 * _MAP_SMOOTHING):
        weight, value = _blurred(seen_and_mean, width)
        share = np.minimum(weight / 0.1, 1.0) * missing
        surface += share * value / np.maximum(weight, 1e-9)
        missing -= share
    return surface
