"""A robot that shows its camera a fiducial: its joints, and the places they give."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.calibration import (
    KINEMATIC_SIGMA,
    MEASUREMENT_SIGMA,
    Head,
    Observations,
)
from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.geometry import SE3
from debrisgrasp.io.observations_file import ObservationFile, ObservationRow
from debrisgrasp.kinematics import ArmCollision, KinematicChain, RobotModel
from debrisgrasp.kinematics.urdf import UrdfJoint

__all__ = ["CalibrationRig", "observations_of", "rig_of"]

_LIMIT_SLACK = 0.1
"""How far a joint may read beyond its limit [rad or m]; more is another unit."""
_FARTHEST_WOUND = 4.0 * np.pi
"""No joint without limits is wound up so far [rad]; most angles in degrees are."""
_DEGREES = "degrees: multiply by pi / 180"


@dataclass(frozen=True, eq=False, kw_only=True)
class CalibrationRig:
    """A robot that shows its camera a fiducial on one of its arms.

    Joints above both the camera and the fiducial, such as RoMan's torso, move both
    alike. They are taken to stand at rest, whatever they read: the camera's pose that
    comes out is that at rest.
    """

    robot: RobotModel
    fiducial: str
    """Link at whose origin the fiducial sits; z points to where it is seen from."""

    def __post_init__(self) -> None:
        self.robot.tree.require_link(self.fiducial, "fiducial")
        self.robot.T_base_camera()  # a robot without a camera is refused here

    @property
    def camera(self) -> str:
        """Optical frame of the camera."""
        return str(self.robot.camera)

    @cached_property
    def shared(self) -> dict[str, float]:
        """Joints that move camera and fiducial alike, at rest."""
        above = {j.name for j in self.robot.tree.joints_above(self.camera)}
        both = [
            joint
            for joint in self.robot.tree.joints_above(self.fiducial)
            if joint.name in above and joint.kind != "fixed"
        ]
        return {joint.name: self.robot.rest.get(joint.name, 0.0) for joint in both}

    @cached_property
    def T_base_shoulder(self) -> SE3:
        """Pose of the link that carries both camera and arm, at rest."""
        above = {j.name for j in self.robot.tree.joints_above(self.camera)}
        for joint in self.robot.tree.joints_above(self.fiducial):
            if joint.name in above:
                return self.robot.link_poses(self.shared)[joint.child]
        return SE3.identity()

    @cached_property
    def arm(self) -> str:
        """Name of the arm that carries the fiducial."""
        for name, spec in self.robot.arms.items():
            moved = {j.name for j in self._joints(self.fiducial)}
            if moved & set(spec.joints) - set(self.shared):
                return name
        above = {joint.name for joint in self._joints(self.camera)}
        is_on_arm = any(above >= set(spec.joints) for spec in self.robot.arms.values())
        raise ConfigError(
            "fiducial",
            got=f"link {self.fiducial!r}, which no arm moves",
            expected="a link on " + " or ".join(self.robot.arms),
            mend="A camera that an arm carries is calibrated in Python "
            "(docs/calibration.md, A camera on the wrist)."
            if is_on_arm
            else "",
        )

    @cached_property
    def chain(self) -> KinematicChain:
        """Chain from base to the fiducial, joints shared with the camera at rest."""
        spec = self.robot.arm(self.arm)
        held = {
            joint.name: self.robot.rest.get(joint.name, 0.0)
            for joint in self._joints(self.fiducial)
            if joint.name not in spec.joints
        }
        return KinematicChain.from_tree(
            self.robot.tree, self.robot.base, self.fiducial, {**held, **self.shared}
        )

    @cached_property
    def head(self) -> Head:
        """What carries the camera, as the robot's model has it."""
        moving = [j for j in self._joints(self.camera) if j.name not in self.shared]
        if not moving:
            at_rest = self.robot.T_base_camera(self.shared)
            return Head.fixed(at_rest)
        chain = KinematicChain.from_tree(
            self.robot.tree, self.robot.base, self.camera, self.shared
        )
        if not chain.is_revolute.all():
            raise ConfigError(
                f"head of robot {self.robot.name}",
                got="a joint that slides",
                expected="joints that turn",
            )
        return Head(
            T_base_camera_at_zero=chain.T_base_tip_at_zero,
            axes=chain.axes,
            points=chain.points,
            joint_names=chain.joint_names,
        )

    @property
    def reference(self) -> FloatArray:
        """Readings of the head at rest, shape (k,)."""
        rest = self.robot.rest
        return np.array([rest.get(name, 0.0) for name in self.head.joint_names])

    def _joints(self, link: str) -> list[UrdfJoint]:
        above = self.robot.tree.joints_above(link)
        return [joint for joint in above if joint.kind != "fixed"]

    @cached_property
    def collision(self) -> ArmCollision:
        """Tests of the arm against the rest of the robot, shared joints at rest."""
        return ArmCollision.fit(self.robot, self.arm, self.chain, held=self.shared)

    def observations(self, given: ObservationFile) -> Observations:
        """Turn joints into places by forward kinematics.

        Raises
        ------
        UnknownNameError, ConfigError, InputError
            Naming the joint that is unknown, missing or beyond its limits.
        """
        for row in given.rows:
            self._require_joints(row)
        with_joints = [self.chain.vector(row.joints) for row in given.rows]
        T_base_fiducial = self.chain.fk(np.array(with_joints))
        places = np.array(
            [
                T_base_fiducial.p[i] if row.position is None else row.position
                for i, row in enumerate(given.rows)
            ]
        )
        knows_wrist = all(row.position is None for row in given.rows)
        rest = dict(zip(self.head.joint_names, self.reference, strict=True))
        readings = [
            [row.joints.get(name, rest[name]) for name in rest] for row in given.rows
        ]
        return Observations(
            places,
            _points(given),
            _sigmas(given),
            np.array(readings).reshape(len(places), -1),
            T_base_fiducial.R if knows_wrist else None,
            tuple(row.name for row in given.rows),
            _kinematic_sigma(given),
        )

    def _require_joints(self, row: ObservationRow) -> None:
        self.robot.joint_values(row.joints)  # refuses unknown names
        needed = () if row.position is not None else self.chain.joint_names
        missing = [name for name in needed if name not in row.joints]
        if missing:
            raise ConfigError(
                f"joints of observation {row.name}",
                got=f"no {', '.join(missing)}",
                expected="every joint between base and fiducial",
            )
        for name, value in row.joints.items():
            joint = self.robot.tree.joints[name]
            low = max(joint.lower, -_FARTHEST_WOUND)
            high = min(joint.upper, _FARTHEST_WOUND)
            is_within = low - _LIMIT_SLACK <= value <= high + _LIMIT_SLACK
            if joint.kind != "fixed" and not is_within:
                slides = joint.kind == "prismatic"
                mend = "millimetres: divide by 1000" if slides else _DEGREES
                raise InputError(
                    f"joint {name} of observation {row.name}",
                    got=f"{value:g}",
                    expected=f"{low:.4g} to {high:.4g} {'m' if slides else 'rad'}",
                    mend=f"It looks like {mend}." if abs(value) > 6.3 else "",
                )


def observations_of(given: ObservationFile, rig: CalibrationRig | None) -> Observations:
    """Observations of a file; without a robot their positions must be written down."""
    if rig is not None:
        return rig.observations(given)
    for row in given.rows:
        if row.position is None or row.joints:
            raise ConfigError(
                f"observation {row.name}",
                got="joint values, but no robot",
                expected="a position in base, or `robot` and `fiducial` of the file",
                mend="Name the robot and the fiducial's link: --robot, --fiducial.",
            )
    places = [row.position or () for row in given.rows]
    return Observations(
        np.array(places).reshape(-1, 3),
        _points(given),
        _sigmas(given),
        names=tuple(row.name for row in given.rows),
        kinematic_sigma=_kinematic_sigma(given),
    )


def rig_of(
    given: ObservationFile,
    folder: Path,
    robot: str | Path | None = None,
    fiducial: str | None = None,
) -> CalibrationRig | None:
    """Rig that a file, or the caller instead, names; None if neither names a robot.

    A robot's file that the observations name lies beside them.
    """
    name = robot or given.robot
    link = fiducial or given.fiducial
    if name is None:
        return None
    if link is None:
        raise ConfigError(
            "fiducial",
            got="none",
            expected="the link of the robot that carries it",
            mend="Name it in the observations (`fiducial:`) or with --fiducial.",
        )
    if robot is None and (folder / name).suffix in (".yaml", ".yml"):
        name = folder / name
    return CalibrationRig(robot=RobotModel.load(name), fiducial=link)


def _points(given: ObservationFile) -> FloatArray:
    empty = [row.name for row in given.rows if row.point is None]
    if empty:
        raise ConfigError(
            "observations",
            got=f"no point for {', '.join(empty[:5])}",
            expected="where the camera sees the fiducial, three numbers [m]",
            mend="Measure it (`debrisgrasp calibrate pick` or `find`), or leave the "
            "observation out.",
        )
    return np.array([row.point for row in given.rows]).reshape(-1, 3)


def _sigmas(given: ObservationFile) -> FloatArray:
    default = (MEASUREMENT_SIGMA if given.sigma is None else given.sigma,)
    rows: list[Sequence[float]] = [row.sigma or default for row in given.rows]
    return np.array([np.broadcast_to(row, 3) for row in rows]).reshape(-1, 3)


def _kinematic_sigma(given: ObservationFile) -> float:
    given_sigma = given.kinematic_sigma
    return KINEMATIC_SIGMA if given_sigma is None else given_sigma
