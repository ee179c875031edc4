"""To the object."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.control import (
    REFERENCE_SAMPLES,
    ContactGuard,
    LegOutcome,
    SafetyConfig,
    TarePolicy,
    reference_wrench,
)
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import LimitSet
from debrisgrasp.motion import UnknownSpace
from debrisgrasp.pipeline import GraspMotion
from debrisgrasp.planning import Grasp

from .context import Context
from .drive import Drive
from .fingers import open_hand
from .limb_state import LimbState
from .moves import planned
from .obstacles import room_for
from .result import Done, FaultFound, LegEnd, StepResult

__all__ = [
    "STANDING",
    "approach",
    "aside_of",
    "motion_of",
    "opening_of",
    "pregrasp",
    "require_room",
    "switch",
]

_AT_GRASP = 0.02
"""A touch so near to the end of the approach is the object between the fingers [m]."""
_ASIDE, _BACK_OFF = 0.006, 0.006
"""Touched by a slanting side before that, the hand goes aside, and back [m] ..."""
_ASIDES = 5
"""... so many times."""
_SLANT = 0.25
"""Share of a push across the approach that makes it slanting."""
STANDING = 0.24
"""How long an arm stands while forces are averaged [s]."""
_GUARD = ContactGuard(force=50.0)
_LEAST_TORQUE = 4.0
"""Less than that is in the noise of a touch [N m]."""
_SLOWEST = 0.002
"""An approach that may only be slower than this takes too long [m/s]."""


def pregrasp(context: Context) -> StepResult:
    """Take the preshape, and go to where the approach begins."""
    motion = motion_of(context)
    limb, drive = context.limbs[motion.arm], Drive(context, motion.arm)
    grasp = motion.grasp
    fault = open_hand(drive, grasp.preshape, opening_of(limb, grasp))
    if fault is not None:
        return fault
    reach = motion.reach.trajectory
    assert reach is not None
    q = context.posture(limb)
    if np.abs(q - reach.q[0]).max() > 0.01:
        # Something happened on the way: the motion is planned anew from here.
        space = room_for(context, [limb], unknown=UnknownSpace.HIDDEN)
        found = planned(context, limb, reach.q[-1], space)
        if isinstance(found, FaultFound):
            return found
        assert found.trajectory is not None
        reach = found.trajectory
    fault = drive.follow(reach, pace=context.cycle.speed)
    if fault is not None:
        return fault
    context.is_in_pile = motion.arm
    return Done({"seconds": round(reach.duration, 3)})


def switch(context: Context) -> StepResult:
    """Hand the arm over to force control: read back, standing, and unloaded."""
    motion = motion_of(context)
    limb, drive = context.limbs[motion.arm], Drive(context, motion.arm)
    arm = limb.limb.arm
    arm.disengage()
    fault = drive.engage()
    if fault is not None:
        return fault
    before = context.posture(limb)
    readings = drive.stand(STANDING, at_least=REFERENCE_SAMPLES)
    if isinstance(readings, FaultFound):
        return readings
    moved = float(np.abs(context.posture(limb) - before).max())
    if moved > 0.01 or not arm.is_engaged:
        arm.disengage()
        words = f"the arm moved by {moved:.3f} rad or m while it was handed over"
        return FaultFound("controller_refuses", words, limb.name)
    loads = []
    for reading in readings:
        q = np.asarray(reading.q, dtype=np.float64).tolist()
        wrench = np.asarray(reading.wrench_ft, dtype=np.float64).tolist()
        loads.append(limb.loads.load_ee(wrench, limb.kinematics.pose(q)[0]))
    try:
        # At the palm, noise of the force is noise of the torque by the lever between.
        lever = float(np.linalg.norm(limb.loads.T_ee_ft.p))
        force, torque = (2.0 * noise for noise in limb.loads.sensor_noise)
        reference = reference_wrench(
            loads, max_sigma_force=force, max_sigma_torque=torque + force * lever
        )
    except InputError as error:
        return FaultFound("controller_refuses", str(error), limb.name)
    force = float(np.linalg.norm(reference[:3]))
    if force > context.settings.empty_load + 4.0:
        words = f"an empty hand in free space bears {force:.1f} N"
        has_jumped = force > SafetyConfig().jump_force
        name = "bias_jump" if has_jumped else "bias_drift"
        return FaultFound(name, words, limb.name, {"force": force})
    return Done({"force": round(force, 2)})


def require_room(limits: LimitSet, load_share: float) -> None:
    """Raise `InputError` if limits leave no room between a touch and too much of it."""
    used = (
        f" Of the limit {100 * load_share:.0f} % are used, see TaskSettings.load_share."
    )
    if limits.torque * load_share < _LEAST_TORQUE:
        raise InputError(
            "limits.torque",
            got=f"{limits.torque:g} N m",
            expected=f"{_LEAST_TORQUE / load_share:.0f} N m or more",
            mend="A touch may turn the hand by that before the arm stands." + used,
        )
    if _GUARD.largest_speed(limits.scaled(load=load_share)) < _SLOWEST:
        least = _GUARD.force + _GUARD.stiffness * _GUARD.reaction_time * _SLOWEST
        raise InputError(
            "limits.force",
            got=f"{limits.force:g} N",
            expected=f"{least / load_share:.0f} N or more",
            mend="A touch is felt at 50 N, and grows until the arm stands." + used,
        )


def approach(context: Context) -> StepResult:
    """Go straight in; stop at the first touch."""
    motion = motion_of(context)
    drive, settings = Drive(context, motion.arm), context.settings
    goal, shift = motion.grasp.T_base_hand, np.zeros(3)
    speed = min(settings.approach_speed, _GUARD.largest_speed(drive.limits))
    end: LegEnd | FaultFound
    for n_aside in range(_ASIDES + 1):
        aim = SE3.from_parts(goal.R, goal.p + shift)
        end = drive.leg(aim, speed=speed, guard=_GUARD)
        if isinstance(end, FaultFound):
            # Still pressed too hard by what it met before to go on.
            is_pressed = n_aside > 0 and end.fault == "ratchet"
            return replace(end, fault="early_contact") if is_pressed else end
        if end.outcome is LegOutcome.DONE or end.left <= _AT_GRASP:
            facts = {"outcome": end.outcome.value, "left": round(end.left, 4)}
            return Done({**facts, "shift_mm": np.round(1e3 * shift, 1).tolist()})
        aside = aside_of(drive.push(), goal.R[:, 2])
        if end.outcome is not LegOutcome.CONTACT or aside is None or n_aside == _ASIDES:
            break
        way = _ASIDE * aside - _BACK_OFF * goal.R[:, 2]
        moved = drive.leg(way, speed=speed, tare=TarePolicy.SESSION)
        if isinstance(moved, FaultFound):
            return moved
        shift = shift + _ASIDE * aside
    assert not isinstance(end, FaultFound)
    words = f"{end.outcome.value} {1000 * end.left:.0f} mm before the grasp"
    name = "early_contact" if end.outcome is LegOutcome.CONTACT else "unreachable"
    return FaultFound(name, words, motion.arm, {"left": end.left})


def aside_of(push: FloatArray, axis: FloatArray) -> FloatArray | None:
    """Direction in which a push (3,) turns a hand aside that goes along an axis.

    None if it only stops it.
    """
    across = push - (push @ axis) * axis
    size = float(np.linalg.norm(across))
    return across / size if size > _SLANT * float(np.linalg.norm(push)) else None


def motion_of(context: Context) -> GraspMotion:
    """Grasp that was chosen, and its motions."""
    assert context.cycle.motion is not None
    return context.cycle.motion


def opening_of(limb: LimbState, grasp: Grasp) -> float:
    """Tell how far fingers are open on the way in [m], no wider than they can."""
    return min(grasp.opening, limb.hand.preshape(grasp.preshape).widest)
