"""A robot whose arm carries its camera before a fiducial that stands still."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from debrisgrasp._arrays import FloatArray, finite, require_metres
from debrisgrasp._joints import arm_joints_above
from debrisgrasp.calibration import Head, Observations
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import SE3
from debrisgrasp.io.observations_file import ObservationFile
from debrisgrasp.kinematics import ArmCollision, KinematicChain, RobotModel

from .rows import kinematic_sigma_of, points_of, require_joints, sigmas_of

__all__ = ["WristRig", "is_carried", "link_before"]


def is_carried(robot: RobotModel) -> bool:
    """Whether an arm of the robot carries its camera, beyond all its joints."""
    return _carrier(robot) is not None


def link_before(robot: RobotModel, frame: str) -> str:
    """Link that the last joint above a frame moves; the base, if none does."""
    joints = robot.tree.joints_above(frame)
    return next((j.child for j in joints if j.kind != "fixed"), robot.base)


def _carrier(robot: RobotModel) -> str | None:
    if robot.camera is None:
        return None
    above = {joint.name for joint in robot.tree.joints_above(robot.camera)}
    arms = (name for name, spec in robot.arms.items() if above >= set(spec.joints))
    return next(arms, None)


@dataclass(frozen=True, eq=False, kw_only=True)
class WristRig:
    """A robot whose arm carries its camera before a fiducial that stands still.

    The link that the last joint above the camera moves takes the place of the base:
    the camera is sought in it, and each look gives the place of the fiducial in it.
    """

    robot: RobotModel
    fiducial: str | Sequence[float]
    """Link that stands still, at whose origin it sits, and whose z points to where it
    is seen from; or its place in base [m], three numbers, to be seen from above."""

    def __post_init__(self) -> None:
        if isinstance(self.fiducial, str):
            self.robot.tree.require_link(self.fiducial, "fiducial")
            moved = arm_joints_above(self.robot, self.fiducial)
            if moved:
                raise ConfigError(
                    "fiducial",
                    got=f"link {self.fiducial!r}, which joint {moved[-1]} moves, and a "
                    "camera that an arm carries",
                    expected="a link that no arm moves, or a place in base",
                    mend="Let it stand still, and give its place: x, y, z in metres.",
                )
        else:
            place = finite(self.fiducial, "place of the fiducial in base", (3,))
            require_metres("place of the fiducial in base", place)

    @cached_property
    def T_base_fiducial(self) -> SE3:
        """Pose of the fiducial as it was given."""
        if isinstance(self.fiducial, str):
            return self.robot.link_pose(self.fiducial)
        return SE3.from_parts(p=np.asarray(self.fiducial, dtype=np.float64))

    @property
    def arm(self) -> str:
        """Name of the arm that carries the camera."""
        return str(_carrier(self.robot))

    @cached_property
    def link(self) -> str:
        """Link in which the camera is sought: the last that a joint moves."""
        return link_before(self.robot, str(self.robot.camera))

    @cached_property
    def head(self) -> Head:
        """Pose of the camera in that link, as the robot's model has it."""
        robot = self.robot
        return Head.fixed(robot.link_pose(self.link).inverse() @ robot.T_base_camera())

    @property
    def reference(self) -> FloatArray:
        """Readings of a head: none."""
        return np.zeros(0)

    @property
    def T_base_shoulder(self) -> None:
        """Nothing carries both the camera and the fiducial."""
        return

    @property
    def shared(self) -> dict[str, float]:
        """Joints that move both: none."""
        return {}

    @cached_property
    def chain(self) -> KinematicChain:
        """Chain from base to the link, joints that are not the arm's at rest."""
        robot, spec = self.robot, self.robot.arm(self.arm)
        held = {
            joint.name: robot.rest.get(joint.name, 0.0)
            for joint in robot.tree.joints_above(self.link)
            if joint.name not in spec.joints and joint.kind != "fixed"
        }
        return KinematicChain.from_tree(robot.tree, robot.base, self.link, held)

    @cached_property
    def collision(self) -> ArmCollision:
        """Tests of the arm against the rest of the robot."""
        return ArmCollision.fit(self.robot, self.arm, self.chain)

    def observations(self, given: ObservationFile) -> Observations:
        """Turn joints into places of the fiducial in the link.

        Raises
        ------
        UnknownNameError, ConfigError, InputError
            Naming the joint that is unknown, missing or beyond its limits.
        """
        needed = arm_joints_above(self.robot, self.link)
        for row in given.rows:
            if row.position is not None:
                raise ConfigError(
                    f"position of observation {row.name}",
                    got="one, and a camera that an arm carries",
                    expected="none: the fiducial stands still",
                    mend="Give the joints of the arm in each look, and the place of "
                    "the fiducial in base once, as `fiducial`.",
                )
            require_joints(self.robot, row, needed, "camera")
        poses = [self.robot.link_pose(self.link, row.joints) for row in given.rows]
        T_link_base = SE3(np.array([pose.matrix for pose in poses])).inverse()
        return Observations(
            T_link_base.apply(self.T_base_fiducial.p),
            points_of(given),
            sigmas_of(given),
            R_base_wrist=T_link_base.R,
            names=tuple(row.name for row in given.rows),
            kinematic_sigma=kinematic_sigma_of(given),
            link=self.link,
        )
