"""A page on which a person clicks the fiducial, and collects observations."""

from __future__ import annotations

import base64
import io
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from debrisgrasp._arrays import FloatArray
from debrisgrasp.errors import CaptureError
from debrisgrasp.geometry import Intrinsics

from .colors import GROUND_COLOR
from .html import filled_page, write_page
from .payload import packed_bytes, packed_points
from .scene import point_spacing

__all__ = ["PickView", "pick_html"]

_POINT_LIMIT = 120_000


class Seen(Protocol):
    """What the page needs of a capture."""

    @property
    def name(self) -> str:
        """What to call it."""
        ...

    @property
    def depth(self) -> FloatArray | None:
        """Depth image [m], NaN where nothing was measured; None for a cloud."""
        ...

    @property
    def intrinsics(self) -> Intrinsics | None:
        """Camera of the depth image."""
        ...

    @property
    def points(self) -> FloatArray | None:
        """Points of a cloud [m], shape (n, 3)."""
        ...

    @property
    def rgb(self) -> NDArray[np.uint8] | None:
        """Colours of the image or of the points."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class PickView:
    """One capture to pick in, and the observation it belongs to."""

    capture: Seen
    observation: Mapping[str, Any]
    """Fields of the observation that are known, its name and its joints among them."""


def pick_html(
    path: str | os.PathLike[str],
    views: Sequence[PickView],
    *,
    header: Mapping[str, Any],
) -> None:
    """Write a page that turns clicks into an observations file.

    A click in the picture takes the median depth of a ring around it, since depth at an
    LED is missing; a click in the 3-D view takes the mean of the nearest points.

    Parameters
    ----------
    path
        Where to write.
    views
        The captures, one observation each.
    header
        Fields of the observations file beside its list.

    Raises
    ------
    ConfigError, OutputError
        If the file has another suffix, or can't be written.
    """
    content = {
        "header": dict(header),
        "views": [_view(view.capture, view.observation) for view in views],
    }
    write_page(
        path,
        filled_page("pick.html", "pick.js", "Pick the fiducial", content),
    )


def _view(capture: Seen, observation: Mapping[str, Any]) -> dict[str, Any]:
    points, colors = _points(capture)
    n = len(points)
    if not n:
        raise CaptureError(
            f"capture {capture.name}", got="no measured point", expected="some"
        )
    # Multiples of the golden ratio are spread evenly over the rows of an image.
    keep = (np.arange(n) * 0.6180339887498949) % 1.0 < _POINT_LIMIT / n
    points, colors = points[keep], colors[keep]
    spacing = point_spacing(points)
    step = max(float(spacing.max(initial=0.0)), 1e-6) / 255.0
    k = capture.intrinsics
    return {
        "name": capture.name,
        "observation": dict(observation),
        "cloud": {
            **packed_points(points),
            "colors": packed_bytes(np.rint(255.0 * colors).astype(np.uint8)),
            "sizes": packed_bytes(np.rint(spacing / step).astype(np.uint8)),
            "sizeStep": round(step, 9),
        },
        "camera": None if k is None else [k.fx, k.fy, k.cx, k.cy, k.width, k.height],
        "picture": _picture(capture),
    }


def _points(capture: Seen) -> tuple[FloatArray, FloatArray]:
    """Measured points in the camera frame, and their colours in [0, 1]."""
    if capture.depth is not None and capture.intrinsics is not None:
        is_measured = np.isfinite(capture.depth)
        points = capture.intrinsics.deproject(capture.depth)[is_measured]
    else:
        everything = np.asarray(capture.points)
        is_measured = np.isfinite(everything).all(axis=-1)
        points = everything[is_measured]
    if capture.rgb is not None:
        return points, capture.rgb[is_measured] / 255.0
    near, far = np.percentile(points[:, 2], [2, 98]) if len(points) else (0.0, 1.0)
    shade = 1.0 - 0.6 * np.clip((points[:, 2] - near) / max(far - near, 1e-6), 0, 1)
    return points, shade[:, None] * np.asarray(GROUND_COLOR)


def _picture(capture: Seen) -> str | None:
    """Colour image, else depth as brightness, as JPEG in base64; None for a cloud."""
    if capture.depth is None:
        return None
    image = capture.rgb
    if image is None:
        depth = np.nan_to_num(capture.depth, nan=0.0)
        near, far = np.percentile(depth[depth > 0], [2, 98])
        tone = 1.0 - 0.8 * np.clip((depth - near) / max(far - near, 1e-6), 0.0, 1.0)
        grey = np.where(depth > 0, 255.0 * tone, 0.0).astype(np.uint8)
        image = np.repeat(grey[..., None], 3, axis=-1)
    stream = io.BytesIO()
    Image.fromarray(np.asarray(image)).save(
        stream, format="JPEG", quality=92, subsampling=0
    )
    return base64.b64encode(stream.getvalue()).decode()
