"""RoMan in physics with an arm over a place, and the moves that tests make."""

from __future__ import annotations

import numpy as np

from debrisgrasp.control.servo import CartesianServo
from debrisgrasp.robot import FakeConfig
from debrisgrasp.sim_robot import RobotPhysics, SimRobot, sim_robot
from debrisgrasp.worlds import World
from tests.unit.robot.rigs import CHAINS, GRIPPERS, PERIOD, ROMAN, Rig, posture


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

    def __init__(  # the robot of a `Rig` is a kinematic one: all of it is made anew
        self, bodies, place=(0.8, -0.3, 0.13), arm="right", **config
    ) -> None:
        start = CHAINS[arm].named(posture(arm, place))
        self.fake = made(bodies, start={arm: start}, **config)
        self.robot = self.fake.robot
        self.limb = self.robot.limbs[arm]
        self.arm, self.hand = self.limb.arm, self.limb.gripper
        self.name, self.chain = arm, CHAINS[arm]
        limits = ROMAN.limits(arm, self.chain).controller
        self.servo = CartesianServo(self.chain, limits, PERIOD)
        self.arm.engage()
        self.wait(0.2)
