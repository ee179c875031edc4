"""Back to rest, by whatever way there is."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from math import hypot

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.control import LegOutcome
from debrisgrasp.errors import DriverError
from debrisgrasp.kinematics import Trajectory
from debrisgrasp.motion import MotionPlan, MotionSpace, UnknownSpace

from .context import Context
from .drag import drive_back
from .drive import Drive
from .felt import feel_out
from .folding import is_folded, straight, unfolds
from .hanging import looked_after, looked_again, looked_around
from .limb_state import LimbState
from .moves import LAST_RESORT, planned, pull_of, reversed_motion
from .obstacles import space_of
from .pacing import cubic_time
from .relief import relieve
from .result import FaultFound
from .states import State

__all__ = ["has_touched", "put_away", "to_rest"]

_UP = 0.12
"""Where it finds no way from, a hand rises so far [m] ..."""
_RISES = 3
"""... and so often ..."""
_LEAST, _AS_BEFORE = 5e-3, 2e-3
"""... if it can by so much [m], and the arm is not as before then [rad or m]."""
_OFF, _FELT = 0.05, 15.0
"""Off what pushes it harder [N] it is drawn so far [m]."""
_SLOW, _SPARE = 0.15, 0.8
"""An arm that is folded turns no joint faster, on average [rad/s or m/s]; share of the
limits that it uses at most."""
_AT_REST = 0.01
"""So near to its posture of rest an arm is there [rad or m]."""
_STEP, _NEXT = 0.03, 0.5
"""Between two postures of a way gone others are filled in, so far apart, if they follow
each other as near as that [rad or m]."""
_PRESSED = 0.3
"""Share of a limit above which a hand gives way before it is taken elsewhere."""
_SUNK = (0.02, 0.04, 0.08)
"""A hand that stands on the ground is planned from as if that lay so much lower [m]."""
_GUARDED = 0.25
"""Share of the planned speed that is left after a touch, or where one is likely."""


def put_away(
    context: Context, arm: str, place: FloatArray | None = None
) -> FaultFound | None:
    """Bring an arm to rest, and the base back; then the arm holds by itself.

    Parameters
    ----------
    place
        Where its hand put something down, base frame [m], shape (3,): that is looked
        at before, and again from rest if something stands.
    """
    T_before_way, seen = context.T_base_way, None
    if place is not None:
        # What answers no more is noticed when it is needed.
        with suppress(DriverError):
            seen = looked_after(context, arm, place)
    fault = to_rest(context, arm)
    if fault is not None:
        return fault
    drive_back(context)
    context.limbs[arm].limb.arm.disengage()
    if place is not None and seen is not None:
        moved = context.T_base_way @ T_before_way.inverse()
        with suppress(DriverError):
            looked_again(context, arm, moved.apply(place), moved.apply(seen))
    return None


def has_touched(context: Context) -> bool:
    """Whether something was touched on a way to rest, or is likely to be."""
    return context.cycle.speed <= _GUARDED


def _may_have_moved(context: Context) -> bool:
    """Whether the hand touched something, or let it fall back into the pile."""
    cycle = context.cycle
    is_lost = State.LIFT in cycle.reached and not cycle.is_removed
    return is_lost or has_touched(context)


def to_rest(context: Context, arm: str) -> FaultFound | None:
    """Bring an arm back to its posture of rest."""
    limb, drive = context.limbs[arm], Drive(context, arm)
    rest = context.settings.rest or limb.rest_of
    q_rest = limb.reach.chain.vector(context.model.posture(arm, rest))
    if _is_at(context, limb, q_rest):
        limb.trail.clear()
        return None
    push = drive.push(drive.weighed())
    eased = relieve(context, arm, _PRESSED) if limb.trail else None
    if eased is None and has_touched(context):
        # It touched something: off that, or else over it.
        eased = _drawn_off(drive, push) or _risen(drive)
    is_moved = _may_have_moved(context)
    if eased is None and is_moved:
        with suppress(DriverError):
            looked_around(context, arm)
    eased = eased or _unfolded(drive)
    if eased is not None:
        return eased
    if _is_at(context, limb, q_rest):
        limb.trail.clear()
        return None
    q = context.posture(limb)
    limb.went(q[None])
    motion = context.cycle.motion
    if motion is not None and motion.arm == arm and context.dragged is None:
        reach = motion.reach.trajectory
        assert reach is not None
        is_there = np.abs(q - reach.q[-1]).max() < _AT_REST
        is_from_rest = np.abs(reach.q[0] - q_rest).max() < _AT_REST
        if is_there and is_from_rest and not is_moved:
            return _back(drive, reversed_motion(reach))
    found = _way_to(context, limb, q_rest)
    for _ in range(_RISES):
        if not isinstance(found, FaultFound) or found.fault != "plan_collision":
            break
        q = context.posture(limb)
        fault = _risen(drive)
        if fault is None and np.abs(context.posture(limb) - q).max() < _AS_BEFORE:
            break
        found = fault or _way_to(context, limb, q_rest)
    if isinstance(found, FaultFound):
        return found
    assert found.trajectory is not None
    return _back(drive, found.trajectory)


def _is_at(context: Context, limb: LimbState, q_rest: FloatArray) -> bool:
    """Whether an arm is back at its posture of rest (d,)."""
    return bool(np.abs(context.posture(limb) - q_rest).max() < _AT_REST)


def _unfolded(drive: Drive) -> FaultFound | None:
    """Lead an arm back to where it last was not folded onto the robot.

    What pushes an arm aside brings it nearer to itself than its leg was to, and no
    motion begins there. Where its joints can't go straight back its hand does, as far
    as the arm would not touch more of the robot.
    """
    context, limb, trail = drive.context, drive.limb, drive.limb.trail
    q = context.posture(limb)
    if not is_folded(limb, q):
        return None
    free = next((row for row in reversed(trail) if not is_folded(limb, row)), q)
    if unfolds(limb, q, free):
        return drive.follow(_turned(limb, q, free))
    way, speed = limb.pose(free).p - limb.pose(q).p, context.settings.lift_speed
    end = straight(drive, way, pull_of(drive), speed=speed, least=_LEAST)
    return end if isinstance(end, FaultFound) else None


def _turned(limb: LimbState, q: FloatArray, goal: FloatArray) -> Trajectory:
    """Motion that turns the joints of an arm slowly and straight to others (d,)."""
    limits = limb.limits.planner
    # What pushes an arm, or a leg, may bring a joint a little beyond the planner's.
    q, goal = (np.clip(row, limits.lower, limits.upper) for row in (q, goal))
    away = np.abs(goal - q)
    time = cubic_time(away, limits) / _SPARE
    duration = max(time, float(away.max()) / _SLOW, _LEAST)
    return Trajectory(
        joint_names=limits.joint_names,
        times=np.array([0.0, duration]),
        q=np.array([q, goal]),
        dq=np.zeros((2, len(q))),
        limits_hash=limits.hash,
    )


def _risen(drive: Drive) -> FaultFound | None:
    """Let an open hand rise a little, as far as nothing holds it.

    Off what that is it goes again, or the next motion would begin pressed to it.
    """
    up, speed = np.array([0.0, 0.0, _UP]), drive.context.settings.lift_speed
    end = straight(drive, up, pull_of(drive), speed=speed, least=_LEAST)
    if isinstance(end, FaultFound):
        return end
    if end.outcome is not LegOutcome.CONTACT:
        return None
    feel_out(drive)
    return _drawn_off(drive, drive.push(drive.weighed()))


def _drawn_off(drive: Drive, push: FloatArray) -> FaultFound | None:
    """Move an open hand on the way on which a force (3,) [N] pushes it.

    Else no way begins there that leads around what it touched.
    """
    size, speed = hypot(*push), drive.context.settings.lift_speed
    if not size > _FELT:
        return None
    way = _OFF / size * push
    end = straight(drive, way, pull_of(drive), speed=speed, least=_LEAST)
    return end if isinstance(end, FaultFound) else None


def _back(drive: Drive, trajectory: Trajectory) -> FaultFound | None:
    """Follow a motion to rest, slowly near all that the empty hand may touch.

    After a touch the next motion is a slower one, around what was touched.
    """
    cycle = drive.context.cycle
    fault = drive.follow(trajectory, pace=cycle.speed)
    if fault is None:
        drive.limb.trail.clear()
    else:
        cycle.speed = min(cycle.speed, _GUARDED)
    return fault


def _way_to(
    context: Context, limb: LimbState, goal: FloatArray
) -> MotionPlan | FaultFound:
    """Plan to a posture; through what was not seen if there is no other way.

    The way that the arm came leads back, if nothing shorter does. Then only what was
    seen is in the way: all else is a guess, near which the arm goes slowly. What came
    into the way since the arm went it moved there, and at last is moved again.
    """
    q, known = context.posture(limb), limb.known_way
    stands, gone = (limb.planner, q), (limb.planner, _way_gone(limb, q))
    for unknown, leaves, with_guesses in (
        (UnknownSpace.HIDDEN, None, True),
        (UnknownSpace.IGNORED, None, True),
        (UnknownSpace.IGNORED, stands, True),
        (UnknownSpace.IGNORED, stands, False),
        (UnknownSpace.IGNORED, gone, False),
    ):
        if leaves is stands and not (with_guesses or context.memory.guesses):
            continue
        space = space_of(
            context, unknown=unknown, stands=leaves, with_guesses=with_guesses
        )
        rounds = None if leaves is None else LAST_RESORT
        found = planned(context, limb, goal, space, known=known, max_rounds=rounds)
        if not isinstance(found, FaultFound):
            return found if with_guesses else _slowed(found)
    return _way_off_ground(context, limb, goal, space) or found


def _way_off_ground(
    context: Context, limb: LimbState, goal: FloatArray, space: MotionSpace
) -> MotionPlan | None:
    """Plan from where a hand stands on the ground, as if that were a little lower."""
    q, plane = context.posture(limb), space.ground_plane
    if plane is None or limb.planner.stands_free(q, space):
        return None
    for depth in _SUNK:
        lower = replace(space, ground_plane=plane + np.array([0.0, 0.0, 0.0, depth]))
        if not limb.planner.stands_free(q, lower):
            continue
        found = planned(context, limb, goal, lower, max_rounds=LAST_RESORT)
        return None if isinstance(found, FaultFound) else _slowed(found)
    return None


def _slowed(plan: MotionPlan) -> MotionPlan:
    """Slow a plan down on which something may be touched, or pushed."""
    slow = plan.trajectory
    assert slow is not None
    slow = replace(slow, times=slow.times / _GUARDED, dq=slow.dq * _GUARDED)
    return replace(plan, trajectory=slow)


def _way_gone(limb: LimbState, q: FloatArray) -> FloatArray:
    """Postures of the way by which an arm came to one (d,), close together, (k, d)."""
    ways = pairwise([*limb.trail, q])
    steps = [_steps(one, other) for one, other in ways]
    return np.concatenate([*steps, q[None]])


def _steps(one: FloatArray, other: FloatArray) -> FloatArray:
    """Postures from one (d,) to another; only the first if they are far apart."""
    far = float(np.abs(other - one).max())
    n = int(np.ceil(far / _STEP)) if far < _NEXT else 1
    return one + np.arange(n)[:, None] / n * (other - one)
