"""Motions that several steps share: as planned, out of the pile, off an object."""

from __future__ import annotations

from dataclasses import replace
from math import hypot

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.control import LegOutcome
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import Trajectory
from debrisgrasp.kinematics.limits import LEAST_MARGIN
from debrisgrasp.motion import (
    MotionPlan,
    MotionPlanner,
    MotionSpace,
)

from .context import Context
from .drive import Drive
from .fingers import loosen
from .folding import straight
from .limb_state import LimbState
from .noticed import OUTSIDE, misplaced
from .result import FaultFound
from .states import State

__all__ = [
    "CAUGHT",
    "LAST_RESORT",
    "back_out",
    "let_go",
    "planned",
    "pull_of",
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
