"""Motions that several steps share: as planned, out of the pile, to the ground."""

from __future__ import annotations

from dataclasses import replace
from math import hypot

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.control import LegOutcome, TarePolicy
from debrisgrasp.control._rigid import Wrench
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import LimitSet, Trajectory
from debrisgrasp.kinematics.limits import LEAST_MARGIN
from debrisgrasp.motion import (
    MotionPlan,
    MotionPlanner,
    MotionSpace,
)

from .context import Context
from .drive import Drive
from .fingers import loosen
from .folding import free_share, straight
from .limb_state import LimbState
from .noticed import OUTSIDE, misplaced
from .pacing import lying_speed
from .relief import standing_load, with_room
from .result import FaultFound
from .states import State
from .stopping import reset_stops

__all__ = [
    "CAUGHT",
    "LAST_RESORT",
    "back_out",
    "let_go",
    "lower",
    "lowering_speed",
    "planned",
    "pull_of",
    "put_down",
    "reversed_motion",
    "within_limits",
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
_HIGH, _LOWERINGS = 0.15, 3
"""What is let go higher above the ground falls [m]: it is lowered so often."""
_SPARE = 0.02
"""Before the last bit of a way that an arm can't go it could hardly go back [m]."""
_SLOWEST = 5e-3
"""Nothing is lowered more slowly [m/s], though what is very long may then press with
more than is left up to the limit."""
_FIRST = 10
"""Looks at the weight before any may count as less."""
_LOWERED_UP_TO = 0.95
"""Share of the controller's limits up to which what hangs is lowered."""


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
    q = within_limits(limb, context.posture(limb))
    if isinstance(q, FaultFound):
        return q
    plan = planner.plan(
        q, goal, space, rng=context.rng, known=known, max_rounds=max_rounds
    )
    if plan.is_solved:
        return plan
    return FaultFound("plan_collision", plan.reason, limb.name)


def within_limits(limb: LimbState, q: FloatArray) -> FloatArray | FaultFound:
    """Posture within the planner's limits, unless it is far outside.

    A leg may have led a joint to the end of the controller's, and it reads beyond.
    """
    limits = limb.limits.planner
    nearest = np.clip(q, limits.lower, limits.upper)
    if np.abs(nearest - q).max() <= LEAST_MARGIN + OUTSIDE:
        return nearest
    return misplaced(q, limits, limb.name) or nearest


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
        if context.cycle.is_removed or State.LIFT in context.cycle.reached:
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


def put_down(context: Context, most: float) -> FaultFound | None:
    """Lower what a hand holds until it lies on something, and let go.

    So far (``most`` [m]), or as far as its lowest point is over the ground. High above
    the ground it may just have brushed something, and is lowered on.
    """
    held = context.held
    if held is None:
        return None
    limb, drive = context.limbs[held.arm], Drive(context, held.arm)
    for n_before in range(_LOWERINGS if held.is_lifted else 0):
        q = context.posture(limb)
        points = limb.pose(q).apply(held.points_hand)
        lowest = float(points[:, 2].min()) if len(points) else 0.0
        if n_before and lowest < _HIGH:
            break
        depth = max(most, lowest)
        share = free_share(limb, q, np.array([0.0, 0.0, -depth]))
        depth = depth if share > 1.0 - 1e-6 else share * depth - _SPARE
        if depth <= 2e-3:
            break
        fault = lower(drive, depth)
        if fault is not None and n_before and fault.fault == "too_heavy":
            reset_stops(context)  # its far end lies on something, and bends no farther
            break
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
    most = _most(drive)
    end = drive.leg(
        [0.0, 0.0, -depth],
        speed=lowering_speed(drive, load),
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
    return None
