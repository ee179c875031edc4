"""Does a robot keep the protocols? One check for each promise that others rely on.

Those in `CHECKS` can be run one by one from pytest::

    @pytest.mark.parametrize("check", CHECKS, ids=str)
    def test_my_robot_conforms(check, my_robot):
        assert check(my_robot) == ()
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from traceback import extract_tb

from debrisgrasp._checked import checked

from .interface import Robot
from .promises import (
    answers_whole,
    arms_are_named,
    base_stands,
    camera_sees,
    clock_runs,
    head_is_known,
    joints_are_read,
    limits_are_true,
    protocols_are_kept,
    stop_latches,
    times_rise,
    wrist_is_read,
)
from .promises_moving import (
    arm_follows,
    disengaged_arm_stands,
    hand_moves,
    head_moves,
    nonsense_is_refused,
    stopped_arm_stands,
    wrist_feels_weight,
)

__all__ = ["CHECKS", "MOVING_CHECKS", "Check", "Finding", "Report", "check_robot"]


@dataclass(frozen=True, slots=True)
class Check:
    """One promise of the protocols."""

    name: str
    promise: str
    """In words."""
    moves: bool
    """Whether it moves the robot: joints by up to 2 degrees, fingers, head."""
    function: Callable[[Robot], Iterator[str]]

    def __call__(self, robot: Robot) -> tuple[str, ...]:
        """Return what is wrong, in words; nothing, if the promise is kept."""
        problems: list[str] = []
        try:
            problems.extend(self.function(robot))
        except Exception as error:  # noqa: BLE001 - a driver may raise anything
            place = extract_tb(error.__traceback__)[-1]
            problems.append(
                f"raised {type(error).__name__}: {error} "
                f"({Path(place.filename).name}, line {place.lineno})"
            )
        finally:
            if self.moves:
                _disengage(robot)
        return tuple(problems)

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True, slots=True)
class Finding:
    """A promise that is not kept."""

    check: str
    problem: str


@dataclass(frozen=True, slots=True)
class Report:
    """What became of all checks."""

    passed: tuple[str, ...]
    """Names of the checks without a finding."""
    findings: tuple[Finding, ...]

    @property
    def is_conformant(self) -> bool:
        """Whether every promise is kept that was looked at."""
        return not self.findings

    def __str__(self) -> str:
        lines = [f"{len(self.passed)} checks passed, {len(self.findings)} problems"]
        lines += [f"  {found.check}: {found.problem}" for found in self.findings]
        return "\n".join(lines)


def _disengage(robot: Robot) -> None:
    """Let every arm hold by itself, also after an error or Ctrl-C in mid motion."""
    for limb in robot.limbs.values():
        with suppress(Exception):  # the check has told
            limb.arm.disengage()


def _check(
    function: Callable[[Robot], Iterator[str]], promise: str, *, moves: bool = False
) -> Check:
    return Check(function.__name__, promise, moves, function)


CHECKS = (
    _check(
        protocols_are_kept, "devices have, and answer, what their protocols ask for"
    ),
    _check(arms_are_named, "limbs, joints and hands bear the names of the model"),
    _check(clock_runs, "time rises, and waiting ends at the time asked for"),
    _check(times_rise, "readings are of now, and later ones are later"),
    _check(joints_are_read, "joints are finite, in radians, within their limits"),
    _check(limits_are_true, "the limits of the arms are those of the model"),
    _check(wrist_is_read, "an idle wrist reads no more than tool and bias"),
    _check(answers_whole, "a hand tells opening and force of every finger, in SI"),
    _check(camera_sees, "depth is in metres, in the size and frame that it says"),
    _check(head_is_known, "the head's joints are the model's, and it stands"),
    _check(base_stands, "the base tells a pose, and stands when stopped"),
    _check(stop_latches, "a stop stays until it is reset"),
)
"""Checks that move nothing."""

MOVING_CHECKS = (
    _check(disengaged_arm_stands, "a disengaged arm follows nothing", moves=True),
    _check(arm_follows, "an engaged arm goes where it is sent", moves=True),
    _check(wrist_feels_weight, "a turned wrist feels the tool's weight", moves=True),
    _check(nonsense_is_refused, "an arm follows no NaN", moves=True),
    _check(stopped_arm_stands, "a stopped arm follows nothing", moves=True),
    _check(hand_moves, "fingers initialise, open and close", moves=True),
    _check(head_moves, "the head turns and tells when it has arrived", moves=True),
)
"""Checks that move: joints by up to 2 degrees, fingers by 2 cm, the head by 2 degrees.
The arms must stand free, and a person at the stop."""


@checked
def check_robot(robot: Robot, *, motion: bool = False) -> Report:
    """Run all checks on a robot.

    Parameters
    ----------
    robot
        Devices of the robot; its hands are empty and touch nothing.
    motion
        Run `MOVING_CHECKS` as well; without, nothing moves.

    Returns
    -------
    Report
        A check that fails does not keep the others from being run.

    Raises
    ------
    InputError
        If something else than a `Robot` is given.
    """
    passed, findings = [], []
    for check in (*CHECKS, *(MOVING_CHECKS if motion else ())):
        problems = check(robot)
        findings += [Finding(check.name, problem) for problem in problems]
        if not problems:
            passed.append(check.name)
    return Report(tuple(passed), tuple(findings))
