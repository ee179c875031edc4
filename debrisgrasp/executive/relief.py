"""Out of a load that is over its limit, along ways on which it falls."""

from __future__ import annotations

from dataclasses import replace
from math import hypot

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._physics import GRAVITY
from debrisgrasp.control import TarePolicy
from debrisgrasp.kinematics import LimitSet

from .context import Context
from .drive import Drive
from .result import FaultFound
from .states import State

__all__ = ["doubted", "heaviest", "relieve", "share_of", "standing_load", "with_room"]

_TIGHT = 0.85
"""Share of a limit above which a hand is drawn out before anything else."""
_EASED = 0.5
"""Share at which it is free enough."""
_STEP = 0.002
"""Of the hand, after which the load is looked at again [m]."""
_STEPS = 30
_SPEED = 0.03
"""Without a load [m/s]; near its limit a leg has a tenth of it."""
_FALLS = 0.99
"""A step that leaves more than this share of the load was the wrong way."""
_REAL = 0.97
"""A step back that leaves less than this share of a force shows that it is real."""
_GROWS = 1.5
"""A load that is so much more has grown [N]."""
_NOISE = (7.0, 2.0)
"""By so much a load may seem to grow [N, N m]."""
_MOST = 4.0
"""Beyond this multiple of a limit nothing is moved any more."""
_EXPECTED = ("too_heavy", "ratchet", "early_contact")
"""How a step may end on which the load grows."""
_BEYOND = 1.25
"""No object weighs so many times what the heaviest may."""
_LOOK = 0.04
"""[s]."""


def relieve(
    context: Context, arm: str, tight: float = _TIGHT, back: FloatArray | None = None
) -> FaultFound | None:
    """Give way in small steps while the load on a hand is near or over its limit.

    Each step goes back where the hand came from, if that is known, where the load
    pushes, or out of the pile. It is stopped at once
    if the load grows beyond what it was when the step began; a way on which it does not
    fall is not tried again.

    Parameters
    ----------
    tight
        Share of a limit above which the hand gives way.
    back
        The way by which it came to what it touches, (3,) [m]; None: that from where it
        gripped, if it did.
    """
    limb, drive = context.limbs[arm], Drive(context, arm)
    limits = drive.limits
    load = standing_load(context, drive)
    if isinstance(load, FaultFound) or share_of(load, limits) < tight:
        return None
    if share_of(load, limits) > _MOST:
        words = f"the force on the hand is {hypot(*load[:3]):.0f} N already"
        return FaultFound("ratchet", words, arm)
    if context.held is None and drive.carried(tuple(load)) > heaviest(context):
        load = (
            _stepped_back(context, drive, load)
            if back is None
            else _drawn_back(context, drive, load, back)
        )
        if isinstance(load, FaultFound):
            return load
    n_failed = 0
    for _ in range(_STEPS):
        before = share_of(load, limits)
        if before < _EASED * tight / _TIGHT:
            return None
        T = limb.pose(context.posture(limb))
        force = T.R @ load[:3]
        push = force / max(float(np.linalg.norm(force)), 1e-9)
        ways = [push, -T.R[:, 2], 0.5 * (push - T.R[:, 2])]
        if back is not None:
            ways.insert(0, back / np.linalg.norm(back))
        if n_failed == len(ways):
            break
        after = _stepped(context, drive, ways[n_failed], load)
        if isinstance(after, FaultFound):
            return after
        load = after
        # Nothing was where it came from, whatever it rubs on, on the way there.
        is_back = back is not None and n_failed == 0
        if share_of(load, limits) > (1.0 if is_back else _FALLS * before):
            n_failed += 1
    if share_of(load, limits) < 1.0:
        return None
    words = f"the force on the hand is {hypot(*load[:3]):.0f} N already, and no way "
    return FaultFound("ratchet", words + "eases it", arm)


def _stepped(
    context: Context, drive: Drive, way: FloatArray, load: FloatArray
) -> FloatArray | FaultFound:
    """Load (6,) after a step along a way (3,), begun at a load (6,)."""
    end = drive.leg(
        _STEP * way,
        speed=_SPEED,
        tare=TarePolicy.SESSION,
        limits=with_room(drive.limits, load),
    )
    if isinstance(end, FaultFound) and end.fault not in _EXPECTED:
        return end
    arm = drive.limb.limb.arm
    if arm.is_stopped:
        context.wait(_LOOK)
        arm.reset()
    return standing_load(context, drive)


def _drawn_back(
    context: Context, drive: Drive, load: FloatArray, back: FloatArray
) -> FloatArray | FaultFound:
    """Load (6,) on a hand drawn back (3,) while it falls, if that is what can be.

    Nothing was there as it came, just now: what does not fall on that way is no load.
    """
    size = float(np.linalg.norm(back))
    for _ in range(int(size / _STEP)):
        after = _stepped(context, drive, back / size, load)
        if isinstance(after, FaultFound):
            return after
        if hypot(*after[:3]) >= _REAL * hypot(*load[:3]):
            break
        load = after
    weight = drive.carried(tuple(load))
    if weight <= heaviest(context):
        return load
    return doubted(context, drive.limb.name, weight)


def _way_back(drive: Drive) -> FloatArray:
    """Way (3,) to where a hand gripped [m]; zero if it did not."""
    context, limb = drive.context, drive.limb
    motion, reached = context.cycle.motion, context.cycle.reached
    was_there = State.CLOSE in reached and State.TRANSPORT not in reached
    if motion is None or motion.arm != limb.name or not was_there:
        return np.zeros(3)
    return motion.grasp.T_base_hand.p - limb.pose(context.posture(limb)).p


def _stepped_back(
    context: Context, drive: Drive, load: FloatArray
) -> FloatArray | FaultFound:
    """Load (6,) after a step back to where the hand gripped, if it is real.

    Then the load falls on that step, and grows again on the way on. Else the sensor is
    doubted: what looks like giving way would press the hand into what it stands on.
    """
    back = _way_back(drive)
    size = float(np.linalg.norm(back))
    if size > _STEP:
        after = _stepped(context, drive, back / size, load)
        if isinstance(after, FaultFound):
            return after
        if hypot(*after[:3]) < _REAL * hypot(*load[:3]):
            return _hooked(context, drive, back / size, after, load)
    return doubted(context, drive.limb.name, drive.carried(tuple(load)))


def _hooked(
    context: Context,
    drive: Drive,
    way: FloatArray,
    load: FloatArray,
    before: FloatArray,
) -> FloatArray | FaultFound:
    """Load (6,) one step along a way (3,) from where it was before, if it grows there.

    It was less after that step, but also falls where the hand is pressed on something
    and the sensor lies. Then it is no more a step to the other side of where it was.
    """
    most = hypot(*before[:3])
    for _ in range(2):
        after = _stepped(context, drive, -way, load)
        if isinstance(after, FaultFound):
            return after
        load = after
        if hypot(*load[:3]) > most + _GROWS:
            return _stepped(context, drive, way, load)
    weight = drive.carried(tuple(load))
    if weight <= heaviest(context):
        return load  # here a sensor that lies would tell what it told before
    return doubted(context, drive.limb.name, weight)


def heaviest(context: Context) -> float:
    """Weight that nothing has which may hang on a hand that holds nothing [N]."""
    return _BEYOND * context.settings.max_mass * GRAVITY


def doubted(context: Context, arm: str, weight: float) -> FaultFound:
    """Doubt the sensor of an empty hand by a weight [N] that nothing has.

    What looks like giving way to it would press the hand into what it stands on.
    """
    words = f"{weight:.0f} N hang on an open hand, more than the "
    words += f"{context.settings.max_mass:g} kg that may: its sensor is wrong"
    return FaultFound("ratchet", words, arm, {"force": weight})


def with_room(limits: LimitSet, load: FloatArray) -> LimitSet:
    """Limits that a load (6,) [N, N m] may grow to from where it stands now.

    No motion out of a load near a limit would go farther than its noise.
    """
    return replace(
        limits,
        force=max(limits.force, hypot(*load[:3]) + _NOISE[0]),
        torque=max(limits.torque, hypot(*load[3:]) + _NOISE[1]),
    )


def standing_load(context: Context, drive: Drive) -> FloatArray | FaultFound:
    """Mean load at the hand, its axes [N, N m], shape (6,); the arm stands."""
    readings = []
    for _ in range(max(3, round(_LOOK / drive.period))):
        context.wait(drive.period)
        readings.append(drive.read())
    load = np.array(drive.mean_load(readings))
    if not np.isfinite(load).all():
        return FaultFound("wrench_nan", "the wrench is not a number", drive.limb.name)
    return load


def share_of(load: FloatArray, limits: LimitSet) -> float:
    """Tell which share of its limits a hand bears with a load (6,) [N, N m]."""
    return max(hypot(*load[:3]) / limits.force, hypot(*load[3:]) / limits.torque)
