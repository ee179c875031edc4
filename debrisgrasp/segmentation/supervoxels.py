"""Voxel Cloud Connectivity Segmentation: patches of similar position and orientation.

Papon et al., "Voxel Cloud Connectivity Segmentation - Supervoxels for Point Clouds",
CVPR 2013. The distance is the plain weighted sum that the point cloud library uses,
not the root of squares of the paper. Patches grow all at once (each voxel takes the
best offer of a sweep) rather than one after the other, so that the result depends on
no order, and every voxel ends up in a patch.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import PointCloud

from .patch_growth import grown
from .supervoxel_config import COARSEST, SupervoxelConfig
from .voxels import (
    VoxelGrid,
    binned,
    cell_ids,
    fitted_normals,
    grid_axes,
    voxelise,
)

__all__ = ["Patches", "supervoxels"]

_COARSER = 2**0.5
"""By how much voxels and patches are enlarged at once."""
_MAX_COARSENINGS = 8
"""Enlargements by the root of 2 at most: single points stay single at any size."""
_MAX_SHORT = 46_000
"""Pairs of fewer patches can be numbered in 32 bits, which sort faster."""


@dataclass(frozen=True, slots=True, eq=False)
class Patches:
    """Supervoxels of a voxel grid and the graph of those that touch."""

    grid: VoxelGrid
    owner: IntArray
    """Patch of each voxel, shape (v,)."""
    centers: FloatArray
    """Mean of the voxels of each patch [m], shape (p, 3)."""
    normals: FloatArray
    """Unit mean normal of each patch, shape (p, 3); NaN where none is known."""
    edges: IntArray
    """Pairs (a, b) with a < b of touching patches, ascending, shape (e, 2)."""
    contacts: IntArray
    """How many pairs of voxels touch across each edge, shape (e,)."""
    config: SupervoxelConfig
    """The settings that were used, after enlargement of the voxels."""

    def __len__(self) -> int:
        return len(self.centers)


def supervoxels(
    cloud: PointCloud,
    config: SupervoxelConfig,
    colors: FloatArray | None = None,
) -> Patches:
    """Divide a cloud into patches; no point is left without one.

    Parameters
    ----------
    cloud
        At least one point, z up.
    colors
        One colour in [0, 1] per point, shape (n, 3); needed if they have a weight.
    """
    if config.color_importance > 0 and colors is None:
        raise ConfigError(
            "color_importance",
            got=config.color_importance,
            expected="0 for a cloud without colours",
            mend="Give colors, one per point.",
        )
    used = colors if config.color_importance > 0 else None
    bins = binned(cloud, config.voxel_resolution, config.binning)
    for _ in range(_MAX_COARSENINGS):
        is_full = len(cloud) >= config.min_points_per_voxel * bins.n_voxels
        if is_full or _COARSER * config.voxel_resolution >= COARSEST:
            break
        config = config.coarsened(_COARSER)
        bins = binned(cloud, config.voxel_resolution, config.binning)
    grid = voxelise(cloud, config.voxel_resolution, config.binning, used, bins)
    seeds = _seeds(grid, cloud, config)
    owner = grown(grid, seeds, config)
    for _ in range(config.refinements):
        grid = _with_normals_within(grid, owner)
        owner = grown(grid, _central_voxels(grid, owner), config)
    centers, normals = _centers_and_normals(grid, owner)
    edges, contacts = _touching_patches(grid, owner)
    return Patches(grid, owner, centers, normals, edges, contacts, config)


def _seeds(grid: VoxelGrid, cloud: PointCloud, config: SupervoxelConfig) -> IntArray:
    """One voxel per coarse cell, nearest to the cell's middle, isolated ones dropped.

    A seed stays if its neighbourhood of half a seed spacing holds at least 5 % of the
    voxels that a flat surface would.
    """
    spacing = config.seed_resolution
    axes = grid_axes(cloud, level=True)
    scaled = axes @ (grid.centers - cloud.viewpoint).T / spacing
    keys = np.floor(scaled)
    offset = np.square(scaled - keys - 0.5).sum(axis=0)
    cell, cells = cell_ids(keys.astype(np.int64))
    least = np.full(cells.shape[1], np.inf)
    np.minimum.at(least, cell, offset)
    # Of equally near voxels the first one: it is written last.
    nearest = np.flatnonzero(offset == least[cell])[::-1]
    seeds = np.empty(cells.shape[1], dtype=np.int64)
    seeds[cell[nearest]] = nearest
    # Voxels per coarse cell stand for the count within half the spacing, whose
    # disc covers pi/4 of the cell.
    flat = (spacing / grid.sizes[seeds]) ** 2
    return np.sort(seeds[np.bincount(cell) > 0.05 * flat])


def _centers_and_normals(
    grid: VoxelGrid, owner: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Mean position and unit mean normal (NaN if none is known) of each patch."""
    count = np.bincount(owner)
    centers = np.stack([np.bincount(owner, weights=x) for x in grid.centers.T], axis=1)
    known = np.nan_to_num(grid.normals)
    normals = np.stack([np.bincount(owner, weights=x) for x in known.T], axis=1)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    unit = np.where(length > 1e-9, normals / np.maximum(length, 1e-9), np.nan)
    return centers / count[:, None], unit


def _central_voxels(grid: VoxelGrid, owner: IntArray) -> IntArray:
    """Voxel of each patch that is nearest to its centre."""
    n_patches = int(owner.max()) + 1
    centers = _centers_and_normals(grid, owner)[0]
    offset = np.square(grid.centers - centers[owner]).sum(axis=1)
    order = np.lexsort((offset, owner))
    return order[np.searchsorted(owner[order], np.arange(n_patches))]


def _with_normals_within(grid: VoxelGrid, owner: IntArray) -> VoxelGrid:
    """Grid with normals that are fitted to neighbours in the same patch only.

    Voxels whose patch is too small for a plane keep their normal.
    """
    inside = owner[grid.sources] == owner[grid.targets]
    normals = fitted_normals(
        grid.centers, grid.viewpoint, grid.sources[inside], grid.targets[inside]
    )
    is_open = np.isnan(normals[:, 0])
    normals[is_open] = grid.normals[is_open]
    return replace(grid, normals=normals)


def _touching_patches(grid: VoxelGrid, owner: IntArray) -> tuple[IntArray, IntArray]:
    """Edges between patches with touching voxels, and the number of such pairs."""
    a, b = owner.take(grid.sources), owner.take(grid.targets)
    crossing = np.flatnonzero(a < b)
    n_patches = int(owner.max()) + 1
    a, b = a.take(crossing), b.take(crossing)
    if n_patches >= _MAX_SHORT:
        a = a.astype(np.int64)
    keys, counts = np.unique(a * n_patches + b, return_counts=True)
    keys = keys.astype(np.int64)
    return np.stack(np.divmod(keys, n_patches), axis=1), counts
