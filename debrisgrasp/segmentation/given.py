"""Objects that somebody else told apart: a reference, or another method."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import FloatArray, IntArray, as_given, frozen
from debrisgrasp._checked import checked
from debrisgrasp.errors import InputError, ShapeError
from debrisgrasp.geometry import PointCloud

from .assembly import assembled
from .pipeline import SegmentationConfig
from .segmentation import PatchGraph, PointKind, Segmentation
from .survey import surveyed

__all__ = ["segmentation_of_labels"]


@checked
def segmentation_of_labels(
    cloud: PointCloud, labels: ArrayLike, config: SegmentationConfig | None = None
) -> Segmentation:
    """Make a segmentation of labels that are known.

    Objects are numbered anew, from 1 for the one with the most points; however few they
    are, none is dropped. Ground and surroundings are found as `segment_cloud` finds
    them; what is of an object is none of them.

    Parameters
    ----------
    cloud
        In the base frame.
    labels
        Which object each point shows, integers from 1 on, with or without gaps; 0 and
        -1 are none. Shape (n,), or (height, width) if the cloud is that of an image.
    config
        Of it only ``ground`` and ``surroundings`` count.

    Raises
    ------
    ShapeError
        If there is not one label for each point or pixel.
    InputError
        If a label is masked, no integer or less than -1, or the cloud is in another
        frame.

    Examples
    --------
    >>> import numpy as np
    >>> from debrisgrasp.geometry import PointCloud
    >>> points = np.random.default_rng(0).uniform(0.0, 0.1, (100, 3))
    >>> up = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
    >>> cloud = PointCloud(points=points, normals=up, viewpoint=np.array([0, 0, 1.5]))
    >>> found = segmentation_of_labels(cloud, np.where(points[:, 0] < 0.03, 7, 4))
    >>> [segment.n_points for segment in found.segments] == sorted(
    ...     [sum(points[:, 0] < 0.03), sum(points[:, 0] >= 0.03)], reverse=True
    ... )
    True
    """
    config = config or SegmentationConfig()
    cloud.require_frame("base")
    own = _of_points(cloud, labels)
    is_object = own > 0
    _, report = surveyed(cloud, config.ground, config.surroundings)
    assert report.kinds is not None
    kinds = np.where(is_object, PointKind.STANDING, report.kinds)
    numbers, index = np.unique(own[is_object], return_inverse=True)
    nothing: FloatArray = np.empty(0)
    return assembled(
        cloud.points,
        is_object,
        PatchGraph(
            point_patch=index.reshape(-1),
            patch_object=np.arange(len(numbers)),
            edges=np.empty((0, 2), dtype=np.int64),
            is_convex=np.empty(0, dtype=bool),
            contact_length=nothing,
            rise=nothing,
            certainty=np.ones(len(numbers)),
        ),
        replace(report, kinds=frozen(kinds, "kinds", (None,), report.kinds.dtype)),
        min_points=0,
        method="given",
    )


def _of_points(cloud: PointCloud, labels: ArrayLike) -> IntArray:
    """Labels of the points of a cloud, shape (n,)."""
    given = as_given(labels, "labels")
    if not np.issubdtype(given.dtype, np.integer):
        raise InputError("labels", got=f"{given.dtype}", expected="integers")
    if given.min(initial=0) < -1:
        raise InputError(
            "labels",
            got=int(given.min()),
            expected="1 and more for objects, 0 or -1 for what is none",
        )
    if given.ndim == 2 and given.shape == cloud.image_shape:
        assert cloud.pixels is not None
        return given.ravel()[cloud.pixels]
    if given.shape != (len(cloud),):
        image = "" if cloud.image_shape is None else f" or {cloud.image_shape}"
        raise ShapeError("labels", got=given.shape, expected=f"({len(cloud)},){image}")
    return given
