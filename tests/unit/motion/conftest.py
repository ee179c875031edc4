"""RoMan's right arm, a planner for it, and something in its way."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.kinematics import ArmReach, RobotModel
from debrisgrasp.motion import MotionPlanner, MotionSpace

GROUND = np.array([0.0, 0.0, 1.0, 0.0])


@pytest.fixture(scope="session")
def arm() -> ArmReach:
    return ArmReach(RobotModel.load("roman"), "right")


@pytest.fixture(scope="session")
def planner(arm: ArmReach) -> MotionPlanner:
    return MotionPlanner.of_arm(arm)


@pytest.fixture(scope="session")
def q_goal(arm: ArmReach) -> np.ndarray:
    """The present posture with the torso turned."""
    goal = arm.q_present.copy()
    goal[0] += 1.0
    return goal


@pytest.fixture(scope="session")
def empty() -> MotionSpace:
    return MotionSpace.from_points(np.zeros((0, 3)), ground_plane=GROUND)


@pytest.fixture(scope="session")
def pillar(arm: ArmReach, q_goal: np.ndarray) -> MotionSpace:
    """A pillar on the hand's straight way from the present posture to the goal."""
    middle = arm.chain.fk(0.5 * (arm.q_present + q_goal)).p
    z = np.arange(0.0, middle[2] + 0.12, 0.01)
    ring = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    side = middle[:2] + 0.04 * np.column_stack([np.cos(ring), np.sin(ring)])
    points = np.column_stack([np.tile(side, (len(z), 1)), np.repeat(z, len(side))])
    return MotionSpace.from_points(points, ground_plane=GROUND)
