"""A hand at an object, as a run recorded them: a picture of one attempt."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from PIL import Image

from debrisgrasp._arrays import BoolArray, FloatArray
from debrisgrasp.geometry import SE3, Solid, voxel_downsample
from debrisgrasp.prototypes import GripperModel

from .colors import BACKGROUND_COLOR, CHOSEN_COLOR, GROUND_COLOR
from .raster import Splats, render
from .scene import arrow, merged, point_spacing
from .view import View

__all__ = ["scene_image"]

_SIZE = (420, 300)
_DIRECTION = (0.62, -0.38, -0.68)
_SHOWN = 0.75
"""Half the edge of the box around a hand that is drawn [m]."""
_HAND = (0.22, 0.36, 0.62)
_WAY = (0.61, 0.52, 0.41)
_OVER, _THICK = 0.06, 0.008
"""So far over the highest of an object the arrow of a push is, and how thick [m]."""
_ROUNDED = 1e-4


def scene_image(
    points: FloatArray,
    hand: Mapping[str, Any],
    model: GripperModel,
    centroid: Sequence[float] | None = None,
) -> str:
    """Draw what was seen, and a hand in it; JPEG in base64.

    Parameters
    ----------
    points
        Base frame [m], shape (n, 3).
    hand
        What the record tells of it: ``preshape``, ``opening`` [m], ``pose`` (4, 4); of
        one that pushes, ``way`` (3,) [m].
    model
        Its shape.
    centroid
        Of the object, base frame [m].
    """
    T = SE3.from_matrix(np.array(hand["pose"]))
    near = np.flatnonzero(np.abs(points - T.p).max(axis=1) < _SHOWN)
    points = points[near[voxel_downsample(points[near], 0.006)]]
    solids = [s.moved(T) for s in _solids(model, hand["preshape"], hand["opening"])]
    meshes = [merged(solids, _HAND)]
    is_own = _about(points, centroid)
    if "way" in hand and is_own.any():
        start = np.append(points[is_own, :2].mean(axis=0), points[is_own, 2].max())
        start[2] += _OVER
        meshes.append(arrow(start, start + np.array(hand["way"]), _WAY, _THICK))
    colors = np.asarray(GROUND_COLOR) * np.where(points[:, 2:] > 0.02, 0.72, 1.05)
    colors[is_own] = 0.5 * colors[is_own] + 0.5 * np.asarray(CHOSEN_COLOR)
    colors = np.clip(colors, 0.0, 1.0)
    view = View.fitted(
        np.concatenate([points, *(mesh.vertices for mesh in meshes)]),
        _DIRECTION,
        _SIZE,
        margin=1.02,
    )
    splats = Splats(points, colors, 1.4 * point_spacing(points))
    drawn = render(view, [splats], meshes, background=np.array(BACKGROUND_COLOR))
    stream = io.BytesIO()
    pixels = np.rint(255.0 * np.clip(drawn.colors, 0.0, 1.0)).astype(np.uint8)
    Image.fromarray(pixels).save(stream, format="JPEG", quality=88)
    return base64.b64encode(stream.getvalue()).decode()


def _solids(model: GripperModel, preshape: str, opening: float) -> tuple[Solid, ...]:
    """Solids of a hand, with an opening that a record rounded to 0.1 mm."""
    shape = model.preshape(preshape)
    possible = float(np.clip(opening, shape.narrowest, shape.widest))
    is_rounded = abs(possible - opening) <= _ROUNDED
    return model.solids(preshape, possible if is_rounded else opening)


def _about(points: FloatArray, centroid: Sequence[float] | None) -> BoolArray:
    """Which points (n, 3) are about where the object is, (n,)."""
    if centroid is None:
        return np.zeros(len(points), dtype=bool)
    away = np.linalg.norm(points - np.array(centroid), axis=1)
    return np.asarray((away < 0.12) & (points[:, 2] > 0.02))
