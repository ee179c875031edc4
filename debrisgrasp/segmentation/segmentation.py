"""What dividing a cloud into objects returns, whichever method does it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, frozen
from debrisgrasp._words import counted
from debrisgrasp.errors import ShapeError, UnknownNameError
from debrisgrasp.geometry import Bounds, PointCloud

__all__ = [
    "GroundReport",
    "PatchGraph",
    "PointKind",
    "Segment",
    "SegmentEdges",
    "Segmentation",
    "Surrounding",
]

_STRAYS = 0.005
"""Share of the points of a segment beyond either end of it."""
_MEASURED = 5000
"""So many of them are enough to find its ends."""


class PointKind(IntEnum):
    """What a point was taken for before the rest was divided into objects."""

    STANDING = 0
    """May belong to an object."""
    GROUND = 1
    """Lies on the ground."""
    BELOW = 2
    """Lies below the ground: side and surroundings of a table."""
    WALL = 3
    """Belongs to a wall that bounds the scene."""
    CONTAINER = 4
    """Belongs to the sides or the floor of what holds most of the scene."""
    OUTSIDE = 5
    """Lies outside such a container."""
    PIT = 6
    """Lies below the ground that is seen around it: in a trench, a shaft."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Surrounding:
    """Something that bounds the scene and was taken away like the ground."""

    kind: PointKind
    n_points: int
    reason: str
    """What speaks for it, in words."""


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
    """Points of the ground that were taken away."""
    pose_doubt: str = ""
    """What speaks against the pose of the camera, in words; empty if nothing does."""
    surroundings: tuple[Surrounding, ...] = ()
    """What else was taken away before objects were sought."""
    kinds: IntArray | None = None
    """`PointKind` of each point, uint8, shape (n,); None before all were judged."""

    @classmethod
    def skipped(cls, reason: str) -> GroundReport:
        """Report that no ground was fitted, and why."""
        return cls(
            status="skipped",
            reason=reason,
            plane=None,
            tilt=np.nan,
            height=np.nan,
            inlier_share=0.0,
            removed_share=np.nan,
            n_removed=0,
        )

    def __repr__(self) -> str:
        return f"<GroundReport {self.status}: {self.reason}>"

    @property
    def counts(self) -> dict[str, int]:
        """Points that were taken away, by kind; kinds without any are left out."""
        counts = {"ground": self.n_removed} if self.n_removed else {}
        for item in self.surroundings:
            name = item.kind.name.lower()
            counts[name] = counts.get(name, 0) + item.n_points
        return counts


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Segment:
    """One object: the visible part of it, in the frame of the cloud."""

    label: int
    n_points: int
    """How many points it has; what `segment_cloud` found repeated counts once."""
    centroid: FloatArray
    """Mean of its points [m], shape (3,)."""
    bounds: Bounds
    """Axis-aligned box around its points."""
    axes: FloatArray
    """Principal axes as rows, longest first, right-handed, shape (3, 3)."""
    extents: FloatArray
    """Length along each principal axis [m], shape (3,); the farthest 0.5 % of the
    points at either end are taken for strays, such as flying pixels at edges."""
    certainty: float = 1.0
    """How sure it is that this is one object, in [0, 1]: the score of the weakest join
    of notable parts; 1 if there was nothing to join."""

    def __repr__(self) -> str:
        size = " x ".join(f"{100 * extent:.0f}" for extent in self.extents)
        x, y, z = self.centroid.tolist()
        middle = f"middle at ({x:.2f}, {y:.2f}, {z:.2f})"
        return f"<Segment {self.label}: {self.n_points} points, {size} cm, {middle}>"


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
    score: FloatArray
    """How near the two were to being joined, in [0, 1], shape (e,). By singulation, the
    probability that they are one object; by LCCP, the convex share of the contact."""

    def __repr__(self) -> str:
        pairs = ", ".join(f"{a}-{b}" for a, b in self.labels.tolist())
        return f"<SegmentEdges between {pairs or 'none'}>"

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
    method: Literal["singulation", "lccp", "given"]
    """Which method divided what stood on the ground; ``given``: somebody else's."""
    kinship: FloatArray | None = None
    """Probability that pairs of segments are one object, whether they touch or not, in
    [0, 1], symmetric, shape (s, s); zero for pairs that nothing joins. None if the
    method doesn't tell."""
    marked_shares: FloatArray | None = None
    """Shares of what was marked as one object that lie on each of the objects that the
    mark covers, as they would be without it, largest first, shape (k,); fewer than two
    if it may well be one object, None if nothing was marked."""

    def __repr__(self) -> str:
        points = counted(self.labels.size, "point")
        objects = counted(len(self.segments), "object")
        return f"<Segmentation of {points}: {objects}, ground {self.ground.status}>"

    def require_of(self, cloud: PointCloud) -> None:
        """Raise `ShapeError` unless there is one label for each point of a cloud."""
        if self.labels.shape != (len(cloud),):
            raise ShapeError(
                "labels of the segmentation",
                got=self.labels.shape,
                expected=f"one label for each of the {len(cloud)} points of the cloud",
                mend="Give the segmentation that was made from this very cloud.",
            )

    def segment(self, label: int) -> Segment:
        """Look up a segment by its label.

        Raises
        ------
        UnknownNameError
            If no segment has it.
        """
        is_count = isinstance(label, (int, np.integer))
        if not is_count or not 1 <= label <= len(self.segments):
            known = (str(segment.label) for segment in self.segments)
            raise UnknownNameError("segment label", label, known)
        return self.segments[label - 1]

    def points_of(self, label: int) -> IntArray:
        """Find the indices of the points of a segment, ascending, shape (m,)."""
        self.segment(label)
        return np.flatnonzero(self.labels == label)

    def belonging(self, label: int) -> FloatArray:
        """Probability that each segment is part of the object that one is part of.

        Parts may be joined by others between them: it is the product of the kinships
        along the best chain.

        Returns
        -------
        FloatArray
            By label from 0 on, shape (s + 1,): 1 for the segment itself, 0 for label 0.

        Raises
        ------
        UnknownNameError
            If no segment has the label.
        """
        self.segment(label)
        best = (np.arange(1, len(self.segments) + 1) == label).astype(np.float64)
        while self.kinship is not None:
            longer = (best[:, None] * self.kinship).max(axis=0)
            if (longer <= best).all():
                break
            best = np.maximum(best, longer)
        return np.append(0.0, best)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PatchGraph:
    """Patches, the object each belongs to, and where they touch.

    What a method of segmentation hands over, before segments are measured.
    """

    point_patch: IntArray
    """Patch of each point from 0, -1 for strays that are on none, shape (m,)."""
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
    score: FloatArray | None = None
    """How much speaks for both patches being one object, in [0, 1], shape (e,); None if
    the method only decides by convexity."""
    certainty: FloatArray | None = None
    """Score of the weakest join within each object, shape (o,); None likewise."""
    pairs: IntArray | None = None
    """Pairs of objects that were compared, touching or not, shape (k, 2); None
    likewise."""
    pair_scores: FloatArray | None = None
    """Probability that each of these pairs is one object, shape (k,)."""
    marked_shares: FloatArray | None = None
    """See `Segmentation.marked_shares`; None if the method heeds no marks."""


def measured_segments(
    points: FloatArray, labels: IntArray, certainty: FloatArray
) -> tuple[Segment, ...]:
    """Measure the segments with labels 1, 2, ... of a cloud.

    Parameters
    ----------
    certainty
        Of each label from 0 on, shape (labels,).
    """
    n_labels = int(labels.max(initial=0))
    if not n_labels:
        return ()
    index = np.flatnonzero(labels)
    order = index[np.argsort(labels[index], kind="stable")]
    count = np.bincount(labels[index] - 1, minlength=n_labels)
    starts = np.concatenate([[0], np.cumsum(count)[:-1]])
    # Coordinates first: reductions along rows of three are ten times slower.
    coordinates = np.ascontiguousarray(points.take(order, axis=0).T)
    centroids = np.add.reduceat(coordinates, starts, axis=1) / count
    centered = coordinates - np.repeat(centroids, count, axis=1)
    covariance = np.zeros((n_labels, 3, 3))
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        moment = np.add.reduceat(centered[i] * centered[j], starts)
        covariance[:, i, j] = covariance[:, j, i] = moment
    axes = np.swapaxes(np.linalg.eigh(covariance)[1][:, :, ::-1], 1, 2)
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    extents = np.empty((n_labels, 3))
    for k, (start, n) in enumerate(zip(starts, count, strict=True)):
        along = axes[k] @ centered[:, start : start + n : n // _MEASURED + 1]
        few = int(_STRAYS * along.shape[1])
        along.partition((few, along.shape[1] - 1 - few))
        extents[k] = along[:, -1 - few] - along[:, few]
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
            certainty=float(certainty[k + 1]),
        )
        for k in range(n_labels)
    )
