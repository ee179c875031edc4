"""A robot that only exists in memory, in a world that only exists there too.

It is kinematic: joints follow, springs push back, bodies that lose their support sink
to the next one. There is no dynamics, and no clock but the one that it is asked to let
run, so that hours of work take minutes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil, isfinite
from typing import ClassVar

import numpy as np

from debrisgrasp._arrays import Rng
from debrisgrasp._checked import checked
from debrisgrasp.control import Body as Tool
from debrisgrasp.control import LoadModel
from debrisgrasp.errors import InputError, UnknownNameError
from debrisgrasp.geometry import SE3, Solid
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.kinematics.solids import solids_of_shape
from debrisgrasp.prototypes import GripperModel, load_grippers
from debrisgrasp.worlds import World, volume_and_centroid
from debrisgrasp.worlds.body import as_part

from .config import FakeConfig
from .drives import Drives, Timeline, Violation
from .fake_arm import FakeArm, FakeForceSensor
from .fake_body import FakeBase, FakeDepthCamera, FakeHead
from .fake_hand import FakeGripper
from .interface import Limb, Robot
from .links import LinkSpheres
from .stage import Stage

__all__ = ["FakeClock", "FakeRobot", "FakeTruth", "fake_robot"]

_LOOK_EVERY = 25
"""Ticks between two looks at what the links of moving arms go through."""


class FakeClock:
    """Lets the world advance; fulfils `debrisgrasp.robot.Clock`."""

    def __init__(self, robot: FakeRobot) -> None:
        self._robot = robot

    def now(self) -> float:
        """Seconds since the start."""
        return self._robot.timeline.now

    def wait_until(self, time: float) -> None:
        """Advance the world, in whole periods, to that time."""
        if not isfinite(time):
            raise InputError("time to wait for", got=time, expected="seconds")
        timeline = self._robot.timeline
        n_ticks = ceil((time - timeline.now) / timeline.period - 1e-6)
        for _ in range(n_ticks):
            self._robot.advance()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FakeTruth:
    """What really happened, which no device tells."""

    world: World
    """Bodies where they are, in the frame of the odometry."""
    begun: World
    """Bodies where they were at the start, or where an injected fault put them."""
    held: Mapping[str, str]
    """Name of the body that each hand holds, by arm; empty hands are left out."""
    removed: tuple[str, ...]
    """Bodies that a hand put down far from where they were."""
    violations: tuple[Violation, ...]
    peak_force: Mapping[str, float]
    """Largest true force at each hand, by arm [N]."""
    peak_torque: Mapping[str, float]
    """Largest true torque about each hand, by arm [N m]."""
    scrapes: Mapping[tuple[str, str], float]
    """How deep the links of an arm went into a body, by arm and body [m]."""
    overloads: tuple[str, ...]
    """Arms whose hand bore more than the limits of the hardware."""
    T_base_camera: SE3
    """Where the camera really is."""


class FakeRobot:
    """Devices of a robot, and the truth behind them; made by `fake_robot`."""

    _arm_type: ClassVar[type[FakeArm]] = FakeArm
    _sensor_type: ClassVar[type[FakeForceSensor]] = FakeForceSensor

    def __init__(
        self,
        model: RobotModel,
        world: World,
        *,
        rng: Rng,
        config: FakeConfig,
        grippers: Mapping[str, GripperModel],
    ) -> None:
        self.model, self.config = model, config
        self.violations: list[Violation] = []
        """Commands that were refused or could not be followed, in order."""
        self.timeline = Timeline(config.period)
        streams = rng.spawn(len(model.arms) + 1)
        self._drives = Drives(config.period)
        self.base = FakeBase(self.timeline, config, self.violations)
        self.head = self._make_head()
        self.arms: dict[str, FakeArm] = {}
        self.hands: dict[str, FakeGripper] = {}
        self.sensors: dict[str, FakeForceSensor] = {}
        limbs = {}
        for name, stream in zip(model.arms, streams[1:], strict=True):
            limbs[name] = self._make_limb(name, grippers, stream)
        self._shapes = self._make_shapes()
        frame = model.camera or model.base
        camera = FakeDepthCamera(frame, self._view, self.timeline, config, streams[0])
        self.robot = Robot(
            model=model,
            clock=FakeClock(self),
            limbs=limbs,
            camera=camera,
            head=self.head if self.head.joint_names else None,
            base=self.base if model.drives else None,
        )
        """Devices, as any robot has them."""
        self._begun = world
        self._stage = self._make_stage(world)

    @cached_property
    def _links(self) -> dict[str, LinkSpheres]:
        return {
            name: LinkSpheres(self.model, name, arm.chain)
            for name, arm in self.arms.items()
        }

    @property
    def world(self) -> World:
        """Bodies where they are now, in the frame of the odometry."""
        return self._stage.world

    def truth(self) -> FakeTruth:
        """Return what no device tells."""
        stage = self._stage
        return FakeTruth(
            world=stage.world,
            begun=self._begun,
            held=stage.held,
            removed=stage.removed,
            violations=tuple(self.violations),
            peak_force=dict(stage.peak_force),
            peak_torque=dict(stage.peak_torque),
            scrapes=dict(stage.scrapes),
            overloads=tuple(
                name
                for name, arm in self.arms.items()
                if stage.peak_force[name] > arm.limits.force
                or stage.peak_torque[name] > arm.limits.torque
            ),
            T_base_camera=self.T_base_camera(),
        )

    def T_base_camera(self) -> SE3:
        """Where the camera really is now, in the frame of the base."""
        nominal = self._link_poses()[self.model.camera or self.model.base]
        return nominal @ self.config.calibration_error

    def advance(self) -> None:
        """Let one period pass."""
        self.timeline.tick += 1
        self.base.advance()
        self.head.advance()
        for arm in self.arms.values():
            arm.advance()
        if not self._drives.is_still:
            self._drives.advance()
            if self.timeline.tick % _LOOK_EVERY == 0:
                self._look_at_links()
        self._stage.advance(self.base.T_odom_base)

    def _look_at_links(self) -> None:
        for name, links in self._links.items():
            if links.has_moved(self.arms[name].q):
                self._stage.scrape(name, links, self.base.T_odom_base)

    def change_world(self, change: Callable[[World], World]) -> bool:
        """Let bodies be others, or elsewhere; not while a hand holds one."""
        before = self._stage
        if before.held:
            return False
        after = self._make_stage(change(before.world))
        after.remember(before)
        self._stage, self._begun = after, change(self._begun)
        return True

    def change_friction(self, friction: float) -> None:
        """Make everything as slick, or as rough."""
        self._stage.friction = friction

    def stick(self, seconds: float) -> None:
        """Let hands keep hold of what they hold for so long."""
        self._stage.sticky_ticks = ceil(seconds / self.timeline.period)

    def misplace(self, margin: float, arm: str | None = None) -> bool:
        """Put the last joint that has limits beyond its upper one [rad].

        Not while the hand is at a body: it would be driven through it.
        """
        name = arm or next(iter(self.arms))
        if self._stage.is_at_a_body(name):
            return False
        device = self.arms[name]
        upper = device.limits.upper
        joint = max(i for i, value in enumerate(upper) if isfinite(value))
        self._drives.put(device.joints[joint], float(upper[joint]) + margin)
        return True

    def _make_head(self) -> FakeHead:
        """Joints between base and camera that no arm moves."""
        model = self.model
        if model.camera is None:
            return FakeHead({}, (), self.timeline, self.violations)
        moved = {joint for arm in model.arms for joint in model.chain(arm).joint_names}
        joints = [
            joint
            for joint in reversed(model.tree.joints_above(model.camera))
            if joint.kind != "fixed" and joint.name not in moved
        ]
        most = self.config.head_speed
        bounds = {j.name: (j.lower, j.upper, min(j.velocity, most)) for j in joints}
        start = [model.rest.get(joint.name, 0.0) for joint in joints]
        return FakeHead(bounds, start, self.timeline, self.violations)

    def _make_limb(
        self, name: str, grippers: Mapping[str, GripperModel], rng: Rng
    ) -> Limb:
        model, config, timeline = self.model, self.config, self.timeline
        spec, chain = model.arm(name), model.chain(name)
        if spec.gripper not in grippers:
            raise UnknownNameError(f"gripper of arm {name}", spec.gripper, grippers)
        arm = self._arm_type(
            name,
            chain,
            model.limits(name, chain).hardware,
            chain.vector(config.start_of(model, name)).tolist(),
            self._drives,
            timeline,
            config,
            self.violations,
        )
        hand = self._make_hand(name, grippers[spec.gripper])
        T_ee_ft = self._T_ee_ft(name)
        loads = LoadModel(
            T_ee_ft=T_ee_ft,
            tool=_tool(hand.model, self._weighed(hand.model), T_ee_ft),
            bias=np.array(config.bias),
            wrench_sign=config.wrench_sign,
            sensor_range=config.sensor_range,
            sensor_noise=config.stated_noise,
        )
        sensor = self._sensor_type(arm, loads, timeline, config, rng)
        self.arms[name], self.hands[name], self.sensors[name] = arm, hand, sensor
        return Limb(arm=arm, sensor=sensor, gripper=hand, loads=loads)

    def _make_hand(self, arm: str, gripper: GripperModel) -> FakeGripper:
        """Hand of an arm."""
        del arm
        return FakeGripper(gripper, self.timeline, self.config, self.violations)

    def _make_stage(self, world: World) -> Stage:
        """Bodies, and what hands do to them."""
        return Stage(world, self.arms, self.hands, self.sensors, self.config)

    @staticmethod
    def _weighed(hand: GripperModel) -> Sequence[Solid]:
        """Solids that carry the weight of a hand: all of it counts as its palm's."""
        return hand.palm

    def _T_ee_ft(self, name: str) -> SE3:
        """Pose of the sensor in the hand: a link named for it, or the hand itself."""
        spec, tree = self.model.arm(name), self.model.tree
        below = tree.links_below(tree.body_of(spec.tip))
        sensors = [link for link in tree.shapes if "ft_frame" in link and link in below]
        if not sensors:
            return SE3.identity()
        poses = self.model.link_poses()
        return poses[spec.tip].inverse() @ poses[sensors[0]]

    def _make_shapes(self) -> list[tuple[str, tuple[Solid, ...]]]:
        """Solids of the links that are no hands, in the frames of the links."""
        tree = self.model.tree
        hands = frozenset[str]().union(
            *(tree.links_below(arm.hand) for arm in self.model.arms.values())
        )
        return [
            (
                link,
                tuple(
                    solid
                    for shape in shapes
                    for solid in solids_of_shape(shape, link, tree.path.parent)
                ),
            )
            for link, shapes in tree.shapes.items()
            if shapes and link not in hands
        ]

    def _link_poses(self) -> dict[str, SE3]:
        """Pose of every link in base."""
        values = dict(zip(self.head.joint_names, self.head.read().q, strict=True))
        for arm in self.arms.values():
            values |= dict(zip(arm.joint_names, arm.q, strict=True))
        return self.model.link_poses({k: float(v) for k, v in values.items()})

    def _view(self) -> tuple[World, SE3, list[Solid]]:
        """World, true pose of the camera and what of the robot is near its picture."""
        T_odom_base = self.base.T_odom_base
        pose = T_odom_base @ self.T_base_camera()
        if not self.config.sees_itself:
            return self.world, pose, []
        poses = self._link_poses()
        solids = [
            solid.moved(T_odom_base @ poses[link])
            for link, shapes in self._shapes
            for solid in shapes
        ]
        for name, hand in self.hands.items():
            T_odom_hand = T_odom_base @ poses[self.model.arm(name).tip]
            solids += [solid.moved(T_odom_hand) for solid in hand.solids()]
        # The camera looks out of its own housing.
        return self.world, pose, [s for s in solids if s.signed_distance(pose.p) > 0.03]


@checked
def fake_robot(
    model: RobotModel,
    world: World,
    *,
    rng: Rng,
    config: FakeConfig | None = None,
    grippers: Mapping[str, GripperModel] | None = None,
) -> FakeRobot:
    """Put a robot in memory before a world.

    Parameters
    ----------
    model
        Which robot; arms start in their idle posture.
    world
        Bodies at rest, in the frame of the base.
    rng
        Source of all randomness: the same state and the same commands give the same
        run.
    config
        How the robot behaves, and how wrong its devices are.
    grippers
        Hands by name; None: those that ship.

    Returns
    -------
    FakeRobot
        Its ``robot`` has the devices that `check_robot` and the executive take,
        ``truth()`` tells what really happened, and time goes on as somebody waits.
        Bodies are rigid, move with a hand or a push, and come to rest without dynamics;
        `debrisgrasp.sim_robot.sim_robot` has those, and takes minutes for a pile.

    Raises
    ------
    UnknownNameError
        If an arm carries a hand that is not among them, or is to begin where no joint
        or posture of it is.

    Examples
    --------
    >>> import numpy as np
    >>> from debrisgrasp.kinematics import RobotModel
    >>> from debrisgrasp.worlds import named_scene
    >>> rng = np.random.default_rng(0)
    >>> fake = fake_robot(RobotModel.load("roman"), named_scene("hedgehog"), rng=rng)
    >>> fake.robot.clock.wait_until(0.1)
    >>> fake.truth().overloads
    ()
    """
    hands = load_grippers() if grippers is None else grippers
    return FakeRobot(
        model, world, rng=rng, config=config or FakeConfig(), grippers=hands
    )


def _tool(hand: GripperModel, solids: Sequence[Solid], T_ee_ft: SE3) -> Tool:
    """Weight of a hand, spread evenly over some of its solids; sensor frame."""
    pieces = [volume_and_centroid(as_part(solid)) for solid in solids]
    volumes = np.array([volume for volume, _ in pieces])
    center = volumes @ np.array([where for _, where in pieces]) / volumes.sum()
    return Tool(hand.mass, T_ee_ft.inverse().apply(center))
