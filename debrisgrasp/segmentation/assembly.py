"""From patches that were joined into objects to a `Segmentation`."""

from __future__ import annotations

from typing import Literal

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, frozen

from .segmentation import (
    GroundReport,
    PatchGraph,
    Segmentation,
    SegmentEdges,
    measured_segments,
)

__all__ = ["assembled"]

_KEPT_APART = 1.8
"""Odds of being one object after all, over those that the score gives: of what is kept
apart to the end, that is true which the merging was too careful for. In 80 settled
piles it was 1.6 to 1.9 where the score was 0.3 or more, and nearer to 1 below."""
_CLEAR_RISE = 0.25
"""Mean sine of the elevation at a contact from which one segment lies higher."""


def assembled(
    points: FloatArray,
    is_candidate: BoolArray,
    graph: PatchGraph | None,
    ground: GroundReport,
    *,
    min_points: int,
    method: Literal["singulation", "lccp", "given"],
) -> Segmentation:
    """Give objects their labels by size, drop specks, and measure what is left.

    Parameters
    ----------
    points
        The whole cloud [m], shape (n, 3).
    is_candidate
        Which of its points may belong to objects, shape (n,); ``graph`` is over them.
    graph
        Patches and objects; None if there are no candidates.
    min_points
        Objects with fewer points are specks of noise: label 0.
    """
    labels = np.zeros(len(points), dtype=np.int32)
    patches = np.zeros(len(points), dtype=np.int32)
    edges = SegmentEdges(
        labels=np.empty((0, 2), dtype=np.int32),
        convexity=np.empty(0),
        contact_length=np.empty(0),
        upper=np.empty(0, dtype=np.int32),
        score=np.empty(0),
    )
    certainty, kinship = np.ones(1), None
    if graph is not None:
        # Taking rows by number is several times faster than by mask.
        candidates = np.flatnonzero(is_candidate)
        object_label = _numbered_by_size(
            points.take(candidates, axis=0), graph, min_points
        )
        patch_label = object_label[graph.patch_object]
        # The last place answers for strays.
        labels[candidates] = np.append(patch_label, 0).take(graph.point_patch)
        patches[candidates] = graph.point_patch + 1
        edges = _segment_edges(graph, patch_label)
        certainty = _certainty(graph, patch_label, object_label)
        kinship = _kinship(graph, object_label)
    return Segmentation(
        labels=frozen(labels, "labels", (None,), np.int32),
        segments=measured_segments(points, labels, certainty),
        edges=edges,
        patches=frozen(patches, "patches", (None,), np.int32),
        ground=ground,
        method=method,
        kinship=kinship,
        marked_shares=None if graph is None else graph.marked_shares,
    )


def _numbered_by_size(
    points: FloatArray, graph: PatchGraph, min_points: int
) -> IntArray:
    """Label of each object: 1 for the largest, 0 for specks."""
    n_objects = int(graph.patch_object.max(initial=-1)) + 1
    # Strays count for one object more, which is dropped again.
    own = np.append(graph.patch_object, n_objects).take(graph.point_patch)
    count = np.bincount(own, minlength=n_objects + 1)[:-1]
    total = [np.bincount(own, x, n_objects + 1)[:-1] for x in points.T]
    mean = np.stack(total) / np.maximum(count, 1)
    # Position settles ties, so that the order of the points can't.
    order = np.lexsort((mean[2], mean[1], mean[0], -count))
    label = np.empty(len(count), dtype=np.int32)
    label[order] = np.arange(1, len(count) + 1)
    label[count < max(min_points, 1)] = 0
    return label


def _certainty(
    graph: PatchGraph, patch_label: IntArray, object_label: IntArray
) -> FloatArray:
    """Certainty of each label from 0 on, shape (labels,)."""
    certainty = np.ones(int(patch_label.max(initial=0)) + 1)
    if graph.certainty is not None:
        certainty[object_label] = graph.certainty
        return certainty
    ends = patch_label[graph.edges].reshape(-1, 2)
    inner = ends[:, 0] == ends[:, 1]
    length = graph.contact_length[inner]
    convex = np.where(graph.is_convex[inner], length, 0.0)
    total, share = (
        np.bincount(ends[inner, 0], weights, len(certainty))
        for weights in (length, convex)
    )
    return np.where(total > 0, share / np.maximum(total, 1e-12), certainty)


def _kinship(graph: PatchGraph, object_label: IntArray) -> FloatArray | None:
    """See `Segmentation.kinship`."""
    if graph.pairs is None or graph.pair_scores is None:
        return None
    ends = object_label[graph.pairs]
    kept = (ends > 0).all(axis=1)
    a, b = ends[kept].T - 1
    kinship = np.zeros((int(object_label.max(initial=0)),) * 2)
    odds = _KEPT_APART * graph.pair_scores[kept]
    kinship[a, b] = kinship[b, a] = odds / (odds + 1.0 - graph.pair_scores[kept])
    return frozen(kinship, "kinship", kinship.shape)


def _segment_edges(graph: PatchGraph, patch_label: IntArray) -> SegmentEdges:
    """Contacts between segments, summed over those of their patches."""
    ends = patch_label[graph.edges].reshape(-1, 2).astype(np.int64)
    crossing = (ends[:, 0] != ends[:, 1]) & (ends > 0).all(axis=1)
    ends = ends[crossing]
    swapped = ends[:, 0] > ends[:, 1]
    ends.sort(axis=1)
    length = graph.contact_length[crossing]
    rise = np.where(swapped, -1.0, 1.0) * graph.rise[crossing] * length
    score = graph.is_convex if graph.score is None else graph.score
    pairs, index = np.unique(ends, axis=0, return_inverse=True)
    index = index.reshape(-1)

    def total(values: FloatArray) -> FloatArray:
        return np.bincount(index, values, len(pairs)).astype(np.float64)

    contact = np.maximum(total(length), 1e-12)
    mean_rise = total(rise) / contact
    upper = np.where(
        mean_rise > _CLEAR_RISE,
        pairs[:, 1],
        np.where(mean_rise < -_CLEAR_RISE, pairs[:, 0], 0),
    )
    return SegmentEdges(
        labels=frozen(pairs, "edge labels", (2,), np.int32),
        convexity=frozen(
            total(length * graph.is_convex[crossing]) / contact, "convexity", (None,)
        ),
        contact_length=frozen(contact, "contact length", (None,)),
        upper=frozen(upper, "upper", (None,), np.int32),
        score=frozen(total(length * score[crossing]) / contact, "score", (None,)),
    )
