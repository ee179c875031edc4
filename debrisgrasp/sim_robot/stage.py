"""Robot and bodies in one simulation, a period at a time."""

from __future__ import annotations

from collections.abc import Mapping
from math import hypot
from typing import Any
from xml.etree import ElementTree

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.robot import FakeConfig
from debrisgrasp.robot.drives import Drives
from debrisgrasp.sim._mujoco import mujoco
from debrisgrasp.sim.model import (
    compiled,
    for_grips,
    placement,
    pose_of,
    world_tree,
)
from debrisgrasp.worlds import World

from .arm import SimArm, SimForceSensor
from .boxes import add_boxes
from .contacts import Contacts, HandTouch
from .gripper import SimGripper
from .physics import RobotPhysics
from .servo import JointServo
from .tree import RobotTree

__all__ = ["SimStage"]

_LOOK_EVERY = 5
"""Periods between two looks at the contacts."""
_OVERLAP = 0.005
"""How deep a body may begin in the robot, as what lies against it does [m]."""
_BEGIN = 0.2
"""Before the clock starts [s]."""


class SimStage:
    """Physics of a robot and the bodies before it."""

    def __init__(
        self,
        robot: RobotModel,
        world: World,
        arms: Mapping[str, SimArm],
        hands: Mapping[str, SimGripper],
        sensors: Mapping[str, SimForceSensor],
        mounts: Mapping[str, SE3],
        drives: Drives,
        config: FakeConfig,
        physics: RobotPhysics,
    ) -> None:
        self._robot, self._config, self._physics = robot, config, physics
        self._arms, self._hands, self._sensors = arms, hands, sensors
        self._mounts, self._drives = mounts, drives
        self._tree = RobotTree(robot, physics.rotor_inertia)
        self._joints = [drives.index[name] for name in self._tree.joints]
        self._of_arm = {
            name: [self._tree.joints.index(joint) for joint in arm.joint_names]
            for name, arm in arms.items()
        }
        self._servo = JointServo(robot, self._tree.joints, physics)
        self._step = physics.physics.time_step
        self._n_steps = _whole(config.period, self._step)
        self._n_ticks = 0
        self._mj_step = mujoco().mj_step
        self._world, self._seen_at = world, -1
        self._touched: dict[int, bool] = {}
        self.touches: dict[str, HandTouch] = {name: HandTouch() for name in arms}
        self.peak_force = dict.fromkeys(arms, 0.0)
        self.peak_torque = dict.fromkeys(arms, 0.0)
        self.peak_time = dict.fromkeys(arms, 0.0)
        self.deepest = dict.fromkeys(arms, 0.0)
        """Deepest interpenetration of hands with bodies, by arm [m]."""
        self.scrapes: dict[tuple[str, str], float] = {}
        self._friction: float | None = None
        self._compile(world)
        self._begin(np.array([drives.q[i] for i in self._joints]))
        self._started = self._centers()

    def _begin(self, q: FloatArray) -> None:
        """Let the arms stand until their drives and fingers carry their weight."""
        mj, model, data = mujoco(), self._model, self.data
        self._servo.place(q, SE3.identity())
        for hand in self._hands.values():
            hand.begin(model, data)
        mj.mj_forward(model, data)
        self._require_apart()
        self._servo.aim(q, np.zeros(len(q)), SE3.identity(), self._config.period)
        for _ in range(round(_BEGIN / self._step)):
            self._servo.drive(1.0, self._step)
            mj.mj_step(model, data)
        mj.mj_forward(model, data)
        self._measure(-np.array(data.sensordata))

    def _require_apart(self) -> None:
        """Refuse bodies that begin inside the robot: they would be shot out of it."""
        found = self._contacts.inside_robot(self.data)
        if found is None or found[0] < _OVERLAP:
            return
        depth, body, link = found
        raise InputError(
            "bodies before the robot",
            got=f"{self._world.names[body]} {1e3 * depth:.0f} mm inside {link}",
            expected=f"none deeper than {1e3 * _OVERLAP:.0f} mm in the robot",
            mend="Put them farther ahead.",
        )

    @property
    def world(self) -> World:
        """Bodies where they are now, frame odom."""
        if self._seen_at != self._n_ticks:
            poses = [pose_of(self.data, i) for i in range(len(self._world.bodies))]
            self._world, self._seen_at = self._world.placed(poses), self._n_ticks
        return self._world

    @property
    def held(self) -> dict[str, str]:
        """Bodies that the fingers of a hand press from both sides, by arm."""
        names = self._world.names
        return {
            arm: names[touch.held]
            for arm, touch in self.touches.items()
            if touch.held is not None
        }

    @property
    def removed(self) -> tuple[str, ...]:
        """Bodies that a hand held and put down far from where they were."""
        far = np.linalg.norm(self._centers() - self._started, axis=1)
        held = set(self.held.values())
        return tuple(
            name
            for i, name in enumerate(self._world.names)
            if i in self._touched
            and name not in held
            and far[i] > self._config.removed_beyond
        )

    @property
    def has_diverged(self) -> bool:
        """Whether the engine had to start over: poses mean nothing from then on."""
        kinds = mujoco().mjtWarning
        bad = (kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC)
        return any(self.data.warning[kind].number for kind in bad)

    def advance(self, T_odom_base: SE3) -> None:
        """Let a period pass."""
        if any(hand.shape != hand.built_shape for hand in self._hands.values()):
            self._reshape()
        for hand in self._hands.values():
            hand.advance()
        drives, n = self._drives, self._n_steps
        q = np.array([drives.q[i] for i in self._joints])
        step = np.array([drives.step[i] for i in self._joints])
        self._servo.aim(q, step, T_odom_base, self._config.period)
        total = np.zeros(6 * len(self._arms))
        for k in range(n):
            self._servo.drive((k + 1) / n, self._step)
            self._mj_step(self._model, self.data)
            total -= self.data.sensordata  # MuJoCo tells what holds the hand
        self._n_ticks += 1
        self._measure(total / n)
        if self._n_ticks % _LOOK_EVERY == 0:
            self._look()

    def set_friction(self, friction: float) -> None:
        """Give all contacts the same coefficient of sliding friction."""
        self._friction = friction
        self._model.geom_friction[:, 0] = friction

    def _compile(self, world: World) -> None:
        """Make the model of world, links, and hands in their present shapes."""
        root = world_tree(world, self._physics.physics)
        for_grips(root)
        palms = self._tree.add(root)
        for arm, palm in palms.items():
            self._hands[arm].add(root, palm, self._step)
            site = ElementTree.SubElement(palm, "site", name=f"{arm}/wrist")
            site.attrib.update(placement(self._mounts[arm]))
        add_boxes(root, world)
        self._servo.add(root)
        section = ElementTree.SubElement(root, "sensor")
        for arm in self._arms:
            for kind in ("force", "torque"):
                ElementTree.SubElement(section, kind, site=f"{arm}/wrist")
        self._model: Any = compiled(root, world)
        self.data: Any = mujoco().MjData(self._model)
        if self._friction is not None:
            self.set_friction(self._friction)
        self._servo.bind(self._model, self.data)
        hands = {arm: hand.model for arm, hand in self._hands.items()}
        self._contacts = Contacts(
            self._model, len(world.bodies), self._tree.links_of_arms(), hands
        )

    def _reshape(self) -> None:
        """Compile anew after a hand took another preshape; all else stays as it is."""
        mj, before, old = mujoco(), self.data, self._model
        aims = {arm: list(hand.aims) for arm, hand in self._hands.items()}
        self._compile(self.world)
        data, model = self.data, self._model
        data.time = before.time
        n_free = 7 * len(self._world.bodies), 6 * len(self._world.bodies)
        data.qpos[: n_free[0]] = before.qpos[: n_free[0]]
        data.qvel[: n_free[1]] = before.qvel[: n_free[1]]
        for hand in self._hands.values():
            hand.begin(model, data)
        names = {old.joint(i).name for i in range(old.njnt)}
        for i in range(model.njnt):
            name = model.joint(i).name
            if name and name in names:
                data.joint(name).qpos[:] = before.joint(name).qpos
                data.joint(name).qvel[:] = before.joint(name).qvel
        for arm, hand in self._hands.items():
            hand.aims = aims[arm]
        mj.mj_forward(model, data)

    def _measure(self, wrenches: FloatArray) -> None:
        """Tell devices what they measure; wrenches of all hands, shape (6 arms,)."""
        q, rows = self._servo.positions().tolist(), wrenches.tolist()
        for number, (name, arm) in enumerate(self._arms.items()):
            arm.measure(tuple([q[i] for i in self._of_arm[name]]))
            self._hands[name].measure()
            load = self._sensors[name].feel(rows[6 * number : 6 * number + 6])
            force, torque = hypot(*load[:3]), hypot(*load[3:])
            if force > self.peak_force[name]:
                self.peak_force[name] = force
                self.peak_time[name] = self._n_ticks * self._config.period
            self.peak_torque[name] = max(self.peak_torque[name], torque)

    def _look(self) -> None:
        """Take note of what hands hold, and what links scrape."""
        self.touches, scrapes = self._contacts.read(self.data)
        for arm, touch in self.touches.items():
            self.deepest[arm] = max(self.deepest[arm], touch.depth)
            if touch.held is not None:
                self._touched[touch.held] = True
        for (arm, body), depth in scrapes.items():
            key = arm, self._world.names[body]
            self.scrapes[key] = max(depth, self.scrapes.get(key, 0.0))

    def _centers(self) -> FloatArray:
        """Centres of mass of all bodies, frame odom [m], shape (n, 3)."""
        return np.array(self.data.xipos[1 : len(self._world.bodies) + 1])


def _whole(period: float, step: float) -> int:
    """Count the steps in a period, or raise `ConfigError`."""
    n = round(period / step)
    if n < 1 or abs(n * step - period) > 1e-9:
        raise ConfigError(
            "Physics.time_step",
            got=f"{step:g} s with a period of {period:g} s",
            expected="a whole number of steps in each period of the devices",
        )
    return n
