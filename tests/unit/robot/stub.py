"""A robot that does at once what it is told; the arms are those of RoMan."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from debrisgrasp.control import GripCommand, LoadModel
from debrisgrasp.executive import STAGES, State
from debrisgrasp.geometry import SE3, Intrinsics
from debrisgrasp.kinematics import LimitSet, RobotModel
from debrisgrasp.robot import (
    DepthFrame,
    HandReading,
    Injection,
    JointReading,
    Limb,
    Robot,
    WrenchReading,
    inject,
)
from debrisgrasp.worlds import World

CAMERA = Intrinsics(fx=80.0, fy=80.0, cx=79.5, cy=44.5, width=160, height=90)
STATES = tuple(state.value for state in State)


@dataclass
class Clock:
    time: float = 0.0

    def now(self) -> float:
        return self.time

    def wait_until(self, time: float) -> None:
        self.time = max(self.time, time)


@dataclass
class StubArm:
    limits: LimitSet
    clock: Clock
    q: Sequence[float]
    is_engaged: bool = False
    is_stopped: bool = False

    @property
    def joint_names(self) -> tuple[str, ...]:
        return self.limits.joint_names

    def read(self) -> JointReading:
        return JointReading(self.clock.now(), tuple(self.q))

    def engage(self) -> None:
        self.is_engaged = not self.is_stopped

    def disengage(self) -> None:
        self.is_engaged = False

    def command(self, q: Sequence[float]) -> None:
        self.q = list(q)

    def stop(self) -> None:
        self.is_stopped, self.is_engaged = True, False

    def reset(self) -> None:
        self.is_stopped = False


@dataclass
class StubSensor:
    clock: Clock
    wrench: tuple[float, ...] = (1.0, -2.0, 3.0, 0.1, 0.2, -0.3)

    def read(self) -> WrenchReading:
        noise = 1e-3 * np.sin(1e3 * self.clock.now())
        return WrenchReading(self.clock.now(), np.array(self.wrench) + noise)


@dataclass
class StubGripper:
    clock: Clock
    name: str = "robotiq_3f"
    is_initialised: bool = True
    openings: tuple[float, ...] = (0.1, 0.1, 0.1)

    def initialise(self) -> None:
        self.is_initialised = True

    def preshape(self, _: str, opening: float) -> None:
        self.openings = (opening,) * 3

    def command(self, command: GripCommand) -> None:
        self.openings = command.openings

    def read(self) -> HandReading:
        return HandReading(self.clock.now(), self.openings, (0.0,) * 3)


@dataclass
class StubCamera:
    clock: Clock

    def capture(self) -> DepthFrame:
        depth = np.full((CAMERA.height, CAMERA.width), 1.4)
        depth[:30] = 0.8
        return DepthFrame(time=self.clock.now(), depth=depth, intrinsics=CAMERA)


@dataclass
class StubHead:
    clock: Clock
    q: Sequence[float] = (0.0, 0.0)
    is_still: bool = True
    joint_names: tuple[str, ...] = ("ptu_pan_joint", "ptu_tilt_joint")

    def read(self) -> JointReading:
        return JointReading(self.clock.now(), tuple(self.q))

    def move_to(self, q: Sequence[float]) -> None:
        self.q = list(q)


@dataclass
class StubWorld:
    """Takes down what happens to it."""

    world: World
    is_held: bool = False
    log: list[tuple[object, ...]] = field(default_factory=list)

    def change_world(self, change: Callable[[World], World]) -> bool:
        if not self.is_held:
            self.world = change(self.world)
        return not self.is_held

    def change_friction(self, friction: float) -> None:
        self.log.append(("friction", friction))

    def stick(self, seconds: float) -> None:
        self.log.append(("stick", seconds))

    def misplace(self, margin: float, arm: str | None) -> bool:
        if not self.is_held:
            self.log.append(("misplace", margin, arm))
        return not self.is_held


def stub_robot(model: RobotModel) -> Robot:
    clock = Clock()
    limbs = {}
    for name in model.arms:
        chain = model.chain(name)
        posture = chain.vector(model.posture(name, model.arm(name).idle)).tolist()
        limbs[name] = Limb(
            arm=StubArm(model.limits(name).hardware, clock, posture),
            sensor=StubSensor(clock),
            gripper=StubGripper(clock),
            loads=LoadModel(T_ee_ft=SE3.from_parts(p=[0.0, 0.0, -0.1])),
        )
    return Robot(
        model=model,
        clock=clock,
        limbs=limbs,
        camera=StubCamera(clock),
        head=StubHead(clock),
    )


def struck(robot, *faults, rng, world=None, **changes):
    """The robot once its faults have begun."""
    injections = [
        fault
        if isinstance(fault, Injection)
        else Injection(fault=fault, **{"at": 0.0, **changes})
        for fault in faults
    ]
    injected = inject(robot, injections, states=STATES, rng=rng, world=world)
    for state in STAGES:
        injected.on_state(state.value)
    return injected
