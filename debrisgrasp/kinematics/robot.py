"""A robot as planning sees it: a URDF file and one file of settings beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf, isfinite, pi
from numbers import Real
from pathlib import Path

from debrisgrasp._files import read_yaml
from debrisgrasp.errors import ConfigError, InputError, UnknownNameError
from debrisgrasp.geometry import SE3, Solid

from .chain import KinematicChain
from .frames import with_frames
from .limits import LimitFamily, LimitSet
from .packages import file_at
from .robot_file import ArmSpec, RobotFile, robot_path
from .solids import solids_of_shape
from .urdf import UrdfTree

__all__ = ["RobotModel"]

_ROUNDING = 1e-3
"""What a value in a file may lie outside of a limit, as rounded ones do [rad or m]."""

_FASTEST = 50.0
"""Beyond it, speeds are in degrees or millimetres, or a number that says nothing."""
_DEGREES = "degrees, multiply by pi / 180"
_STANDING = "as it stands"
_UNNAMED = "A joint that isn't named stands at zero: name it, at a value within them."


@dataclass(frozen=True, eq=False, kw_only=True)
class RobotModel:
    """Links and joints of a robot, its arms, and where it keeps what it doesn't use."""

    name: str
    tree: UrdfTree
    base: str
    """Link that every pose and solid is expressed in."""
    camera: str | None
    """Optical frame of the depth camera."""
    arms: Mapping[str, ArmSpec]
    rest: Mapping[str, float]
    """Values of the joints that no arm moves [rad or m]."""
    ignored_collisions: frozenset[frozenset[str]]
    """Pairs of links that are not tested against each other."""
    drives: bool = True
    """Whether the base can drive; an arm on a table can't."""

    def __repr__(self) -> str:
        arms = (f"{name} ({arm.gripper})" for name, arm in self.arms.items())
        return f"<RobotModel {self.name}: arms {', '.join(arms)}>"

    @classmethod
    def load(cls, name_or_path: str | Path) -> RobotModel:
        """Load a shipped robot by name, or any robot by the path of its YAML file.

        Raises
        ------
        UnknownNameError
            If no robot of that name is shipped; names those that are.
        ConfigError
            If the file or its URDF is malformed; names the field and what it needs.
        """
        path = robot_path(name_or_path)
        file = RobotFile.parse(read_yaml(path), path)
        urdf = file_at(file.urdf, path.parent)
        model = cls(
            name=file.name,
            tree=with_frames(UrdfTree.load(urdf), file.frames),
            base=file.base,
            camera=file.camera,
            drives=file.drives,
            arms=file.arms,
            rest=file.rest,
            ignored_collisions=file.ignored_collisions,
        )
        model._require_known_names()
        return model

    def _require_known_names(self) -> None:
        tree = self.tree
        links = {"base": self.base}
        if self.camera is not None:
            links["camera"] = self.camera
        for arm in self.arms.values():
            links[f"tip of arm {arm.name}"] = arm.tip
            links[f"hand of arm {arm.name}"] = arm.hand
        for kind, link in links.items():
            tree.require_link(link, kind)
        for pair in self.ignored_collisions:
            for link in pair:
                tree.require_link(link, "link in ignored_collisions")
        named: list[tuple[str, Mapping[str, float]]] = [("rest", self.rest)]
        for arm in self.arms.values():
            at_zero = dict.fromkeys(arm.joints, 0.0)
            named.append((f"joints of arm {arm.name}", at_zero))
            for key, posture in arm.postures.items():
                named.append((f"posture {key!r}", {**at_zero, **posture}))
        for where, values in named:
            for joint in values:
                if joint not in tree.joints:
                    raise UnknownNameError(
                        f"joint in {where} of robot {self.name}", joint, tree.joints
                    )
        for where, values in named:
            if not where.startswith("joints of"):
                self._require_within_limits(where, values)
        for arm in self.arms.values():
            self._require_own_joints(arm)

    def _require_within_limits(self, where: str, values: Mapping[str, float]) -> None:
        for name, value in values.items():
            joint = self.tree.joints[name]
            low, high, whose = joint.lower, joint.upper, "its limits in the URDF"
            if joint.kind == "continuous":
                low, high, whose = -2.0 * pi, 2.0 * pi, "a turn to either side"
            # A fixed joint has no value, and one without a range none to leave.
            if joint.kind == "fixed" or high <= low:
                continue
            if low - _ROUNDING <= value <= high + _ROUNDING:
                continue
            slides = joint.kind == "prismatic"
            mend = "millimetres, divide by 1000" if slides else _DEGREES
            mend = f"If these are {mend}." if value else _UNNAMED
            raise ConfigError(
                f"{name} in {where} of robot {self.name}",
                got=value,
                expected=f"{low:.4g} to {high:.4g} {'m' if slides else 'rad'}, {whose}",
                mend=mend,
            )

    def _require_own_joints(self, arm: ArmSpec) -> None:
        """Refuse joints, postures and a hand that are not of this arm."""
        tree, what = self.tree, f"of arm {arm.name} of robot {self.name}"
        above = {
            link: {j.name for j in tree.joints_above(link) if j.kind != "fixed"}
            for link in (self.base, arm.tip, arm.hand)
        }
        moving = above[arm.tip] - above[self.base]
        for name in sorted(moving.difference(arm.joints)):
            if (driver := tree.joints[name].mimics) in arm.joints:
                raise ConfigError(
                    f"joints {what}",
                    got=f"{driver}, which drives {name} between base and tip",
                    expected="joints that move alone",
                    mend="A chain with a mimic joint can't be planned for with its "
                    f"driver moving: leave {driver} out, too.",
                )
        for k, name in enumerate(arm.joints):
            if name not in moving or name in arm.joints[:k]:
                is_fixed = tree.joints[name].kind == "fixed"
                odd = "which is fixed" if is_fixed else "not between them"
                raise ConfigError(
                    f"joints {what}",
                    got=f"{name}, {'twice' if name in moving else odd}",
                    expected=f"joints that move between base {self.base!r} and tip "
                    f"{arm.tip!r}",
                )
            # What hangs on the hand is left out of the test against the scene.
            if name not in above[arm.hand]:
                hangs = tree.joints[name].child in tree.links_below(arm.hand)
                carries = "carries" if hangs else "is not carried by"
                raise ConfigError(
                    f"hand {what}",
                    got=f"{arm.hand!r}, which {carries} joint {name} of the arm",
                    expected="the link at which the hand begins, beyond all its joints",
                )
        others = {name for other in self.arms.values() for name in other.joints}
        for key, posture in arm.postures.items():
            for name in posture:
                if name in others.difference(arm.joints):
                    raise ConfigError(
                        f"posture {key!r} {what}",
                        got=f"{name}, a joint of another arm",
                        expected="joints of this arm: " + ", ".join(arm.joints),
                    )

    def arm(self, name: str) -> ArmSpec:
        """Return an arm by name, or raise `UnknownNameError` listing the arms."""
        if name not in self.arms:
            raise UnknownNameError(f"arm of robot {self.name}", name, self.arms)
        return self.arms[name]

    def arms_with(self, gripper: str) -> tuple[str, ...]:
        """Names of the arms that carry a gripper."""
        return tuple(n for n, arm in self.arms.items() if arm.gripper == gripper)

    def chain(
        self, arm: str, locked: Mapping[str, float] | None = None
    ) -> KinematicChain:
        """Chain from base to the arm's tip.

        Parameters
        ----------
        arm
            Name of the arm.
        locked
            Joints to hold still and their values, beside those that the robot's file
            leaves out of the arm's joints; for instance ``{"torso_joint": 0.0}``.
        """
        if locked:
            return self._chain(arm, locked)
        if arm not in self._chains:
            self._chains[arm] = self._chain(arm, {})
        return self._chains[arm]

    @cached_property
    def _chains(self) -> dict[str, KinematicChain]:
        """Those that were asked for: to write out their formulas takes a while."""
        return {}

    def _chain(self, arm: str, locked: Mapping[str, float]) -> KinematicChain:
        spec = self.arm(arm)
        on_the_way = {joint.name for joint in self.tree.joints_above(spec.tip)}
        held = {
            name: self.rest.get(name, 0.0)
            for name in on_the_way
            if name not in spec.joints and self.tree.joints[name].kind != "fixed"
        }
        chain = KinematicChain.from_tree(
            self.tree, self.base, spec.tip, {**held, **locked}
        )
        others = {
            joint.name
            for other in self.arms.values()
            if other is not spec
            for joint in self.tree.joints_above(other.tip)
        }
        return replace(chain, shared=frozenset(others.intersection(chain.joint_names)))

    def limits(self, arm: str, chain: KinematicChain | None = None) -> LimitFamily:
        """Limits of the joints of an arm's chain; None: those of `chain`.

        Speeds come from the URDF, the rest from the robot's file.

        Raises
        ------
        ConfigError
            If the URDF has no speed for a joint.
        """
        spec, chain = self.arm(arm), chain or self.chain(arm)
        speeds = {name: self.tree.joints[name].velocity for name in chain.joint_names}
        for name, speed in speeds.items():
            if not 0.0 < speed <= _FASTEST:
                raise ConfigError(
                    f"largest speed of joint {name} of robot {self.name}",
                    got="none" if speed == inf else speed,
                    expected=f"one above 0 and up to {_FASTEST:g} [rad/s or m/s], from "
                    "the data sheet",
                    mend=f"Give `velocity` in its <limit> in {self.tree.path.name}.",
                )
        usual = spec.limits["acceleration"]
        hardware = LimitSet.of_chain(
            chain,
            velocity=list(speeds.values()),
            acceleration=[spec.accelerations.get(name, usual) for name in speeds],
            force=spec.limits["force"],
            torque=spec.limits["torque"],
        )
        return LimitFamily.around(hardware)

    def posture(self, arm: str, name: str) -> dict[str, float]:
        """Joint values of an arm's named posture.

        Raises
        ------
        UnknownNameError
            If the arm, or a posture of it, is not known.
        """
        spec = self.arm(arm)
        if name not in spec.postures:
            raise UnknownNameError(
                f"posture of arm {arm} of robot {self.name}", name, spec.postures
            )
        return dict(spec.postures[name])

    def standing(self, joints: Mapping[str, float]) -> RobotModel:
        """Return the robot with arms that idle where some of their joints are now.

        Others are planned around them there.

        Parameters
        ----------
        joints
            Values by name [rad or m]; the others of these arms are idle.

        Raises
        ------
        UnknownNameError, InputError
            As `joint_values` does.
        """
        values, arms = self.joint_values(joints), dict(self.arms)
        for name, arm in self.arms.items():
            if not joints.keys().isdisjoint(arm.joints):
                now = {joint: values[joint] for joint in arm.joints}
                postures = {**arm.postures, _STANDING: now}
                arms[name] = replace(arm, postures=postures, idle=_STANDING)
        return replace(self, arms=arms)

    def joint_values(
        self, moved: Mapping[str, float] | None = None
    ) -> dict[str, float]:
        """Value of every joint: at rest, arms idle, but for those in ``moved``.

        Raises
        ------
        UnknownNameError
            If the robot has no joint of a name in ``moved``.
        InputError
            If a value is no number.
        """
        values = dict.fromkeys(self.tree.joints, 0.0) | dict(self.rest)
        for arm in self.arms.values():
            values |= self.posture(arm.name, arm.idle)
        for name, value in (moved or {}).items():
            if name not in self.tree.joints:
                raise UnknownNameError(
                    f"joint of robot {self.name}", name, self.tree.joints
                )
            if not (isinstance(value, Real) and isfinite(value)):
                raise InputError(f"joint {name}", got=value, expected="a number")
        return values | dict(moved or {})

    def link_poses(self, moved: Mapping[str, float] | None = None) -> dict[str, SE3]:
        """Pose of every link in the base frame; ``moved`` as in `joint_values`."""
        poses = self.tree.link_poses(self.joint_values(moved))
        to_base = poses[self.base].inverse()
        return {link: to_base @ pose for link, pose in poses.items()}

    def link_pose(self, link: str, moved: Mapping[str, float] | None = None) -> SE3:
        """Pose of one link in the base frame; ``moved`` as in `joint_values`."""
        values = self.joint_values(moved)
        to_base = self.tree.link_pose(self.base, values).inverse()
        return to_base @ self.tree.link_pose(link, values)

    def links_solids(
        self, moved: Mapping[str, float] | None = None
    ) -> list[tuple[str, Solid]]:
        """Collision solids of every link, hands included, in the base frame.

        Parameters
        ----------
        moved
            Joint values by name, for instance those of a grasp; arms not named stand in
            their idle posture, all other joints at rest.
        """
        poses = self.link_poses(moved)
        return [
            (link, solid.moved(poses[link]))
            for link, shapes in self.tree.shapes.items()
            for shape in shapes
            for solid in solids_of_shape(shape, link, self.tree.path.parent)
        ]

    @cached_property
    def fixed_solids(self) -> tuple[Solid, ...]:
        """Collision solids of the links that no joint moves, in the base frame."""
        joints_above = self.tree.joints_above
        return tuple(
            solid
            for link, solid in self.links_solids()
            if all(joint.kind == "fixed" for joint in joints_above(link))
        )

    def stands_at(self, place: tuple[float, float], height: float) -> bool:
        """Whether what no joint moves begins below a height over a place in base [m].

        What hangs higher, as the beam of a gantry, leaves room for what is put down.
        """
        boxes = (solid.bounds for solid in self.fixed_solids)
        return any(
            bool(((box.lower[:2] <= place) & (place <= box.upper[:2])).all())
            for box in boxes
            if box.lower[2] < height
        )

    def T_base_camera(self, moved: Mapping[str, float] | None = None) -> SE3:
        """Nominal pose of the camera; a calibration is better where there is one.

        Raises
        ------
        ConfigError
            If the robot's file names no camera.
        """
        if self.camera is None:
            raise ConfigError(
                f"camera of robot {self.name}",
                got="none",
                expected="an optical frame",
                mend="Name one under `camera:` in the robot's file.",
            )
        return self.link_pose(self.camera, moved)
