"""Dividing an organised cloud of debris into objects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp.geometry import PointCloud
from debrisgrasp.segmentation.marked import covered_shares
from debrisgrasp.segmentation.segmentation import PatchGraph

from .borders import patch_graph
from .camera import inverse_depth_image
from .cells import CellImage, cell_image
from .evidence import fitted_evidence
from .graph import BorderSum, RegionGraph, RegionSum
from .merging import Merged, merged_regions
from .notches import flush_bars_apart
from .patches import planar_patches
from .refine import pixel_patches

__all__ = ["SingulationConfig", "singulate"]

_FOCAL = 300.0
"""Focal length [cells] for which steps between cells are given."""
_MAX_CONCAVITY = float(np.deg2rad(24))
"""Concave angle that noise and curvature of one surface explain [rad]."""
_MAY_BE_ONE = 0.05
"""Probability of being one object from which a mark that says so is believed. Of 66
right marks in 10 drawn piles it doubts 6; 0.3 would doubt 21."""
_COUNTED = 0.3
"""From such a one on, parts count as one object where a mark covers several: in those
piles that came nearest to their number."""
_LARGEST_MIN_PATCH = 1000
"""Cells of the whole face of an object: were no patch as large, none would take in the
smaller ones, and nothing would be merged."""
_SPECK = 10
"""Cells of the smallest object."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class SingulationConfig:
    """How planar patches are found, and what joins them to objects."""

    max_gap: float = 0.013
    """Largest step of 1/z between neighbouring cells that touch [1/m]: 3 cm at 1.5 m,
    for 300 cells of focal length; coarser images get as much more as their cells are
    larger. Larger bridges more noise and more gaps between objects."""
    max_increase: float = 30.0
    """Growth of the squared error, in variances, up to which patches merge to a plane;
    larger makes fewer, coarser patches."""
    sweeps: int = 2
    """Rounds in which cells at borders choose their patch."""
    min_patch: int = 10
    """Cells of the smallest patch, at most 1000; smaller ones go to their
    neighbours."""
    min_score: float = 0.75
    """Probability of being one object from which regions are joined. Larger splits
    objects, smaller joins several; for grasping the second is worse. Slivers become
    parts of what they touch from 0.6 on."""

    color_weight: float = 0.5
    """Log-odds that a clear difference in colour takes from a score, where colours are
    given; larger trusts paint more than shape."""

    def __post_init__(self) -> None:
        require_range("max_gap [m]", self.max_gap, 1e-6, 1.0)
        require_range("max_increase", self.max_increase, 1e-9)
        require_range("sweeps", self.sweeps, 0)
        require_range("min_patch", self.min_patch, 0, _LARGEST_MIN_PATCH)
        require_range("min_score", self.min_score, 0.0, 1.0)
        require_range("color_weight", self.color_weight, 0.0, 1e6)


def singulate(
    cloud: PointCloud,
    is_candidate: BoolArray,
    config: SingulationConfig,
    *,
    colors: FloatArray | None = None,
    of_interest: BoolArray | None = None,
) -> PatchGraph | None:
    """Divide the candidate points of an organised cloud.

    Parameters
    ----------
    cloud
        With its ground, which tells what can be seen through a gap; z up.
    is_candidate
        Points to divide, at least one, shape (n,).
    colors
        Colour of each point in [0, 1], shape (n, 3): weak evidence.
    of_interest
        Points that somebody marked as one object, shape (n,); they become one.

    Returns
    -------
    PatchGraph or None
        Over the candidate points; None if the cloud is not a pinhole image.
    """
    image = inverse_depth_image(cloud)
    if image is None or cloud.pixels is None:
        return None
    pixels = cloud.pixels[is_candidate]
    mask = np.zeros(image.values.shape, dtype=bool)
    mask.ravel()[pixels] = True
    cells = cell_image(image, mask, config.max_gap)
    max_gap = config.max_gap * max(1.0, _FOCAL / cells.focal)
    marked = _averaged(cells, cloud, of_interest)
    is_marked = None if marked is None else marked[..., 0] > 0.5
    patches = planar_patches(
        cells,
        max_gap=max_gap,
        max_increase=config.max_increase,
        sweeps=config.sweeps,
        min_cells=config.min_patch,
        of_interest=is_marked,
    )
    patches = flush_bars_apart(cells, patches)
    graph = patch_graph(
        cells,
        patches,
        max_gap,
        of_interest=is_marked,
        colors=_averaged(cells, cloud, colors),
    )

    def merge(graph: RegionGraph, min_score: float) -> Merged:
        return merged_regions(
            graph,
            cells,
            fitted_evidence().probability,
            min_score,
            color_weight=0.0 if colors is None else config.color_weight,
        )

    found = _described(
        graph,
        merge(graph, config.min_score),
        cells,
        pixel_patches(image, cells, patches, pixels, max_gap),
    )
    if is_marked is None:
        return found
    return replace(found, marked_shares=_marked_shares(graph, merge))


def _marked_shares(
    graph: RegionGraph, merge: Callable[[RegionGraph, float], Merged]
) -> FloatArray:
    """Shares of what is marked on each of the objects that would be found without.

    Empty if all of it may be one object.
    """
    marked = graph.regions[:, RegionSum.OF_INTEREST]
    shares = np.empty(0)
    for min_score in (_MAY_BE_ONE, _COUNTED):
        region = merge(graph.unmarked(), min_score).region
        size = np.bincount(region, graph.regions[:, RegionSum.CELLS])
        # Specks are no objects.
        own = np.where(size < _SPECK, 0.0, np.bincount(region, marked))
        shares = covered_shares(own, size)
        if len(shares) < 2:
            return np.empty(0)
    return shares


def _averaged(
    cells: CellImage, cloud: PointCloud, values: NDArray[Any] | None
) -> FloatArray | None:
    """Mean of values (n,) or (n, c) of points in each cell, shape (h, w, c)."""
    if values is None or cloud.pixels is None or cloud.image_shape is None:
        return None
    columns = np.asarray(values, dtype=np.float64).reshape(len(values), -1)
    return cells.means(cloud.pixels, cloud.image_shape[1], columns)


def _described(
    graph: RegionGraph, merged: Merged, cells: CellImage, point_patch: IntArray
) -> PatchGraph:
    """Patches and objects with the borders at which patches touch."""
    touches = graph.borders[:, BorderSum.TOUCHING] > 0
    border = graph.borders[touches]
    count = border[:, BorderSum.TOUCHING]
    depth = border[:, BorderSum.PLACE][:, 2] / count
    return PatchGraph(
        point_patch=point_patch,
        patch_object=merged.region,
        edges=graph.edges[touches],
        is_convex=border[:, BorderSum.CONCAVE_ANGLE] < _MAX_CONCAVITY * count,
        contact_length=count * depth / cells.focal,
        rise=border[:, BorderSum.RISE] / count,
        score=merged.scores[touches],
        certainty=merged.certainty,
        pairs=merged.pairs,
        pair_scores=merged.pair_scores,
    )
