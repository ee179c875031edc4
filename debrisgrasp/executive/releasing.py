"""Down, open, and see that the hand is empty."""

from __future__ import annotations

from math import hypot

import numpy as np

from debrisgrasp.control import LegOutcome, TarePolicy

from .context import Context
from .drag import drive_back
from .drive import Drive
from .hanging import looked_after
from .moves import back_out, let_go, lying, put_down, to_rest
from .relief import relieve
from .result import Done, FaultFound, StepResult
from .senses import mean_wrench

__all__ = ["release", "retreat", "verify_release"]

_LOWERED = 0.12
"""How far an object is lowered at most [m]."""
_STANDING = 0.24
_CAUGHT = 40.0
"""On a hand that should be empty, this force means that it isn't [N]."""
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
        T_now = T if context.dragged is None else context.dragged @ T
        context.dropped.append(lying(T_now, points))
    context.cycle.is_removed = False
    context.released, context.is_in_pile = held, held.arm
    return Done({"place": np.round(T.p, 3).tolist()})


def _shaken_open(context: Context) -> FaultFound | None:
    """Open as wide as the hand goes, and shake once."""
    held = context.held
    assert held is not None
    limb = context.limbs[held.arm]
    motion = context.cycle.motion
    preshape = (
        next(iter(limb.hand.preshapes)) if motion is None else (motion.grasp.preshape)
    )
    fault = let_go(context, limb.hand.preshape(preshape).widths[1])
    fault = fault or relieve(context, limb.name)
    drive = Drive(context, limb.name)
    for way in (_SHAKE, -_SHAKE):
        if fault is not None:
            return fault
        speed = context.settings.lift_speed
        end = drive.leg([0.0, 0.0, way], speed=speed, tare=TarePolicy.SESSION)
        fault = end if isinstance(end, FaultFound) else None
    return fault


def verify_release(context: Context) -> StepResult:
    """Rise a little, and weigh: nothing may hang on the hand."""
    held = context.released
    assert held is not None
    limb, drive = context.limbs[held.arm], Drive(context, held.arm)
    T = limb.pose(context.posture(limb))
    backed = drive.leg(
        -0.04 * T.R[:, 2],
        speed=0.5 * context.settings.lift_speed,
        tare=TarePolicy.SESSION,
        until=lambda load: hypot(*load[:3]) > _CAUGHT,
    )
    if isinstance(backed, FaultFound):
        return backed
    if backed.outcome is LegOutcome.CONTACT:
        words = f"{hypot(*drive.load[:3]):.0f} N as the open hand rises: it is caught"
        context.held = held
        return FaultFound("not_released", words, held.arm)
    readings = drive.stand(_STANDING)
    if isinstance(readings, FaultFound):
        return readings
    q = context.posture(limb).tolist()
    load = limb.loads.load_ee(
        mean_wrench(readings).tolist(), limb.kinematics.pose(q)[0]
    )
    weight = drive.carried(load)
    openings = drive.fingers().openings
    is_open = min(openings) >= min(held.state.held_openings or (0.0,))
    values = {"weight": weight, "opening": min(openings)}
    if not is_open or weight > 0.5 * context.settings.empty_load:
        words = f"{weight:.1f} N still hang on the hand"
        if not is_open:
            words = f"a finger is open by {1e3 * min(openings):.0f} mm only; {words}"
        context.held = held
        return FaultFound("not_released", words, held.arm, values)
    context.cycle.is_removed = True
    context.n_removed += 1
    return Done({"weight": round(weight, 2)})


def retreat(context: Context) -> StepResult:
    """Draw the hand back, and bring the arm to rest."""
    arm = context.cycle.motion.arm if context.cycle.motion else None
    if arm is None:
        return Done()
    limb = context.limbs[arm]
    fault, n_seen = back_out(context, arm), 0
    if fault is None and context.cycle.is_removed:
        n_seen = looked_after(context, arm, max(limb.limb.gripper.read().openings))
    fault = fault or to_rest(context, arm) or drive_back(context)
    if fault is not None:
        return fault
    limb.limb.arm.disengage()
    context.is_in_pile = None
    return Done({"removed": context.n_removed, "points": n_seen})
