"""A robot in memory with an arm over a place, and the moves that tests make."""

from __future__ import annotations

from functools import cache

import numpy as np

from debrisgrasp.control import FingerReading, GripCommand, GripConfig, GripController
from debrisgrasp.control.servo import CartesianServo
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.kinematics import RobotModel, solve
from debrisgrasp.prototypes import load_grippers
from debrisgrasp.robot import FakeConfig, fake_robot
from debrisgrasp.worlds import Body, World, make_body

ROMAN = RobotModel.load("roman")
CHAINS = {arm: ROMAN.chain(arm) for arm in ROMAN.arms}
GRIPPERS = load_grippers()
PERIOD = 0.004


def turned(yaw: float) -> np.ndarray:
    return so3.exp(np.array([0.0, 0.0, yaw]))


def downwards(x: float, y: float, z: float, yaw: float = np.pi / 2) -> SE3:
    """Palm that looks down; at the default its fingers close along y."""
    return SE3.from_parts(
        turned(yaw) @ so3.from_rpy(np.array([np.pi, 0, 0])), [x, y, z]
    )


def beam(name: str, mass: float, at: tuple, *, length=0.5, yaw=0.0) -> Body:
    """A bar of 89 mm by 89 mm along x, or turned."""
    sizes = {"length": length, "width": 0.089, "height": 0.089}
    return make_body("lumber_4x4", sizes, mass, name=name).at(
        SE3.from_parts(turned(yaw), at)
    )


FAR = beam("far", 3.0, (3.0, 0.0, 0.0445))


@cache
def posture(arm: str, place: tuple[float, ...]) -> tuple[float, ...]:
    goal = downwards(*place)
    found = np.atleast_2d(solve(CHAINS[arm], goal, rng=np.random.default_rng(3)).q)[0]
    assert np.allclose(CHAINS[arm].fk(found).matrix, goal.matrix, atol=1e-3)
    return tuple(found.tolist())


def drive(robot, forward, turn, seconds):
    """Have a base go on for so long: it is told again in time."""
    clock, until = robot.clock, robot.clock.now() + seconds
    while clock.now() < until - 1e-9:
        robot.base.drive(forward, turn)
        clock.wait_until(min(clock.now() + 0.1, until))


class Rig:
    """Arm over a place (x, y, z, yaw), hand open and initialised."""

    settles = 0.1
    """How long it stands before a test begins [s]."""

    def __init__(self, bodies, place=(0.8, -0.3, 0.13), arm="right", **config) -> None:
        start = CHAINS[arm].named(posture(arm, place))
        self.fake = self.made(bodies, start={arm: start}, **config)
        self.robot = self.fake.robot
        self.limb = self.robot.limbs[arm]
        self.arm, self.hand = self.limb.arm, self.limb.gripper
        self.name, self.chain = arm, CHAINS[arm]
        limits = ROMAN.limits(arm, self.chain).controller
        self.servo = CartesianServo(self.chain, limits, PERIOD)
        self.arm.engage()
        self.wait(self.settles)

    @staticmethod
    def made(bodies, **config):
        """RoMan before bodies at rest, or a world of them."""
        return fake_robot(
            ROMAN,
            bodies if isinstance(bodies, World) else World(tuple(bodies)),
            rng=np.random.default_rng(5),
            config=FakeConfig(**{"is_initialised": True, "noise": None, **config}),
            grippers=GRIPPERS,
        )

    def wait(self, seconds: float) -> None:
        self.robot.clock.wait_until(self.robot.clock.now() + seconds)

    @property
    def load(self) -> np.ndarray:
        """What the sensor makes of the load on the hand, axes of the hand."""
        R = self.chain.fk(self.arm.read().q).R
        raw = self.limb.sensor.read().wrench_ft
        return np.array(self.limb.loads.load_ee(raw, tuple(R.ravel())))

    def body(self, name: str) -> SE3:
        world = self.fake.world
        return world.bodies[world.index(name)].T_base_body

    def move(self, *shift: float, speed=0.25, until=lambda: False) -> bool:
        """Move the hand straight; whether it went all the way."""
        state = self.servo.start(self.arm.read().q)
        start = self.chain.fk(self.arm.read().q)
        n = max(int(np.linalg.norm(shift) / (speed * PERIOD)), 1)
        R = tuple(start.R.ravel().tolist())
        for k in range(1, n + 500):
            share = min(k / n, 1.0)
            p = start.p + share * np.array(shift)
            state = self.servo.step(state, R, tuple(p.tolist()))
            self.arm.command(state.q)
            self.wait(PERIOD)
            if until():
                self._brake(state)
                return False
            if k > n and state.gap < 2e-4 and not state.is_moving:
                break
        self._brake(state)
        return True

    def _brake(self, state) -> None:
        while state.is_moving:
            state = self.servo.braked(state)
            self.arm.command(state.q)
            self.wait(PERIOD)

    def grip(self, width=0.089, squeeze=40.0) -> str:
        """Close, squeeze, and say how that ended."""
        opening = self.hand.read().openings[0]
        model = self.hand.model
        grip = GripController(
            GripConfig(
                opening=opening,
                width=width,
                squeeze=squeeze,
                max_force=model.max_force,
                sides=tuple(finger.side for finger in model.fingers),
            )
        )
        state = grip.preshape()
        for _ in range(1500):
            state, command = grip.step(state, FingerReading(*self.hand.read()[1:]))
            self.hand.command(command)
            self.wait(PERIOD)
            if state.phase.name == "READY":
                state = grip.close(state)
            is_held = state.phase.name == "HOLDING" and state.elapsed > 0.2
            if is_held or state.phase.name in ("EMPTY", "JAMMED", "SLIPPED"):
                break
        return state.phase.name

    def open(self, opening=0.15) -> None:
        n = len(self.hand.read().openings)
        self.hand.command(GripCommand((opening,) * n, self.hand.model.max_force))
        self.wait(1.0)
