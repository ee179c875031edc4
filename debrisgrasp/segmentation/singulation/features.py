"""What speaks for two regions being parts of one object, in numbers."""

from __future__ import annotations

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray

from .cells import CellImage
from .graph import BorderSum, RegionGraph, RegionSum
from .shapes import Shapes, covariances, extents_of

__all__ = ["FEATURES", "distant_pairs", "pair_features"]

FEATURES = (
    # The border: lengths relative to the smaller region, means over what touches.
    "touch_over_root_area",
    "touch_share",
    "front_share",
    "back_share",
    "step",
    "offset_at_border",
    "opening",
    "angle",
    "concave_angle",
    "smooth",
    "rise",
    "jump",
    "contact_spread",
    "contact_at_end_small",
    "contact_at_end_large",
    "touch_over_best",
    "touch_share_large",
    "contact_spread_large",
    "contact_width",
    "cut_share",
    # The outline of each.
    "unknown_share",
    "ground_share",
    "free_share",
    "hidden_share_small",
    "hidden_share_large",
    "ragged_small",
    "ragged_large",
    # Shapes, alone and together.
    "normals",
    "plane_offset",
    "plane_increase",
    "flatness_small",
    "flatness_large",
    "flatness_both",
    "length_small",
    "width_small",
    "thickness_small",
    "length_large",
    "width_large",
    "thickness_large",
    "length_both",
    "width_both",
    "thickness_both",
    "fill_small",
    "fill_large",
    "fill_both",
    "axes",
    "distance",
    "aside",
    "end_near",
    "end_far",
    "width_ratio",
    "cells_small",
    "cells_large",
    # The space between their middles, and how well it is known.
    "unseen_between",
    "empty_between",
    "noise",
)
"""Names of the columns of `pair_features`; lengths in [m], angles in [rad]."""
_SAMPLES = 16
"""Places at which the straight line between two regions is inspected."""
_MAX_EMPTY = 0.25
"""Share of the line between two bars that may be seen to be empty."""
_MAX_REACH = 2.0
"""Distance of the middles of bars in line, over the sum of their lengths, up to which
one may continue the other: that much may be hidden."""
_MIN_DISTANT = 40
"""Cells of the smallest region that is compared with others it doesn't touch."""


def pair_features(
    graph: RegionGraph,
    shapes: Shapes,
    cells: CellImage,
    which: IntArray,
) -> FloatArray:
    """Features of some edges of a graph, shape (k, features).

    Those of touching surfaces are NaN for regions that don't touch.

    Parameters
    ----------
    which
        Indices of the edges, shape (k,).
    """
    a, b = graph.edges[which].T
    size = graph.regions[:, RegionSum.CELLS]
    is_a_smaller = size[a] < size[b]
    small, large = np.where(is_a_smaller, a, b), np.where(is_a_smaller, b, a)
    columns = [
        *_border_features(graph, shapes, which, small, large, is_a_smaller),
        *_outline_features(graph, shapes, small, large),
        *_shape_features(graph.regions, shapes, small, large, cells.noise),
        *_sight_features(graph, shapes, cells, a, b),
        cells.noise / shapes.inverse[small] ** 2,
    ]
    return np.stack(columns, axis=1)


def _border_features(
    graph: RegionGraph,
    shapes: Shapes,
    which: IntArray,
    small: IntArray,
    large: IntArray,
    is_a_smaller: BoolArray,
) -> list[FloatArray]:
    border = graph.borders[which]
    touching = border[:, BorderSum.TOUCHING]
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.where(touching[:, None] > 0, border / touching[:, None], np.nan)
        n_jumps = border[:, BorderSum.LENGTH] - touching
        jump = np.where(n_jumps > 0, border[:, BorderSum.JUMP] / n_jumps, np.nan)
    a_near, b_near = border[:, BorderSum.A_NEARER], border[:, BorderSum.B_NEARER]
    outline = np.maximum(graph.regions[:, RegionSum.OUTLINE], 1.0)
    place = mean[:, BorderSum.PLACE]

    def at_end(region: IntArray) -> FloatArray:
        apart = place - shapes.center[region]
        along = np.abs(np.einsum("ek,ek->e", apart, shapes.axis[region]))
        share: FloatArray = along / (0.5 * shapes.extents[region, 0])
        return share

    spread = covariances(mean[:, BorderSum.SPREAD], place)

    def along(region: IntArray) -> FloatArray:
        axis = shapes.axis[region]
        square = np.einsum("ei,eij,ej->e", axis, spread, axis)
        share: FloatArray = (
            2.0 * np.sqrt(np.maximum(square, 0.0)) / shapes.extents[region, 0]
        )
        return share

    spreads = np.full((len(which), 3), np.nan)
    known = touching > 0
    spreads[known] = np.linalg.eigvalsh(spread[known])
    cut = border[:, BorderSum.CUT] / np.maximum(touching, 1.0)
    all_touching = graph.borders[:, BorderSum.TOUCHING]
    total, best = np.zeros(len(graph)), np.zeros(len(graph))
    for end in graph.edges.T:
        total += np.bincount(end, all_touching, len(graph))
        np.maximum.at(best, end, all_touching)
    return [
        touching / np.sqrt(graph.regions[small, RegionSum.CELLS]),
        touching / outline[small],
        np.where(is_a_smaller, a_near, b_near) / outline[small],
        np.where(is_a_smaller, b_near, a_near) / outline[small],
        *mean[:, BorderSum.STEP : BorderSum.RISE].T,
        np.where(is_a_smaller, -1.0, 1.0) * mean[:, BorderSum.RISE],
        jump,
        along(small),
        at_end(small),
        at_end(large),
        touching / np.maximum(best[small], 1.0),
        touching / np.maximum(total[large], 1.0),
        along(large),
        np.sqrt(np.maximum(spreads[:, 1], 0.0)),
        np.minimum(cut, 1.0),
    ]


def _outline_features(
    graph: RegionGraph, shapes: Shapes, small: IntArray, large: IntArray
) -> list[FloatArray]:
    touching = graph.regions[:, RegionSum.ON_GROUND].copy()
    hidden = np.zeros(len(graph))
    outline = np.maximum(graph.regions[:, RegionSum.OUTLINE], 1.0)
    nearer = (BorderSum.B_NEARER, BorderSum.A_NEARER)
    for end, other_is_nearer in zip(graph.edges.T, nearer, strict=True):
        for total, column in (
            (touching, BorderSum.TOUCHING),
            (hidden, other_is_nearer),
        ):
            total += np.bincount(end, graph.borders[:, column], len(graph))
    return [
        graph.regions[small, RegionSum.UNKNOWN] / outline[small],
        graph.regions[small, RegionSum.ON_GROUND] / outline[small],
        1.0 - touching[small] / outline[small],
        hidden[small] / outline[small],
        hidden[large] / outline[large],
        shapes.raggedness[small],
        shapes.raggedness[large],
    ]


def _shape_features(
    regions: FloatArray,
    shapes: Shapes,
    small: IntArray,
    large: IntArray,
    noise: float,
) -> list[FloatArray]:
    sums = regions[small] + regions[large]
    both = extents_of(sums)
    joint = Shapes.joint_error(sums, noise)
    size = regions[:, RegionSum.CELLS]
    error = shapes.error
    increase = joint - error[small] - error[large]
    apart = shapes.center[small] - shapes.center[large]
    reach = 0.5 * (shapes.extents[small, 0] + shapes.extents[large, 0])
    widths = shapes.extents[small, 1], shapes.extents[large, 1]
    return [
        np.einsum("ek,ek->e", shapes.normal[small], shapes.normal[large]),
        shapes.offset(small, large),
        increase / (size[small] * noise**2),
        np.sqrt(error[small] / size[small]) / noise,
        np.sqrt(error[large] / size[large]) / noise,
        np.sqrt(joint / (size[small] + size[large])) / noise,
        *shapes.extents[small].T,
        *shapes.extents[large].T,
        *both.T,
        shapes.fill[small],
        shapes.fill[large],
        sums[:, RegionSum.AREA] / (both[:, 0] * both[:, 1]),
        np.abs(np.einsum("ek,ek->e", shapes.axis[small], shapes.axis[large])),
        np.sqrt(np.einsum("ek,ek->e", apart, apart)) / reach,
        shapes.aside(small, large),
        *shapes.ends(small, large),
        np.minimum(*widths) / np.maximum(*widths),
        np.log(size[small]),
        np.log(size[large]),
    ]


def _sight_features(
    graph: RegionGraph, shapes: Shapes, cells: CellImage, a: IntArray, b: IntArray
) -> list[FloatArray]:
    """Shares of the straight line between two middles that are hidden or empty."""
    share = (np.arange(_SAMPLES) + 0.5) / _SAMPLES

    def along(values: FloatArray) -> FloatArray:
        line: FloatArray = values[a, None] * (1.0 - share) + values[b, None] * share
        return line

    row, column = (np.rint(along(shapes.pixel[:, k])).astype(np.int64) for k in (0, 1))
    # On a straight line in space 1/z is linear in the image.
    expected = along(shapes.inverse)
    there, seen = graph.labels[row, column], cells.values[row, column]
    outside = (there != a[:, None]) & (there != b[:, None])
    # Nearer than expected by 1.5 cm, or by what noise can't do.
    margin = np.maximum(0.015 * expected**2, 2.5 * cells.noise)
    is_unseen = outside & ((seen == 0) | (seen > expected + margin))
    is_empty = outside & (seen > 0) & (seen < expected - margin)
    n_outside = outside.sum(axis=1)
    unseen = is_unseen.sum(axis=1) / np.maximum(n_outside, 1)
    return [
        np.where(n_outside > 0, unseen, 1.0),
        is_empty.mean(axis=1),
    ]


def distant_pairs(graph: RegionGraph, shapes: Shapes, cells: CellImage) -> IntArray:
    """Pairs of regions that may continue each other behind something, (k, 2).

    They are coplanar, or long and in line; whether they meet doesn't matter. Bars in
    line between which one can see through do not continue each other.
    """
    large = np.flatnonzero(graph.regions[:, RegionSum.CELLS] >= _MIN_DISTANT)
    a, b = (large[k] for k in np.triu_indices(len(large), 1))
    extents = shapes.extents
    apart = shapes.center[b] - shapes.center[a]
    distance = np.sqrt(np.einsum("ek,ek->e", apart, apart))
    total = extents[a, 0] + extents[b, 0]
    near = distance < _MAX_REACH * total + 0.05
    a, b, distance, total = a[near], b[near], distance[near], total[near]
    cosine = np.einsum("ek,ek->e", shapes.normal[a], shapes.normal[b])
    is_coplanar = (cosine > 0.97) & (shapes.offset(a, b) < 0.02 + 0.03 * distance)
    is_coplanar &= distance < total + 0.05
    is_long = extents[:, 0] > 2.5 * extents[:, 1]
    cosine = np.abs(np.einsum("ek,ek->e", shapes.axis[a], shapes.axis[b]))
    widest = np.maximum(extents[a, 1], extents[b, 1])
    in_line = (cosine > 0.96) & (shapes.aside(a, b) < 0.03 + 0.5 * widest)
    in_line &= is_long[a] & is_long[b]
    chosen = is_coplanar | in_line
    a, b, in_line = a[chosen], b[chosen], in_line[chosen]
    empty = _sight_features(graph, shapes, cells, a, b)[1]
    kept = ~in_line | (empty < _MAX_EMPTY)
    return np.stack([a[kept], b[kept]], axis=1)
