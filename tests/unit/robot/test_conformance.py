"""Our own robot keeps every promise; one that breaks a promise fails that check."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from debrisgrasp.kinematics import RobotModel
from debrisgrasp.robot import CHECKS, MOVING_CHECKS, check_robot
from debrisgrasp.robot.promises import joints_are_read, limits_are_true
from tests.unit.robot.broken_robots import (
    backward_clock,
    base_of_numbers,
    blind,
    degrees,
    exiting,
    forces_only,
    frozen_time,
    frozen_wrench,
    head_in_degrees,
    impatient_clock,
    incomplete,
    integer_depth,
    integer_millimetres,
    inverted_wrench,
    late_wrench,
    lensless,
    limits_in_degrees,
    lying_limits,
    made,
    millimetre_depth,
    millimetre_fingers,
    nameless,
    nan_joint,
    no_image,
    no_latch,
    no_limits,
    no_reset,
    other_frame,
    other_hand,
    other_order,
    other_resolution,
    reset_is_no_method,
    short_reading,
    silent,
    stopped_clock,
    timeless,
    unnamed_reading,
    worded_answer,
    worded_fingers,
    worded_joints,
    worded_wrench,
)


def test_our_robot_conforms_even_in_motion():
    report = check_robot(made(), motion=True)
    assert report.is_conformant, str(report)
    assert len(report.passed) == len(CHECKS) + len(MOVING_CHECKS)


def with_joint(**joint):
    """RoMan's left arm, whose first own joint is of another kind."""
    model = RobotModel.load("roman")
    known = model.tree.joints["left_arm_joint1"]
    joints = {**model.tree.joints, known.name: replace(known, **joint)}
    model = replace(model, tree=replace(model.tree, joints=joints))
    arm = SimpleNamespace(limits=model.limits("left").hardware)
    return SimpleNamespace(model=model, limbs={"left": SimpleNamespace(arm=arm)}), arm


def reading(value):
    """All joints of an arm at zero, but for its second one."""
    return lambda: SimpleNamespace(q=(0.0, value, *(0.0,) * 6))


def test_joints_without_limits_are_those_of_the_model():
    robot, _ = with_joint(kind="continuous", lower=-np.inf, upper=np.inf)
    assert list(limits_are_true(robot)) == []


@pytest.mark.parametrize(
    ("joint", "value", "words"),
    [
        ({"kind": "continuous", "lower": -np.inf, "upper": np.inf}, 19.0, ""),
        ({"kind": "continuous", "lower": -np.inf, "upper": np.inf}, 90.0, "degrees"),
        ({"lower": -25.0, "upper": 25.0}, 24.0, ""),
        ({"lower": -1.0, "upper": 1.0}, 50.0, "joint1 reads 50.0; radians, not deg"),
        ({"kind": "prismatic", "lower": 0.0, "upper": 0.9}, 0.8, ""),
        ({"kind": "prismatic", "lower": 0.0, "upper": 0.9}, 8.0, "not millimetres"),
    ],
)
def test_a_joint_that_can_not_stand_there_is_asked_for_its_unit(joint, value, words):
    robot, arm = with_joint(**joint)
    arm.read = reading(value)
    said = list(joints_are_read(robot))
    assert len(said) == bool(words)
    assert words in "".join(said)


def test_limits_of_a_slide_in_millimetres_are_told_as_such():
    robot, arm = with_joint(kind="prismatic", lower=-0.5, upper=0.9)
    arm.limits = replace(arm.limits, upper=arm.limits.upper * ([1.0, 1e3] + [1.0] * 6))
    (said,) = limits_are_true(robot)
    assert "left_arm_joint1 is 900; the model says 0.9; metres, not milli" in said


@pytest.mark.parametrize("check", CHECKS, ids=str)
def test_checks_run_one_by_one(check):
    assert check(made()) == ()
    assert not check.moves


def test_without_motion_nothing_moves():
    robot = made()
    before = [limb.arm.read().q for limb in robot.limbs.values()]
    check_robot(robot)
    assert [limb.arm.read().q for limb in robot.limbs.values()] == before


@pytest.mark.parametrize(
    ("broken", "check", "words"),
    [
        (no_reset, "stop_latches", "still stopped"),
        (no_latch, "stop_latches", "not stopped after a stop"),
        (lying_limits, "limits_are_true", "upper of torso_joint"),
        (limits_in_degrees, "limits_are_true", "radians, not degrees"),
        (degrees, "joints_are_read", "degrees|exceeded"),
        (short_reading, "joints_are_read", "8 joints"),
        (nan_joint, "joints_are_read", "nan"),
        (worded_joints, "joints_are_read", "numbers are needed"),
        (worded_wrench, "wrist_is_read", "numbers are needed"),
        (worded_wrench, "protocols_are_kept", "right arm: its force sensor: reads"),
        (worded_fingers, "answers_whole", "numbers are needed"),
        (worded_answer, "protocols_are_kept", "is_engaged of its arm is 'no'"),
        (no_limits, "limits_are_true", "a LimitSet is needed"),
        (exiting, "joints_are_read", "SystemExit"),
        (other_order, "arms_are_named", "in this order"),
        (frozen_time, "times_rise", "no later time"),
        (late_wrench, "times_rise", "sensor right: .*; it may be 12 ms old"),
        (timeless, "times_rise", "arm right: the time is None; a number"),
        (timeless, "protocols_are_kept", "its arm: the time is None"),
        (nameless, "protocols_are_kept", "joint_names of its arm is None; a tuple"),
        (lensless, "camera_sees", "Intrinsics are needed"),
        (stopped_clock, "clock_runs", "the time is None; a number"),
        (silent, "joints_are_read", "DriverError: arm: no answer"),
        (incomplete, "protocols_are_kept", "has no .*command"),
        (reset_is_no_method, "protocols_are_kept", "arm right has no reset"),
        (unnamed_reading, "protocols_are_kept", "arm right: .*dict without time, q"),
        (no_image, "protocols_are_kept", "camera: .*a DepthFrame is needed"),
        (silent, "times_rise", r"broken_robots\.py, line \d+"),
        (inverted_wrench, "wrist_is_read", "sign is inverted"),
        (frozen_wrench, "wrist_is_read", "is it alive"),
        (forces_only, "wrist_is_read", "its torques are .* in all 25 readings"),
        (millimetre_fingers, "answers_whole", "not millimetres"),
        (other_hand, "arms_are_named", "robotiq_3f"),
        (millimetre_depth, "camera_sees", "not millimetres"),
        (integer_depth, "camera_sees", "metres as floats"),
        (integer_millimetres, "camera_sees", "not millimetres"),
        (blind, "camera_sees", "0 % of the pixels"),
        (other_frame, "camera_sees", "'world'"),
        (other_resolution, "camera_sees", "intrinsics"),
        (backward_clock, "clock_runs", "time fell"),
        (impatient_clock, "clock_runs", "ended after"),
        (head_in_degrees, "head_is_known", "beyond"),
        (base_of_numbers, "base_stands", "one pose is needed, as SE3"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_a_broken_promise_fails_its_check(broken, check, words):
    robot = broken(made())
    [one] = [c for c in CHECKS if c.name == check]
    problems = one(robot)
    assert problems
    assert re.search(words, " ".join(problems)), problems


@pytest.mark.parametrize("broken", [degrees, short_reading, nan_joint, worded_joints])
def test_joints_that_are_none_are_not_the_wrists_fault(broken):
    report = check_robot(broken(made()))
    assert "joints_are_read" in {found.check for found in report.findings}
    assert "wrist_is_read" not in {found.check for found in report.findings}


def test_a_report_says_all_that_is_wrong():
    report = check_robot(millimetre_depth(lying_limits(made())))
    assert not report.is_conformant
    assert {found.check for found in report.findings} == {
        "limits_are_true",
        "camera_sees",
    }
    text = str(report)
    assert "checks passed" in text
    assert "limits_are_true: arm right: upper of torso_joint" in text
