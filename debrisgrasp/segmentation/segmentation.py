"""What dividing a cloud into objects returns, whichever method does it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, frozen
from debrisgrasp.errors import UnknownNameError
from debrisgrasp.geometry import Bounds

__all__ = ["GroundReport", "PatchGraph", "Segment", "SegmentEdges", "Segmentation"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GroundReport:
    """Whether the ground was taken away, and on what evidence."""

    status: Literal["removed", "skipped"]
    reason: str
    """One sentence that says why it was removed or skipped."""
    plane: FloatArray | None
    """(a, b, c, d) with a x + b y + c z + d the height above the fitted plane [m],
    shape (4,); None if none could be fitted."""
    tilt: float
    """Angle between the fitted and the expected plane [rad]; NaN without a fit."""
    height: float
    """Height of the fitted plane over the expected one at the middle of its points [m];
    NaN without a fit."""
    inlier_share: float
    """Points near the fitted surface, as a share of all."""
    removed_share: float
    """Points that removal takes from the region of interest, as a share of those in
    it; NaN if it wasn't reached."""
    n_removed: int
    """Points that were taken away."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Segment:
    """One object: the visible part of it, in the frame of the cloud."""

    label: int
    n_points: int
    centroid: FloatArray
    """Mean of its points [m], shape (3,)."""
    bounds: Bounds
    """Axis-aligned box around its points."""
    axes: FloatArray
    """Principal axes as rows, longest first, right-handed, shape (3, 3)."""
    extents: FloatArray
    """Length along each principal axis [m], shape (3,)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SegmentEdges:
    """Which segments touch, how, and who lies on whom."""

    labels: IntArray
    """Pairs of labels (a, b), a < b, ascending, shape (e, 2)."""
    convexity: FloatArray
    """Share of the contact that is convex, in [0, 1], shape (e,)."""
    contact_length: FloatArray
    """Visible length of the contact [m], shape (e,)."""
    upper: IntArray
    """Label of the segment that lies above the other along gravity where they touch, 0
    if neither does, shape (e,)."""

    def __len__(self) -> int:
        return len(self.labels)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Segmentation:
    """A cloud divided into objects."""

    labels: IntArray
    """Label of each point, int32, shape (n,); 0 is not an object. The segment with the
    most points has label 1."""
    segments: tuple[Segment, ...]
    """Ordered by label, from 1 without gaps."""
    edges: SegmentEdges
    patches: IntArray
    """Patch of each point, int32, shape (n,); 0 for points of the ground."""
    ground: GroundReport
    method: Literal["singulation", "lccp"]
    """Which method divided what stood on the ground."""

    def segment(self, label: int) -> Segment:
        """Look up a segment by its label."""
        if not 1 <= label <= len(self.segments):
            known = (str(segment.label) for segment in self.segments)
            raise UnknownNameError("segment label", label, known)
        return self.segments[label - 1]

    def points_of(self, label: int) -> IntArray:
        """Find the indices of the points of a segment, ascending."""
        self.segment(label)
        return np.flatnonzero(self.labels == label)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PatchGraph:
    """Patches, the object each belongs to, and where they touch.

    What a method of segmentation hands over, before segments are measured.
    """

    point_patch: IntArray
    """Patch of each point from 0, shape (m,)."""
    patch_object: IntArray
    """Object of each patch from 0, shape (p,)."""
    edges: IntArray
    """Pairs of touching patches, each once, shape (e, 2)."""
    is_convex: BoolArray
    """Whether each edge was found convex, shape (e,)."""
    contact_length: FloatArray
    """Length of each contact [m], shape (e,)."""
    rise: FloatArray
    """Sine of the elevation of the second patch over the first near the contact, from
    -1 to 1, shape (e,)."""


def measured_segments(points: FloatArray, labels: IntArray) -> tuple[Segment, ...]:
    """Measure the segments with labels 1, 2, ... of a cloud."""
    n_labels = int(labels.max(initial=0))
    if not n_labels:
        return ()
    index = np.flatnonzero(labels)
    order = index[np.argsort(labels[index], kind="stable")]
    own = labels[order] - 1
    count = np.bincount(own, minlength=n_labels)
    starts = np.concatenate([[0], np.cumsum(count)[:-1]])
    # Coordinates first: reductions along rows of three are ten times slower.
    coordinates = np.ascontiguousarray(points[order].T)
    centroids = np.add.reduceat(coordinates, starts, axis=1) / count
    centered = coordinates - centroids[:, own]
    covariance = np.zeros((n_labels, 3, 3))
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        moment = np.add.reduceat(centered[i] * centered[j], starts)
        covariance[:, i, j] = covariance[:, j, i] = moment
    axes = np.swapaxes(np.linalg.eigh(covariance)[1][:, :, ::-1], 1, 2)
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    extents = np.empty((n_labels, 3))
    for i in range(3):
        along = sum(axes[own, i, j] * centered[j] for j in range(3))
        extents[:, i] = np.maximum.reduceat(along, starts)
        extents[:, i] -= np.minimum.reduceat(along, starts)
    lower = np.minimum.reduceat(coordinates, starts, axis=1).T - 1e-6
    upper = np.maximum.reduceat(coordinates, starts, axis=1).T + 1e-6
    centroids = centroids.T
    return tuple(
        Segment(
            label=k + 1,
            n_points=int(count[k]),
            centroid=frozen(centroids[k], "centroid", (3,)),
            bounds=Bounds(lower[k], upper[k]),
            axes=frozen(axes[k], "axes", (3, 3)),
            extents=frozen(extents[k], "extents", (3,)),
        )
        for k in range(n_labels)
    )
