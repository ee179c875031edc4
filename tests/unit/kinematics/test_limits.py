"""One set of limits for planner, controller and robot, and trajectories bound to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError, ShapeError
from debrisgrasp.kinematics import (
    DeflectionLimits,
    LimitFamily,
    LimitSet,
    RobotModel,
    Trajectory,
)


def limits(**changed) -> LimitSet:
    fields = {
        "joint_names": ("a", "b"),
        "lower": [-1.0, -np.inf],
        "upper": [1.0, np.inf],
        "velocity": [0.5, 0.5],
        "acceleration": [2.0, 2.0],
    }
    return LimitSet(**fields | changed)


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("lower", [2.0, 0.0], "position limits of joint 'a'"),
        ("velocity", [0.5, 0.0], "velocity limit of joint 'b'"),
        ("velocity", [0.5, np.inf], "velocity limit of joint 'b'"),
        ("acceleration", [np.nan, 1.0], "acceleration"),
        ("force", float("inf"), "force"),
        ("torque", -1.0, "torque"),
    ],
)
def test_limits_that_make_no_sense_are_refused(field, value, words):
    with pytest.raises(ConfigError, match=words):
        limits(**{field: value})


def test_planner_lies_within_controller_by_a_margin():
    family = LimitFamily.around(limits())
    assert family.planner.upper[0] == pytest.approx(0.98)
    with pytest.raises(ConfigError, match=r"planner's limits.*at least -0\.98"):
        LimitFamily(
            hardware=limits(), controller=limits(), planner=limits().shrunk(0.01)
        )


def test_a_range_of_which_nothing_is_left_is_told_as_it_was():
    short = limits(lower=[0.0, -np.inf], upper=[0.03, np.inf])
    with pytest.raises(ConfigError, match=r"'a': got 0 to 0\.03.*above 0\.04"):
        LimitFamily.around(short)


@pytest.mark.parametrize(
    "wider",
    [
        {"velocity": [0.6, 0.5]},
        {"acceleration": [2.0, 3.0]},
        {"lower": [-1.1, -np.inf]},
        {"force": 200.0},
        {"deflection": DeflectionLimits(translation=0.2)},
        {"joint_names": ("a", "c")},
    ],
)
def test_controller_lies_within_the_hardware(wider):
    with pytest.raises(ConfigError):
        LimitFamily(
            hardware=limits(),
            controller=limits(**wider),
            planner=limits(**wider).shrunk(),
        )


def test_hash_changes_with_every_number():
    one = limits()
    others = [
        limits(lower=[-1.01, -np.inf]),
        limits(velocity=[0.4, 0.5]),
        limits(acceleration=[2.0, 1.9]),
        limits(force=149.0),
        limits(torque=39.0),
        limits(deflection=DeflectionLimits(rotation=0.3)),
        limits(joint_names=("a", "c")),
    ]
    assert len({one.hash, *(other.hash for other in others)}) == 8
    assert limits().hash == one.hash


def test_raising_a_limit_needs_a_reason_that_is_kept():
    slower = limits().scaled(velocity=0.5)
    assert slower.relaxed == ()
    assert slower.velocity[0] == 0.25
    with pytest.raises(ConfigError, match="because"):
        limits().scaled(load=1.2)
    raised = limits().scaled(load=1.2, because="stuck block, asked by the operator")
    assert raised.relaxed == ("load x 1.2: stuck block, asked by the operator",)
    assert raised.force == pytest.approx(180.0)


def test_violations_are_named():
    one = limits()
    assert one.violation([0.5, 100.0]) == ""
    assert "position of a" in one.violation([1.1, 0.0])
    assert "velocity of b" in one.violation([0, 0], [0.1, -0.6])
    assert "acceleration of a" in one.violation([0, 0], [0, 0], [3.0, 0])
    assert "position of a" in one.violation([np.nan, 0.0])


def test_a_trajectory_is_bound_to_its_limits():
    one = limits()
    motion = Trajectory(
        joint_names=("a", "b"),
        times=[0.0, 2.0],
        q=[[0.0, 0.0], [0.5, 0.2]],
        dq=[[0.0, 0.0], [0.0, 0.0]],
        limits_hash=one.hash,
    )
    motion.require_executable(one)
    with pytest.raises(ConfigError, match="hash"):
        motion.require_executable(one.shrunk())
    q, dq, ddq = motion.at(1.0)
    np.testing.assert_allclose(q, (0.25, 0.1))
    np.testing.assert_allclose(dq, (0.375, 0.15))
    np.testing.assert_allclose(ddq, 0.0, atol=1e-12)
    t, h = np.linspace(0.1, 1.9, 7), 1e-6
    forth, back = motion.at(t + h)[0], motion.at(t - h)[0]
    np.testing.assert_allclose(motion.at(t)[1], (forth - back) / (2 * h), atol=1e-6)
    fast = replace(motion, times=np.array([0.0, 1.0]))
    assert "velocity of a" in fast.violation(one)
    with pytest.raises(ConfigError, match="velocity of a"):
        fast.require_executable(one)
    np.testing.assert_allclose(motion.at(99.0)[0], (0.5, 0.2))
    assert not motion.at(99.0)[1].any()


def test_malformed_trajectories_are_refused():
    good = {"joint_names": ("a",), "limits_hash": "x"}
    with pytest.raises(ConfigError, match="times"):
        Trajectory(**good, times=[0.0, 0.0], q=[[0.0], [1.0]], dq=[[0.0], [0.0]])
    with pytest.raises(ShapeError, match="rows"):
        Trajectory(**good, times=[0.0], q=[[0.0], [1.0]], dq=[[0.0], [0.0]])


def test_roman_has_the_limits_of_its_urdf_and_its_file():
    family = RobotModel.load("roman").limits("right")
    assert family.controller.n_joints == 8
    np.testing.assert_allclose(family.hardware.velocity, 0.5)
    np.testing.assert_allclose(family.hardware.acceleration, 2.0)
    assert family.controller.upper[1] == pytest.approx(3.1415)
