"""Which arms a command is about."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from debrisgrasp._words import arm_called
from debrisgrasp.errors import ConfigError, InputError, UnknownNameError
from debrisgrasp.kinematics import ArmReach
from debrisgrasp.pipeline import with_hands
from debrisgrasp.prototypes import FURTHER_HANDS, load_grippers

from .capture_arguments import tell
from .site_arguments import add_grippers, add_site, site_of

__all__ = ["add_arm", "chosen_arms", "require_carried"]


def add_arm(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that choose a robot and its arms, and ``--json``."""
    parser.add_argument(
        "--robot", help="a shipped robot or a YAML file (default: the site's, or roman)"
    )
    parser.add_argument("--arm", help="only this arm")
    parser.add_argument("--gripper", help="only arms that carry this hand")
    add_grippers(parser)
    add_site(parser)
    parser.add_argument(
        "--json", action="store_true", help="print JSON for machines instead of text"
    )


def chosen_arms(arguments: argparse.Namespace) -> list[ArmReach]:
    """Arms that the arguments choose; one at least.

    Raises
    ------
    UnknownNameError
        If the robot, arm or gripper is not known; the known ones are listed.
    ConfigError
        If the file of the site, or of a hand, is malformed.
    """
    settings = site_of(arguments)
    robot = settings.robot_model()
    if robot is None:
        raise InputError("robot", got="none", expected="one with an arm")
    hands = load_grippers(settings.grippers)
    tell(
        f"the {arm_called(name)} carries {arm.gripper!r}, of which there is no file: "
        f"that hand touches nothing here. {FURTHER_HANDS}"
        for name, arm in robot.arms.items()
        if arm.gripper not in hands
    )
    robot = with_hands(robot, hands)
    names = tuple(robot.arms)
    if settings.arm is not None:
        names = (robot.arm(settings.arm).name,)
    if settings.gripper is not None:
        carriers = robot.arms_with(settings.gripper)
        names = tuple(name for name in names if name in carriers)
        if not names:
            carried = sorted(arm.gripper for arm in robot.arms.values())
            raise UnknownNameError(
                f"gripper of {robot.name}", settings.gripper, carried
            )
    return [ArmReach(robot, name) for name in names]


def require_carried(arms: Sequence[ArmReach], grippers: Sequence[str | None]) -> None:
    """Raise `ConfigError` if no arm carries a hand that some grasps are for.

    A grasp for any hand, as a pose that stands for itself, has None for it.
    """
    carried = {arm.gripper for arm in arms}
    if not {None, *carried} & set(grippers):
        raise ConfigError(
            "gripper of the grasps",
            got=", ".join(sorted({str(gripper) for gripper in grippers})),
            expected=f"{', '.join(sorted(carried))}, which the arms in question carry",
            mend="Give the robot that they were planned for.",
        )
