"""Motions that several steps share: to rest, out of the pile, down to the ground."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import hypot

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.control import LegOutcome, TarePolicy
from debrisgrasp.control._rigid import Wrench
from debrisgrasp.geometry import SE3, Bounds
from debrisgrasp.kinematics import Trajectory
from debrisgrasp.kinematics.limits import LEAST_MARGIN
from debrisgrasp.motion import (
    MotionPlan,
    MotionPlanner,
    MotionSpace,
    UnknownSpace,
)

from .context import Context, LimbState
from .drive import OUTSIDE, Drive
from .fingers import loosen
from .folding import free_share, straight
from .obstacles import space_of
from .pacing import widest_corners
from .relief import relieve, standing_load, with_room
from .result import FaultFound

__all__ = [
    "CAUGHT",
    "LAST_RESORT",
    "back_out",
    "let_go",
    "lower",
    "planned",
    "pull_of",
    "put_down",
    "reversed_motion",
    "to_rest",
]

LAST_RESORT = 1200
"""Rounds of a search after which nobody is left to ask."""
CAUGHT = 40.0
"""On a hand that should be empty, this force means that it isn't [N]."""
_HARDER = 15.0
"""A hand that does not come free is pulled by no more than so much than before [N]."""
_BACK = 0.12
"""How far a hand backs out of the pile [m]."""
_PART = 0.1
"""Less than this share of it is not worth the leg."""
_SPARE = 0.02
"""Before the last bit of a way that an arm can't go it could hardly go back [m]."""
_UP = 0.12
"""Where it finds no way from, a hand rises so far [m] ..."""
_RISES = 3
"""... and so often ..."""
_LEAST, _AS_BEFORE = 5e-3, 2e-3
"""... if it can by so much [m], and the arm is not as before then [rad or m]."""
_FIRST = 10
"""Looks at the weight before any may count as less."""
_STEP, _NEXT = 0.03, 0.5
"""Between two postures of a way gone others are filled in, so far apart, if they follow
each other as near as that [rad or m]."""
_LOWERED_UP_TO = 0.95
"""Share of the controller's limits up to which what hangs is lowered."""
_ROLLS = 0.8
"""What was let go may roll or slide so far [m]: there only later looks count."""
_PRESSED = 0.3
"""Share of a limit above which a hand gives way before it is taken elsewhere."""
_GUARDED = 0.25
"""Share of the planned speed that is left on it."""


def reversed_motion(trajectory: Trajectory) -> Trajectory:
    """Return the same motion from its end to its start."""
    return replace(
        trajectory,
        times=trajectory.times[-1] - trajectory.times[::-1],
        q=trajectory.q[::-1],
        dq=-trajectory.dq[::-1],
    )


def planned(
    context: Context,
    limb: LimbState,
    goal: SE3 | FloatArray,
    space: MotionSpace,
    planner: MotionPlanner | None = None,
    known: FloatArray | None = None,
    max_rounds: int | None = None,
) -> MotionPlan | FaultFound:
    """Plan from where the arm stands.

    Parameters
    ----------
    planner
        For an arm with something in its hand; None: for the arm alone.
    known
        Postures (k, d) of a way that it has gone.
    max_rounds
        Of the search; None: the planner's.
    """
    planner = planner or limb.planner
    q = _inside(limb, context.posture(limb))
    if isinstance(q, str):
        return FaultFound("start_outside_limits", q, limb.name)
    plan = planner.plan(
        q, goal, space, rng=context.rng, known=known, max_rounds=max_rounds
    )
    if plan.is_solved:
        return plan
    return FaultFound("plan_collision", plan.reason, limb.name)


def _inside(limb: LimbState, q: FloatArray) -> FloatArray | str:
    """Posture within the planner's limits, unless it is far outside.

    A leg may have led a joint to the end of the controller's, and it reads beyond.
    """
    limits = limb.limits.planner
    nearest = np.clip(q, limits.lower, limits.upper)
    if np.abs(nearest - q).max() > LEAST_MARGIN + OUTSIDE:
        return limits.violation(q)
    return nearest


def back_out(context: Context, arm: str) -> FaultFound | None:
    """Draw a hand straight back, the way it came, as far as the arm can."""
    limb = context.limbs[arm]
    q = context.posture(limb)
    T = limb.pose(q)
    motion = context.cycle.motion
    shift = -_BACK * T.R[:, 2]
    if motion is not None and motion.arm == arm and context.dragged is None:
        # Straight out: aside it would draw its fingers along what they touch.
        far = float((motion.grasp.T_base_pregrasp.p - T.p) @ -T.R[:, 2])
        if context.cycle.is_removed:
            # By now it is elsewhere, and what it put down as long as it was.
            grasp = motion.grasp
            way_in = grasp.T_base_hand.p - grasp.T_base_pregrasp.p
            far = max(float(np.linalg.norm(way_in)), _BACK)
        if 0.0 < far < 0.3:
            shift = -far * T.R[:, 2]
    if np.linalg.norm(shift) < 5e-3:
        return None
    drive = Drive(context, arm)
    end = straight(
        drive,
        shift,
        pull_of(drive),
        speed=context.settings.lift_speed,
        least=_PART * float(np.linalg.norm(shift)),
    )
    if isinstance(end, FaultFound) or end.outcome is not LegOutcome.CONTACT:
        return end if isinstance(end, FaultFound) else None
    words = f"{hypot(*drive.load[:3]):.0f} N on an open hand that is drawn back"
    return FaultFound("not_released", words, arm)


def pull_of(drive: Drive) -> float:
    """Force up to which a hand that may be caught is pulled [N]."""
    return max(CAUGHT, hypot(*drive.weighed()[:3]) + _HARDER)


def to_rest(context: Context, arm: str) -> FaultFound | None:
    """Bring an arm back to its posture of rest."""
    limb, drive = context.limbs[arm], Drive(context, arm)
    rest = context.settings.rest or limb.rest_of
    q_rest = limb.reach.chain.vector(context.model.posture(arm, rest))
    q = context.posture(limb)
    if np.abs(q - q_rest).max() < 0.01:
        limb.trail.clear()
        return None
    eased = relieve(context, arm, _PRESSED) if limb.trail else None
    if eased is None and context.cycle.speed <= _GUARDED:
        eased = _risen(drive)  # it touched something: over that
    if eased is not None:
        return eased
    q = context.posture(limb)
    limb.went(q[None])
    motion = context.cycle.motion
    if motion is not None and motion.arm == arm and context.dragged is None:
        reach = motion.reach.trajectory
        assert reach is not None
        is_there = np.abs(q - reach.q[-1]).max() < 0.01
        is_from_rest = np.abs(reach.q[0] - q_rest).max() < 0.01
        if is_there and is_from_rest:
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


def _risen(drive: Drive) -> FaultFound | None:
    """Let an open hand rise a little, as far as nothing holds it."""
    up, speed = np.array([0.0, 0.0, _UP]), drive.context.settings.lift_speed
    end = straight(drive, up, pull_of(drive), speed=speed, least=_LEAST)
    return end if isinstance(end, FaultFound) else None


def _back(drive: Drive, trajectory: Trajectory) -> FaultFound | None:
    """Follow a motion to rest, slowly near all that the empty hand may touch.

    After a touch the next motion is a slower one.
    """
    cycle = drive.context.cycle
    corners = widest_corners(drive.limb)
    fault = drive.follow(trajectory, pace=cycle.speed, points=corners)
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
    known = np.array(limb.trail) if limb.trail else None
    q = context.posture(limb)
    stands, gone = (limb.planner, q), (limb.planner, _way_gone(limb, q))
    for unknown, leaves, with_guesses in (
        (UnknownSpace.HIDDEN, None, True),
        (UnknownSpace.IGNORED, None, True),
        (UnknownSpace.IGNORED, stands, True),
        (UnknownSpace.IGNORED, stands, False),
        (UnknownSpace.IGNORED, gone, False),
    ):
        if leaves is stands and not (with_guesses or context.dropped or context.fallen):
            continue
        space = space_of(
            context, unknown=unknown, stands=leaves, with_guesses=with_guesses
        )
        rounds = None if leaves is None else LAST_RESORT
        found = planned(context, limb, goal, space, known=known, max_rounds=rounds)
        if not isinstance(found, FaultFound):
            return found if with_guesses else _slowed(found)
    return found


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


def put_down(context: Context, most: float) -> FaultFound | None:
    """Lower what a hand holds until it lies on something, and let go.

    So far (``most`` [m]), or as far as its lowest point is over the ground.
    """
    held = context.held
    if held is None:
        return None
    limb, drive = context.limbs[held.arm], Drive(context, held.arm)
    if held.is_lifted:
        if len(held.points_hand):
            T = limb.pose(context.posture(limb))
            most = max(most, float(T.apply(held.points_hand)[:, 2].min()))
        share = free_share(limb, context.posture(limb), np.array([0.0, 0.0, -most]))
        depth = most if share > 1.0 - 1e-6 else share * most - _SPARE
        if depth > 2e-3:
            fault = lower(drive, depth)
            if fault is not None:
                return fault
    return let_go(context)


def lower(drive: Drive, depth: float) -> FaultFound | None:
    """Go down [m] until something else bears a good part of the weight on the hand."""
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
    # What is too heavy hangs near the limit already, and can only be put down.
    limits = with_room(drive.limits, load)
    most = drive.limb.limits.controller.scaled(load=_LOWERED_UP_TO)
    end = drive.leg(
        [0.0, 0.0, -depth],
        speed=drive.context.settings.lift_speed,
        tare=TarePolicy.SESSION,
        until=lies,
        limits=replace(
            limits,
            force=min(limits.force, most.force),
            torque=min(limits.torque, most.torque),
        ),
    )
    # Loaded to its limit already, the hand can't go down: it lets go here.
    if isinstance(end, FaultFound) and end.fault != "ratchet":
        return end
    return None


def let_go(context: Context, opening: float | None = None) -> FaultFound | None:
    """Open the hand that holds something, and hold nothing.

    Parameters
    ----------
    opening
        To open to [m]; None: just far enough to be free, for there may be no more
        room.
    """
    held = context.held
    if held is None:
        return None
    most = held.grip.config.opening if opening is None else opening
    with context.fingers_as_they_are():
        fault = loosen(Drive(context, held.arm), most)
    if fault is not None:
        return fault
    context.held = None
    context.cycle.speed = 1.0  # what was held swings and touches no more
    if held.is_lifted:
        limb = context.limbs[held.arm]
        T = limb.pose(context.posture(limb))
        points = np.concatenate([T.apply(held.points_hand), T.p[None]])
        context.known.stirred(Bounds.around(points, _ROLLS))
    return None
