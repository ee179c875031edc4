"""Our own robot keeps every promise; one that breaks a promise fails that check."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from debrisgrasp.errors import DriverError
from debrisgrasp.robot import (
    CHECKS,
    MOVING_CHECKS,
    FakeConfig,
    check_robot,
    fake_robot,
)
from debrisgrasp.worlds import World
from tests.unit.robot.rigs import FAR, GRIPPERS, ROMAN, beam


def made_fake():
    return fake_robot(
        ROMAN,
        World((FAR, beam("near", 2.0, (1.2, 0.0, 0.0445)))),
        rng=np.random.default_rng(0),
        config=FakeConfig(),
        grippers=GRIPPERS,
    )


def made():
    return made_fake().robot


class Changed:
    """A device some of whose members are others."""

    def __init__(self, device, **members) -> None:
        self._device, self._members = device, members

    def __getattr__(self, name):
        if name in self._members:
            return self._members[name]
        return getattr(self._device, name)


def with_limb(robot, device, **members):
    """The same robot, one device of whose right arm is changed."""
    limb = robot.limbs["right"]
    limb = replace(limb, **{device: Changed(getattr(limb, device), **members)})
    return replace(robot, limbs={**robot.limbs, "right": limb})


def nothing(*_args):
    """Do nothing, whatever was asked for."""


def raising(*_args):
    raise DriverError("arm", "no answer")


def test_our_robot_conforms_even_in_motion():
    report = check_robot(made(), motion=True)
    assert report.is_conformant, str(report)
    assert len(report.passed) == len(CHECKS) + len(MOVING_CHECKS)


@pytest.mark.parametrize("check", CHECKS, ids=str)
def test_checks_run_one_by_one(check):
    assert check(made()) == ()
    assert not check.moves


def test_without_motion_nothing_moves():
    robot = made()
    before = [limb.arm.read().q for limb in robot.limbs.values()]
    check_robot(robot)
    assert [limb.arm.read().q for limb in robot.limbs.values()] == before


def no_reset(robot):
    return with_limb(robot, "arm", reset=nothing)


def no_latch(robot):
    arm = robot.limbs["right"].arm
    return with_limb(robot, "arm", stop=arm.disengage)


def lying_limits(robot):
    limits = robot.limbs["right"].arm.limits
    wider = replace(limits, upper=limits.upper + 1.0)
    return with_limb(robot, "arm", limits=wider)


def limits_in_degrees(robot):
    limits = robot.limbs["right"].arm.limits
    return with_limb(
        robot, "arm", limits=replace(limits, velocity=np.rad2deg(limits.velocity))
    )


def degrees(robot):
    arm = robot.limbs["right"].arm
    return with_limb(
        robot, "arm", read=lambda: arm.read()._replace(q=np.rad2deg(arm.read().q))
    )


def short_reading(robot):
    arm = robot.limbs["right"].arm
    return with_limb(robot, "arm", read=lambda: arm.read()._replace(q=arm.read().q[1:]))


def nan_joint(robot):
    arm = robot.limbs["right"].arm
    return with_limb(robot, "arm", read=lambda: arm.read()._replace(q=[np.nan] * 8))


def other_order(robot):
    names = robot.limbs["right"].arm.joint_names
    return with_limb(robot, "arm", joint_names=names[::-1])


def frozen_time(robot):
    arm = robot.limbs["right"].arm
    return with_limb(robot, "arm", read=lambda: arm.read()._replace(time=1.0))


def silent(robot):
    return with_limb(robot, "arm", read=raising)


def unnamed_reading(robot):
    arm = robot.limbs["right"].arm
    return with_limb(robot, "arm", read=lambda: {"time": 0.0, "q": arm.read().q})


def no_image(robot):
    return replace(robot, camera=Changed(robot.camera, capture=nothing))


def reset_is_no_method(robot):
    return with_limb(robot, "arm", reset=None)


def incomplete(robot):
    arm = robot.limbs["right"].arm
    part = SimpleNamespace(
        joint_names=arm.joint_names, limits=arm.limits, read=arm.read
    )
    limb = replace(robot.limbs["right"], arm=part)
    return replace(robot, limbs={**robot.limbs, "right": limb})


def inverted_wrench(robot):
    sensor = robot.limbs["right"].sensor

    def read():
        reading = sensor.read()
        return reading._replace(wrench_ft=-np.asarray(reading.wrench_ft))

    return with_limb(robot, "sensor", read=read)


def frozen_wrench(robot):
    sensor = robot.limbs["right"].sensor
    first = sensor.read()
    return with_limb(
        robot, "sensor", read=lambda: first._replace(time=robot.clock.now())
    )


def millimetre_fingers(robot):
    hand = robot.limbs["right"].gripper

    def read():
        reading = hand.read()
        return reading._replace(openings=tuple(1e3 * x for x in reading.openings))

    return with_limb(robot, "gripper", read=read)


def other_hand(robot):
    return with_limb(robot, "gripper", name="camhand")


def seen(robot, **changes):
    camera = robot.camera

    def capture():
        frame = camera.capture()
        made = {key: change(frame) for key, change in changes.items()}
        return replace(frame, **made)

    return replace(robot, camera=Changed(camera, capture=capture))


def millimetre_depth(robot):
    return seen(robot, depth=lambda frame: 1e3 * frame.depth)


def integer_depth(robot):
    return seen(robot, depth=lambda frame: (1e3 * frame.depth).astype(np.uint16))


def blind(robot):
    return seen(robot, depth=lambda frame: 0.0 * frame.depth)


def other_frame(robot):
    return seen(robot, frame=lambda _: "world")


def other_resolution(robot):
    return seen(
        robot, intrinsics=lambda frame: replace(frame.intrinsics, fx=3000.0, fy=3000.0)
    )


def backward_clock(robot):
    times = iter(np.arange(1e3, 0.0, -1.0))
    return replace(
        robot,
        clock=Changed(robot.clock, now=lambda: float(next(times)), wait_until=nothing),
    )


def impatient_clock(robot):
    return replace(robot, clock=Changed(robot.clock, wait_until=nothing))


def head_in_degrees(robot):
    head = robot.head
    return replace(
        robot,
        head=Changed(
            head, read=lambda: head.read()._replace(q=np.rad2deg(head.read().q))
        ),
    )


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
        (other_order, "arms_are_named", "in this order"),
        (frozen_time, "times_rise", "no later time"),
        (silent, "joints_are_read", "DriverError: arm: no answer"),
        (incomplete, "protocols_are_kept", "has no .*command"),
        (reset_is_no_method, "protocols_are_kept", "arm right has no reset"),
        (unnamed_reading, "protocols_are_kept", "arm right: .*dict without time, q"),
        (no_image, "protocols_are_kept", "camera: .*a DepthFrame is needed"),
        (silent, "times_rise", r"test_conformance\.py, line \d+"),
        (inverted_wrench, "wrist_is_read", "sign is inverted"),
        (frozen_wrench, "wrist_is_read", "is it alive"),
        (millimetre_fingers, "answers_whole", "not millimetres"),
        (other_hand, "arms_are_named", "robotiq_3f"),
        (millimetre_depth, "camera_sees", "not millimetres"),
        (integer_depth, "camera_sees", "metres as floats"),
        (blind, "camera_sees", "0 % of the pixels"),
        (other_frame, "camera_sees", "'world'"),
        (other_resolution, "camera_sees", "intrinsics"),
        (backward_clock, "clock_runs", "time fell"),
        (impatient_clock, "clock_runs", "ended after"),
        (head_in_degrees, "head_is_known", "beyond"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_a_broken_promise_fails_its_check(broken, check, words):
    robot = broken(made())
    [one] = [c for c in CHECKS if c.name == check]
    problems = one(robot)
    assert problems
    assert re.search(words, " ".join(problems)), problems


def eager(robot):
    """A disengaged arm that follows all the same."""
    arm = robot.limbs["right"].arm

    def command(q):
        arm.engage()
        arm.command(q)

    return with_limb(robot, "arm", command=command)


def lazy(robot):
    return with_limb(robot, "arm", command=nothing)


def stuck_joint(robot):
    arm = robot.limbs["right"].arm

    def command(q):
        arm.command([*q[:5], arm.read().q[5], *q[6:]])

    return with_limb(robot, "arm", command=command)


def credulous(robot):
    arm = robot.limbs["right"].arm
    start = np.array(arm.read().q)

    def command(q):
        q = np.asarray(q, dtype=float)
        arm.command(start + 0.001 if np.isnan(q).any() else q)

    def read():
        reading = arm.read()
        moved = np.abs(np.array(reading.q) - start).max() > 5e-4
        return reading._replace(q=np.full(8, np.nan)) if moved else reading

    return with_limb(robot, "arm", command=command, read=read)


def unfelt(robot):
    """A sensor that is alive and measures nothing but its bias."""
    limb, rng = robot.limbs["right"], np.random.default_rng(1)

    def read():
        wrench = limb.loads.bias + rng.normal(0.0, 0.05, 6)
        return limb.sensor.read()._replace(wrench_ft=wrench)

    return with_limb(robot, "sensor", read=read)


def inverted_weight(robot):
    """A sensor of the wrong sign; its model has the bias that it then seems to have."""
    robot = inverted_wrench(robot)
    limb = robot.limbs["right"]
    R = robot.model.chain("right").fk(limb.arm.read().q).R @ limb.loads.T_ee_ft.R
    weight = R.T @ (limb.loads.tool.mass * limb.loads.gravity)
    moment = np.cross(limb.loads.tool.com, weight)
    bias = -limb.loads.bias - 2.0 * np.concatenate([weight, moment])
    limb = replace(limb, loads=limb.loads.with_bias(bias))
    return replace(robot, limbs={**robot.limbs, "right": limb})


def deaf_stop(robot):
    return with_limb(robot, "arm", stop=nothing)


def never_engaged(robot):
    return with_limb(robot, "arm", engage=nothing)


def stiff_hand(robot):
    return with_limb(robot, "gripper", command=nothing, preshape=nothing)


def never_zeroed(robot):
    return with_limb(robot, "gripper", initialise=nothing)


def still_head(robot):
    return replace(robot, head=Changed(robot.head, move_to=nothing))


@pytest.mark.parametrize(
    ("broken", "check", "words"),
    [
        (eager, "disengaged_arm_stands", "though it was disengaged"),
        (lazy, "arm_follows", "misses it"),
        (stuck_joint, "arm_follows", "right_arm_joint5"),
        (never_engaged, "arm_follows", "not engaged"),
        (unfelt, "wrist_feels_weight", "right.*does it measure at all"),
        (inverted_weight, "wrist_feels_weight", "right.*sign is inverted"),
        (credulous, "nonsense_is_refused", "sent NaN"),
        (deaf_stop, "stopped_arm_stands", "though it was stopped"),
        (stiff_hand, "hand_moves", "missed by|misses it"),
        (never_zeroed, "hand_moves", "not initialised"),
        (still_head, "head_moves", "arrived"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_a_promise_broken_in_motion_fails_its_check(broken, check, words):
    [one] = [c for c in MOVING_CHECKS if c.name == check]
    problems = one(broken(made()))
    assert problems
    assert re.search(words, " ".join(problems)), problems


def test_at_rest_no_check_sees_what_a_turn_of_the_wrist_shows():
    assert check_robot(inverted_weight(made())).is_conformant


def test_a_wrist_is_turned_though_joints_read_a_little_outside_their_limits():
    [check] = [c for c in MOVING_CHECKS if c.name == "wrist_feels_weight"]
    fake = made_fake()
    arm = fake.arms["right"]
    for joint in (2, 4):
        fake._drives.put(arm.joints[joint], arm.limits.upper[joint] + 1e-4)
    assert check(fake.robot) == ()


def test_a_weight_too_small_for_the_noise_says_nothing():
    [check] = [c for c in MOVING_CHECKS if c.name == "wrist_feels_weight"]
    robot = unfelt(made())
    limb = robot.limbs["right"]
    loads = replace(limb.loads, tool=replace(limb.loads.tool, mass=0.1))
    limbs = {**robot.limbs, "right": replace(limb, loads=loads)}
    assert check(replace(robot, limbs=limbs)) == ()


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
