"""Joints that stand outside their limits, straight back inside."""

from __future__ import annotations

from collections.abc import Mapping
from math import dist

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.kinematics import LimitSet

from .context import Context
from .drive import Drive
from .limb_state import LimbState
from .pacing import cubic_time
from .result import FaultFound
from .stopping import stop_all

__all__ = ["moved_inside"]

_MET = (30.0, 10.0)
"""A load on a hand that changes by so much is a contact [N, N m]; what is carried
weighs some other way by half of that, as the hand turns."""
_FARTHEST = 0.2
"""A joint that stands farther outside is not moved [rad or m]."""
_EASY = 0.5
"""Share of the speed and acceleration of its joints that an arm uses."""
_SWAYS = 0.1
"""An arm is given so long to stand, before and after [s]."""


def moved_inside(context: Context, message: str) -> FaultFound | None:
    """Move joints that stand outside their limits straight back inside.

    A hand that meets something on the way is the end of it: tried again, it would press
    harder.

    Parameters
    ----------
    message
        What was found to be outside; for the fault, if that is too far away.
    """
    drives = {name: Drive(context, name) for name in context.limbs}
    for drive in drives.values():
        drive.read()
        if drive.limb.doubt is not None:
            return drive.limb.doubt  # it may stand elsewhere
    for name, limb in context.limbs.items():
        limits, q = limb.limits.planner, context.posture(limb)
        away = float(np.abs(np.clip(q, limits.lower, limits.upper) - q).max())
        if not np.isfinite(away) or away > _FARTHEST:
            return FaultFound("start_outside_limits", message, name)
        if away < 1e-9:
            continue
        fault = _led_inside(context, limb, drives)
        if fault is not None:
            return fault
    return None


def _led_inside(
    context: Context, limb: LimbState, drives: Mapping[str, Drive]
) -> FaultFound | None:
    """Lead one arm inside, and feel at each tick what any of the hands meets."""
    arm, limits, period = limb.limb.arm, limb.limits.planner, context.settings.period
    refused = drives[limb.name].switch_on()
    if refused is not None:
        return refused
    context.wait(_SWAYS)
    q = context.posture(limb)  # it swayed on while it was engaged
    begun = {name: drive.weighed() for name, drive in drives.items()}
    for row in _way_inside(q, limits, period):
        arm.command(row.tolist())
        context.wait(period)
        for name, drive in drives.items():
            load, before = drive.weighed(), begun[name]
            if drive.limb.doubt is not None:
                stop_all(context)
                return drive.limb.doubt
            force, torque = dist(load[:3], before[:3]), dist(load[3:], before[3:])
            if not (force <= _MET[0] and torque <= _MET[1]):
                stop_all(context)
                words = f"{force:.0f} N and {torque:.1f} N m more on the {name} "
                words += "hand on the way back inside"
                return FaultFound("ratchet", words, name)
    context.wait(_SWAYS)
    return None


def _way_inside(q: FloatArray, limits: LimitSet, period: float) -> FloatArray:
    """Postures of each tick (n, d) that lead joints (d,) straight inside their limits.

    Parameters
    ----------
    period
        Of a tick [s].
    """
    inside = np.clip(q, limits.lower, limits.upper)
    time = cubic_time(np.abs(inside - q), limits, _EASY)
    u = np.linspace(0.0, 1.0, int(np.ceil(time / period)) + 2)[:, None]
    return np.asarray(q + (3.0 - 2.0 * u) * u * u * (inside - q))
