"""The robot in physics keeps the same promises as a real one has to."""

from __future__ import annotations

import pytest

pytest.importorskip("mujoco")

from debrisgrasp.robot import CHECKS, MOVING_CHECKS
from tests.unit.robot.rigs import FAR, beam

from ._rig import made


@pytest.fixture(scope="module")
def robot():
    near = beam("near", 2.0, (1.2, 0.0, 0.0445))
    return made([FAR, near], start={"right": "ready", "left": "ready"}).robot


@pytest.mark.parametrize("check", [*CHECKS, *MOVING_CHECKS], ids=str)
def test_it_keeps_its_promises(check, robot):
    assert check(robot) == ()
