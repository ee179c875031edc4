"""Which arms a command is about."""

from __future__ import annotations

import argparse

from debrisgrasp.errors import InputError, UnknownNameError
from debrisgrasp.kinematics import ArmReach, RobotModel

__all__ = ["add_arm", "chosen_arms"]


def add_arm(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that choose a robot and its arms, and ``--json``."""
    parser.add_argument(
        "--robot",
        default="roman",
        help="a shipped robot or a YAML file (default: roman)",
    )
    parser.add_argument("--arm", help="only this arm")
    parser.add_argument("--gripper", help="only arms that carry this hand")
    parser.add_argument(
        "--json", action="store_true", help="print JSON for machines instead of text"
    )


def chosen_arms(arguments: argparse.Namespace) -> list[ArmReach]:
    """Arms that the arguments choose; one at least.

    Raises
    ------
    UnknownNameError
        If the robot, arm or gripper is not known; the known ones are listed.
    """
    if arguments.robot == "none":
        raise InputError("robot", got="none", expected="one with an arm")
    robot = RobotModel.load(arguments.robot)
    names = tuple(robot.arms)
    if arguments.arm is not None:
        names = (robot.arm(arguments.arm).name,)
    if arguments.gripper is not None:
        carriers = robot.arms_with(arguments.gripper)
        names = tuple(name for name in names if name in carriers)
        if not names:
            carried = sorted(arm.gripper for arm in robot.arms.values())
            raise UnknownNameError(
                f"gripper of {robot.name}", arguments.gripper, carried
            )
    return [ArmReach(robot, name) for name in names]
