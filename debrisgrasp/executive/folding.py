"""Straight ways of a hand, as far as its arm does not fold onto the robot."""

from __future__ import annotations

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.control import CartesianLeg, LegOutcome, LegPlanner, TarePolicy
from debrisgrasp.motion import ExactTest, MotionSpace

from .context import LimbState
from .drive import Drive
from .obstacles import BARE
from .result import FaultFound, LegEnd

__all__ = ["free_share", "is_folded", "straight", "unfolds"]

_LOOKS = 20
"""On a way between two postures."""


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

    legs = LegPlanner(limb.reach.chain, limits, is_free=is_free)
    return legs.plan(start, CartesianLeg.along(limb.pose(start), way).goal).share


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
