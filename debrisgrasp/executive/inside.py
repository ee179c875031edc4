"""Joints led slowly to where an arm may move again, feeling what its hand meets."""

from __future__ import annotations

from math import dist

import numpy as np

from debrisgrasp._arrays import FloatArray

from .context import Context, LimbState
from .drive import Drive
from .result import FaultFound
from .stopping import stop_all

__all__ = ["led", "moved_inside"]

_MET = (30.0, 10.0)
"""A load on a hand that changes by so much is a contact [N, N m]; what is carried
weighs some other way by half of that, as the hand turns."""
_FARTHEST = 0.2
"""A joint that stands farther outside is not moved [rad or m]."""
_SLOW = 0.15
"""A joint moves by so much in a second, on average, at most [rad/s or m/s]."""
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
    for name in context.limbs:
        drive = Drive(context, name)
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
        words = "on the way back inside"
        fault = led(context, limb, limits.lower, limits.upper, words)
        if fault is not None:
            return fault
    return None


def led(
    context: Context, limb: LimbState, lower: FloatArray, upper: FloatArray, where: str
) -> FaultFound | None:
    """Lead one arm into a box of postures, and feel at each tick what a hand meets.

    Parameters
    ----------
    lower, upper
        Of the box, shape (d,) each.
    where
        Of the way, in words; for the fault.
    """
    drives = [Drive(context, name) for name in context.limbs]
    arm, limits, period = limb.limb.arm, limb.limits.planner, context.settings.period
    arm.engage()
    context.wait(_SWAYS)
    q = context.posture(limb)  # it swayed on while it was engaged
    goal = np.clip(q, lower, upper)
    # So long that the joints begin and end with half of their acceleration.
    away = float(np.abs(goal - q).max())
    time = max(np.sqrt(12.0 * away / float(limits.acceleration.min())), away / _SLOW)
    n = int(np.ceil(time / period)) + 1
    begun = [drive.weighed() for drive in drives]
    for k in range(n + 1):
        share = (k / n) ** 2 * (3.0 - 2.0 * k / n)
        arm.command((q + (goal - q) * share).tolist())
        context.wait(period)
        for drive, before in zip(drives, begun, strict=True):
            load = drive.weighed()
            if drive.limb.doubt is not None:
                stop_all(context)
                return drive.limb.doubt
            force, torque = dist(load[:3], before[:3]), dist(load[3:], before[3:])
            if not (force <= _MET[0] and torque <= _MET[1]):
                stop_all(context)
                name = drive.limb.name
                words = f"{force:.0f} N and {torque:.1f} N m more on the {name} "
                return FaultFound("ratchet", f"{words}hand {where}", name)
    context.wait(_SWAYS)
    return None
