"""What a device lacks is told once; nothing moves while something is wrong at rest."""

from __future__ import annotations

from dataclasses import replace

import pytest

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
    assert not tuple(check.function(robot))
    assert used <= check.needs
