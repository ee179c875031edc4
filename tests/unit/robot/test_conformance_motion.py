"""Checks in motion: wrists that jump, arms that tell wrong limits, how they end."""

from __future__ import annotations

import itertools
import re
from contextlib import suppress
from dataclasses import replace
from math import nan

import numpy as np
import pytest

from debrisgrasp.errors import DriverError, InputError
from debrisgrasp.robot import MOVING_CHECKS, check_robot, fake_robot
from tests.unit.robot.rigs import ROMAN
from tests.unit.robot.test_conformance import made, with_limb


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


@pytest.mark.parametrize("thing", [None, "roman", ROMAN])
def test_what_is_no_robot_is_refused(thing):
    with pytest.raises(InputError, match="expected a Robot"):
        check_robot(thing)
    with pytest.raises(InputError, match=r"world.*expected a World"):
        fake_robot(ROMAN, thing, rng=np.random.default_rng(0))
