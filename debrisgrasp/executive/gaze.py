"""Where the head looks, and that it gets there."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import SE3

from .context import Context
from .result import FaultFound

__all__ = ["look_of", "look_towards", "turn_head"]

_HEAD_TIME = 6.0
"""Within which the head is still where it was sent [s]."""
_TRIED = 31
"""Values of each joint of the head."""
_STOPS = 0.1
"""So far from its stops, for an encoder may be off [rad]."""
_INSIDE, _SHY = 0.45, 0.1
"""So far from the middle of the picture [rad] a place is seen well enough, and this
share of an angle between this look and the last is as bad as missing it by so much."""
_SHOWN = 0.01
"""A look that loses no more is good [rad]."""


def look_of(context: Context) -> Mapping[str, float]:
    """Joints of the head for a capture."""
    return {**context.model.rest, **(context.settings.look or {})}


def look_towards(
    context: Context, place: FloatArray, T_base_before: SE3 | None = None
) -> Mapping[str, float]:
    """Joints of the head that show a place (3,), and else what was seen before.

    The arm may have turned what carries the head.

    Parameters
    ----------
    T_base_before
        Pose of the camera then; None: the place comes into the middle of the picture.
    """
    look = {**look_of(context)}
    if context.robot.head is None:
        return look
    values = context.joint_values()

    def loss(name: str, value: float) -> float:
        T = context.model.T_base_camera({**values, **look, name: value})
        x, y, z = T.inverse().apply(place)
        away = float(np.arctan2(np.hypot(x, y), z))
        if T_base_before is None:
            return away
        turned = float(np.arccos(np.clip(T.R[:, 2] @ T_base_before.R[:, 2], -1, 1)))
        return max(away - _INSIDE, 0.0) + _SHY * turned

    for name in 2 * context.robot.head.joint_names:
        joint, first = context.model.tree.joints[name], look.get(name, 0.0)
        low, high = joint.lower + _STOPS, joint.upper - _STOPS
        tried = [first, *np.linspace(low, high, _TRIED)]
        if loss(name, first) > _SHOWN:
            look[name] = float(min(tried, key=lambda value: loss(name, value)))
    return look


def turn_head(context: Context, look: Mapping[str, float]) -> FaultFound | None:
    """Turn the head, and wait until it is still."""
    head = context.robot.head
    if head is None:
        return None
    head.move_to([float(look.get(name, 0.0)) for name in head.joint_names])
    end = context.now() + _HEAD_TIME
    context.wait(context.settings.period)
    while not head.is_still:
        if context.now() > end:
            words = f"the head is not still after {_HEAD_TIME:g} s"
            return FaultFound("joint_stuck", words)
        context.wait(0.02)
    return None
