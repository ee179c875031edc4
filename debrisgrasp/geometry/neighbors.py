"""Voxel cells of a cloud: which points share one, and which point stands for it."""

from __future__ import annotations

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray, require_finite, require_trailing
from debrisgrasp.errors import InputError

__all__ = ["cell_means", "voxel_cells", "voxel_downsample"]

_KEY_BITS = 21
"""Three coordinates of this many bits fit into one int64 key."""


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
    """
    require_trailing(points, "points", (3,))
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
    cell_index, n_cells = voxel_cells(points, size)
    offset = points - cell_means(points, cell_index, n_cells)[cell_index]
    distance_squared = np.einsum("ni,ni->n", offset, offset)
    nearest_first = np.lexsort((distance_squared, cell_index))
    sorted_cells = cell_index[nearest_first]
    is_first = np.diff(sorted_cells, prepend=-1) > 0
    return np.sort(nearest_first[is_first])
