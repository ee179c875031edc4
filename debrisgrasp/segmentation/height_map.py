"""A smooth map of how high the local ground lies over its plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter, grey_erosion

from debrisgrasp._arrays import FloatArray, IntArray

__all__ = ["DEEP", "HeightMap", "fitted_height_map"]

DEEP = 0.10
"""Points farther below the ground than this [m] are not counted to it."""
_MAP_CELL = 0.08
"""Edge of a cell of the height map [m]."""
_MAP_SMOOTHING = 1.5
"""Width of the Gaussian over the height map, in cells."""
_MAX_SLOPE = 0.07
"""Steepest slope of the ground relative to its plane."""
_ENVELOPE_CELLS = 6
"""How far one cell of the height map limits others, in cells."""
_MAX_MAP = 1e7
"""Largest height map, in cells; beyond it the plane alone has to do."""


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

    def at(self, points: FloatArray) -> FloatArray:
        """Height of the ground over its plane under points (n, 3) [m], shape (n,)."""
        corners, weights = _bilinear(points, self.lower, self.heights.shape)
        return _interpolated(self.heights, corners, weights)


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
    reach = np.linalg.norm(points - viewpoint, axis=1)
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
    for _ in range(3):
        local = over_plane - _interpolated(surface, corners, weights)
        # Things that lie on the ground would lift the surface, so the limit is tight.
        noise = _spread(local[inside], reach[inside])
        inside = np.abs(local) < np.maximum(0.01, 2.5 * noise * reach)
        if not inside.any():
            break
        surface = _smoothed(_cell_means(corners[0][inside], over_plane[inside], shape))
    return HeightMap(lower, surface, noise)


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
    row, column = x.astype(np.int32), y.astype(np.int32)
    fx, fy = x - row, y - column
    corner = row * np.int32(shape[1]) + column
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


def _smoothed(mean: FloatArray) -> FloatArray:
    """Gaussian smoothing that fills gaps from afar; without any data the plane."""
    seen = np.isfinite(mean).astype(np.float64)
    filled = np.nan_to_num(mean)
    surface = np.zeros(mean.shape)
    missing = np.ones(mean.shape)
    for width in (_MAP_SMOOTHING, 3 * _MAP_SMOOTHING, 9 * _MAP_SMOOTHING):
        weight = gaussian_filter(seen, width, mode="constant")
        value = gaussian_filter(filled, width, mode="constant")
        share = np.minimum(weight / 0.1, 1.0) * missing
        surface += share * value / np.maximum(weight, 1e-9)
        missing -= share
    return surface
