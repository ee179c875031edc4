"""Surface normals of a cloud without pixel order, by planes through neighbours."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from debrisgrasp._arrays import (
    FloatArray,
    as_floats,
    as_rows,
    require_finite,
    require_range,
)

from .neighbors import by_place, cell_means, voxel_cells

__all__ = ["neighborhood_normals"]

_NEIGHBORS_AT_ONCE = 300_000
"""Neighbours gathered at once, about 15 MB of them and of their differences."""


def neighborhood_normals(
    points: FloatArray,
    viewpoint: ArrayLike,
    *,
    n_neighbors: int = 24,
    max_support: int = 200_000,
    flatness: float = 0.5,
) -> FloatArray:
    """Estimate unit normals of an unorganised cloud, towards the viewpoint.

    Points in one place count once, and share a normal: merged scans repeat many.

    A cloud with many more points than ``max_support`` is first averaged in voxels; its
    points then share the normal of their voxel, so that time and memory stay bounded.

    Parameters
    ----------
    points
        Positions [m], shape (n, 3), finite.
    viewpoint
        Position of the sensor [m], shape (3,).
    n_neighbors
        Points whose plane is fitted, the point itself included; four times as many
        where these form no surface. More neighbours average over more noise and round
        edges more.
    max_support
        About how many neighbourhoods are fitted at most.
    flatness
        Largest ratio of the smallest to the middle variance of a neighbourhood that
        still counts as a surface, in (0, 1].

    Returns
    -------
    FloatArray
        Normals, shape (n, 3); NaN where the neighbours form a line or a ball.

    Raises
    ------
    InputError
        If points or viewpoint are of another shape or not finite, or a setting is none.
    """
    points = as_rows(points)
    require_finite(points, "points")
    sight = as_floats(viewpoint, "viewpoint", (3,))
    require_finite(sight, "viewpoint")
    require_range("n_neighbors", n_neighbors, 3)
    require_range("max_support", max_support, 1)
    require_range("flatness", flatness, 1e-6, 1.0)
    first = by_place(points)[1]
    index = np.flatnonzero(first == np.arange(len(points)))
    places = points.take(index, axis=0)
    normals = np.empty_like(points)
    normals[index] = _place_normals(places, sight, n_neighbors, max_support, flatness)
    return normals.take(first, axis=0)


def _place_normals(
    points: FloatArray,
    viewpoint: FloatArray,
    n_neighbors: int,
    max_support: int,
    flatness: float,
) -> FloatArray:
    """Estimate normals where no point repeats another; see `neighborhood_normals`."""
    if len(points) <= 1.5 * max_support:
        return _fitted_normals(points, viewpoint, n_neighbors, flatness)
    size = _voxel_size(points, max_support)
    cell_index, n_cells = voxel_cells(points, size)
    means = cell_means(points, cell_index, n_cells)
    return _fitted_normals(means, viewpoint, n_neighbors, flatness)[cell_index]


def _voxel_size(points: FloatArray, n_cells: int) -> float:
    """Voxel edge [m] at which a cloud occupies about ``n_cells`` voxels.

    Surfaces occupy voxels as the inverse square of their edge; two corrections on that
    rule are enough, since the count need not be met.
    """
    size = float(np.ptp(points, axis=0).max() / np.sqrt(n_cells))
    for _ in range(2):
        _, n_occupied = voxel_cells(points, size)
        size *= float(np.clip(np.sqrt(n_occupied / n_cells), 0.1, 10.0))
    return size


def _fitted_normals(
    points: FloatArray, viewpoint: FloatArray, n_neighbors: int, flatness: float
) -> FloatArray:
    normals = np.full(points.shape, np.nan)
    tree, columns = cKDTree(points), np.array(points.T, order="C")
    # Where points lie closer than their noise, only a wider look shows the surface.
    for wanted in (n_neighbors, 4 * n_neighbors):
        count = min(wanted, len(points))
        if count < 3:
            break
        pending = np.flatnonzero(np.isnan(normals[:, 0]))
        chunk = _NEIGHBORS_AT_ONCE // count
        for start in range(0, len(pending), chunk):
            part = pending[start : start + chunk]
            _, neighbors = tree.query(points[part], k=count, workers=-1)
            normals[part] = _plane_normals(
                columns.take(np.transpose(neighbors), axis=1), flatness
            )
    away = np.einsum("ni,ni->n", normals, viewpoint - points) < 0.0
    normals[away] *= -1.0
    return normals


def _plane_normals(neighborhoods: FloatArray, flatness: float) -> FloatArray:
    """Direction of least variance of k points around each of m, shape (m, 3).

    The neighbourhoods have the shape (3, k, m): sums run along the longest axis.
    """
    centered = neighborhoods - neighborhoods.mean(axis=1, keepdims=True)
    scatter = np.einsum("ikm,jkm->mij", centered, centered)
    variances, axes = np.linalg.eigh(scatter)
    small, middle, large = variances.T
    is_surface = (small <= flatness * middle) & (middle > 1e-6 * large)
    return np.where(is_surface[:, None], axes[:, :, 0], np.nan)
