"""Joint values that somebody gives: of joints that move, and within their limits."""

from __future__ import annotations

from collections.abc import Mapping

from debrisgrasp.errors import ConfigError
from debrisgrasp.kinematics import RobotModel

__all__ = ["arm_joints_above", "require_joints"]

_OVER = 0.01
"""A joint may read this far beyond its limit [rad or m]."""


def require_joints(robot: RobotModel, joints: Mapping[str, float]) -> None:
    """Refuse values that the joints of a robot can't have.

    Parameters
    ----------
    joints
        Value of each [rad or m].

    Raises
    ------
    UnknownNameError
        If the robot has no joint of a name.
    InputError
        If a value is no number.
    ConfigError
        If a value is beyond the limits of its joint, or moves a fixed one.
    """
    robot.joint_values(joints)
    for name, value in joints.items():
        joint = robot.tree.joints[name]
        if joint.kind == "fixed":
            if value != 0.0:
                raise ConfigError(
                    f"joint {name}",
                    got=value,
                    expected="none, for it is fixed",
                    mend="Leave it out.",
                )
            continue
        # One without a range has no limit to leave.
        is_within = joint.lower - _OVER <= value <= joint.upper + _OVER
        if is_within or joint.upper <= joint.lower:
            continue
        slides = joint.kind == "prismatic"
        raise ConfigError(
            f"joint {name}",
            got=value,
            expected=f"{joint.lower:.4g} to {joint.upper:.4g} "
            f"{'m' if slides else 'rad'}",
            mend="Lengths are in metres."
            if slides
            else "Joints are in radians: 90 degrees are 1.571.",
        )


def arm_joints_above(robot: RobotModel, link: str) -> list[str]:
    """Names of the joints of arms that move a link, from base to it."""
    of_arms = {name for arm in robot.arms.values() for name in arm.joints}
    above = [joint.name for joint in robot.tree.joints_above(link)]
    return [name for name in reversed(above) if name in of_arms]
