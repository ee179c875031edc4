from __future__ import annotations

import pytest

from debrisgrasp.kinematics import ArmReach, KinematicChain, ReachMap, RobotModel


@pytest.fixture(scope="session")
def roman() -> RobotModel:
    return RobotModel.load("roman")


@pytest.fixture(scope="session")
def arm(roman: RobotModel) -> KinematicChain:
    """The right arm on its torso joint: eight joints."""
    return roman.chain("right")


@pytest.fixture(scope="session")
def arm_map(arm: KinematicChain) -> ReachMap:
    return ReachMap.build(arm)


@pytest.fixture(scope="session")
def right_reach(roman: RobotModel) -> ArmReach:
    return ArmReach(roman, "right")
