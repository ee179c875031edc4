"""Drive to where the arms reach better, when nothing more can be got from here."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.robot import Base

from .context import Context
from .driving import driven

__all__ = ["FARTHEST", "repositioned", "stepped_back"]

_STANDS = (0.95, 0.8, 1.1)
"""Ahead of the base an arm reaches most in the first: there an object is brought to; in
the others it is seen and reached otherwise [m]."""
_LEAST, _MOST = 0.08, 0.35
"""Ways worth driving, and as far as is driven without another look [m]."""
FARTHEST = 0.7
"""From where the task began, ahead or back [m]."""
_ROOM, _BESIDE = 0.08, 0.045
"""In front of the base, and beside it, that stays free [m]."""
_LOW = 0.05
"""What is higher than this stands in the way of the base [m]."""
_STEP, _SHOWN, _STILL = 0.3, 0.02, 0.8
"""So far back the strip before the tracks is seen [m]; less than this share of the
workspace may stay unseen; and where more than this share of what was missing still is,
it helps no more."""
_SPEED = 0.08
"""[m/s]."""


def repositioned(context: Context, places: Sequence[FloatArray]) -> float:
    """Drive ahead or back so that the first place that this helps is reached better.

    Not to where nothing could be got either, since something was removed last.
    Everything that is remembered by its place is taken along. Arms are at rest.

    Parameters
    ----------
    places
        Middles of objects, base frame [m], each (3,).

    Returns
    -------
    float
        How far the base went ahead [m]; 0 if that helps none, or may not be.
    """
    base = context.base
    if base is None or context.n_moves >= context.settings.repositions:
        return 0.0
    now = float(-context.T_base_way.p[0])
    context.in_vain.append((context.n_removed, now))
    stood = [at for n, at in context.in_vain if n == context.n_removed]
    room = _room(context)
    ways = [
        _way(context, float(place[0]) - stand, room)
        for stand in _STANDS
        for place in places
    ]
    is_new = (way for way in ways if min(abs(now + way - at) for at in stood) >= _LEAST)
    way = next(is_new, 0.0)
    if way == 0.0:
        return 0.0
    return _driven(context, base, way)


def stepped_back(context: Context, missing: float) -> float:
    """Drive back where a part of the workspace is in no picture, as before the tracks.

    Not if the last step back showed nothing of it.

    Parameters
    ----------
    missing
        Share of the workspace's ground.

    Returns
    -------
    float
        How far the base went ahead [m], below 0; 0 if it may not go.
    """
    base = context.base
    if base is None or context.n_moves >= context.settings.repositions:
        return 0.0
    gone = float(-context.T_base_way.p[0])
    way = max(-_STEP, -FARTHEST - gone)
    if missing < _SHOWN or missing > _STILL * context.missing or -way < _LEAST:
        return 0.0
    context.missing = missing
    return _driven(context, base, way)


def _driven(context: Context, base: Base, way: float) -> float:
    """Drive straight ahead [m]; how far it went."""
    moved = driven(context, base, _SPEED, ahead=way)
    context.n_moves += 1
    context.marks.begin_anew()
    return float(moved.p[0])


def _way(context: Context, wanted: float, room: float) -> float:
    """Tell how much of a way ahead may be driven [m], if so much of it is free."""
    gone = float(-context.T_base_way.p[0])
    way = float(np.clip(wanted, max(-_MOST, -FARTHEST - gone), _MOST))
    return min(way, FARTHEST - gone, room)


def _room(context: Context) -> float:
    """Tell how far ahead the base meets nothing that is known to be there [m]."""
    seen = context.cycle.seen
    assert seen is not None
    points = np.concatenate([seen.cloud.points, *context.memory.surfaces])
    front, half_width = _front(context)
    is_ahead = (np.abs(points[:, 1]) < half_width + _BESIDE) & (points[:, 0] > front)
    ahead = points[is_ahead & (points[:, 2] > _LOW), 0]
    if not len(ahead):
        return _MOST
    return max(float(np.quantile(ahead, 0.01)) - front - _ROOM, 0.0)


def _front(context: Context) -> tuple[float, float]:
    """Tell where the front of the base is, and how far it reaches to a side [m]."""
    boxes = [solid.bounds for solid in context.model.fixed_solids]
    front = max((float(box.upper[0]) for box in boxes), default=0.0)
    beside = [max(-float(box.lower[1]), float(box.upper[1])) for box in boxes]
    return front, max(beside, default=0.0)
