"""How far an arm may go straight before it folds onto the robot."""

from __future__ import annotations

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.control import CartesianLeg, LegPlanner
from debrisgrasp.motion import ExactTest, MotionSpace

from .context import LimbState
from .obstacles import BARE

__all__ = ["free_share", "is_folded"]


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


def _alone(limb: LimbState) -> ExactTest:
    """Test of an arm against the robot and level ground only."""
    space = MotionSpace(measured=None, unknown=None, ground_plane=BARE)
    return limb.planner.exact_test(space, with_hand=False)
