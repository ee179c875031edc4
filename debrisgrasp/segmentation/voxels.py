"""Voxel grids over clouds: occupied cells, their means, and who touches whom."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray
from debrisgrasp.geometry import PointCloud

__all__ = ["Binning", "VoxelGrid", "cell_ids", "grid_axes", "voxelise"]

_DENSE_CELLS = 1 << 25
"""Largest table of all cells, occupied or not (128 MB); beyond it cells are sorted."""

_NORMAL_REACH = 5
"""Cells over which normals spread to cells without any."""

_HALF_NEIGHBOURHOOD = tuple(
    (i, j, k)
    for i in (-1, 0, 1)
    for j in (-1, 0, 1)
    for k in (-1, 0, 1)
    if (i, j, k) > (0, 0, 0)
)
"""One of each two opposite offsets to the 26 neighbours of a cell."""


class Binning(Enum):
    """Which coordinates the cells of a voxel grid divide evenly."""

    METRIC = "metric"
    """Cubes of one size everywhere."""
    SINGLE_CAMERA = "single_camera"
    """x/z, y/z and ln z along the line of sight: cells grow with the distance z, as the
    gaps between the samples of a depth camera do."""


@dataclass(frozen=True, slots=True, eq=False)
class VoxelGrid:
    """The occupied cells of a cloud, in an order that its points don't influence."""

    centers: FloatArray
    """Mean of the points of each cell [m], shape (v, 3)."""
    normals: FloatArray
    """Unit mean of their normals, shape (v, 3); NaN where none is known."""
    colors: FloatArray | None
    """Mean colour in [0, 1], shape (v, 3), if the points have any."""
    sizes: FloatArray
    """Edge length of each cell at its place [m], shape (v,)."""
    point_voxel: IntArray
    """Cell of each point, shape (n,)."""
    sources: IntArray
    """First voxel of each ordered pair of 26-neighbours, shape (p,)."""
    targets: IntArray
    """Second voxel of each pair, ascending, shape (p,); every pair occurs both ways."""

    def __len__(self) -> int:
        return len(self.centers)


def voxelise(
    cloud: PointCloud,
    resolution: float,
    binning: Binning = Binning.METRIC,
    colors: FloatArray | None = None,
) -> VoxelGrid:
    """Bin a cloud and find the 26-neighbours of every occupied cell.

    The grid is anchored at the viewpoint and turned towards the cloud (see
    `grid_axes`), so that moving scene and camera together leaves the cells as they are.

    Parameters
    ----------
    cloud
        At least one point, z up.
    resolution
        Edge length [m]; with `Binning.SINGLE_CAMERA` that of a cell at 1 m.
    colors
        One colour in [0, 1] per point, shape (n, 3).
    """
    axes = grid_axes(cloud, level=binning is Binning.METRIC)
    local = axes @ (cloud.points - cloud.viewpoint).T
    scale = np.ones(len(cloud))
    if binning is Binning.SINGLE_CAMERA:
        # Points beside or behind the sensor (a scanner sees all round) have no
        # perspective coordinates of their own; a floor on the depth keeps them finite.
        reach = np.sqrt(np.einsum("ij,ij->j", local, local))
        scale = np.maximum(np.maximum(local[0], 0.1 * reach), 1e-3)
        local[0] = np.log(scale)
        local[1:] /= scale
    local /= resolution
    point_voxel, cells = cell_ids(np.floor(local, out=local).astype(np.int64))
    n_voxels = cells.shape[1]
    counts = np.bincount(point_voxel, minlength=n_voxels)

    def mean(values: FloatArray) -> FloatArray:
        return np.bincount(point_voxel, weights=values, minlength=n_voxels) / counts

    centers = np.stack([mean(x) for x in cloud.points.T], axis=1)
    normals = np.stack([mean(x) for x in np.nan_to_num(cloud.normals.T)], axis=1)
    sources, targets = _neighbour_pairs(cells)
    return VoxelGrid(
        centers=centers,
        normals=_completed_normals(normals, sources, targets),
        colors=None
        if colors is None
        else np.stack([mean(colors[:, i]) for i in range(3)], axis=1),
        sizes=resolution * mean(scale),
        point_voxel=point_voxel,
        sources=sources,
        targets=targets,
    )


def grid_axes(cloud: PointCloud, *, level: bool) -> FloatArray:
    """Axes of a grid that turns with scene and camera, as rows, shape (3, 3).

    The first points from the viewpoint to the centroid of the cloud, in the horizontal
    if ``level``; the second lies in the horizontal; the third completes them upwards.
    """
    forward = cloud.points.mean(axis=0) - cloud.viewpoint
    horizontal = np.array([forward[0], forward[1], 0.0])
    reach = np.linalg.norm(horizontal)
    if reach < 1e-6:
        horizontal, reach = np.array([1.0, 0.0, 0.0]), np.float64(1.0)
    left = np.array([-horizontal[1], horizontal[0], 0.0]) / reach
    first = horizontal if level or not forward.any() else forward
    first = first / np.linalg.norm(first)
    return np.stack([first, left, np.cross(first, left)])


def cell_ids(keys: IntArray) -> tuple[IntArray, IntArray]:
    """Give the occupied cells numbers in the order of their coordinates.

    Parameters
    ----------
    keys
        Cell coordinates of each point, shape (3, n).

    Returns
    -------
    ids, cells
        Number of each point's cell, shape (n,), and the coordinates of the numbered
        cells, shape (3, v).
    """
    lower = keys.min(axis=1)
    shape = tuple(int(size) for size in keys.max(axis=1) - lower + 1)
    flat = _flattened(keys, lower, shape)
    if np.prod(shape, dtype=np.float64) <= _DENSE_CELLS:
        is_occupied = np.zeros(int(np.prod(shape)), dtype=bool)
        is_occupied[flat] = True
        occupied = np.flatnonzero(is_occupied)
        number = np.empty(len(is_occupied), dtype=np.int32)
        number[occupied] = np.arange(len(occupied), dtype=np.int32)
        ids: IntArray = number[flat]
    else:
        occupied, ids = np.unique(flat, return_inverse=True)
    return ids, np.stack(np.unravel_index(occupied, shape)) + lower[:, None]


def _flattened(keys: IntArray, lower: IntArray, shape: tuple[int, ...]) -> IntArray:
    flat: IntArray = (keys[0] - lower[0]) * shape[1] + (keys[1] - lower[1])
    flat *= shape[2]
    flat += keys[2] - lower[2]
    return flat


def _neighbour_pairs(cells: IntArray) -> tuple[IntArray, IntArray]:
    """Ordered pairs of cells that touch by face, edge or corner, by second cell."""
    # A rim of one cell keeps offsets from wrapping round to the other side.
    lower = cells.min(axis=1) - 1
    shape = tuple(int(size) for size in cells.max(axis=1) - lower + 2)
    flat = _flattened(cells, lower, shape)
    is_dense = np.prod(shape, dtype=np.float64) <= _DENSE_CELLS
    if is_dense:
        number = np.full(int(np.prod(shape)), -1, dtype=np.int32)
        number[flat] = np.arange(len(flat), dtype=np.int32)
    firsts, seconds = [], []
    for i, j, k in _HALF_NEIGHBOURHOOD:
        shifted = flat + ((i * shape[1] + j) * shape[2] + k)
        if is_dense:
            other = number[shifted]
            first = np.flatnonzero(other >= 0)
            second = other[first]
        else:
            place = np.minimum(np.searchsorted(flat, shifted), len(flat) - 1)
            first = np.flatnonzero(flat[place] == shifted)
            second = place[first]
        firsts.append(first.astype(np.int32))
        seconds.append(second.astype(np.int32))
    a, b = np.concatenate(firsts), np.concatenate(seconds)
    sources, targets = np.concatenate([a, b]), np.concatenate([b, a])
    order = np.argsort(targets, kind="stable")
    return sources[order], targets[order]


def _completed_normals(
    normals: FloatArray, sources: IntArray, targets: IntArray
) -> FloatArray:
    """Scale normals to unit length; cells without any ask their neighbours in turn."""
    length = np.linalg.norm(normals, axis=1)
    unknown = length < 1e-6
    normals[~unknown] /= length[~unknown, None]
    for _ in range(_NORMAL_REACH):
        asks = unknown[targets] & ~unknown[sources]
        if not asks.any():
            break
        for i in range(3):
            normals[:, i] += np.bincount(
                targets[asks], normals[sources[asks], i], len(normals)
            )
        length = np.linalg.norm(normals, axis=1)
        answered = unknown & (length > 1e-6)
        normals[answered] /= length[answered, None]
        unknown &= ~answered
    normals[unknown] = np.nan
    return normals
