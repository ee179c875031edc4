"""Patches that grow from seeds over the voxels of a grid, all at once."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from debrisgrasp._arrays import BoolArray, Float32Array, IntArray

from .supervoxel_config import SupervoxelConfig
from .voxels import VoxelGrid

__all__ = ["grown"]

_SETTLED = 0.002
"""Sweeps end early once a smaller share of the voxels than this changes its patch."""
_PAIRS_AT_ONCE = 1 << 16
"""Pairs of voxels compared at once, so that the work stays in the processor's cache."""


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


def grown(grid: VoxelGrid, seeds: IntArray, config: SupervoxelConfig) -> IntArray:
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
