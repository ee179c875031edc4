"""Does a robot keep the protocols? One check for each promise that others rely on.

Those in `CHECKS` can be run one by one from pytest::

    @pytest.mark.parametrize("check", CHECKS, ids=str)
    def test_my_robot_conforms(check, my_robot):
        assert check(my_robot) == ()
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from traceback import extract_tb

from debrisgrasp._arrays import require_range
from debrisgrasp._checked import checked
from debrisgrasp.prototypes import GripperModel, with_shipped

from .gaps import Gap, absent, gaps_of
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
    base_stands_by_itself,
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
    """Whether it moves the robot: joints by up to 2 degrees, fingers, head, base."""
    function: Callable[..., Iterator[str]]
    needs: frozenset[str] = frozenset()
    """Members of devices that it uses, such as ``arm.read``."""
    subject: str = ""
    """The device that it is about, if a robot may be without: ``head`` or ``base``."""
    takes: frozenset[str] = frozenset()
    """What it must know beside the robot: ``period``, ``grippers``."""

    def lacks(self, gaps: Iterable[Gap]) -> tuple[str, ...]:
        """Tell which of the members that it needs are missing."""
        return tuple(member for gap in gaps for member in gap.of(self.needs))

    def is_idle(self, robot: Robot) -> bool:
        """Tell whether the robot is without the device that this is about."""
        return bool(self.subject) and getattr(robot, self.subject) is None

    def strangers(
        self, robot: Robot, grippers: Mapping[str, GripperModel]
    ) -> tuple[str, ...]:
        """Tell which hands it can't try, for it does not know how far they open."""
        if "grippers" not in self.takes:
            return ()
        names = dict.fromkeys(limb.gripper.name for limb in robot.limbs.values())
        return tuple(name for name in names if name not in grippers)

    def __call__(
        self,
        robot: Robot,
        *,
        period: float = 0.004,
        grippers: Mapping[str, GripperModel] | None = None,
    ) -> tuple[str, ...]:
        """Return what is wrong, in words; nothing, if the promise is kept.

        Nothing is done with a robot that lacks a member that the check needs. Of a
        device that a robot may be without, and is, nothing can be wrong. Period and
        hands are those of `check_robot`.
        """
        if lacking := self.lacks(absent(robot)):
            return (f"not run: there is no {', '.join(lacking)}",)
        if self.is_idle(robot):
            return ()
        hands = with_shipped(grippers)
        known = {"period": period, "grippers": hands}
        problems: list[str] = []
        try:
            if strange := self.strangers(robot, hands):
                return (f"not run: {_unknown(strange)}",)
            problems.extend(
                self.function(robot, **{name: known[name] for name in self.takes})
            )
        except (Exception, SystemExit) as error:  # noqa: BLE001 - a driver may raise any
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
    skipped: tuple[Finding, ...] = ()
    """Checks that were not run, each with its reason."""

    @property
    def is_conformant(self) -> bool:
        """Whether every promise is kept that was looked at."""
        return not self.findings

    def __str__(self) -> str:
        n = len(self.findings)
        first = f"{len(self.passed)} checks passed, {n} problem{'s' * (n != 1)}"
        if self.skipped:
            first += f", {len(self.skipped)} not run"
        lines = [f"  {found.check}: {found.problem}" for found in self.findings]
        reasons = dict.fromkeys(each.problem for each in self.skipped)
        for reason in reasons:
            names = [each.check for each in self.skipped if each.problem == reason]
            lines.append(f"  not run: {', '.join(names)} ({reason})")
        return "\n".join([first, *lines])


def _unknown(hands: Iterable[str]) -> str:
    return f"{', '.join(hands)} is not known: give its model as grippers"


def _disengage(robot: Robot) -> None:
    """Let every arm hold by itself, also after an error or Ctrl-C in mid motion."""
    for limb in robot.limbs.values():
        with suppress(Exception):  # the check has told
            limb.arm.disengage()


def _check(
    function: Callable[..., Iterator[str]],
    promise: str,
    needs: str,
    *,
    moves: bool = False,
    subject: str = "",
    takes: str = "",
) -> Check:
    members, known = frozenset(needs.split()), frozenset(takes.split())
    return Check(function.__name__, promise, moves, function, members, subject, known)


_CLOCK = "clock.now clock.wait_until "
_STATE = "arm.engage arm.disengage arm.is_engaged arm.stop arm.reset arm.is_stopped "
_MOTION = _CLOCK + "arm.read arm.command arm.limits "
_HEAD = "head.joint_names head.read head.is_still "

CHECKS = (
    _check(
        protocols_are_kept, "devices have, and answer, what their protocols ask for", ""
    ),
    _check(
        arms_are_named,
        "limbs, joints and hands bear the names of the model",
        "arm.joint_names gripper.name",
    ),
    _check(clock_runs, "time rises, and waiting ends at the time asked for", _CLOCK),
    _check(
        times_rise,
        "readings are of now, and later ones are later",
        _CLOCK + "arm.read sensor.read gripper.read head.read",
    ),
    _check(
        joints_are_read,
        "joints are finite, in radians, within their limits",
        "arm.read arm.limits arm.joint_names",
    ),
    _check(
        limits_are_true, "the limits of the arms are those of the model", "arm.limits"
    ),
    _check(
        wrist_is_read,
        "an idle wrist reads no more than tool and bias",
        _CLOCK + "sensor.read arm.read arm.joint_names",
    ),
    _check(
        answers_whole,
        "a hand tells opening and force of every finger, in SI",
        "gripper.read",
    ),
    _check(
        camera_sees,
        "depth is in metres, in the size and frame that it says",
        "clock.now camera.capture",
    ),
    _check(
        head_is_known,
        "the head's joints are the model's, and it stands",
        _HEAD,
        subject="head",
    ),
    _check(
        base_stands,
        "the base tells a pose, and stands when stopped",
        _CLOCK + "base.read base.stop",
        subject="base",
    ),
    _check(stop_latches, "a stop stays until it is reset", _CLOCK + _STATE),
)
"""Checks that move nothing."""

MOVING_CHECKS = (
    _check(
        disengaged_arm_stands,
        "a disengaged arm follows nothing",
        _MOTION + "arm.disengage arm.is_engaged",
        moves=True,
        takes="period",
    ),
    _check(
        arm_follows,
        "an engaged arm goes where it is sent",
        _MOTION + _STATE + "arm.joint_names",
        moves=True,
        takes="period",
    ),
    _check(
        wrist_feels_weight,
        "a turned wrist feels the tool's weight",
        _MOTION + _STATE + "sensor.read",
        moves=True,
        takes="period",
    ),
    _check(
        nonsense_is_refused,
        "an arm follows no NaN",
        _MOTION + _STATE,
        moves=True,
        takes="period",
    ),
    _check(
        stopped_arm_stands,
        "a stopped arm follows nothing",
        _MOTION + _STATE,
        moves=True,
        takes="period",
    ),
    _check(
        hand_moves,
        "fingers initialise, open and close",
        _CLOCK + "arm.disengage gripper.name gripper.initialise gripper.preshape "
        "gripper.is_initialised gripper.command gripper.read",
        moves=True,
        takes="period grippers",
    ),
    _check(
        head_moves,
        "the head turns and tells when it has arrived",
        _CLOCK + _HEAD + "head.move_to arm.disengage",
        moves=True,
        subject="head",
    ),
    _check(
        base_stands_by_itself,
        "a base goes when it is told, and stands when it is told no more",
        _CLOCK + "base.read base.drive base.stop arm.disengage",
        moves=True,
        subject="base",
    ),
)
"""Checks that move: joints by up to 2 degrees, fingers by 2 cm, the head by 2 degrees,
the base by 2 cm, or by 4 if it does not stand by itself.
The arms must stand free, and a person at the stop."""

_UNSAFE = "nothing is moved as long as a check at rest finds something"


@checked
def check_robot(
    robot: Robot,
    *,
    motion: bool = False,
    period: float = 0.004,
    grippers: Mapping[str, GripperModel] | None = None,
) -> Report:
    """Run all checks on a robot.

    Parameters
    ----------
    robot
        Devices of the robot; its hands are empty and touch nothing.
    motion
        Run `MOVING_CHECKS` as well, if those at rest find nothing; without, nothing
        moves.
    period
        Of the drives, in which arms and hands are sent where they go, 0.0005 to 0.01:
        `TaskSettings.period` of the task [s].
    grippers
        Hands that do not ship, by name; one that is in neither is not moved, and stands
        among what was skipped.

    Returns
    -------
    Report
        A check at rest that fails does not keep others from being run, but for those
        that need what a device lacks. Checks of a head or a base are not run on a robot
        without.

    Raises
    ------
    InputError
        If something else than a `Robot` is given, or one of its limbs isn't a `Limb`.
    ConfigError
        If the period is out of its range.
    """
    require_range("period [s]", period, 5e-4, 0.01)
    hands = with_shipped(grippers)
    passed: list[str] = []
    findings: list[Finding] = []
    skipped: list[Finding] = []
    gaps: tuple[Gap, ...] = ()
    at_rest = {check.name for check in CHECKS}
    for check in (*CHECKS, *(MOVING_CHECKS if motion else ())):
        if check.is_idle(robot):
            why = f"the robot has no {check.subject}"
            skipped.append(Finding(check.name, why))
            continue
        if check.moves and at_rest.intersection(found.check for found in findings):
            skipped.append(Finding(check.name, _UNSAFE))
            continue
        if lacking := check.lacks(gaps):
            why = f"needs {', '.join(lacking)}, see protocols_are_kept"
            skipped.append(Finding(check.name, why))
            continue
        if strange := check.strangers(robot, hands):
            skipped.append(Finding(check.name, _unknown(strange)))
            continue
        problems = check(robot, period=period, grippers=hands)
        findings += [Finding(check.name, problem) for problem in problems]
        if not problems:
            passed.append(check.name)
        elif check.function is protocols_are_kept:
            gaps = gaps_of(robot)
    return Report(tuple(passed), tuple(findings), tuple(skipped))
