"""Which points of a cloud share a place or a voxel, and which one stands for it."""

from __future__ import annotations

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray, as_rows, require_finite
from debrisgrasp.errors import InputError

__all__ = ["by_place", "cell_means", "voxel_cells", "voxel_count", "voxel_downsample"]

_KEY_BITS = 21
"""Three coordinates of this many bits fit into one int64 key."""
_MAX_TABLE = 30_000_000
"""A table of more cells than this takes longer to set up than sorting does."""


def by_place(points: FloatArray) -> tuple[IntArray, IntArray]:
    """Order points by their coordinates, and find those that repeat another.

    Parameters
    ----------
    points
        Positions [m], shape (n, 3), finite.

    Returns
    -------
    order, first
        Indices of the points by x, then y, then z, those in one place ascending, shape
        (n,); and the first point in the place of each, itself if it repeats none, (n,).
    """
    points = as_rows(points)
    x, y, z = points.T
    order = np.argsort(x)
    is_same = np.diff(x[order]) == 0.0
    tied = np.zeros(len(points), dtype=bool)
    tied[1:] |= is_same
    tied[:-1] |= is_same
    ties = np.sort(order[tied])
    order[tied] = ties = ties[np.lexsort((z[ties], y[ties], x[ties]))]
    is_first = (np.diff(points[ties], axis=0, prepend=np.nan) != 0.0).any(axis=1)
    first = np.arange(len(points))
    first[ties] = ties[is_first][np.cumsum(is_first) - 1]
    return order, first


def voxel_cells(points: FloatArray, size: float) -> tuple[IntArray, int]:
    """Enumerate the occupied cells of a grid whose cell edges are ``size`` long.

    The grid is fixed in space: a cell begins at each multiple of ``size``.

    Parameters
    ----------
    points
        Positions [m], shape (n, 3), finite.
    size
        Edge length [m].

    Returns
    -------
    cell_index, n_cells
        Cell of each point, shape (n,), in 0..n_cells-1, and how many there are.

    Raises
    ------
    InputError
        If the size is none, or too small for the extent of the points.
    """
    points = as_rows(points)
    require_finite(points, "points")
    if not size > 0:
        raise InputError("voxel size", got=size, expected="a length > 0 [m]")
    if not len(points):
        return np.empty(0, dtype=np.int64), 0
    low = np.floor(points.min(axis=0) / size)
    extent = np.floor(points.max(axis=0) / size) - low
    if extent.max() >= 2**_KEY_BITS:
        raise InputError(
            "voxel size",
            got=f"{size:g} m for a cloud {extent.max() * size:g} m long",
            expected=f"at most {2**_KEY_BITS} cells along each axis",
            mend="Take larger voxels, or crop the cloud.",
        )
    keys = np.zeros(len(points), dtype=np.int64)
    for axis in range(3):
        keys <<= _KEY_BITS
        keys |= (np.floor(points[:, axis] / size) - low[axis]).astype(np.int64)
    occupied, cell_index = np.unique(keys, return_inverse=True)
    return cell_index, len(occupied)


def cell_means(points: FloatArray, cell_index: IntArray, n_cells: int) -> FloatArray:
    """Mean of the points in each cell [m], shape (n_cells, 3)."""
    counts = np.bincount(cell_index, minlength=n_cells)
    sums = [np.bincount(cell_index, points[:, axis], n_cells) for axis in range(3)]
    means: FloatArray = np.stack(sums, axis=-1) / counts[:, None]
    return means


def voxel_downsample(points: FloatArray, size: float) -> IntArray:
    """Thin a cloud to one measured point per occupied voxel.

    Parameters
    ----------
    points
        Positions [m], shape (n, 3), finite.
    size
        Edge length of the voxels [m].

    Returns
    -------
    IntArray
        Ascending indices of the points nearest to the means of their cells, one for
        each occupied cell.
    """
    points = as_rows(points)
    columns = np.array(points.T, order="C")
    cell_index, n_cells = _any_cells(points, columns, size)
    counts = np.bincount(cell_index, minlength=n_cells)
    distance_squared = np.zeros(len(points))
    for column in columns:
        mean = np.bincount(cell_index, column, n_cells) / counts
        distance_squared += np.square(column - mean[cell_index])
    least = np.full(n_cells, np.inf)
    np.minimum.at(least, cell_index, distance_squared)
    nearest = np.flatnonzero(distance_squared <= least[cell_index])
    # Of equally near points the first stays: the assignment runs backwards.
    kept = np.empty(n_cells, dtype=np.int64)
    kept[cell_index[nearest[::-1]]] = nearest[::-1]
    is_kept = np.zeros(len(points), dtype=bool)
    is_kept[kept] = True
    return np.flatnonzero(is_kept)


def voxel_count(points: FloatArray, size: float) -> int:
    """How many voxels with edges ``size`` [m] the points (n, 3) occupy."""
    points = as_rows(points)
    return _any_cells(points, points.T, size)[1]


def _any_cells(
    points: FloatArray, columns: FloatArray, size: float
) -> tuple[IntArray, int]:
    """Like `voxel_cells`, but in any order, which spares the sorting."""
    if not size > 0 or not len(points):
        return voxel_cells(points, size)
    cells = np.floor(columns / size)
    low = cells.min(axis=1)
    shape = cells.max(axis=1) - low + 1
    # NaN fails the comparison too, and is refused there.
    if not np.prod(shape) <= _MAX_TABLE:
        return voxel_cells(points, size)
    # Whole numbers below 2^53 are exact as floats.
    (x, y, z), (x0, y0, z0), (_, ny, nz) = cells, low, shape
    keys = (((x - x0) * ny + (y - y0)) * nz + (z - z0)).astype(np.int64)
    # Each cell is named by one of its points; only cells that hold one are touched.
    owner = np.empty(int(np.prod(shape)), dtype=np.int32)
    everyone = np.arange(len(points), dtype=np.int32)
    owner[keys] = everyone
    name = owner[keys]
    is_owner = name == everyone
    return (np.cumsum(is_owner) - 1)[name], int(np.count_nonzero(is_owner))
