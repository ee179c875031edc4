"""Joints in memory: they follow, and never leave their limits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from debrisgrasp.errors import InputError, UnknownNameError
from debrisgrasp.robot import Arm, FakeConfig, fake_robot
from debrisgrasp.worlds import World
from tests.unit.robot.rigs import CHAINS, FAR, GRIPPERS, PERIOD, ROMAN

LIMITS = ROMAN.limits("right").hardware


def made(seed=0, **config):
    return fake_robot(
        ROMAN,
        World((FAR,)),
        rng=np.random.default_rng(seed),
        config=FakeConfig(**config),
        grippers=GRIPPERS,
    )


def engaged(fake, name="right"):
    arm = fake.robot.limbs[name].arm
    arm.engage()
    fake.robot.clock.wait_until(fake.robot.clock.now() + 0.1)
    assert arm.is_engaged
    return arm


def ticks(fake, n):
    for _ in range(n):
        fake.robot.clock.wait_until(fake.robot.clock.now() + PERIOD)
        yield


def test_it_fulfils_the_protocol():
    assert isinstance(made().robot.limbs["right"].arm, Arm)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_a_stream_within_limits_is_followed_exactly(n):
    fake = made()
    arm = engaged(fake)
    start = np.array(arm.read().q)
    for k in range(200):
        goal = start.copy()
        goal[2] += 0.1 * (1.0 - np.cos(0.9 * k * n * PERIOD))
        arm.command(goal)
        fake.robot.clock.wait_until(fake.robot.clock.now() + n * PERIOD)
        if k > 1:
            assert np.allclose(arm.read().q, goal, atol=1e-9)
    assert not fake.violations


def test_a_far_goal_is_reached_without_overshoot():
    fake = made()
    arm = engaged(fake)
    start = np.array(arm.read().q)
    goal = start + np.where(start > 0, -0.4, 0.4)
    path = []
    for _ in ticks(fake, 700):
        arm.command(goal)
        path.append(arm.read().q)
    share = (np.array(path) - start) / (goal - start)
    assert share.max() <= 1.0 + 1e-9
    assert np.allclose(arm.read().q, goal, atol=1e-9)


@pytest.mark.parametrize("value", [np.nan, np.inf, 4.0, -1e9])
def test_what_is_no_posture_is_refused_and_recorded(value):
    fake = made()
    arm = engaged(fake)
    before = arm.read().q
    arm.command([*before[:-1], value])
    fake.robot.clock.wait_until(1.0)
    assert arm.read().q == before
    assert len(fake.violations) == 1
    assert "right_arm_joint7" in fake.violations[0].message
    assert fake.truth().violations == tuple(fake.violations)


def test_a_command_of_the_wrong_length_is_refused():
    fake = made()
    arm = engaged(fake)
    arm.command([0.0, 1.0])
    assert "2 values for 8 joints" in fake.violations[0].message


def test_a_jump_is_recorded_and_followed_within_the_limits():
    fake = made()
    arm = engaged(fake)
    goal = np.array(arm.read().q)
    goal[3] += 0.5
    arm.command(goal)
    fake.robot.clock.wait_until(fake.robot.clock.now() + PERIOD)
    assert "speed" in fake.violations[0].message
    assert 0.0 < arm.read().q[3] - (goal[3] - 0.5) <= LIMITS.velocity[3] * PERIOD


def test_without_commands_it_holds_after_the_watchdog():
    fake = made()
    arm = engaged(fake)
    goal = np.array(arm.read().q)
    goal[3] += 0.5
    arm.command(goal)
    fake.robot.clock.wait_until(fake.robot.clock.now() + 3.0)
    way = arm.read().q[3] - (goal[3] - 0.5)
    # 0.1 s at 2 rad/s^2 are 10 mrad; as much again to come to rest.
    assert 0.005 < way < 0.03


def test_engaging_takes_a_moment():
    fake = made(engage_time=0.05)
    arm = fake.robot.limbs["left"].arm
    arm.engage()
    assert not arm.is_engaged
    fake.robot.clock.wait_until(0.06)
    assert arm.is_engaged


def test_a_disengaged_arm_follows_nothing():
    fake = made()
    arm = fake.robot.limbs["right"].arm
    before = arm.read().q
    for _ in ticks(fake, 20):
        arm.command([value + 0.001 for value in before])
    assert arm.read().q == before


def test_a_stop_is_latched_until_reset():
    fake = made()
    arm = engaged(fake)
    goal = np.array(arm.read().q)
    goal[3] += 0.5
    for _ in ticks(fake, 100):
        arm.command(goal)
    arm.stop()
    for _ in ticks(fake, 100):
        arm.engage()
        arm.command(goal)
    stood = arm.read().q
    assert arm.is_stopped
    assert not arm.is_engaged
    assert stood[3] < goal[3] - 0.1
    for _ in ticks(fake, 100):
        arm.command(goal)
    assert arm.read().q == stood
    arm.reset()
    assert not arm.is_stopped
    assert arm.read().q == stood
    engaged(fake)


def test_the_other_arm_goes_along_with_the_torso():
    fake = made()
    arm, other = engaged(fake), fake.robot.limbs["left"].arm
    before = np.array(other.read().q)
    goal = np.array(arm.read().q)
    goal[0] = 0.2
    for _ in ticks(fake, 400):
        arm.command(goal)
    after = np.array(other.read().q)
    assert after[0] == pytest.approx(0.2)
    assert (after[1:] == before[1:]).all()


def test_arms_start_where_they_are_told():
    fake = made(start={"right": "ready", "left": {"left_arm_joint2": 0.5}})
    right = fake.robot.limbs["right"].arm.read().q
    assert CHAINS["right"].named(right)["right_arm_joint1"] == 1.883
    left = fake.robot.limbs["left"].arm.read().q
    assert CHAINS["left"].named(left)["left_arm_joint2"] == 0.5


def test_an_unknown_posture_or_hand_is_refused():
    with pytest.raises(UnknownNameError, match="reday"):
        made(start={"right": "reday"})
    with pytest.raises(UnknownNameError, match=r"right_arm_joint2.*right, left"):
        made(start={"right_arm_joint2": 0.3})
    with pytest.raises(UnknownNameError, match=r"arm left.*right_arm_joint2"):
        made(start={"left": {"right_arm_joint2": 0.3}})
    with pytest.raises(UnknownNameError, match="robotiq_3f"):
        fake_robot(ROMAN, World((FAR,)), rng=np.random.default_rng(0), grippers={})


def test_time_rises_only_when_waited_for():
    clock = made().robot.clock
    assert clock.now() == 0.0
    clock.wait_until(0.0101)
    assert clock.now() == pytest.approx(0.012)
    clock.wait_until(-3.0)
    assert clock.now() == pytest.approx(0.012)
    with pytest.raises(InputError):
        clock.wait_until(np.nan)


numbers = st.one_of(
    st.floats(-4.0, 4.0),
    st.sampled_from([np.nan, np.inf, -np.inf, 1e300, 0.0, 3.1415, -3.1415]),
)
postures = st.one_of(
    st.lists(numbers, min_size=8, max_size=8),
    st.lists(st.floats(-1.5, 1.5), min_size=8, max_size=8),
    st.lists(numbers, max_size=3),
    st.sampled_from([None, "q", ["a"] * 8]),
)
actions = st.tuples(
    st.sampled_from(["command"] * 6 + ["stop", "reset", "engage", "disengage"]),
    postures,
    st.sampled_from(["right", "left"]),
    st.integers(0, 8),
)


@settings(max_examples=15)
@given(st.lists(actions, max_size=20))
def test_no_commands_take_joints_out_of_their_limits(sequence):
    fake = made()
    arms = {name: engaged(fake, name) for name in ("right", "left")}
    path = {name: [arm.read().q] * 2 for name, arm in arms.items()}
    for what, q, name, n in sequence:
        if what == "command":
            arms[name].command(q)
        else:
            getattr(arms[name], what)()
        for _ in ticks(fake, n):
            for key, arm in arms.items():
                path[key].append(arm.read().q)
    for name, rows in path.items():
        limits = ROMAN.limits(name).hardware
        q = np.array(rows)
        dq = np.diff(q, axis=0) / PERIOD
        ddq = np.diff(dq, axis=0) / PERIOD
        assert np.isfinite(q).all()
        assert limits.violation(q) == ""
        assert (np.abs(dq) <= limits.velocity + 1e-9).all()
        assert (np.abs(ddq) <= limits.acceleration + 1e-6).all()


def test_the_same_seed_and_commands_give_the_same_run():
    def run(seed):
        fake = made(seed)
        arm = engaged(fake)
        rng = np.random.default_rng(8)
        rows = []
        goal = np.array(arm.read().q)
        for _ in ticks(fake, 60):
            goal = goal + rng.normal(0, 1e-3, 8)
            arm.command(goal)
            rows.append([*arm.read().q, *fake.robot.limbs["right"].sensor.read()[1]])
        return np.array(rows), fake.robot.camera.capture().depth

    first, again, other = run(1), run(1), run(2)
    assert (first[0] == again[0]).all()
    assert (first[1] == again[1]).all()
    assert not (first[1] == other[1]).all()
