"""What of the workspace no picture shows: where nobody looked, nothing is clear."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray
from debrisgrasp.geometry import DepthSight

from .context import Context

__all__ = ["never_shown", "was_shown"]

_PACE = 0.05
"""Spacing of places that must have been in a picture before the way counts as clear
[m]."""
_GAINED = 0.5
"""A look that leaves more than this share of what was missing is the last: the head
turns no farther."""


def never_shown(context: Context) -> FloatArray | None:
    """Middle of the workspace's ground that no capture shows, frame of the way [m].

    None: there is none, or the head can't turn there.
    """
    low, high = context.settings.bounds.lower, context.settings.bounds.upper
    x, y = (np.arange(a, b, _PACE) for a, b in zip(low[:2], high[:2], strict=True))
    ground = np.stack([*np.meshgrid(x, y, indexing="ij"), np.zeros((len(x), len(y)))])
    ground = ground.reshape(3, -1).T
    places = context.T_base_way.apply(ground)
    is_in = np.array([_is_in(sight, places) for sight in context.shown])
    places = places[~is_in.any(axis=0)]
    n_before = int((~is_in[:-1].any(axis=0)).sum())
    is_in_vain = len(is_in) > 1 and len(places) > _GAINED * n_before
    if context.robot.head is None or is_in_vain or not len(places):
        return None
    return np.asarray(context.T_base_way.inverse().apply(places).mean(axis=0))


def was_shown(sights: Sequence[DepthSight], place: FloatArray) -> bool:
    """Whether a place (3,), base frame [m], is in one of some pictures."""
    return any(_is_in(sight, place[None])[0] for sight in sights)


def _is_in(sight: DepthSight, points: FloatArray) -> BoolArray:
    """Which points (n, 3) are in a picture, seen or hidden, shape (n,)."""
    camera = sight.intrinsics
    uv, depth = camera.project(sight.T_base_camera.inverse().apply(points))
    is_inside = ((uv >= 0) & (uv < (camera.width, camera.height))).all(axis=1)
    return np.asarray(is_inside & (depth > 0.0))
