"""The checks that a `Capture` makes of its arrays."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray

from debrisgrasp._arrays import FloatArray, unmasked
from debrisgrasp._words import counted
from debrisgrasp.errors import CaptureError
from debrisgrasp.geometry import SE3, Intrinsics

__all__ = ["checked_depth", "checked_image", "checked_points", "checked_pose"]

logger = logging.getLogger(__name__)

_FARTHEST_MEDIAN = 50.0
"""Median depth [m] beyond which an image can't be metres: no depth camera sees so far,
and millimetres begin at a few hundred."""
_FARTHEST_CLOUD = 250.0
"""The same for scanners, which reach farther."""
_FARTHEST_COORDINATE = 1e4
"""Beyond this [m] single precision no longer tells millimetres apart."""
_LARGEST_LABEL = 2**31 - 1
_AT_SENSOR = 1e-3
"""No sensor measures what is so near [m]; its position in single precision is."""
_FEWEST_POINTS = 3
"""Without this many measured points there is no surface."""


def checked_depth(depth: object, intrinsics: Intrinsics | None) -> FloatArray:
    """Depth in metres, NaN where nothing was measured, or masked; read-only."""
    _require_floats(_array(depth, "depth"), "depth")
    array = np.asarray(unmasked(depth))
    if array.ndim != 2:
        raise CaptureError(
            "depth", got=f"shape {array.shape}", expected="an image (height, width)"
        )
    if intrinsics is None:
        raise CaptureError("depth", got="no K", expected="intrinsics K of its camera")
    if array.shape != (intrinsics.height, intrinsics.width):
        raise CaptureError(
            "depth",
            got=f"shape {array.shape}",
            expected=f"that of its K, ({intrinsics.height}, {intrinsics.width})",
        )
    intrinsics.require_plausible()
    cleaned = np.array(array, dtype=np.float64)
    if (cleaned < 0).any():
        raise CaptureError(
            "depth",
            got=f"{np.count_nonzero(cleaned < 0)} negative values",
            expected="metres in front of the camera, 0 or NaN for nothing",
            mend="Store depth along the optical axis, not a signed coordinate.",
        )
    cleaned[~np.isfinite(cleaned) | (cleaned == 0)] = np.nan
    measured = cleaned[np.isfinite(cleaned)]
    if measured.size < _FEWEST_POINTS:
        raise CaptureError(
            "depth",
            got=f"{measured.size} measured pixels of {cleaned.size}",
            expected=f"at least {_FEWEST_POINTS}",
            mend="Look at the camera: covered, too close, or not streaming.",
        )
    _require_metres(float(np.median(measured)), "median depth", _FARTHEST_MEDIAN)
    _require_near(measured, "depth", "Write 0 or NaN where nothing is seen.")
    cleaned.flags.writeable = False
    return cleaned


def checked_points(points: object, viewpoint: object) -> tuple[FloatArray, FloatArray]:
    """Points (n, 3) and their viewpoint (3,), both read-only.

    Points at the viewpoint become NaN, as a depth of 0 does: nothing was measured. So
    do masked ones.
    """
    _require_floats(_array(points, "points"), "points")
    array = np.asarray(unmasked(points))
    if array.ndim != 2 or array.shape[1] != 3:
        raise CaptureError("points", got=f"shape {array.shape}", expected="(n, 3)")
    if viewpoint is None:
        raise CaptureError(
            "viewpoint",
            got="none",
            expected="the position of the sensor in the frame of the points",
            mend="Give viewpoint=(x, y, z) (--viewpoint X Y Z), or store it: "
            "'viewpoint' in .npz, 'comment viewpoint x y z' in PLY.",
        )
    sight = _array(viewpoint, "viewpoint")
    if sight.dtype.kind not in "fiu" or sight.shape != (3,):
        raise CaptureError("viewpoint", got=viewpoint, expected="three numbers [m]")
    sight = np.array(sight, dtype=np.float64)
    if not np.isfinite(sight).all():
        raise CaptureError("viewpoint", got=sight.tolist(), expected="finite numbers")
    copy = np.array(array, dtype=np.float64)
    # Lidars write their own position where nothing came back.
    copy[(np.abs(copy - sight) < _AT_SENSOR).all(axis=-1)] = np.nan
    measured = copy[np.isfinite(copy).all(axis=-1)]
    if len(measured) < _FEWEST_POINTS:
        raise CaptureError(
            "points",
            got=f"{len(measured)} finite of {len(copy)} away from the viewpoint",
            expected=f"at least {_FEWEST_POINTS}",
        )
    _require_near(
        measured,
        "points",
        "Drop broken points, and give positions relative to a near origin.",
    )
    ranges = np.linalg.norm(measured - sight, axis=-1)
    _require_metres(
        float(np.median(ranges)), "median distance to the viewpoint", _FARTHEST_CLOUD
    )
    copy.flags.writeable = sight.flags.writeable = False
    return copy, sight


def checked_image(image: object, name: str, shape: tuple[int, ...]) -> NDArray[Any]:
    """Check ``rgb``, ``mask`` or ``labels`` against the pixels or points; read-only."""
    if np.ma.is_masked(image):
        raise CaptureError(
            name,
            got="a masked array",
            expected="one without a mask",
            mend="Fill what is masked: array.filled(0).",
        )
    array = _array(image, name)
    wanted = (*shape, 3) if name == "rgb" else shape
    if array.shape != wanted:
        raise CaptureError(
            name, got=f"shape {array.shape}", expected=f"{wanted}, as the measurement"
        )
    fits, expected, dtype = {
        "rgb": (array.dtype == np.uint8, "uint8", np.uint8),
        "mask": (array.dtype.kind in "biu", "bool, or integers with 0 = no", np.bool_),
        "labels": (array.dtype.kind in "iu", "integers", np.int32),
    }[name]
    if not fits:
        raise CaptureError(name, got=f"dtype {array.dtype}", expected=expected)
    if name == "mask":
        _doubt_labels(array)
    elif array.size and (array.min() < -_LARGEST_LABEL or array.max() > _LARGEST_LABEL):
        raise CaptureError(
            name,
            got=f"values from {array.min()} to {array.max()}",
            expected=f"numbers of objects, at most {_LARGEST_LABEL}",
            mend="Number the objects: numpy.unique(labels, return_inverse=True)[1].",
        )
    copy: NDArray[Any] = np.array(array, dtype=dtype)
    copy.flags.writeable = False
    return copy


def _doubt_labels(mask: NDArray[Any]) -> None:
    """Warn of a mask that looks like labels of several objects."""
    marked = mask[mask != 0]
    if marked.size and (marked.min() < 0 or marked.min() != marked.max()):
        logger.warning(
            "mask: got values from %d to %d, as labels have, expected one besides 0; "
            "all but 0 are taken for the object",
            marked.min(),
            marked.max(),
        )


def checked_pose(pose: SE3 | None, name: str) -> None:
    """Raise unless ``pose`` is None or one rigid transform."""
    if pose is None:
        return
    if pose.batch:
        raise CaptureError(name, got=f"a batch {pose.batch}", expected="one pose")
    SE3.from_matrix(pose.matrix, name)
    if np.abs(pose.p).max() > _FARTHEST:
        raise CaptureError(
            f"position in {name}",
            got=f"{pose.p.round(3).tolist()} m",
            expected=f"within {_FARTHEST:g} m of the robot",
            mend="If these are millimetres, divide them by 1000.",
        )


_FARTHEST = 100.0
"""A camera farther away than this from its robot [m] is given in millimetres."""


def _array(values: object, name: str) -> NDArray[Any]:
    try:
        return np.asarray(values)
    except (TypeError, ValueError, OverflowError) as error:
        raise CaptureError(
            name,
            got=type(values).__name__ + " that is no array",
            expected="an array, or lists of equal lengths",
        ) from error


def _require_floats(array: NDArray[Any], name: str) -> None:
    if array.dtype.kind == "f":
        return
    is_integer = array.dtype.kind in "iu"
    raise CaptureError(
        f"dtype of {name}",
        got=str(array.dtype) + (", most likely millimetres" if is_integer else ""),
        expected="floating-point metres",
        mend="Divide by 1000 and store as float32." if is_integer else "",
    )


def _require_near(measured: FloatArray, what: str, mend: str) -> None:
    far = np.abs(measured)
    if n_far := int(np.count_nonzero(far > _FARTHEST_COORDINATE)):
        raise CaptureError(
            what,
            got=f"{counted(n_far, 'value')} of {far.size} up to {far.max():g} m",
            expected=f"at most {_FARTHEST_COORDINATE:g} m",
            mend=mend,
        )


def _require_metres(median: float, what: str, farthest: float) -> None:
    if median > farthest:
        raise CaptureError(
            what,
            got=f"{median:.4g} m",
            expected=f"at most {farthest:g} m",
            mend=f"If these are millimetres, divide by 1000 (to {median / 1e3:.3g} m); "
            f"if centimetres, by 100 (to {median / 1e2:.3g} m).",
        )
