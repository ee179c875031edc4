"""Square tags as fiducials, found by the AprilTag library (extra ``tags``)."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from debrisgrasp._arrays import FloatArray, require_range
from debrisgrasp.errors import MissingExtraError, UnknownNameError
from debrisgrasp.geometry import SE3, Intrinsics

from .picture import checked_picture

__all__ = ["TagFound", "find_tags"]

_FAMILIES = ("tag36h11", "tag25h9", "tag16h5", "tagStandard41h12")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TagFound:
    """One tag, and where it is."""

    number: int
    """Its identity within the family."""
    T_camera_tag: SE3
    """Pose of its middle; x right and y down on the print, z into it."""
    corners: FloatArray
    """Pixels (u, v) of its corners, shape (4, 2)."""
    margin: float
    """How clearly its bits were read, of 255; below 30 it is doubtful."""


def find_tags(
    rgb: NDArray[np.uint8],
    intrinsics: Intrinsics,
    *,
    size: float,
    family: str = "tag36h11",
    min_margin: float = 30.0,
) -> tuple[TagFound, ...]:
    """Find all tags of a family in a picture.

    Parameters
    ----------
    rgb
        Picture, uint8, shape (height, width, 3) or grey (height, width).
    intrinsics
        Its camera.
    size
        Edge length of a tag between the outer corners of its black border [m].
    family
        Which set of tags was printed.
    min_margin
        Tags that are read less clearly are left out.

    Raises
    ------
    InputError, UnknownNameError
        If the picture is of another size than the camera's or of another type, or the
        family is not known.
    MissingExtraError
        If the library is not installed.
    """
    require_range("size of the tag", size, 1e-3, 2.0)
    if family not in _FAMILIES:
        raise UnknownNameError("family of tags", family, _FAMILIES)
    shape = (intrinsics.height, intrinsics.width)
    image: NDArray[Any] = checked_picture(rgb, "rgb", (*shape, 3), shape)
    if image.ndim == 3:
        image = np.rint(image @ [0.299, 0.587, 0.114])
    try:
        library: Any = import_module("pupil_apriltags")
    except ImportError as error:
        raise MissingExtraError("finding tags", "tags") from error
    k = intrinsics
    found = library.Detector(families=family).detect(
        np.ascontiguousarray(image, dtype=np.uint8),
        estimate_tag_pose=True,
        camera_params=(k.fx, k.fy, k.cx, k.cy),
        tag_size=size,
    )
    return tuple(
        TagFound(
            number=int(tag.tag_id),
            T_camera_tag=SE3.from_parts(tag.pose_R, tag.pose_t.reshape(3)),
            corners=np.asarray(tag.corners),
            margin=float(tag.decision_margin),
        )
        for tag in found
        if tag.decision_margin >= min_margin
    )
