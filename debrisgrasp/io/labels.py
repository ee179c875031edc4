"""Labels on disk: one for every pixel or point of the capture they belong to."""

from __future__ import annotations

import os
from io import BytesIO

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray
from debrisgrasp._files import require_suffix, write_atomic

from ._checks import checked_image
from .capture import Capture

__all__ = ["measured", "point_colors", "save_labels"]


def measured(capture: Capture) -> BoolArray:
    """Which pixels (height, width) or points (n,) of a capture its cloud holds."""
    is_measured: BoolArray
    if capture.depth is not None:
        is_measured = np.isfinite(capture.depth)
    elif capture.points is not None:
        is_measured = np.all(np.isfinite(capture.points), axis=-1)
    else:
        raise AssertionError("the constructor admits no other capture")
    return is_measured


def point_colors(capture: Capture) -> FloatArray | None:
    """Colours in [0, 1] of the points of ``capture.cloud()``, (n, 3); None if grey."""
    if capture.rgb is None:
        return None
    colors: FloatArray = capture.rgb[measured(capture)] / 255.0
    return colors


def save_labels(
    capture: Capture, labels: IntArray, path: str | os.PathLike[str]
) -> None:
    """Write labels of the points of ``capture.cloud()`` as ``labels`` in a .npz file.

    The array has the shape of the depth image, or one entry per point of the file;
    what was not measured gets 0.

    Raises
    ------
    ConfigError
        If the file's name does not end in .npz.
    CaptureError
        If the labels are not integers, one for each point of the cloud.
    """
    require_suffix(path, (".npz",), "a file of labels")
    is_measured = measured(capture)
    given = checked_image(labels, "labels", (int(is_measured.sum()),))
    full = np.zeros(is_measured.shape, dtype=np.int32)
    full[is_measured] = given
    buffer = BytesIO()
    np.savez_compressed(buffer, labels=full)
    write_atomic(path, buffer.getvalue())
