"""Down, open, and see that the hand is empty."""

from __future__ import annotations

from math import hypot

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.control import LegOutcome

from .caught import felt_out, nudged, pushed_to
from .context import Context
from .drive import Drive
from .grasping import STANDING, aside_of
from .laying import put_down
from .moves import CAUGHT, back_out, let_go
from .obstacles import lying
from .relief import relieve
from .resting import put_away
from .result import Done, FaultFound, LegEnd, StepResult

__all__ = ["release", "retreat", "verify_release"]

_LOWERED = 0.12
"""How far an object is lowered at most [m]."""
_GROWN = 50.0
"""More than while a hand brakes [N]: something else pushes, or the sensor lies."""
_OUT = 0.04
"""How far an open hand is drawn back before it is weighed [m]."""
_ASIDE, _ASIDES = 0.006, 5
"""Where the side of a finger is caught it goes aside by so much [m], so many times."""
_UP = np.array([0.0, 0.0, 1.0])
_SHAKE = 0.03
"""How far a hand that does not come free is shaken up and down [m]."""


def release(context: Context) -> StepResult:
    """Lower the object until it lies, and open."""
    held = context.held
    if held is None:
        return Done({"already": True})
    limb = context.limbs[held.arm]
    points = held.points_hand
    tries = sum(state is context.state for state in context.cycle.reached)
    fault = _shaken_open(context) if tries > 1 else put_down(context, _LOWERED)
    if fault is not None:
        return fault
    T = limb.pose(context.posture(limb))
    # Let go a second time it lies, or nearly, where it was let go first.
    if len(points) and context.released is not held:
        body = lying(T, points)
        context.memory.dropped.append(body)
        context.cycle.place = body.mean(axis=0)
    context.cycle.hung = None  # what is caught in the hand now lies where it belongs
    context.cycle.is_removed = False
    context.released, context.is_in_pile = held, held.arm
    # As the base stands once it is back.
    place = T.p if context.dragged is None else context.dragged.apply(T.p)
    return Done({"place": np.round(place, 3).tolist()})


def _shaken_open(context: Context) -> FaultFound | None:
    """Lower the hand off what it hooks, open as wide as it goes, and shake once."""
    held = context.held
    assert held is not None
    limb, drive = context.limbs[held.arm], Drive(context, held.arm)
    with context.fingers_as_they_are():
        fault = _nudged(drive, -_SHAKE * _UP)
    fault = fault or let_go(context, limb.hand.preshape(limb.preshape).widest)
    fault = fault or relieve(context, limb.name)
    return fault or _nudged(drive, _SHAKE * _UP) or _nudged(drive, -_SHAKE * _UP)


def _nudged(drive: Drive, way: FloatArray) -> FaultFound | None:
    """Move a hand that is caught by an offset (3,) [m], until it is pushed harder."""
    end = nudged(drive, way)
    return end if isinstance(end, FaultFound) else None


def _drawn_out(drive: Drive, axis: FloatArray) -> LegEnd | FaultFound:
    """Draw the open hand back along its axis (3,); aside where its side is caught."""
    left = _OUT
    for n_before in range(_ASIDES + 1):
        end = pushed_to(drive, -left * axis, CAUGHT)
        if isinstance(end, FaultFound) or end.outcome is not LegOutcome.CONTACT:
            return end
        left, aside = end.left, aside_of(drive.push(), axis)
        if aside is None or n_before == _ASIDES:
            return end
        fault = _nudged(drive, _ASIDE * aside)
        if fault is not None:
            return fault
    return end


def verify_release(context: Context) -> StepResult:
    """Rise a little, and weigh: nothing may hang on the hand."""
    held = context.released
    assert held is not None
    limb, drive = context.limbs[held.arm], Drive(context, held.arm)
    backed = _drawn_out(drive, limb.pose(context.posture(limb)).R[:, 2])
    if isinstance(backed, FaultFound):
        return backed
    if backed.outcome is LegOutcome.CONTACT:
        begun = max(hypot(*drive.load[:3]), CAUGHT)
        stood = drive.stand(STANDING)  # does it grow while nothing moves?
        if isinstance(stood, FaultFound):
            return stood
        load = hypot(*drive.weighed()[:3])
        if load > begun + _GROWN:
            words = f"{load:.0f} N on an open hand that was stopped at {begun:.0f} N"
            return FaultFound("ratchet", words + ": not its own motion", held.arm)
        words = f"{load:.0f} N as the open hand rises: it is caught"
        context.held = held
        return FaultFound("not_released", words, held.arm)
    readings = drive.stand(STANDING)
    if isinstance(readings, FaultFound):
        return readings
    weight = drive.carried(drive.mean_load(readings))
    openings = drive.fingers().openings
    is_open = min(openings) >= min(held.state.held_openings or (0.0,))
    values = {"weight": weight, "opening": min(openings)}
    if not is_open or weight > 0.5 * context.settings.empty_load:
        words = f"{weight:.1f} N still hang on the hand"
        if not is_open:
            words = f"a finger is open by {1e3 * min(openings):.0f} mm only; {words}"
        context.held = held
        return FaultFound("not_released", words, held.arm, values)
    context.count_removal()
    return Done({"weight": round(weight, 2)})


def retreat(context: Context) -> StepResult:
    """Draw the hand back, and bring the arm to rest."""
    arm = context.cycle.motion.arm if context.cycle.motion else None
    if arm is None:
        return Done()
    # After a fault it may have been cleared up, and is at rest already.
    fault = back_out(context, arm) if context.is_in_pile == arm else None
    if fault is not None and fault.fault == "not_released":
        fault = felt_out(context, arm)
    place = context.cycle.place if context.cycle.is_removed else None
    fault = fault or put_away(context, arm, place)
    if fault is not None:
        return fault
    context.is_in_pile = None
    return Done({"removed": context.n_removed})
