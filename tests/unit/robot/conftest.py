"""Robot of the tests of injected faults."""

from __future__ import annotations

import pytest

from debrisgrasp.kinematics import RobotModel
from debrisgrasp.robot import Robot

from .stub import stub_robot


@pytest.fixture(scope="module")
def model() -> RobotModel:
    return RobotModel.load("roman")


@pytest.fixture
def robot(model: RobotModel) -> Robot:
    return stub_robot(model)
