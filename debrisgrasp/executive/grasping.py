"""To the object, and around it."""

from __future__ import annotations

from math import hypot

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.control import (
    ContactGuard,
    GripConfig,
    GripController,
    GripPhase,
    LegOutcome,
    SafetyConfig,
    TarePolicy,
    reference_wrench,
)
from debrisgrasp.errors import InputError
from debrisgrasp.executable import GraspMotion
from debrisgrasp.geometry import SE3, voxel_downsample
from debrisgrasp.motion import UnknownSpace
from debrisgrasp.planning import Grasp

from .context import FINGER_TICKS, Context, Held, LimbState
from .drive import Drive, LegEnd
from .fingers import open_hand, run_grip
from .moves import planned, space_of
from .pacing import careful
from .result import Done, FaultFound, StepResult

__all__ = ["approach", "close", "pregrasp", "switch", "verify_grasp"]

_AT_GRASP = 0.02
"""A touch so near to the end of the approach is the object between the fingers [m]."""
_ASIDE, _BACK_OFF = 0.006, 0.006
"""Touched by a slanting side before that, the hand goes aside, and back [m] ..."""
_ASIDES = 5
"""... so many times."""
_SLANT = 0.25
"""Share of a push across the approach that makes it slanting."""
_STANDING = 0.24
"""How long the arm stands while forces are averaged [s]."""
_GENTLE, _FIRM = 100.0, 200.0
"""A claw could crush: a finger squeezes as the weight demands, within these [N]."""
_PUSHED = 45.0
"""Pushed by more while it closes, the hand gives way [N] ..."""
_GIVE = 0.0015
"""... by so much [m] ..."""
_GIVES = 8
"""... so many times: then the object pushes the hand off, or it was never around it."""
_RESISTANCE = 10.0
"""A finger that feels so much stops until the others do, too [N]."""
_CLOSING = 0.04
"""Speed of the pads [m/s]."""
_GUARD = ContactGuard(force=50.0)
_RAMP, _SETTLING = 32, 8
"""Steps in which the force of the fingers grows, and settles ..."""
_WAITS = 60
"""... and at most so many in which it waits for the fingers on the other side ..."""
_ANSWERED = 0.3
"""... until those feel this share of what the first ones do."""
_THICKEST = 0.1
"""[m]."""
_SQUEEZED = 0.015
"""What gives way by more when squeezed was not between the fingers [m]."""


def pregrasp(context: Context) -> StepResult:
    """Take the preshape, and go to where the approach begins."""
    motion = _motion(context)
    limb, drive = context.limbs[motion.arm], Drive(context, motion.arm)
    grasp = motion.grasp
    fault = open_hand(drive, grasp.preshape, _opening(limb, grasp))
    if fault is not None:
        return fault
    reach = motion.reach.trajectory
    assert reach is not None
    q = context.posture(limb)
    if np.abs(q - reach.q[0]).max() > 0.01:
        # Something happened on the way: the motion is planned anew from here.
        space = space_of(context, unknown=UnknownSpace.HIDDEN)
        found = planned(context, limb, reach.q[-1], space)
        if isinstance(found, FaultFound):
            return found
        assert found.trajectory is not None
        reach = found.trajectory
    solids = limb.hand.solids(grasp.preshape, _opening(limb, grasp))
    corners = np.concatenate([solid.mesh()[0] for solid in solids])
    paces = careful(context, limb, corners, reach, context.cycle.speed)
    fault = drive.follow(reach, pace=paces)
    if fault is not None:
        return fault
    context.is_in_pile = motion.arm
    return Done({"seconds": round(reach.duration, 3)})


def switch(context: Context) -> StepResult:
    """Hand the arm over to force control: read back, standing, and unloaded."""
    motion = _motion(context)
    limb, drive = context.limbs[motion.arm], Drive(context, motion.arm)
    arm = limb.limb.arm
    arm.disengage()
    fault = drive.engage()
    if fault is not None:
        return fault
    before = context.posture(limb)
    readings = drive.stand(_STANDING)
    if isinstance(readings, FaultFound):
        return readings
    moved = float(np.abs(context.posture(limb) - before).max())
    if moved > 0.01 or not arm.is_engaged:
        arm.disengage()
        words = f"the arm moved by {moved:.3f} rad while it was handed over"
        return FaultFound("controller_refuses", words, limb.name)
    loads = []
    for reading in readings:
        q = np.asarray(reading.q, dtype=np.float64).tolist()
        wrench = np.asarray(reading.wrench_ft, dtype=np.float64).tolist()
        loads.append(limb.loads.load_ee(wrench, limb.kinematics.pose(q)[0]))
    try:
        # At the palm, noise of the force is noise of the torque by the lever between.
        lever = float(np.linalg.norm(limb.loads.T_ee_ft.p))
        reference = reference_wrench(loads, max_sigma_torque=0.02 + 0.6 * lever)
    except InputError as error:
        return FaultFound("controller_refuses", str(error), limb.name)
    force = float(np.linalg.norm(reference[:3]))
    if force > context.settings.empty_load + 4.0:
        words = f"an empty hand in free space bears {force:.1f} N"
        has_jumped = force > SafetyConfig().jump_force
        name = "bias_jump" if has_jumped else "bias_drift"
        return FaultFound(name, words, limb.name, {"force": force})
    return Done({"force": round(force, 2)})


def approach(context: Context) -> StepResult:
    """Go straight in; stop at the first touch."""
    motion = _motion(context)
    drive, settings = Drive(context, motion.arm), context.settings
    goal, shift = motion.grasp.T_base_hand, np.zeros(3)
    end: LegEnd | FaultFound
    for n_aside in range(_ASIDES + 1):
        aim = SE3.from_parts(goal.R, goal.p + shift)
        end = drive.leg(aim, speed=settings.approach_speed, guard=_GUARD)
        if isinstance(end, FaultFound):
            return end
        if end.outcome is LegOutcome.DONE or end.left <= _AT_GRASP:
            facts = {"outcome": end.outcome.value, "left": round(end.left, 4)}
            return Done({**facts, "shift_mm": np.round(1e3 * shift, 1).tolist()})
        aside = _aside(drive.push(), goal.R[:, 2])
        if end.outcome is not LegOutcome.CONTACT or aside is None or n_aside == _ASIDES:
            break
        way = _ASIDE * aside - _BACK_OFF * goal.R[:, 2]
        moved = drive.leg(way, speed=settings.approach_speed, tare=TarePolicy.SESSION)
        if isinstance(moved, FaultFound):
            return moved
        shift = shift + _ASIDE * aside
    assert not isinstance(end, FaultFound)
    words = f"{end.outcome.value} {1000 * end.left:.0f} mm before the grasp"
    name = "early_contact" if end.outcome is LegOutcome.CONTACT else "unreachable"
    return FaultFound(name, words, motion.arm, {"left": end.left})


def _aside(push: FloatArray, axis: FloatArray) -> FloatArray | None:
    """Direction in which a push (3,) turns a hand aside that goes along an axis.

    None if it only stops it.
    """
    across = push - (push @ axis) * axis
    size = float(np.linalg.norm(across))
    return across / size if size > _SLANT * float(np.linalg.norm(push)) else None


def close(context: Context) -> StepResult:
    """Close the fingers until all of them feel the object."""
    motion = _motion(context)
    limb, drive = context.limbs[motion.arm], Drive(context, motion.arm)
    held = _grip_of(context, limb, motion)
    fault = run_grip(drive, held, (GripPhase.READY, GripPhase.JAMMED, GripPhase.LOST))
    if fault is not None:
        return fault
    if held.state.phase is not GripPhase.READY:
        return FaultFound("finger_jammed", held.state.phase.value, limb.name)
    held.state = held.grip.close(held.state)
    context.held, context.is_closed = held, True
    ends = (GripPhase.HOLDING, GripPhase.EMPTY, GripPhase.JAMMED, GripPhase.LOST)
    n_gives = 0
    while held.state.phase not in ends:
        fault = run_grip(drive, held, ends, most_force=_PUSHED)
        if fault is None and held.state.phase not in ends:
            fault = _given_way(context, held, drive, n_gives)
            n_gives += 1
        if fault is not None:
            return fault
    phase, openings = held.state.phase, drive.fingers().openings
    words = f"{phase.value}: fingers at "
    words += ", ".join(f"{1e3 * x:.0f}" for x in openings)
    words += f" mm, {1e3 * held.grip.config.width:.0f} mm expected"
    if phase is GripPhase.HOLDING:
        return _squeezed(context, held, drive)
    fault_name = "empty_grip" if phase is GripPhase.EMPTY else "finger_jammed"
    return FaultFound(fault_name, words, limb.name)


def _given_way(
    context: Context, held: Held, drive: Drive, n_before: int
) -> FaultFound | None:
    """Let the arm yield to what pushes the closing hand: an edge, or the ground."""
    push = drive.push()
    force = float(np.linalg.norm(push))
    if n_before >= _GIVES:
        words = f"closing pushes the hand off: {force:.0f} N after it gave way "
        words += f"{n_before} times"
        return FaultFound("empty_grip", words, held.arm, {"force": force})
    context.held = None  # the fingers wait
    end = drive.leg(_GIVE / force * push, speed=0.02, tare=TarePolicy.SESSION)
    context.held = held
    return end if isinstance(end, FaultFound) else None


def _squeezed(context: Context, held: Held, drive: Drive) -> StepResult:
    """Squeeze until the fingers have settled; from there on a travel means slip.

    The force grows only while fingers on both sides feel it, and the arm gives way to
    what it pushes the hand aside with: else the wrist would bear it.
    """
    gripper, first = drive.limb.limb.gripper, held.state
    context.held = None
    config = held.grip.config
    n_gives = n_waits = level = 0
    while level < _RAMP + _SETTLING:
        share = min(level / _RAMP, 1.0)
        force = config.resistance + share * (config.squeeze - config.resistance)
        _, command = held.grip.step(first, drive.fingers())
        gripper.command(command._replace(force=force))
        stood = drive.stand(4 * context.settings.period)
        if isinstance(stood, FaultFound):
            return stood
        if hypot(*drive.load[:3]) > _PUSHED:
            halted = tuple(drive.fingers().openings)
            gripper.command(command._replace(openings=halted, force=config.resistance))
            level //= 2
            fault = _given_way(context, held, drive, n_gives)
            if fault is not None:
                return fault
            context.held, n_gives = None, n_gives + 1
        elif _is_answered(drive, config.resistance):
            level += 1
        else:
            level, n_waits = max(level - 1, 0), n_waits + 1
        if n_waits > _WAITS:
            words = "the fingers of one side feel nothing of what the others squeeze"
            return FaultFound("empty_grip", words, held.arm)
    context.held = held
    openings = tuple(drive.fingers().openings)
    travel = max(a - b for a, b in zip(first.held_openings, openings, strict=True))
    if travel > _SQUEEZED:
        words = f"squeezing closed the fingers by {1e3 * travel:.0f} mm"
        return FaultFound("empty_grip", words, held.arm, {"travel": travel})
    held.state = first._replace(held_openings=openings)
    return Done({"openings": [round(x, 4) for x in openings]})


def _is_answered(drive: Drive, least: float) -> bool:
    """Whether fingers on both sides feel the squeeze."""
    sums = {True: 0.0, False: 0.0}
    forces = drive.fingers().forces
    for finger, force in zip(drive.limb.hand.fingers, forces, strict=True):
        sums[finger.side > 0] += force
    low, high = sorted(sums.values())
    return high < least or low > _ANSWERED * high


def verify_grasp(context: Context) -> StepResult:
    """Squeeze for a moment; what is really held does not give way."""
    held = context.held
    assert held is not None
    drive = Drive(context, held.arm)
    before = drive.fingers().openings
    stood = drive.stand(_STANDING)
    if isinstance(stood, FaultFound):
        return stood
    fingers = drive.fingers()
    travel = max(a - b for a, b in zip(before, fingers.openings, strict=True))
    least = min(fingers.forces)
    if travel > held.grip.config.slip_travel or least < 1.0:
        words = f"closed by {1e3 * travel:.1f} mm more, the weakest finger feels "
        words += f"{least:.1f} N"
        return FaultFound("empty_grip", words, held.arm)
    held.points_hand = _object_in_hand(context, held)
    return Done({"travel": round(travel, 5), "least_force": round(least, 2)})


def _motion(context: Context) -> GraspMotion:
    assert context.cycle.motion is not None
    return context.cycle.motion


def _opening(limb: LimbState, grasp: Grasp) -> float:
    widest = limb.hand.preshape(grasp.preshape).widths[1]
    return float(min(grasp.opening, widest))


def _grip_of(context: Context, limb: LimbState, motion: GraspMotion) -> Held:
    grasp = motion.grasp
    opening = _opening(limb, grasp)
    most = limb.hand.max_force
    squeeze = min(0.9 * most, _squeeze_for(grasp))

    def config(period: float) -> GripConfig:
        return GripConfig(
            opening=opening,
            width=min(grasp.width, opening),
            resistance=min(_RESISTANCE, squeeze),
            speed=_CLOSING,
            squeeze=squeeze,
            empty_margin=opening,
            tolerance=0.006,
            period=period,
            max_force=most,
        )

    period = context.settings.period
    grip = GripController(config(period))
    return Held(
        arm=motion.arm,
        grip=grip,
        watch=GripController(config(FINGER_TICKS * period)),
        state=grip.preshape(Drive(context, motion.arm).fingers()),
    )


def _squeeze_for(grasp: Grasp) -> float:
    """Squeeze of each finger that holds what the object may weigh [N]."""
    if grasp.load is None:
        return _GENTLE
    return float(np.clip(grasp.load.grip[1], _GENTLE, _FIRM))


def _object_in_hand(context: Context, held: Held) -> FloatArray:
    """Visible points of the object in the frame of the palm that holds it."""
    cycle = context.cycle
    assert cycle.seen is not None
    assert cycle.label is not None
    limb = context.limbs[held.arm]
    points = cycle.seen.cloud.points[cycle.seen.segmentation.points_of(cycle.label)]
    T = limb.pose(context.posture(limb))
    points = points[voxel_downsample(points, 0.01)]
    # Its underside is as far below as it is thick.
    thick = min(_motion(context).grasp.width, _THICKEST)
    points = np.concatenate([points, points - [0.0, 0.0, thick]])
    return T.inverse().apply(points)
