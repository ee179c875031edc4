"""Checks in motion: what each finds, wrists that jump, and how they end."""

from __future__ import annotations

import itertools
import re
from contextlib import suppress
from dataclasses import replace
from math import nan

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError, DriverError, InputError
from debrisgrasp.geometry import SE3
from debrisgrasp.robot import MOVING_CHECKS, FakeConfig, check_robot, fake_robot
from debrisgrasp.worlds import World
from tests.unit.robot.broken_robots import (
    Changed,
    inverted_wrench,
    made,
    made_fake,
    nothing,
    stuck_joint,
    with_limb,
)
from tests.unit.robot.rigs import FAR, GRIPPERS, ROMAN


def eager(robot):
    """A disengaged arm that follows all the same."""
    arm = robot.limbs["right"].arm

    def command(q):
        arm.engage()
        arm.command(q)

    return with_limb(robot, "arm", command=command)


def lazy(robot):
    return with_limb(robot, "arm", command=nothing)


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


def lost_by_nan(robot, reads):
    """Return a driver that reads otherwise once it was sent NaN."""
    arm, lost = robot.limbs["right"].arm, []

    def command(q):
        lost.extend(value for value in q if np.isnan(value))
        arm.command(q)

    def read():
        reading = arm.read()
        return reads(reading, lost[0]) if lost else reading

    return with_limb(robot, "arm", command=command, read=read)


def obedient(robot):
    """A driver that is nowhere once it was sent NaN."""
    return lost_by_nan(robot, lambda reading, nan: reading._replace(q=np.full(8, nan)))


def confused(robot):
    """A driver that can't count any more once it was sent NaN."""
    return lost_by_nan(robot, lambda _, nan: int(nan))


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


def endless_base(robot):
    """A base that goes on until it is told otherwise."""
    now = robot.clock.now

    def read():
        return SE3.from_parts(p=[0.03 * now(), 0.0, 0.0])

    return replace(robot, base=Changed(robot.base, read=read))


def still_base(robot):
    return replace(robot, base=Changed(robot.base, drive=nothing))


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
        (obedient, "nonsense_is_refused", "right: obeys NaN, went to .*nan"),
        (confused, "nonsense_is_refused", "right: can't be read after .* sent NaN"),
        (deaf_stop, "stopped_arm_stands", "though it was stopped"),
        (stiff_hand, "hand_moves", "missed by|misses it"),
        (never_zeroed, "hand_moves", "not initialised"),
        (still_head, "head_moves", "arrived"),
        (endless_base, "base_stands_by_itself", "must stand by itself"),
        (still_base, "base_stands_by_itself", "went 0.0 mm"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_a_promise_broken_in_motion_fails_its_check(broken, check, words):
    [one] = [c for c in MOVING_CHECKS if c.name == check]
    problems = one(broken(made()))
    assert problems
    assert re.search(words, " ".join(problems)), problems


def test_an_arm_that_obeys_nan_is_told_of_in_words():
    report = check_robot(obedient(made()), motion=True)
    problems = {found.check: found.problem for found in report.findings}
    assert "obeys NaN" in problems["nonsense_is_refused"]
    assert "did it obey NaN?" in problems["stopped_arm_stands"]
    assert "raised" not in str(report)


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


def spoiled_wrench(robot, spoil):
    """A sensor whose readings are spoiled by how many there were before."""
    sensor, count = robot.limbs["right"].sensor, itertools.count()

    def read():
        reading = sensor.read()
        wrench = np.array(reading.wrench_ft)
        return reading._replace(wrench_ft=spoil(next(count), wrench))

    return with_limb(robot, "sensor", read=read)


def jumping_wrench(robot):
    """A sensor that is 8 N off in every other stretch of 60 readings."""
    return spoiled_wrench(robot, lambda k, wrench: wrench + 8.0 * (k // 60 % 2))


def wrench_with_strays(robot):
    return spoiled_wrench(robot, lambda k, wrench: wrench + 30.0 * (k % 9 == 0))


def wrench_that_ends(robot):
    return spoiled_wrench(robot, lambda k, wrench: wrench if k < 30 else wrench * nan)


def exaggerated_wrench(robot):
    """A sensor that tells three times what it feels."""
    return spoiled_wrench(robot, lambda _, wrench: 3.0 * wrench)


@pytest.mark.parametrize(
    ("spoiled", "words"),
    [
        (jumping_wrench, "right: jumps by [89]"),
        (wrench_with_strays, "right: jumps by 3"),
        (wrench_that_ends, "right.*NaN"),
        (exaggerated_wrench, "right.*does it jump"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_a_wrist_that_lies_in_motion_is_found(spoiled, words):
    [check] = [c for c in MOVING_CHECKS if c.name == "wrist_feels_weight"]
    problems = check(spoiled(made()))
    assert re.search(words, " ".join(problems)), problems


@pytest.mark.parametrize("error", [DriverError("arm", "no answer"), KeyboardInterrupt])
def test_whatever_ends_a_check_in_motion_no_arm_stays_engaged(error):
    robot = made()
    arm = robot.limbs["right"].arm
    start = np.array(arm.read().q)

    def read():
        if np.abs(np.array(arm.read().q) - start).max() > 1e-3:
            raise error
        return arm.read()

    def command(q):
        arm.command(q)
        read()

    [check] = [c for c in MOVING_CHECKS if c.name == "arm_follows"]
    with suppress(KeyboardInterrupt):
        assert check(with_limb(robot, "arm", command=command))
    robot.clock.wait_until(robot.clock.now() + 0.2)
    assert np.abs(np.array(arm.read().q) - start).max() > 1e-3
    assert not any(limb.arm.is_engaged for limb in robot.limbs.values())


def test_limits_in_degrees_do_not_make_an_arm_fast():
    robot, sent = made(), []
    arm, known = robot.limbs["right"].arm, ROMAN.limits("right").hardware
    said = replace(
        known,
        velocity=np.rad2deg(known.velocity),
        acceleration=np.rad2deg(known.acceleration),
    )

    def command(q):
        sent.append(list(q))
        arm.command(q)

    [check] = [c for c in MOVING_CHECKS if c.name == "arm_follows"]
    check(with_limb(robot, "arm", limits=said, command=command))
    speeds = np.abs(np.diff(sent, axis=0)).max(axis=0) / 0.004
    assert (speeds > 0.0).all()
    assert (speeds < 0.25 * known.velocity).all()


def test_a_slide_goes_millimetres_and_comes_back():
    tree = ROMAN.tree
    slide = replace(tree.joints["torso_joint"], kind="prismatic")
    tree = replace(tree, joints={**tree.joints, slide.name: slide})
    world, rng = World((FAR,)), np.random.default_rng(0)
    model = replace(ROMAN, tree=tree)
    robot = fake_robot(model, world, rng=rng, grippers=GRIPPERS).robot
    arm, sent = robot.limbs["right"].arm, []

    def command(q):
        sent.append(list(q))
        arm.command(q)

    [check] = [c for c in MOVING_CHECKS if c.name == "arm_follows"]
    assert check(with_limb(robot, "arm", command=command)) == ()
    ways = np.ptp(sent, axis=0)
    assert ways[0] == pytest.approx(0.1 * np.deg2rad(2.0))
    assert ways[1:] == pytest.approx(np.deg2rad(2.0))

    def left_behind(q):
        sent.append(list(q))
        arm.command([max((row[0] for row in sent), key=abs), *q[1:]])

    sent.clear()
    (said,) = check(with_limb(robot, "arm", command=left_behind))
    assert "did not come back" in said


@pytest.mark.parametrize("period", [5e-4, 0.001, 0.008])
def test_an_arm_of_any_rate_is_asked_for_no_more_than_it_can(period):
    fake = made_fake(FakeConfig(period=period))
    report = check_robot(fake.robot, motion=True, period=period)
    assert report.is_conformant, str(report)
    asked = [v.message for v in fake.violations if "nan" not in v.message]
    assert asked == []


def test_a_period_that_no_loop_has_is_refused():
    with pytest.raises(ConfigError, match="period"):
        check_robot(made(), period=4.0)


def with_own_hand(**members):
    arms = {**ROMAN.arms, "right": replace(ROMAN.arms["right"], gripper="own_hand")}
    robot = with_limb(made(), "gripper", name="own_hand", **members)
    return replace(robot, model=replace(ROMAN, arms=arms))


def test_a_hand_that_nobody_knows_is_not_said_to_move():
    report = check_robot(with_own_hand(command=nothing), motion=True)
    reasons = {each.check: each.problem for each in report.skipped}
    assert "own_hand is not known" in reasons["hand_moves"]
    assert "hand_moves" not in report.passed
    [check] = [c for c in MOVING_CHECKS if c.name == "hand_moves"]
    [problem] = check(with_own_hand())
    assert "own_hand is not known" in problem


def test_a_hand_that_does_not_ship_is_moved_if_it_is_given():
    hands = {"own_hand": GRIPPERS["robotiq_3f"]}
    report = check_robot(with_own_hand(), motion=True, grippers=hands)
    assert "hand_moves" in report.passed, str(report)
    report = check_robot(with_own_hand(command=nothing), motion=True, grippers=hands)
    assert [found.check for found in report.findings] == ["hand_moves"]


@pytest.mark.parametrize("thing", [None, "roman", ROMAN])
def test_what_is_no_robot_is_refused(thing):
    with pytest.raises(InputError, match="expected a Robot"):
        check_robot(thing)
    with pytest.raises(InputError, match=r"world.*expected a World"):
        fake_robot(ROMAN, thing, rng=np.random.default_rng(0))
