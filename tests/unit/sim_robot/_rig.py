"""RoMan in physics with an arm over a place, and the moves that tests make."""

from __future__ import annotations

import numpy as np

from debrisgrasp.robot import FakeConfig
from debrisgrasp.sim_robot import RobotPhysics, SimRobot, sim_robot
from debrisgrasp.worlds import World
from tests.unit.robot.rigs import GRIPPERS, ROMAN, Rig


def made(bodies, physics: RobotPhysics | None = None, seed=5, **config) -> SimRobot:
    """RoMan before bodies at rest."""
    return sim_robot(
        ROMAN,
        World(tuple(bodies)),
        rng=np.random.default_rng(seed),
        config=FakeConfig(**{"is_initialised": True, "noise": None, **config}),
        physics=physics,
        grippers=GRIPPERS,
    )


class SimRig(Rig):
    """As `Rig`, but where things weigh, push and slip."""

    fake: SimRobot
    settles = 0.2
    made = staticmethod(made)
