"""Where a camera is that an arm carries, when it takes a picture."""

from __future__ import annotations

from collections.abc import Mapping

from debrisgrasp._joints import arm_joints_above, require_joints
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import SE3
from debrisgrasp.io.calibration_json import StoredCalibration
from debrisgrasp.kinematics import RobotModel

from .wrist import link_before

__all__ = ["pose_on_arm"]


def pose_on_arm(
    stored: StoredCalibration,
    robot: RobotModel | None,
    joints: Mapping[str, float] | None,
) -> SE3:
    """Pose in base of a camera that a link of an arm carries.

    Parameters
    ----------
    stored
        Its calibration, with a `link`.
    robot
        The robot that it was made with; any other, or another camera, is refused.
    joints
        Values by name when the picture is taken [rad or m]. Each joint of an arm that
        moves the camera must be there; others stand at rest if they are not.

    Raises
    ------
    ConfigError
        For another robot or camera, a joint that is missing or beyond its limits.
    UnknownNameError, InputError
        For a joint that the robot lacks, or that is no number.
    """
    link, what = str(stored.link), f"calibration {stored.path}"
    if joints is None:
        raise _without_joints(stored, "none")
    if robot is None:
        raise ConfigError(
            what,
            got=f"one of a camera on link {link!r} of the robot {stored.robot!r}",
            expected="one of no robot, for a hand without an arm is in use",
            mend="Name its robot with --robot, or as `robot` of the site.",
        )
    stored.require_of(robot.name)
    robot.tree.require_link(link, f"link of {what}")
    own = link if robot.camera is None else link_before(robot, robot.camera)
    if own != link:
        raise ConfigError(
            what,
            got=f"one of a camera on link {link!r}",
            expected=f"one of a camera on {own!r}, which carries {robot.camera!r}, the "
            f"camera of {robot.name}",
            mend="Calibrate this camera, or name as `camera` of the robot's file the "
            "frame of the one that was calibrated.",
        )
    missing = [name for name in arm_joints_above(robot, link) if name not in joints]
    if missing:
        raise _without_joints(stored, f"none for {', '.join(missing)}")
    require_joints(robot, joints)
    return robot.link_pose(link, joints) @ stored.T_link_camera


def _without_joints(stored: StoredCalibration, got: str) -> ConfigError:
    return ConfigError(
        f"joints beside calibration {stored.path}",
        got=got,
        expected=f"all that move link {stored.link!r}, which carries the camera, as "
        "they were when the picture was taken",
        mend="Give --joints NAME=VALUE ... (`plan`, `motion`, `view`; joints= in "
        "Python), or the pose of the camera in base as --camera-pose.",
    )
