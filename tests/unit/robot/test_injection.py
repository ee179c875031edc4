"""Faults on purpose: what each does to its device, when, and to nobody else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from debrisgrasp.control import GripCommand
from debrisgrasp.errors import ConfigError, DriverError, InputError, UnknownNameError
from debrisgrasp.executive import FAULTS, STAGES
from debrisgrasp.robot import INJECTABLE, Injection, Robot, inject

from .stub import STATES, struck

PERIOD = 0.004


def test_every_fault_of_the_table_can_be_injected():
    assert set(INJECTABLE) == set(FAULTS) - {"software_error"}
    assert len(INJECTABLE) == 34
    states = {stage.value for stage in STAGES}
    assert {kind.state for kind in INJECTABLE.values()} <= states


@pytest.mark.parametrize(
    "fault", [n for n, k in INJECTABLE.items() if k.device != "world"]
)
def test_a_fault_begins_in_its_state_and_not_before(robot, rng, fault):
    state = INJECTABLE[fault].state
    injected = inject(robot, [Injection(fault=fault, at=0.5)], states=STATES, rng=rng)
    for earlier in STAGES[: [s.value for s in STAGES].index(state)]:
        injected.on_state(earlier.value)
        everything(injected.robot)
    assert injected.happened == ()
    injected.on_state(state)
    robot.clock.time += 0.45
    everything(injected.robot)
    assert injected.happened == ()
    robot.clock.time += 0.1
    everything(injected.robot)
    assert injected.happened == (fault,)


def everything(robot: Robot) -> None:
    """Use every device once."""
    robot.camera.capture()
    robot.head.move_to((0.1, 0.1))
    robot.head.read()
    for limb in robot.limbs.values():
        try:
            assert limb.arm.limits is not None
            limb.arm.engage()
            limb.arm.command(limb.arm.read().q)
            limb.sensor.read()
            limb.gripper.initialise()
            limb.gripper.command(GripCommand((0.05,) * 3, 10.0))
            limb.gripper.read()
        except DriverError:
            continue


def test_devices_that_no_fault_strikes_are_the_robots_own(robot, rng):
    injection = Injection(fault="wrench_nan", arm="left")
    spoiled = inject(robot, [injection], states=STATES, rng=rng).robot
    assert spoiled.limbs["right"] == robot.limbs["right"] or (
        spoiled.limbs["right"].sensor is robot.limbs["right"].sensor
    )
    assert spoiled.limbs["left"].arm is robot.limbs["left"].arm
    assert spoiled.limbs["left"].sensor is not robot.limbs["left"].sensor
    assert spoiled.camera is robot.camera


def wrench(robot: Robot, arm: str = "right") -> np.ndarray:
    return np.asarray(robot.limbs[arm].sensor.read().wrench_ft)


def test_lies_of_the_sensor(robot, rng):
    true = wrench(robot)

    def seen(fault, **changes):
        return struck(robot, fault, rng=rng, **changes).robot

    assert np.isnan(wrench(seen("wrench_nan"))).all()
    np.testing.assert_array_equal(wrench(seen("wrench_sign")), -true)
    jump = wrench(seen("bias_jump", severity=70.0)) - true
    np.testing.assert_allclose(jump, [70, 0, 0, 0, 0, 0])
    assert wrench(seen("sensor_saturated"))[2] == 660.0
    stamp = seen("clock_disorder").limbs["right"].sensor.read().time
    assert 0.1 <= robot.clock.now() - stamp <= 0.2


def test_a_frozen_wrench_stays_while_its_time_goes_on(robot, rng):
    spoiled = struck(robot, "wrench_frozen", rng=rng).robot
    sensor = spoiled.limbs["left"].sensor
    first = sensor.read()
    robot.clock.time += 0.1
    second = sensor.read()
    assert first.wrench_ft == second.wrench_ft
    assert second.time > first.time
    robot.clock.time += 1.0
    assert tuple(sensor.read().wrench_ft) != second.wrench_ft


def test_a_drift_grows(robot, rng):
    spoiled = struck(robot, "bias_drift", rng=rng).robot
    values = []
    for _ in range(4):
        values.append(wrench(spoiled)[0] - wrench(robot)[0])
        robot.clock.time += 2.5
    assert values == pytest.approx([0.0, 20.0, 40.0, 40.0])


def load(robot: Robot, spoiled: Robot, arm: str = "right") -> np.ndarray:
    """Load in the axes of base that the fault alone makes one believe in."""
    limb = robot.limbs[arm]
    T = robot.model.chain(arm).fk(np.array(limb.arm.read().q)[None])[0]
    R = tuple(T.R.ravel().tolist())
    both = [limb.loads.load_ee(wrench(r, arm).tolist(), R) for r in (robot, spoiled)]
    felt = np.array(both[1]) - np.array(both[0])
    return np.concatenate([T.R @ felt[:3], T.R @ felt[3:]])


@pytest.mark.parametrize(
    ("fault", "after", "expected"),
    [
        ("baseline_contact", 1.0, [15, 0, 0, 0, 0, 0]),
        ("ratchet", 1.0, [0, 0, -0.75 * 150, 0, 0, 0]),
        ("object_swings", 0.25, [0, 0, 0, 0, 1.3 * 40, 0]),
        ("oscillation", 1 / 24, [0.3 * 150, 0, 0, 0, 0, 0]),
    ],
)
def test_what_is_felt_acts_at_the_hand_in_the_axes_of_base(
    robot, rng, fault, after, expected
):
    spoiled = struck(robot, fault, rng=rng).robot
    robot.clock.time += after
    np.testing.assert_allclose(load(robot, spoiled), expected, atol=1e-9)


def test_a_wall_pushes_back_as_deep_as_the_hand_is_in_it(robot, rng):
    spoiled = struck(robot, "early_contact", rng=rng).robot
    assert np.allclose(load(robot, spoiled), 0.0)
    chain, arm = robot.model.chain("right"), robot.limbs["right"].arm
    T = chain.fk(np.array(arm.q)[None])[0]
    # A small step of the joints; whatever part of it goes ahead counts.
    q = np.array(arm.q)
    grid = q + 0.05 * np.vstack([np.eye(len(q)), -np.eye(len(q))])
    ahead = (chain.fk(grid).p - T.p) @ T.R[:, 2]
    arm.q = grid[ahead.argmax()].tolist()
    depth = ahead.max() - 0.008
    assert depth > 0.0
    felt = load(robot, spoiled)[:3]
    np.testing.assert_allclose(felt, -1e4 * depth * T.R[:, 2], atol=1e-6)


def test_what_is_stuck_pulls_the_more_the_higher_the_hand_is(robot, rng):
    spoiled = struck(robot, "too_heavy", rng=rng).robot
    assert np.allclose(load(robot, spoiled), 0.0)
    chain, arm = robot.model.chain("right"), robot.limbs["right"].arm
    q = np.array(arm.q)
    z = chain.fk(q[None])[0].p[2]
    for size in (0.01, 0.02, -0.02):
        grid = q + size * np.vstack([np.eye(len(q)), -np.eye(len(q))])
        rises = chain.fk(grid).p[:, 2] - z
        which = rises.argmax() if size > 0 else rises.argmin()
        arm.q = grid[which].tolist()
        pull = load(robot, spoiled)[2]
        expected = -min(5e3 * max(rises[which], 0.0), 225.0)
        assert pull == pytest.approx(expected, abs=1e-6)


def test_a_stuck_joint_brakes_within_its_limits_and_stays(robot, rng):
    spoiled = struck(robot, "joint_stuck", severity=2, rng=rng).robot
    arm, inner = spoiled.limbs["right"].arm, robot.limbs["right"].arm
    q = np.array(inner.q)
    step = np.full(len(q), 0.5 * PERIOD)
    places = []
    for k in range(1, 200):
        robot.clock.time += PERIOD
        arm.command((q + k * step).tolist())
        places.append(inner.q[2])
    moved = np.diff([q[2], *places])
    assert moved[0] == pytest.approx(0.5 * PERIOD)
    gains = np.abs(np.diff(moved)) / PERIOD**2
    assert gains.max() <= inner.limits.acceleration[2] + 1e-9
    assert moved[-1] == 0.0
    assert inner.q[1] == pytest.approx(q[1] + 199 * 0.5 * PERIOD)


def test_an_encoder_that_jumped_is_off_by_the_same_from_then_on(robot, rng):
    spoiled = struck(robot, "encoder_jump", rng=rng).robot
    arm = spoiled.limbs["left"].arm
    gaps = np.array(arm.read().q) - np.array(robot.limbs["left"].arm.read().q)
    assert sorted(gaps)[-1] == pytest.approx(0.3)
    assert np.count_nonzero(gaps) == 1
    again = np.array(arm.read().q) - np.array(robot.limbs["left"].arm.read().q)
    np.testing.assert_array_equal(gaps, again)
    true = list(robot.limbs["left"].arm.q)
    arm.command(arm.read().q)
    np.testing.assert_allclose(robot.limbs["left"].arm.q, true)


def test_a_lost_connection_comes_back(robot, rng):
    spoiled = struck(robot, "connection_lost", rng=rng, arm="left").robot
    limb = spoiled.limbs["left"]
    for call in (limb.arm.read, limb.sensor.read, limb.gripper.read, limb.arm.engage):
        with pytest.raises(DriverError, match="no answer"):
            call()
    limb.arm.stop()
    assert robot.limbs["left"].arm.is_stopped
    spoiled.limbs["right"].arm.read()
    robot.clock.time += 0.31
    limb.arm.read()


def test_drives_refuse_as_often_as_asked(robot, rng):
    spoiled = struck(robot, "controller_refuses", severity=2, rng=rng, arm="left").robot
    arm = spoiled.limbs["left"].arm
    engaged = []
    for _ in range(3):
        arm.engage()
        engaged.append(arm.is_engaged)
    assert engaged == [False, False, True]


def test_limits_that_lie_are_narrower(robot, rng):
    spoiled = struck(robot, "limit_mismatch", rng=rng).robot
    told, true = spoiled.limbs["left"].arm.limits, robot.limbs["left"].arm.limits
    np.testing.assert_allclose(told.upper, true.upper - 0.2)
    assert told.hash != true.hash


def test_pairs_act_together(robot, rng):
    jump = Injection(fault="bias_jump", state="lift", at=0.0)
    pair = (jump, Injection(fault="wrench_sign"))
    spoiled = struck(robot, *pair, rng=rng).robot
    expected = -(wrench(robot) + np.array([90, 0, 0, 0, 0, 0]))
    np.testing.assert_allclose(wrench(spoiled), expected)


@given(
    st.builds(
        Injection,
        fault=st.sampled_from(sorted(INJECTABLE)),
        state=st.none() | st.sampled_from([s.value for s in STAGES]),
        arm=st.none() | st.sampled_from(["left", "right"]),
        at=st.none() | st.floats(0, 1e3),
    )
)
def test_an_injection_survives_its_file(injection):
    assert Injection.from_json(injection.to_json()) == injection


@pytest.mark.parametrize(
    ("fault", "severity", "words"),
    [
        ("slip", "a", "got a, expected 0 or more"),
        ("slip", True, "got True"),
        ("slip", float("inf"), "got inf"),
        ("unreachable", -0.1, "expected 0 or more .m."),
        ("connection_lost", -1.0, "expected 0 or more"),
        ("finger_jammed", 1.5, "a whole number"),
        ("empty_cloud", 0.5, "a whole number"),
        ("wrench_nan", 3, "none: it strikes, or it does not"),
        ("bias_jump", float("nan"), "a number .N."),
    ],
)
def test_a_severity_that_means_nothing_is_refused(fault, severity, words):
    with pytest.raises(ConfigError, match=f"severity of {fault}: .*{words}"):
        Injection(fault=fault, severity=severity)


def test_no_joint_sticks_that_is_not_there(robot, rng):
    stuck = Injection(fault="joint_stuck", severity=99)
    with pytest.raises(ConfigError, match="joint_stuck: got 99, expected 0 to 7"):
        inject(robot, [stuck], states=STATES, rng=rng)


def test_what_can_not_be_injected_is_refused(robot, rng):
    with pytest.raises(UnknownNameError, match="wrench_nan"):
        Injection(fault="wrench_nam")
    with pytest.raises(ConfigError, match="begin of slip"):
        Injection(fault="slip", at=-1.0)
    with pytest.raises(ConfigError, match="severity of slip"):
        Injection(fault="slip", severity=float("nan"))
    with pytest.raises(ConfigError, match="injection"):
        Injection.from_json({"fault": "slip", "when": 3})
    with pytest.raises(UnknownNameError, match="arm"):
        inject(robot, [Injection(fault="slip", arm="third")], states=STATES, rng=rng)
    misspelt = Injection(fault="wrench_nan", state="lfit")
    with pytest.raises(UnknownNameError, match=r"wrench_nan strikes.*'lfit'.*lift"):
        inject(robot, [misspelt], states=STATES, rng=rng)
    with pytest.raises(UnknownNameError, match="'approach'"):
        inject(robot, [Injection(fault="wrench_nan")], states=("drive",), rng=rng)
    with pytest.raises(InputError, match="robot in memory"):
        inject(robot, [Injection(fault="slip")], states=STATES, rng=rng)
    headless = replace(robot, head=None)
    with pytest.raises(InputError, match="head"):
        inject(headless, [Injection(fault="calibration_off")], states=STATES, rng=rng)
