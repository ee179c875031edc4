"""What of the workspace no picture shows: where nobody looked, nothing is clear."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from debrisgrasp._arrays import BoolArray, FloatArray
from debrisgrasp.geometry import DepthSight

from .context import Context
from .gaze import look_towards

__all__ = ["NeverShown", "never_shown", "was_shown"]

_PACE = 0.05
"""Spacing of places that must have been in a picture before the way counts as clear
[m]."""
_AROUND = 0.4
"""What is missing so near to one place is looked at together [m]."""
_FEWER = 20
"""So many places around one that the head can't show are looked for no more."""
_ALL = 0.9
"""Share of an object's points that is all of it, but for holes in the depth."""
_GAINED = 0.05
"""A look that shows no more than this share of what was missing is the last: the head
does not turn there."""


class NeverShown(NamedTuple):
    """Ground of the workspace that no capture shows."""

    share: float
    """Of all of it."""
    middle: FloatArray | None
    """Of some of it, frame of the way [m], shape (3,); None: there is none, or the head
    can't turn there."""


def never_shown(context: Context) -> NeverShown:
    """Find what no capture shows, and where to look next.

    What is missing on both sides is looked at one after the other, the larger part
    first.
    """
    is_in, places = _looked_at(context)
    is_missing = ~is_in.any(axis=0)
    share = float(1.0 - is_in.any(axis=0).mean())
    n_before = int((~is_in[:-1].any(axis=0)).sum())
    is_in_vain = len(is_in) > 1 and is_missing.sum() >= (1.0 - _GAINED) * n_before
    if context.robot.head is None or is_in_vain:
        return NeverShown(share, None)
    return NeverShown(share, _next_middle(context, places[is_missing]))


def _next_middle(context: Context, places: FloatArray) -> FloatArray | None:
    """Middle of many of some places (n, 3), base frame, that the head can show."""
    while len(places) >= _FEWER:
        tree = cKDTree(places)
        counts = tree.query_ball_point(places, _AROUND, return_length=True)
        together = tree.query_ball_point(places[np.argmax(counts)], _AROUND)
        middle = places[together].mean(axis=0)
        if _can_show(context, middle):
            return np.asarray(context.T_base_way.inverse().apply(middle))
        places = np.delete(places, tree.query(middle, _FEWER)[1], axis=0)
    return None


def was_shown(sights: Sequence[DepthSight], points: FloatArray) -> bool:
    """Whether pictures have depth at nearly all of an object's points (n, 3).

    What the border of one cut off was not judged by that. Points are in the base frame
    [m].
    """
    x, y, z = points.T.astype(np.float32)
    is_shown = np.zeros(len(points), dtype=bool)
    for sight in sights:
        is_shown |= _is_in(sight, points) & np.isfinite(sight.clearance(x, y, z))
    return bool(is_shown.mean() > _ALL)


def _looked_at(context: Context) -> tuple[BoolArray, FloatArray]:
    """Which capture shows which ground, (k, n), and its places, base frame (n, 3)."""
    low, high = context.settings.bounds.lower, context.settings.bounds.upper
    x, y = (np.arange(a, b, _PACE) for a, b in zip(low[:2], high[:2], strict=True))
    ground = np.stack([*np.meshgrid(x, y, indexing="ij"), np.zeros((len(x), len(y)))])
    places = context.T_base_way.apply(ground.reshape(3, -1).T)
    return np.array([_is_in(sight, places) for sight in context.shown]), places


def _can_show(context: Context, place: FloatArray) -> bool:
    """Whether the head can turn so that a place (3,), base frame [m], is shown."""
    values = {**context.joint_values(), **look_towards(context, place)}
    T_base_camera = context.model.T_base_camera(values)
    turned = replace(context.shown[-1], T_base_camera=T_base_camera)
    return bool(_is_in(turned, place[None])[0])


def _is_in(sight: DepthSight, points: FloatArray) -> BoolArray:
    """Which points (n, 3) are in a picture, seen or hidden, shape (n,)."""
    camera = sight.intrinsics
    uv, depth = camera.project(sight.T_base_camera.inverse().apply(points))
    is_inside = ((uv >= 0) & (uv < (camera.width, camera.height))).all(axis=1)
    return np.asarray(is_inside & (depth > 0.0))
