"""On what to seek grasps, and in which order."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, require_metres
from debrisgrasp.errors import CaptureError
from debrisgrasp.geometry import Bounds, PointCloud
from debrisgrasp.segmentation import Candidate, Segmentation, region_of_interest

__all__ = ["Target", "choose_targets", "whole_of", "with_crumbs"]

_LIKELY = 0.5
"""More likely than this to be of one object counts as part of it."""
_SEVERAL = 0.2
"""What holds such a share of the points in a region lies in it, and not just beside."""

_CRUMB_HEIGHT = 0.03
"""What is of no object and stands higher over the ground is a crumb of one [m] ..."""
_CRUMB_GAP = 0.02
"""... from which it is no farther than this [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """Where to seek grasps, and on which points."""

    label: int
    """Label of the object; 0 for whatever lies in a region."""
    region: Bounds
    is_object: BoolArray
    """Which points of the cloud belong to it, shape (n,)."""
    cost: float = 0.0
    """What the order ascends by; 0 where there is none."""


def choose_targets(
    cloud: PointCloud,
    segmentation: Segmentation,
    order: Sequence[Candidate],
    *,
    region: Bounds | None,
    object_label: int | None,
    is_marked: BoolArray | None,
    margin: float,
) -> Iterable[Target]:
    """List the targets, first choice first, each worked out when its turn comes.

    A label or a region that the caller gives is the only one. Marked points are one
    object, however they were segmented: a handle is always divided from what it sits
    on, and the mark keeps it whole. Otherwise the objects follow in their order.

    Parameters
    ----------
    is_marked
        Whether a point of the cloud is marked, shape (n,).
    margin
        How far the region reaches beyond the points of an object [m].

    Raises
    ------
    CaptureError
        If points are marked, but none that was measured, or none of the object.
    ConfigError
        If the region can only be in millimetres.
    UnknownNameError
        If the label is not in the segmentation.
    """
    if is_marked is not None and not is_marked.any():
        raise CaptureError(
            "mask",
            got="no measured point inside it",
            expected="at least one",
            mend="Leave the mask out to plan on the whole scene.",
        )
    if region is not None:
        require_metres("region", [region.lower, region.upper])
    labels = segmentation.labels
    if object_label is not None:
        chosen = cloud.points[segmentation.points_of(object_label)]
        box = region or region_of_interest(chosen, margin=margin)
        targets = [Target(object_label, box, labels == object_label)]
    elif region is not None:
        targets = [Target(0, region, labels > 0)]
    elif is_marked is not None:
        label = int(np.bincount(labels[is_marked]).argmax())
        box = region_of_interest(cloud.points[is_marked], margin=margin)
        return [Target(label, box, is_marked)]
    else:
        return (
            Target(
                candidate.label,
                region_of_interest(
                    cloud.points.take(segmentation.points_of(candidate.label), axis=0),
                    margin=margin,
                ),
                labels == candidate.label,
                candidate.cost,
            )
            for candidate in order
        )
    if is_marked is None:
        return targets
    if object_label is not None and not (targets[0].is_object & is_marked).any():
        raise CaptureError(
            "mask",
            got=f"no measured point of object {object_label} inside it",
            expected="some, where mask and label both say what to take",
            mend="Leave one of them out.",
        )
    return [replace(t, is_object=t.is_object & is_marked) for t in targets]


def whole_of(segmentation: Segmentation, label: int, is_chosen: BoolArray) -> BoolArray:
    """Find the points of what chosen points are part of, those included, shape (n,).

    A mask or a region says where to grip; what is lifted is the whole.

    Parameters
    ----------
    label
        Of the marked object; 0 for whatever lies in a region.
    is_chosen
        Which points are marked or in the region, shape (n,).
    """
    labels = segmentation.labels
    if label:
        is_part = np.arange(len(segmentation.segments) + 1) == label
        if segmentation.kinship is not None:
            # Not along chains: slivers at the edge of a mask lead to neighbours.
            is_part[1:] |= segmentation.kinship[label - 1] > _LIKELY
    else:
        count = np.bincount(labels[is_chosen], minlength=len(segmentation.segments) + 1)
        is_part = count > _SEVERAL * count.sum()
        is_part[0] = False
    whole: BoolArray = is_chosen | is_part[labels]
    return whole


def with_crumbs(
    points: FloatArray, labels: IntArray, is_own: BoolArray, plane: FloatArray | None
) -> BoolArray:
    """Add crumbs to the points of what is lifted, shape (n,).

    What is too small for an object is of none, also at the rim of a crate, where it
    would stand in the way of the crate itself.

    Parameters
    ----------
    points
        Base frame [m], shape (n, 3).
    labels
        Of each; 0: no object, shape (n,).
    is_own
        Which are lifted, shape (n,).
    plane
        Of the ground (4,); None: nothing tells a crumb from it.
    """
    if plane is None or not is_own.any():
        return is_own
    around = region_of_interest(points[is_own], margin=2.0 * _CRUMB_GAP)
    crumbs = np.flatnonzero((labels == 0) & ~is_own)
    crumbs = crumbs[points.take(crumbs, axis=0) @ plane[:3] + plane[3] > _CRUMB_HEIGHT]
    crumbs = crumbs[around.contains(points.take(crumbs, axis=0))]
    if not len(crumbs):
        return is_own
    others = np.flatnonzero(is_own | (labels > 0))
    others = others[around.contains(points.take(others, axis=0))]
    tree = cKDTree(points[others], balanced_tree=False, compact_nodes=False)
    gap, nearest = tree.query(points[crumbs])
    whole = is_own.copy()
    whole[crumbs] = (gap < _CRUMB_GAP) & is_own[others[nearest]]
    return whole
