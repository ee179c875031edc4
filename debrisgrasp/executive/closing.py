"""Around the object: close, squeeze, and see that it is held."""

from __future__ import annotations

from collections.abc import Callable
from math import hypot

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.control import (
    GripConfig,
    GripController,
    GripPhase,
    TarePolicy,
)
from debrisgrasp.control._rigid import Wrench
from debrisgrasp.control.grip import STILL_FELT
from debrisgrasp.pipeline import GraspMotion

from .context import Context, Held
from .drive import Drive
from .dropoff import object_in_hand
from .fingers import run_grip
from .grasping import STANDING, motion_of, opening_of
from .limb_state import LimbState
from .result import Done, FaultFound, StepResult

__all__ = ["close", "verify_grasp"]

_SQUEEZE = 200.0
"""A claw could crush: the fingers of a side squeeze no harder [N]. Claws that hold, in
physics, at their full force hold at this, and one of four does not at half of it."""
_PUSHED = 45.0
"""Pushed by more while it closes, the hand gives way [N] ..."""
_GIVE = 0.002
"""... by so much [m] ..."""
_GIVES = 20
"""... so many times: then the object pushes the hand off, or it was never around it."""
_STAYS, _STAYS_FOR = 0.9, 3
"""A hard push of which so much is left after the hand gave way so often is no contact.
"""
_MORE = 15.0
"""By so much more it is pushed off while it only squeezes on [N]."""
_SHIFTS = 2
"""So often a hand that met something with one side only is shifted ..."""
_TOUCHED = 30.0
"""... until the fingers of the other side feel enough to stop there; the wrist, no more
than that [N]."""
_RESISTANCE = 10.0
"""A finger that feels its share of so much on its side stops until the others do, too
[N]."""
_FELT_OVER = 0.05
"""What closing fingers feel is smoothed over so long [s]."""
_CLOSING = 0.04
"""Speed of the pads [m/s]."""
_SLACK = 4.0
"""Beyond the time that this takes, a finger that has met nothing is jammed [s]."""
_RAMP, _SETTLING = 32, 8
"""Steps in which the force of the fingers grows, and settles ..."""
_FEELING = 0.016
"""... each of which is felt for so long [s] ..."""
_STEP = 3e-4
"""... and closes them by so much at most [m]: where all of them push the hand
off, what the wrist bears must not grow faster than it is felt ..."""
_WAITS = 60
"""... and at most so many in which it waits for the fingers on the other side ..."""
_ANSWERED = 0.3
"""... until those feel this share of what the first ones do."""
_MOVED = 0.01
"""A finger that has closed by so much does move [m]."""
_LOOKS = 4
"""So often a grip is looked at until its fingers rest: where they curl around
something, that takes a while."""
_SQUEEZED = 0.015
"""What gives way by more when squeezed was not between the fingers [m]."""


def close(context: Context) -> StepResult:
    """Close the fingers until all of them feel the object."""
    motion = motion_of(context)
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
    n_gives = n_shifts = 0
    while held.state.phase not in ends:
        fault = run_grip(drive, held, ends, most_force=_PUSHED)
        side = _one_side(limb, held)
        if fault is None and held.state.phase not in ends:
            fault = _given_way(context, held, drive, n_gives)
            n_gives += 1
        elif held.state.phase is GripPhase.EMPTY and side and n_shifts < _SHIFTS:
            fault = _shifted(context, held, drive, side)
            n_shifts += 1
        if fault is not None:
            return fault
    phase, openings = held.state.phase, drive.fingers().openings
    words = f"{phase.value}: fingers at "
    words += ", ".join(f"{1e3 * x:.0f}" for x in openings)
    words += f" mm, {1e3 * held.grip.config.width:.0f} mm expected"
    if phase is GripPhase.HOLDING:
        return _squeezed(context, held, drive)
    # Fingers that moved, or feel what stops them, are no broken ones.
    beyond = held.grip.config.opening - _MOVED
    stands = any(
        x > beyond and not is_met
        for x, is_met in zip(openings, held.state.is_stopped, strict=True)
    )
    is_jammed = phase is GripPhase.LOST or (phase is GripPhase.JAMMED and stands)
    fault_name = "finger_jammed" if is_jammed else "empty_grip"
    return FaultFound(fault_name, words, limb.name)


def _one_side(limb: LimbState, held: Held) -> int:
    """Side on which fingers have met something, if none has on the other; else 0."""
    fingers = zip(limb.hand.fingers, held.state.is_stopped, strict=True)
    sides = {1 if finger.side > 0 else -1 for finger, is_met in fingers if is_met}
    return sides.pop() if len(sides) == 1 else 0


def _shifted(
    context: Context, held: Held, drive: Drive, side: int
) -> FaultFound | None:
    """Move the hand aside until what one side met is between its fingers; close on.

    Fingers can't close beyond the middle of the hand, and what is thinner than it
    looked may lie all on one side of it.
    """
    limb, openings = drive.limb, tuple(drive.fingers().openings)
    met = [
        x for x, is_met in zip(openings, held.state.is_stopped, strict=True) if is_met
    ]
    way = 0.5 * side * max(met) * limb.pose(context.posture(limb)).R[:, 0]
    enough = held.grip.config.resistance

    def is_met(load: Wrench) -> bool:
        felt = min(held.grip.pressed(drive.fingers().forces))
        return felt >= enough or -side * load[0] > _TOUCHED

    fault = _nudged(context, drive, way, until=is_met)
    if fault is not None:
        return fault
    held.state = held.state._replace(
        phase=GripPhase.CLOSING,
        targets=openings,
        is_stopped=(False,) * len(openings),
        elapsed=0.0,
        felt=(),
    )
    return None


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
    for _ in range(_STAYS_FOR):
        fault = _nudged(context, drive, _GIVE / force * push)
        left = float(drive.push() @ push) / force
        if fault is not None or left < max(_STAYS * force, 2.0 * _PUSHED):
            return fault
    words = f"{left:.0f} N push the hand as before it gave way {_STAYS_FOR} times: "
    return FaultFound("ratchet", words + "not what it touches", held.arm)


def _nudged(
    context: Context,
    drive: Drive,
    way: FloatArray,
    until: Callable[[Wrench], bool] | None = None,
) -> FaultFound | None:
    """Move the hand a little (3,) [m] while its fingers stay as they are."""
    with context.fingers_as_they_are():
        end = drive.leg(way, speed=0.02, tare=TarePolicy.SESSION, until=until)
    return end if isinstance(end, FaultFound) else None


def _squeezed(context: Context, held: Held, drive: Drive) -> StepResult:
    """Squeeze until the fingers have settled; from there on a travel means slip.

    The force grows only while fingers on both sides feel it, and the arm gives way to
    what it pushes the hand aside with: else the wrist would bear it.
    """
    first = held.state
    context.held = None
    config = held.grip.config
    n_gives = n_waits = level = 0
    while level < _RAMP + _SETTLING:
        share = min(level / _RAMP, 1.0)
        force = config.resistance + share * (config.squeeze - config.resistance)
        fingers = drive.fingers()
        _, command = held.grip.step(first, fingers)
        goals = zip(command.openings, fingers.openings, strict=True)
        drive.send_fingers([max(x, y - _STEP) for x, y in goals], force)
        stood = drive.stand(_FEELING)
        if isinstance(stood, FaultFound):
            return stood
        if hypot(*drive.load[:3]) > _PUSHED:
            drive.send_fingers(drive.fingers().openings, config.resistance)
            level //= 2
            fault = _given_way(context, held, drive, n_gives)
            if fault is not None:
                return fault
            context.held, n_gives = None, n_gives + 1
        elif _is_answered(held, drive):
            level += 1
        else:
            level, n_waits = max(level - 1, 0), n_waits + 1
        if n_waits > _WAITS:
            words = "the fingers of one side feel nothing of what the others squeeze"
            return FaultFound("empty_grip", words, held.arm)
    context.held = held
    openings = tuple(drive.fingers().openings)
    travel = held.grip.travel(first.held_openings, openings)
    if travel > _SQUEEZED:
        words = f"squeezing closed the fingers by {1e3 * travel:z.0f} mm"
        return FaultFound("empty_grip", words, held.arm, {"travel": travel})
    held.state = first.held_from(openings)
    return Done({"openings": [round(x, 4) for x in openings]})


def _is_answered(held: Held, drive: Drive) -> bool:
    """Whether fingers on both sides feel the squeeze."""
    low, high = sorted(held.grip.pressed(drive.fingers().forces))
    return high < held.grip.config.resistance or low > _ANSWERED * high


def verify_grasp(context: Context) -> StepResult:
    """Squeeze for a moment; what is really held does not give way."""
    held = context.held
    assert held is not None
    drive = Drive(context, held.arm)
    most = _PUSHED + _MORE
    for _ in range(_LOOKS):
        before = drive.fingers().openings
        stood = drive.stand(STANDING, until=lambda load: hypot(*load[:3]) > most)
        if isinstance(stood, FaultFound):
            return stood
        force = hypot(*drive.load[:3])
        if force > most:
            drive.halt_fingers()
            words = f"squeezing pushes the hand off: {force:.0f} N"
            return FaultFound("empty_grip", words, held.arm, {"force": force})
        fingers = drive.fingers()
        travel = held.grip.travel(before, fingers.openings)
        if travel <= held.grip.config.slip_travel:
            break
    least = held.grip.weakest(fingers.forces)
    if travel > held.grip.config.slip_travel or least < STILL_FELT:
        words = f"closed by {1e3 * travel:z.1f} mm more, the weaker side feels "
        words += f"{least:.1f} N"
        return FaultFound("empty_grip", words, held.arm)
    held.state = held.state.held_from(tuple(fingers.openings))
    limb = context.limbs[held.arm]
    held.points_hand = object_in_hand(
        context, limb.pose(context.posture(limb)), motion_of(context).grasp.width
    )
    return Done({"travel": round(travel, 5), "least_force": round(least, 2)})


def _grip_of(context: Context, limb: LimbState, motion: GraspMotion) -> Held:
    grasp = motion.grasp
    opening = opening_of(limb, grasp)
    most = limb.hand.max_force
    squeeze = min(0.9 * most, _SQUEEZE)

    def config(period: float) -> GripConfig:
        return GripConfig(
            opening=opening,
            width=min(grasp.width, opening),
            resistance=min(_RESISTANCE, squeeze),
            tau=_FELT_OVER,
            speed=_CLOSING,
            squeeze=squeeze,
            empty_margin=opening,
            tolerance=0.006,
            timeout=_SLACK + opening / _CLOSING,
            sides=tuple(finger.side for finger in limb.hand.fingers),
            period=period,
            max_force=most,
        )

    period = context.settings.period
    grip = GripController(config(period))
    return Held(
        arm=motion.arm,
        grip=grip,
        watch=GripController(config(context.settings.finger_ticks * period)),
        state=grip.preshape(),
    )
