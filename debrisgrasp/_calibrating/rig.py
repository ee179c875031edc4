"""A robot that shows its camera a fiducial: its joints, and the places they give."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.calibration import Head, Observations
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import SE3
from debrisgrasp.io.observations_file import ObservationFile
from debrisgrasp.kinematics import ArmCollision, KinematicChain, RobotModel
from debrisgrasp.kinematics.urdf import UrdfJoint

from .rows import kinematic_sigma_of, points_of, require_joints, sigmas_of
from .wrist import is_carried

__all__ = ["CalibrationRig"]


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
        raise ConfigError(
            "fiducial",
            got=f"link {self.fiducial!r}, which no arm moves",
            expected="a link on " + " or ".join(self.robot.arms),
            mend="A camera that an arm carries has a `WristRig`."
            if is_carried(self.robot)
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
            needed = () if row.position is not None else self.chain.joint_names
            require_joints(self.robot, row, needed)
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
            points_of(given),
            sigmas_of(given),
            np.array(readings).reshape(len(places), -1),
            T_base_fiducial.R if knows_wrist else None,
            tuple(row.name for row in given.rows),
            kinematic_sigma_of(given),
        )
