"""What a pipeline is given, checked and loaded."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import inf

from debrisgrasp._words import arm_called
from debrisgrasp.errors import ChoiceError, ConfigError, UnknownNameError
from debrisgrasp.kinematics import ArmReach, RobotModel, with_hand
from debrisgrasp.planning import LoadConfig
from debrisgrasp.prototypes import (
    FURTHER_HANDS,
    GripperModel,
    PrototypeLibrary,
    load_grippers,
    require_hands,
)

__all__ = [
    "LEAST_MASS",
    "MOST_MASS",
    "arms_of",
    "hands_of",
    "library_of",
    "liftable",
    "require_generic",
    "require_limits",
    "robot_of",
    "with_hands",
]

LEAST_MASS, MOST_MASS = 1e-3, 1e4
"""Less or more [kg] can only be another unit."""


def robot_of(robot: str | os.PathLike[str] | RobotModel) -> RobotModel | None:
    """Load a robot unless it is one; None for a floating hand."""
    if isinstance(robot, RobotModel):
        return robot
    return None if robot == "none" else RobotModel.load(os.fspath(robot))


def hands_of(
    grippers: str | os.PathLike[str] | None,
    prototypes: str | os.PathLike[str] | PrototypeLibrary | None,
) -> Mapping[str, GripperModel]:
    """Find the hands that are known: those of a folder, or of a dictionary, too."""
    own = prototypes.grippers if isinstance(prototypes, PrototypeLibrary) else {}
    return {**load_grippers(grippers), **own}


def with_hands(robot: RobotModel, grippers: Mapping[str, GripperModel]) -> RobotModel:
    """Return the robot with the hands that its URDF lacks, open.

    Links of a hand that is not there would touch nothing, and nobody would see it.
    """
    require_hands(grippers)
    for name, arm in robot.arms.items():
        if arm.gripper in grippers:
            hand = grippers[arm.gripper]
            preshape, shape = next(iter(hand.preshapes.items()))
            robot = with_hand(robot, name, hand.solids(preshape, shape.widest))
    return robot


def require_limits(seed: int, deadline: float | None, mass: float | None) -> None:
    """Raise unless seed, deadline and mass mean something."""
    if seed < 0:
        raise ConfigError("seed", got=seed, expected="an integer of 0 or more")
    if deadline is not None and not deadline > 0:
        raise ConfigError(
            "deadline",
            got=f"{deadline} s",
            expected="a positive number of seconds, or none",
        )
    if mass is not None and not LEAST_MASS <= mass <= MOST_MASS:
        raise ConfigError(
            "mass of the object",
            got=f"{mass} kg",
            expected=f"{LEAST_MASS:g} to {MOST_MASS:g} kg, or none if not known",
        )


def liftable(arms: Sequence[ArmReach], config: LoadConfig) -> float:
    """Find what the strongest of some arms lifts [kg]; infinite for none."""
    return max((arm.wrench_limits[0] for arm in arms), default=inf) / config.gravity


def arms_of(
    robot: RobotModel | None, arm: str | None, gripper: str | None
) -> tuple[ArmReach, ...]:
    """Arms of the robot that are in use."""
    if robot is None:
        if arm is not None:
            raise ChoiceError(
                "arm",
                got=repr(arm),
                expected="no arm, because the robot is 'none'",
                mend="Name a robot, or choose the hand by its gripper.",
            )
        return ()
    if arm is not None and arm not in robot.arms:
        raise UnknownNameError("arm", arm, robot.arms)
    carried = {name: spec.gripper for name, spec in robot.arms.items()}
    if gripper is not None and gripper not in carried.values():
        raise UnknownNameError(
            f"gripper of {robot.name}",
            gripper,
            sorted(carried.values()),
            mend="A hand without an arm is planned for with the robot 'none'.",
        )
    if arm is not None and gripper not in (None, carried[arm]):
        raise ChoiceError(
            f"gripper of the {arm_called(arm)}",
            got=repr(gripper),
            expected=f"{carried[arm]!r}, which it carries",
            mend="Choose the arm or the gripper; one follows from the other.",
        )
    return tuple(
        ArmReach(robot, name)
        for name in carried
        if arm in (None, name) and gripper in (None, carried[name])
    )


def library_of(
    arms: tuple[ArmReach, ...],
    gripper: str | None,
    *,
    prototypes: str | os.PathLike[str] | PrototypeLibrary | None,
    known: Mapping[str, GripperModel],
) -> PrototypeLibrary:
    """Prototypes of the hands that are in use; one at least."""
    if isinstance(prototypes, PrototypeLibrary):
        library = replace(prototypes, grippers=known)
    else:
        library = PrototypeLibrary.load(prototypes, grippers=known)
    for name in sorted({prototype.gripper for prototype in library} - set(known)):
        raise UnknownNameError("gripper", name, known, mend=FURTHER_HANDS)
    library = library.select(gripper=gripper)
    hands = {arm.gripper for arm in arms}
    if hands:
        library = library.select(names=[p.name for p in library if p.gripper in hands])
    if not len(library):
        used = sorted(hands) or [gripper or "HAND"]
        unknown = sorted(hands - set(known))
        raise ChoiceError(
            "prototypes",
            got=f"none for {', '.join(used)}" if hands or gripper else "none",
            expected="at least one",
            mend=f"No hand {unknown[0]!r} is known, only {', '.join(sorted(known))}. "
            + FURTHER_HANDS
            if unknown
            else "Give a folder that has some (--prototypes), or make them with "
            f"`debrisgrasp prototype adapt --gripper {used[0]}`.",
        )
    return library


def require_generic(library: PrototypeLibrary) -> None:
    """Raise unless a prototype may be tried where nothing is marked."""
    if not len(library.select(kind="generic")):
        raise ChoiceError(
            "prototypes",
            got="object-specific ones only",
            expected="a generic one, as neither a mask nor a region says what to take",
            mend="Mark the object, or write `kind: generic` in a prototype's file.",
        )
