"""Locally Convex Connected Patches: join supervoxels across convex borders.

Stein, Schoeler, Papon and Woergoetter, "Object Partitioning using Local Convexity",
CVPR 2014, with the criteria of `debrisgrasp.segmentation.convexity`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray
from debrisgrasp._checked import checked_fields
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import PointCloud

from .convexity import extended_convexity, is_convex, is_singular, is_step
from .segmentation import PatchGraph
from .supervoxel_config import SupervoxelConfig
from .supervoxels import Patches, supervoxels

__all__ = ["LccpConfig", "lccp"]


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class LccpConfig:
    """Which borders between patches join them."""

    supervoxels: SupervoxelConfig = field(default_factory=SupervoxelConfig)
    concavity_tolerance: float = float(np.deg2rad(17))
    """Concave borders still join below this angle between normals [rad]; larger bridges
    noise and shallow grooves."""
    smoothness: float | None = 1.0
    """Permitted step between patches in units of ``voxel_resolution``; None for any."""
    sanity: bool = True
    """Whether patches that meet at a corner only are kept apart."""
    extended_convexity: int = 0
    """How many common convex neighbours a convex border needs; 1 cuts thin bridges."""
    min_segment_size: int = 20
    """Objects of at most so many patches go to their largest neighbour."""

    def __post_init__(self) -> None:
        if not 0 <= self.concavity_tolerance <= np.pi:
            raise ConfigError(
                "concavity_tolerance",
                got=self.concavity_tolerance,
                expected="an angle in [0, pi] rad",
                mend="Degrees are to be multiplied by pi / 180.",
            )
        if self.smoothness is not None and not 0 <= self.smoothness < np.inf:
            raise ConfigError(
                "smoothness", got=self.smoothness, expected="0 or more, or None"
            )
        for name in ("extended_convexity", "min_segment_size"):
            if getattr(self, name) < 0:
                raise ConfigError(name, got=getattr(self, name), expected="0 or more")


def lccp(
    cloud: PointCloud, config: LccpConfig, colors: FloatArray | None = None
) -> PatchGraph:
    """Divide a cloud, without its ground, into locally convex objects.

    Parameters
    ----------
    cloud
        At least one point, z up.
    colors
        One colour in [0, 1] per point, shape (n, 3), or None.
    """
    patches = supervoxels(cloud, config.supervoxels, colors)
    convex, valid = judged_borders(patches, config)
    joined = _components(patches.edges[valid], len(patches))
    joined = merged_small(joined, patches.edges, config.min_segment_size)
    first, second = patches.edges.T
    between = patches.centers[second] - patches.centers[first]
    size = np.bincount(
        patches.owner, weights=patches.grid.sizes, minlength=len(patches)
    ) / np.bincount(patches.owner, minlength=len(patches))
    # A straight border of k cells has about 3 k pairs of 26-neighbours across it, on
    # either side, of which each is counted once.
    length = patches.contacts * (size[first] + size[second]) / 6.0
    return PatchGraph(
        point_patch=patches.owner.take(patches.grid.point_voxel),
        patch_object=joined,
        edges=patches.edges,
        is_convex=convex,
        contact_length=length,
        rise=between[:, 2] / np.linalg.norm(between, axis=1),
    )


def judged_borders(patches: Patches, config: LccpConfig) -> tuple[BoolArray, BoolArray]:
    """Which edges of the patch graph are convex, and which of these join, each (e,)."""
    a, b = patches.edges.T
    ends = (
        patches.centers[a],
        patches.centers[b],
        patches.normals[a],
        patches.normals[b],
    )
    with np.errstate(invalid="ignore"):
        convex = is_convex(*ends, config.concavity_tolerance)
        if config.smoothness is not None:
            resolution = patches.config
            convex &= ~is_step(
                *ends,
                seed_resolution=resolution.seed_resolution,
                allowance=config.smoothness * resolution.voxel_resolution,
            )
        if config.sanity:
            convex &= ~is_singular(*ends)
    if not config.extended_convexity:
        return convex, convex
    valid = extended_convexity(
        patches.edges, convex, len(patches), config.extended_convexity
    )
    return convex, valid


def _components(edges: IntArray, n_patches: int) -> IntArray:
    graph = coo_array(
        (np.ones(len(edges), dtype=bool), (edges[:, 0], edges[:, 1])),
        shape=(n_patches, n_patches),
    )
    components: IntArray = connected_components(graph, directed=False)[1]
    return components


def merged_small(joined: IntArray, edges: IntArray, min_size: int) -> IntArray:
    """Give objects of at most ``min_size`` patches to their largest neighbour.

    Neighbours are those of any border, concave ones included. Rounds repeat until no
    small object has a neighbour; isolated ones stay.

    Parameters
    ----------
    joined
        Object of each patch, shape (p,).
    edges
        Pairs of touching patches, shape (e, 2).

    Returns
    -------
    IntArray
        Object of each patch, numbered from 0 without gaps, shape (p,).
    """
    joined = np.unique(joined, return_inverse=True)[1]
    while True:
        size = np.bincount(joined)
        ends = np.concatenate([joined[edges], joined[edges[:, ::-1]]])
        ends = ends[(ends[:, 0] != ends[:, 1]) & (size[ends[:, 0]] <= min_size)]
        if not len(ends):
            return joined
        # The last of each small object's neighbours in this order is its largest one.
        order = np.lexsort((-ends[:, 1], size[ends[:, 1]], ends[:, 0]))
        ends = ends[order]
        last = np.flatnonzero(np.diff(ends[:, 0], append=-1))
        joined = _components(ends[last], len(size))[joined]
