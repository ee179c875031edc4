"""Straight ways of a hand, as far as its arm does not fold onto the robot."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.control import (
    CartesianLeg,
    CartesianServo,
    LegOutcome,
    LegPlanner,
    LegStatus,
    TarePolicy,
)
from debrisgrasp.motion import ExactTest, MotionSpace

from .drive import Drive
from .limb_state import LimbState
from .obstacles import BARE
from .result import FaultFound, LegEnd

__all__ = ["free_share", "is_folded", "straight", "unfolds"]

_LOOKS = 20
"""On a way between two postures."""
_TICK, _PACE, _EVERY = 0.004, 1e-4, 20
"""Period [s] and way [m] of a tick of a leg that is followed, and how many ticks pass
between looks at where the arm is."""
_ASTRAY = 2e-3
"""A hand so far off its line no longer follows it [m]."""


def straight(
    drive: Drive, way: FloatArray, most: float, *, speed: float, least: float
) -> LegEnd | FaultFound:
    """Move an open hand by an offset (3,) [m], until it is pushed so hard [N].

    It goes only as far as the arm does not fold onto the robot; where that is less than
    ``least`` [m], it stays.
    """
    length, q = float(np.linalg.norm(way)), drive.context.posture(drive.limb)
    share = free_share(drive.limb, q, way)
    if share * length < least:
        return LegEnd(LegOutcome.BLOCKED, 0.0, length)
    return drive.leg(
        share * way,
        speed=speed,
        tare=TarePolicy.SESSION,
        until=drive.against(way, most),
    )


def free_share(limb: LimbState, q: FloatArray, way: FloatArray) -> float:
    """Tell how much of a straight way (3,) of the hand an arm can go.

    Folded onto itself it would find no way on from there; but if it is so already, it
    must get out, without touching more of itself.
    """
    limits = limb.limits.controller
    start = np.clip(q, limits.lower, limits.upper)
    test = _alone(limb)
    touching = set(test.contacts(start))

    def is_free(row: FloatArray) -> bool:
        if not touching:
            return bool(test.is_free(row[None])[0])
        return touching.issuperset(test.contacts(row))

    leg = CartesianLeg.along(limb.pose(start), way)
    plan = LegPlanner(limb.reach.chain, limits, is_free=is_free).plan(start, leg.goal)
    if plan.status is not LegStatus.JOINT_LIMIT:
        return plan.share
    return max(plan.share, _share_followed(limb, start, leg, is_free))


def _share_followed(
    limb: LimbState,
    q: FloatArray,
    leg: CartesianLeg,
    is_free: Callable[[FloatArray], bool],
) -> float:
    """Tell how much of a leg an arm can follow from q (d,), tick by tick.

    There the others do what a joint at its limit can't, which no plan counts on.
    """
    servo = CartesianServo(limb.reach.chain, limb.limits.controller, _TICK)
    state, n = servo.start(q), int(np.ceil(leg.length / _PACE))
    for i in range(n):
        state = servo.step(state, *leg.at((i + 1) / n))
        if state.gap > _ASTRAY or not (i % _EVERY or is_free(np.array(state.q))):
            return max(i - _EVERY, 0) / n
    return 1.0


def is_folded(limb: LimbState, q: FloatArray) -> bool:
    """Whether an arm is nearer to itself, or to the robot, than plans may be."""
    return not _alone(limb).is_free(q[None])[0]


def unfolds(limb: LimbState, q: FloatArray, goal: FloatArray) -> bool:
    """Whether an arm touches no more of the robot on its way from q (d,) to a goal."""
    test = _alone(limb)
    touching = set(test.contacts(q))
    way = q + np.linspace(0.0, 1.0, _LOOKS)[:, None] * (goal - q)
    return all(touching.issuperset(test.contacts(row)) for row in way)


def _alone(limb: LimbState) -> ExactTest:
    """Test of an arm against the robot and level ground only."""
    space = MotionSpace(measured=None, unknown=None, ground_plane=BARE)
    return limb.planner.exact_test(space, with_hand=False)
