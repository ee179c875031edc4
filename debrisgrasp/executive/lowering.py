"""Down until something else bears what a hand holds."""

from __future__ import annotations

from dataclasses import replace
from math import hypot

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.control import LegOutcome, TarePolicy
from debrisgrasp.control._rigid import Wrench
from debrisgrasp.kinematics import LimitSet

from .drive import Drive
from .pacing import lying_speed
from .relief import standing_load, with_room
from .result import FaultFound, LegEnd

__all__ = ["lower", "lowering_limits", "lowering_speed"]

_SLOWEST = 5e-3
"""Nothing is lowered more slowly [m/s], though what is very long may then press with
more than is left up to the limit."""
_FIRST = 10
"""Looks at the weight before any may count as less."""
_LOWERED_UP_TO = 0.95
"""Share of the controller's limits up to which what hangs is lowered."""


def lower(drive: Drive, depth: float) -> LegEnd | FaultFound:
    """Go down [m] until something else bears a good part of the weight on the hand.

    Loaded to its limit already, the hand can't go down: it is blocked.
    """
    least: list[float] = []

    def lies(load: Wrench) -> bool:
        least.append(drive.carried(load))
        if len(least) < _FIRST:
            return False
        weight = sum(least[:_FIRST]) / _FIRST
        return sum(least[-5:]) < 5.0 * (weight - max(4.0, 0.3 * weight))

    load = standing_load(drive.context, drive)
    if isinstance(load, FaultFound):
        return load
    end = drive.leg(
        [0.0, 0.0, -depth],
        speed=lowering_speed(drive, load),
        tare=TarePolicy.SESSION,
        until=lies,
        limits=lowering_limits(drive, load),
    )
    if isinstance(end, FaultFound) and end.fault == "ratchet":
        return LegEnd(LegOutcome.BLOCKED, 0.0, depth)
    return end


def lowering_speed(drive: Drive, load: FloatArray) -> float:
    """Speed at which what a hand holds may come to lie on something [m/s].

    Parameters
    ----------
    load
        On the hand as it begins [N, N m], shape (6,).
    """
    held = drive.context.held
    points = np.zeros((0, 3)) if held is None else held.points_hand
    reach = float(np.linalg.norm(points, axis=1).max(initial=0.0))
    speed = lying_speed(_most(drive).torque - hypot(*load[3:]), reach, drive.period)
    return max(min(drive.context.settings.lift_speed, speed), _SLOWEST)


def _most(drive: Drive) -> LimitSet:
    """Limits up to which what hangs is lowered."""
    return drive.limb.limits.controller.scaled(load=_LOWERED_UP_TO)


def lowering_limits(drive: Drive, load: FloatArray) -> LimitSet:
    """Limits up to which what a hand holds is put down.

    What is too heavy hangs near the usual ones already.

    Parameters
    ----------
    load
        On the hand as a leg begins [N, N m], shape (6,).
    """
    limits, most = with_room(drive.limits, load), _most(drive)
    return replace(
        limits,
        force=min(limits.force, most.force),
        torque=min(limits.torque, most.torque),
    )
