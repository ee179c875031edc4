"""What a device lacks is told once; nothing moves while something is wrong at rest."""

from __future__ import annotations

from dataclasses import replace

import pytest

from debrisgrasp.errors import InputError
from debrisgrasp.robot import CHECKS, MOVING_CHECKS, check_robot
from tests.unit.robot.broken_robots import (
    Changed,
    incomplete,
    lying_limits,
    made,
    reset_is_no_method,
    silent,
    stuck_joint,
    unnamed_reading,
    with_limb,
)
from tests.unit.robot.rigs import GRIPPERS


def no_camera(robot):
    return replace(robot, camera=None)


def no_time(robot):
    return replace(robot, clock=object())


@pytest.mark.parametrize(
    ("broken", "needed"),
    [
        (incomplete, "stop of arm right"),
        (reset_is_no_method, "reset of arm right"),
        (unnamed_reading, "read of arm right"),
        (no_camera, "capture of camera"),
        (no_time, "wait_until of clock"),
    ],
)
def test_what_a_device_lacks_is_told_once(broken, needed):
    report = check_robot(broken(made()))
    [found] = report.findings
    assert found.check == "protocols_are_kept"
    assert report.skipped
    assert all("see protocols_are_kept" in each.problem for each in report.skipped)
    assert any(needed in each.problem for each in report.skipped)
    n = len(report.passed) + len(report.findings) + len(report.skipped)
    assert n == len(CHECKS)
    assert f"{len(report.skipped)} not run" in str(report)
    assert all(each.check in str(report) for each in report.skipped)


def test_what_does_not_need_it_is_run():
    report = check_robot(no_camera(made()))
    assert [each.check for each in report.skipped] == ["camera_sees"]
    assert len(report.passed) == len(CHECKS) - 2


def test_a_check_for_itself_does_nothing_with_a_device_that_lacks_what_it_needs():
    stopped = []
    robot = with_limb(made(), "arm", stop=lambda: stopped.append(1), reset=None)
    [check] = [c for c in CHECKS if c.name == "stop_latches"]
    [problem] = check(robot)
    assert "reset of arm right" in problem
    assert not stopped


def test_nothing_is_moved_while_a_check_at_rest_finds_something():
    sent = []
    limits = lying_limits(made()).limbs["right"].arm.limits
    robot = with_limb(made(), "arm", command=sent.append, limits=limits)
    report = check_robot(robot, motion=True)
    assert {found.check for found in report.findings} == {"limits_are_true"}
    assert not sent
    assert {each.check for each in report.skipped} == {c.name for c in MOVING_CHECKS}
    assert "nothing is moved" in str(report)


def test_a_check_in_motion_that_fails_keeps_no_other_from_being_run():
    report = check_robot(stuck_joint(made()), motion=True)
    assert {found.check for found in report.findings} == {"arm_follows"}
    assert report.skipped == ()
    assert len(report.passed) == len(CHECKS) + len(MOVING_CHECKS) - 1


def test_a_device_that_does_not_answer_keeps_no_check_at_rest_from_being_run():
    report = check_robot(silent(made()))
    assert "clock_runs" in report.passed
    assert "camera_sees" in report.passed


def test_what_a_robot_is_without_is_not_run_and_said():
    bare = replace(made(), head=None, base=None)
    report = check_robot(bare, motion=True)
    assert report.is_conformant, str(report)
    assert {each.check: each.problem for each in report.skipped} == {
        "head_is_known": "the robot has no head",
        "head_moves": "the robot has no head",
        "base_stands": "the robot has no base",
        "base_stands_by_itself": "the robot has no base",
    }
    assert len(report.passed) == len(CHECKS) + len(MOVING_CHECKS) - 4
    assert "16 checks passed, 0 problems, 4 not run" in str(report)
    assert "not run: head_is_known, head_moves (the robot has no head)" in str(report)


@pytest.mark.parametrize("check", [*CHECKS, *MOVING_CHECKS], ids=str)
def test_a_check_says_which_device_it_is_about(check):
    bare = replace(made(), head=None, base=None)
    about = {
        "head_is_known": "head",
        "head_moves": "head",
        "base_stands": "base",
        "base_stands_by_itself": "base",
    }
    assert check.subject == about.get(check.name, "")
    assert check.is_idle(bare) == bool(check.subject)
    assert not check.is_idle(made())
    if check.subject:
        assert check(bare) == ()


@pytest.mark.parametrize("limbs", [{"left": 1}, {"left": None}, [1], None])
def test_limbs_that_are_none_are_refused_in_words(limbs):
    robot = replace(made(), limbs=limbs)
    with pytest.raises(InputError, match=r"limb.*of the robot.*expected a"):
        check_robot(robot)
    with pytest.raises(InputError, match=r"limb.*of the robot.*expected a"):
        CHECKS[0](robot)


class Watched(Changed):
    """A device that takes down which of its members are used."""

    def __init__(self, device, kind, used) -> None:
        super().__init__(device)
        self._kind, self._used = kind, used

    def __getattr__(self, name):
        self._used.add(f"{self._kind}.{name}")
        return super().__getattr__(name)


@pytest.mark.parametrize("check", [*CHECKS[1:], *MOVING_CHECKS], ids=str)
def test_a_check_says_which_members_it_needs(check):
    used, robot = set(), made()
    limbs = {
        name: replace(
            limb,
            **{
                kind: Watched(getattr(limb, kind), kind, used)
                for kind in ("arm", "sensor", "gripper")
            },
        )
        for name, limb in robot.limbs.items()
    }
    own = ("clock", "camera", "head", "base")
    others = {k: Watched(getattr(robot, k), k, used) for k in own if getattr(robot, k)}
    robot = replace(robot, limbs=limbs, **others)
    given = {"period": 0.004, "grippers": GRIPPERS}
    known = {name: given[name] for name in check.takes}
    assert not tuple(check.function(robot, **known))
    assert used <= check.needs
