"""Voxel Cloud Connectivity Segmentation: patches of similar position and orientation.

Papon et al., "Voxel Cloud Connectivity Segmentation - Supervoxels for Point Clouds",
CVPR 2013. The distance is the plain weighted sum that the point cloud library uses,
not the root of squares of the paper. Patches grow all at once (each voxel takes the
best offer of a sweep) rather than one after the other, so that the result depends on
no order, and every voxel ends up in a patch.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from debrisgrasp._arrays import BoolArray, Float32Array, FloatArray, IntArray
from debrisgrasp._checked import checked_fields
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import PointCloud

from .voxels import (
    Binning,
    VoxelGrid,
    binned,
    cell_ids,
    fitted_normals,
    grid_axes,
    voxelise,
)

__all__ = ["Patches", "SupervoxelConfig", "supervoxels"]

_MAX_COARSENINGS = 8
"""Enlargements by the root of 2 at most: single points stay single at any size."""
_MAX_SHORT = 46_000
"""Pairs of fewer patches can be numbered in 32 bits, which sort faster."""
_FINEST, _COARSEST = 5e-4, 10.0
"""Resolutions beyond these [m] can only be of another unit."""
_SETTLED = 0.002
"""Sweeps end early once a smaller share of the voxels than this changes its patch."""
_PAIRS_AT_ONCE = 1 << 16
"""Pairs of voxels compared at once, so that the work stays in the processor's cache."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class SupervoxelConfig:
    """How fine the patches are and what makes a point similar to one."""

    voxel_resolution: float = 0.008
    """Edge of a voxel [m]; larger is faster and blurs thin parts together. Voxels are
    enlarged where the cloud is coarser, see ``min_points_per_voxel``."""
    seed_resolution: float = 0.024
    """Distance between the seeds of patches [m], about their size."""
    color_importance: float = 0.0
    """Weight of the distance in colour; needs colours with the cloud."""
    spatial_importance: float = 0.4
    """Weight of the distance in space, in units of ``seed_resolution``."""
    normal_importance: float = 8.0
    """Weight of 1 - |cos| between the normals."""
    binning: Binning = Binning.METRIC
    """Shape of the voxels; `Binning.SINGLE_CAMERA` keeps far surfaces whole where the
    samples lie farther apart than a voxel."""
    refinements: int = 0
    """Rounds of fitting normals within the patches, reseeding at their centres, and
    growing anew."""

    min_points_per_voxel: float = 2.0
    """Mean number of points per voxel below which voxels and patches are enlarged:
    cells finer than the samples of a coarse or distant scan don't touch each other. 0
    keeps the resolution."""

    def coarsened(self, factor: float) -> SupervoxelConfig:
        """Return the same settings with larger voxels and patches."""
        return replace(
            self,
            voxel_resolution=factor * self.voxel_resolution,
            seed_resolution=factor * self.seed_resolution,
        )

    def __post_init__(self) -> None:
        if not _FINEST <= self.voxel_resolution < self.seed_resolution <= _COARSEST:
            raise ConfigError(
                "voxel_resolution and seed_resolution",
                got=f"{self.voxel_resolution} and {self.seed_resolution}",
                expected=f"{_FINEST} <= voxel_resolution < seed_resolution <= "
                f"{_COARSEST} [m]",
                mend="Millimetres are to be divided by 1000.",
            )
        for name in (
            "color_importance",
            "spatial_importance",
            "normal_importance",
            "min_points_per_voxel",
        ):
            if not 0 <= getattr(self, name) < np.inf:
                raise ConfigError(name, got=getattr(self, name), expected="0 or more")
        if self.refinements < 0:
            raise ConfigError(
                "refinements", got=self.refinements, expected="0 or more rounds"
            )


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
        if len(cloud) >= config.min_points_per_voxel * bins.n_voxels:
            break
        config = config.coarsened(2**0.5)
        bins = binned(cloud, config.voxel_resolution, config.binning)
    grid = voxelise(cloud, config.voxel_resolution, config.binning, used, bins)
    seeds = _seeds(grid, cloud, config)
    owner = _grown(grid, seeds, config)
    for _ in range(config.refinements):
        grid = _with_normals_within(grid, owner)
        owner = _grown(grid, _central_voxels(grid, owner), config)
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


def _features(grid: VoxelGrid, config: SupervoxelConfig) -> Float32Array:
    """Position in units of the seed spacing, normal, and colour if it counts, (f, v).

    Positions are relative to their mean: single precision would not resolve them far
    from the origin.
    """
    centered = grid.centers - grid.centers.mean(axis=0)
    parts = [centered.T / config.seed_resolution, np.nan_to_num(grid.normals.T)]
    if grid.colors is not None:
        parts.append(grid.colors.T)
    return np.concatenate(parts).astype(np.float32, order="C")


def _distance(
    features: Float32Array,
    means: Float32Array,
    patch: IntArray,
    voxel: IntArray,
    config: SupervoxelConfig,
) -> Float32Array:
    """Distance D of voxels to patches, both (k,): weighted sum over the features."""

    def gap(rows: slice) -> Float32Array:
        squares = np.zeros(len(voxel), dtype=np.float32)
        for ours, theirs in zip(features[rows], means[rows], strict=True):
            step = ours.take(voxel)
            step -= theirs.take(patch)
            step *= step
            squares += step
        return np.sqrt(squares, out=squares)

    cosine = np.zeros(len(voxel), dtype=np.float32)
    for ours, theirs in zip(features[3:6], means[3:6], strict=True):
        product = ours.take(voxel)
        product *= theirs.take(patch)
        cosine += product
    total = np.float32(config.spatial_importance) * gap(slice(0, 3))
    total += np.float32(config.normal_importance) * (1 - np.abs(cosine))
    if len(features) > 6:
        total += np.float32(config.color_importance) * gap(slice(6, None))
    return total


def _grown(grid: VoxelGrid, seeds: IntArray, config: SupervoxelConfig) -> IntArray:
    """Grow patches from seed voxels over the neighbour graph.

    In every sweep each voxel compares the patch it is in with the offers of patches
    next to it. After the usual 1.8 seed spacings patches only take what nobody has yet,
    until no such voxel can be reached; what is left becomes patches of its own.

    Returns
    -------
    IntArray
        Patch of each voxel, numbered from 0 without gaps, shape (v,).
    """
    features = _features(grid, config)
    owner = np.full(len(grid), -1, dtype=np.int32)
    cost = np.full(len(grid), np.inf, dtype=np.float32)
    owner[seeds] = np.arange(len(seeds))
    cost[seeds] = 0.0
    means = features[:, seeds]
    sources, targets = grid.sources, grid.targets
    offered = owner.copy()
    n_sweeps = int(1.8 * config.seed_resolution / config.voxel_resolution) - 1
    for _ in range(n_sweeps):
        before = owner.copy()
        taken = _sweep(sources, targets, features, means, offered, owner, cost, config)
        if len(taken) <= _SETTLED * len(grid):
            break
        means = _patch_means(features, owner, len(seeds))
        # A patch that neither gained nor lost a voxel offers what it did before.
        has_changed = np.zeros(len(seeds) + 1, dtype=bool)
        has_changed[owner[taken]] = has_changed[before[taken]] = True
        has_changed[-1] = False
        offered = np.where(has_changed[owner], owner, -1)
    while True:
        open_pairs = np.flatnonzero(owner.take(targets) < 0)
        sources, targets = sources.take(open_pairs), targets.take(open_pairs)
        offered = owner.copy()
        if not len(
            _sweep(sources, targets, features, means, offered, owner, cost, config)
        ):
            break
    free = owner < 0
    if free.any():
        owner[free] = len(seeds) + _components(grid, free)
    numbered: IntArray = np.unique(owner, return_inverse=True)[1].astype(np.int32)
    return numbered


def _sweep(
    sources: IntArray,
    targets: IntArray,
    features: Float32Array,
    means: Float32Array,
    offered: IntArray,
    owner: IntArray,
    cost: Float32Array,
    config: SupervoxelConfig,
) -> IntArray:
    """Let every voxel take the best offer of its neighbours, in place.

    Parameters
    ----------
    sources, targets
        Ordered pairs of voxels of which the first offers to the second, by the second.
    offered
        Patch that each voxel offers, -1 for none, shape (v,).
    owner, cost
        Patch of each voxel, -1 for none, and its distance to it, shape (v,).

    Returns
    -------
    IntArray
        Voxels that took an offer.
    """
    # All pairs of a voxel together.
    cuts = np.searchsorted(targets, targets[_PAIRS_AT_ONCE::_PAIRS_AT_ONCE])
    taken = []
    for start, end in pairwise([0, *cuts, len(targets)]):
        patch, voxel = _offers(
            offered.take(sources[start:end]), owner, targets[start:end]
        )
        offer = _distance(features, means, patch, voxel, config)
        # Few offers are better than what a voxel has; only these are compared.
        better = np.flatnonzero(offer < cost.take(voxel))
        patch, voxel, offer = patch[better], voxel[better], offer[better]
        starts = np.flatnonzero(np.diff(voxel, prepend=-1))
        if not len(starts):
            continue
        best = np.minimum.reduceat(offer, starts)
        # Of equal offers the patch with the smallest number wins.
        width = np.diff(starts, append=len(voxel))
        contender = np.where(offer <= np.repeat(best, width), patch, means.shape[1])
        taker = voxel[starts]
        owner[taker] = np.minimum.reduceat(contender, starts)
        cost[taker] = best
        taken.append(taker)
    return np.concatenate(taken) if taken else np.empty(0, dtype=np.intp)


def _offers(
    offered: IntArray, owner: IntArray, targets: IntArray
) -> tuple[IntArray, IntArray]:
    """Offered patches and the voxels they are offered to, of pairs by their voxel.

    Voxels are not offered the patch they are in, and most others only once.
    """
    is_offer = offered != owner.take(targets)
    is_offer &= offered >= 0
    # Neighbours in a row mostly offer the same patch.
    is_new = offered[1:] != offered[:-1]
    is_new |= targets[1:] != targets[:-1]
    is_offer[1:] &= is_new
    chosen = np.flatnonzero(is_offer)
    return offered.take(chosen).astype(np.intp), targets.take(chosen)


def _patch_means(
    features: Float32Array, owner: IntArray, n_patches: int
) -> Float32Array:
    """Mean features of each patch with unit normals, (f, p); voxels of none are -1."""
    # Those go to one patch more, which is dropped again.
    index = np.where(owner < 0, n_patches, owner)
    means = np.stack(
        [np.bincount(index, weights=x, minlength=n_patches + 1) for x in features]
    )[:, :-1].astype(np.float64)
    length = np.sqrt(np.square(means[3:6]).sum(axis=0))
    # A patch that lost all its voxels offers nothing any more; its mean is moot.
    count = np.maximum(np.bincount(index, minlength=n_patches + 1)[:-1], 1)
    normals = means[3:6] / np.maximum(length, 1e-12)
    means /= count
    means[3:6] = normals
    return means.astype(np.float32)


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


def _components(grid: VoxelGrid, chosen: BoolArray) -> IntArray:
    """Find the connected component of each chosen voxel."""
    index = np.flatnonzero(chosen)
    number = np.full(len(grid), -1)
    number[index] = np.arange(len(index))
    inside = chosen[grid.sources] & chosen[grid.targets]
    a, b = number[grid.sources[inside]], number[grid.targets[inside]]
    graph = coo_array((np.ones(len(a), dtype=bool), (a, b)), shape=(len(index),) * 2)
    components: IntArray = connected_components(graph, directed=False)[1]
    return components


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
