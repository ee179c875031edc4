"""What stops the arm, when, and what can't be talked out of it."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.control import (
    BiasBound,
    Command,
    Contact,
    ContactGuard,
    ControllerConfig,
    Fault,
    FaultClass,
    LegOutcome,
    LoadModel,
    Reading,
    RefusalCause,
    SafetyConfig,
    StartError,
    TarePolicy,
)
from debrisgrasp.errors import ConfigError, InputError

from .rigs import LIMITS, PERIOD, SOFT, T_EE_FT, Rig, pushed, wrench


def test_torque_alone_stops_too():
    rig = Rig(SOFT)
    loads = [np.array([0, 0, 0, 0, 4.0 * min(k, 11), 0]) for k in range(20)]
    _, seen = pushed(rig, loads)
    assert seen[-1].stop.fault is Fault.TORQUE_OVERLOAD
    assert "torque" in seen[-1].stop.message


def test_limit_shrinks_by_what_the_bias_may_be_wrong():
    rig = Rig(SOFT)
    supervisor = rig.controller._supervisor
    assert supervisor.load_limits(0.0) == pytest.approx((148.0, 39.9))
    assert supervisor.load_limits(3600.0) == pytest.approx((143.0, 39.6))


def test_one_spike_passes_and_two_stop():
    rig = Rig(SOFT)
    quiet = wrench(0, 0, 0)
    _, seen = pushed(rig, [quiet, quiet, wrench(0, 0, 400), quiet, quiet])
    assert not any(command.is_stop for command in seen)
    _, seen = pushed(rig, [quiet, quiet, *[wrench(0, 0, 400)] * 2])
    assert seen[-1].is_stop


def test_a_stop_is_latched_and_stands_where_the_arm_was_measured():
    rig = Rig(SOFT)
    state, seen = pushed(rig, [wrench(0, 0, -30 * min(k, 6)) for k in range(10)])
    assert seen[-1].is_stop
    stood = seen[-1].q
    state, later = pushed(rig, [wrench(0, 0, 0)] * 50, state=state, start=20)
    assert {command.q for command in later} == {stood}
    assert all(command.outcome is LegOutcome.STOPPED for command in later)
    assert later[-1].stop == seen[-1].stop


def test_stop_holds_the_measured_posture_and_not_the_commanded():
    rig = Rig(SOFT)
    state = rig.engaged()
    q = np.array(rig.q_start)
    for k in range(1, 30):
        state, command = rig.controller.step(
            state, rig.reading(k, q, np.full(6, 0.01 * k))
        )
        q = np.array(command.q) - 0.004
    for k in range(30, 34):
        state, command = rig.controller.step(
            state, rig.reading(k, q, wrench(0, 0, 300))
        )
    assert command.is_stop
    np.testing.assert_allclose(command.q, q, atol=1e-12)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_wrench_that_is_no_number_holds_then_pauses_then_stops(value):
    rig = Rig(SOFT)
    state, seen = pushed(rig, [wrench(5, 0, 0)] * 100)
    q, deflections, shares, stopped = seen[-1].q, [], [], None
    for k in range(101, 120):
        now = k * PERIOD
        reading = Reading(now, q, (value, 0.0, 0.0, 0.0, 0.0, 0.0), now)
        state, command = rig.controller.step(state, reading)
        q = command.q
        if command.is_stop:
            stopped = k - 100
            break
        deflections.append(command.deflection)
        shares.append(state.pace)
    assert set(deflections) == {seen[-1].deflection}
    assert shares[2] == pytest.approx(seen[-1].share - seen[-2].share, rel=1e-6)
    assert shares[-1] < 0.95 * shares[2]
    assert stopped == 10  # 40 ms
    assert command.stop.fault is Fault.WRENCH_LOST
    assert "the limit is 40 (SafetyConfig.stop_after)" in command.stop.message
    assert np.isfinite(state.filtered).all()


def test_a_frozen_wrench_stops_a_moving_arm_only():
    rig = Rig(SOFT)
    state, q = rig.engaged(), rig.q_start
    raw = rig.raw(q, (0.0,) * 6)
    for k in range(1, 20):
        now = k * PERIOD
        state, command = rig.controller.step(state, Reading(now, q, raw, now))
        q = command.q
        if command.is_stop:
            break
    assert command.stop.fault is Fault.WRENCH_FROZEN
    assert k == 14  # it moves from the first tick on; frozen for over 50 ms
    still = Rig(SOFT, offset=(0, 0, 0))
    state = still.engaged()
    for k in range(1, 100):
        now = k * PERIOD
        state, command = still.controller.step(
            state, Reading(now, still.q_start, raw, now)
        )
    assert not command.is_stop


def test_a_saturated_sensor_stops():
    rig = Rig(SOFT)
    raw = list(rig.raw(rig.q_start, (0.0,) * 6))
    raw[5] = 59.5
    _, command = rig.controller.step(
        rig.engaged(), Reading(PERIOD, rig.q_start, tuple(raw), PERIOD)
    )
    assert command.stop.fault is Fault.WRENCH_SATURATED


def read_while_moving(told, noise, most=np.inf):
    """Stop of a leg on which a press grows, and the wrist tells something of it."""
    rig, rng = Rig(offset=(0.0, 0.0, 0.2)), np.random.default_rng(0)
    state, q = rig.engaged(), rig.q_start
    for k in range(1, 250):
        size = min(max(k - 80, 0), most)
        press = np.array([0.0, 0.0, -0.9 * size, 0.0, 0.15 * size, 0.0])
        scatter = rng.normal(0.0, noise, 6) * np.repeat([1.0, 0.05], 3)
        raw = tuple(told(np.array(rig.raw(q, press + scatter))).tolist())
        now = k * PERIOD
        state, command = rig.controller.step(state, Reading(now, q, raw, now))
        if command.stop is not None:
            return command.stop, press
        q = command.q
    return None, press


@pytest.mark.parametrize(
    ("force", "torque", "end"), [(60.0, 60.0, "60 N"), (600.0, 11.0, "11 N")]
)
def test_an_axis_that_ends_before_its_range_stops(force, torque, end):
    most = np.repeat([force, torque], 3)
    stop, press = read_while_moving(lambda raw: np.clip(raw, -most, most), 0.3)
    assert stop.fault is Fault.WRENCH_SATURATED
    assert end in stop.message
    assert "sensor_range" in stop.message
    assert np.linalg.norm(press) < LIMITS.force


@pytest.mark.parametrize("noise", [0.01, 0.3])
def test_a_sensor_of_coarse_steps_is_at_no_end(noise):
    """Hardly noisy for its steps, it may tell the same for long under a load."""
    steps = np.array([0.2, 0.2, 0.2, 1e-6, 1e-6, 1e-6])
    stop, press = read_while_moving(
        lambda raw: steps * np.round(raw / steps), noise, most=60
    )
    assert stop is None
    assert press[2] == -54.0


def test_a_jump_of_the_bias_stops():
    rig = Rig(SOFT)
    _, seen = pushed(rig, [*[wrench(0, 0, 0)] * 10, *[wrench(70, 0, 0)] * 2])
    assert seen[-1].stop.fault is Fault.WRENCH_JUMP
    assert seen[-1].stop.fault.fault_class is FaultClass.MECHANICAL


def test_an_interrupted_loop_stops():
    rig = Rig(SOFT)
    state, _ = pushed(rig, [wrench(0, 0, 0)] * 10)
    late = rig.reading(21, state.servo.q, (0.0,) * 6)
    _, command = rig.controller.step(state, late)
    assert command.stop.fault is Fault.CLOCK_GAP


def ticked(times) -> Command:
    """Last command of a free leg whose ticks come at such times."""
    rig = Rig()
    state, q = rig.engaged(), rig.q_start
    for now in times:
        raw = rig.raw(q, wrench(0, 0, 0) + 0.1 * np.sin(900.0 * now))
        state, command = rig.controller.step(state, Reading(now, q, raw, now))
        q = command.q
    return command


@pytest.mark.parametrize("period", [0.5 * PERIOD, 0.25 * PERIOD, 0.9 * PERIOD])
def test_a_loop_faster_than_its_period_stops(period):
    """Each tick moves the arm by a period: at 1 kHz it would be four times as fast."""
    command = ticked(period * np.arange(1, 500))
    assert command.stop.fault is Fault.CLOCK_FAST
    assert f"{1000 * period:.3g} ms instead of 4 (Contr" in command.stop.message
    assert command.share < 0.3


def test_a_loop_that_jitters_goes_on():
    """Even by 30 ms, made up for by ticks at once, or a clock of coarse steps."""
    rng = np.random.default_rng(0)
    grid = PERIOD * np.arange(1, 500)
    late = np.maximum.accumulate(grid + rng.choice([0.0, 0.03], 499, p=[0.95, 0.05]))
    assert not ticked(late + 1e-5 * np.arange(499)).is_stop
    assert not ticked(grid + rng.uniform(0.0, 0.9 * PERIOD, 499)).is_stop
    assert not ticked(0.01 * np.ceil(grid / 0.01)).is_stop
    assert not ticked(0.97 * grid).is_stop


def test_old_and_early_stamps_are_dropped():
    rig = Rig(SOFT)
    state, seen = pushed(rig, [wrench(0, 0, 0)] * 10)
    q = seen[-1].q
    for stamp in (10 * PERIOD, 5 * PERIOD, 1e6, np.nan):
        reading = rig.reading(11, q, (50.0, 0, 0, 0, 0, 0))._replace(wrench_time=stamp)
        after, command = rig.controller.step(state, reading)
        assert after.filtered == state.filtered
        assert not command.is_stop


def test_a_joint_that_does_not_follow_stops():
    rig = Rig(SOFT)
    state = rig.engaged()
    off = np.array([0, 0, 0.06, 0, 0, 0, 0])
    for i in range(1, 41):
        q = np.array(state.servo.q) + off * min(i / 4, 1)
        load = (0.1 * (i % 3), 0.0, 0.0, 0.0, 0.0, 0.0)
        state, command = rig.controller.step(state, rig.reading(i, q, load))
        if command.is_stop:
            break
    assert command.stop.fault is Fault.JOINT_STUCK
    assert 0.100 < i * PERIOD < 0.130


@pytest.mark.parametrize(
    ("error", "fault"), [(0.2, Fault.ENCODER_JUMP), (np.nan, Fault.ENCODER_INVALID)]
)
def test_an_encoder_that_jumps_stops_at_the_last_believable_posture(error, fault):
    rig = Rig(SOFT)
    state, seen = pushed(rig, [wrench(0, 0, 0)] * 10)
    q = np.array(seen[-1].q)
    q[3] += error
    reading = rig.reading(11, seen[-1].q, (0.0,) * 6)._replace(q=q)
    _, command = rig.controller.step(state, reading)
    assert command.stop.fault is fault
    np.testing.assert_allclose(command.q, seen[-2].q, atol=1e-12)


def test_repeated_motions_cannot_add_up_beyond_the_limit():
    """Each motion is re-tared and adds 50 N; the absolute limit sees the sum."""
    config = ControllerConfig(
        tare=TarePolicy.MOTION,
        contact=Contact(stiffness=1e3),
        safety=SafetyConfig(motion_force=80.0),
    )
    held, worst, refused = 0.0, 0.0, False
    for _ in range(6):
        rig = Rig(SOFT, config=config)
        engagement = rig.controller.engage(
            rig.reading(0, rig.q_start, wrench(0, 0, -held))
        )
        if not engagement.is_engaged:
            refused = True
            assert engagement.refusals[0].cause is RefusalCause.LOADED
            assert "60 %" in engagement.refusals[0].words
            break
        loads = [wrench(0, 0, -held - 0.5 * k) for k in range(100)]
        _, seen = pushed(rig, loads, state=engagement.state)
        if seen[-1].is_stop:
            refused = True
            break
        held += 50.0
        worst = max(worst, held)
    assert refused
    assert worst <= 150.0


@pytest.mark.parametrize(
    ("policy", "force", "is_engaged"),
    [
        (TarePolicy.MOTION, 85.0, True),
        (TarePolicy.MOTION, 95.0, False),
        (TarePolicy.SESSION, 95.0, True),
        (TarePolicy.SESSION, 149.0, False),
    ],
)
def test_a_motion_that_is_tared_anew_begins_below_60_percent(policy, force, is_engaged):
    config = ControllerConfig(tare=policy, contact=Contact(stiffness=1e3))
    rig = Rig(SOFT, config=config)
    reading = rig.reading(0, rig.q_start, wrench(0, -force, 0))
    assert rig.controller.engage(reading).is_engaged is is_engaged


def test_the_absolute_limit_holds_within_a_re_tared_motion():
    """Engaged at 80 N, stopped at 148, though the change is below its own limit."""
    config = ControllerConfig(
        tare=TarePolicy.MOTION,
        contact=Contact(stiffness=1e3),
        safety=SafetyConfig(motion_force=100.0),
    )
    rig = Rig(SOFT, config=config)
    state = rig.engaged(wrench(0, 0, -80))
    _, seen = pushed(rig, [wrench(0, 0, -80 - k) for k in range(90)], state=state)
    assert seen[-1].stop.fault is Fault.OVERLOAD
    assert np.linalg.norm(seen[-1].load[:3]) < 150.0


def test_a_motion_may_have_a_limit_of_its_own():
    config = ControllerConfig(
        tare=TarePolicy.MOTION,
        contact=Contact(stiffness=1e3),
        safety=SafetyConfig(motion_force=40.0),
    )
    rig = Rig(SOFT, config=config)
    state = rig.engaged(wrench(0, 0, -30))
    _, seen = pushed(rig, [wrench(0, 0, -30 - k) for k in range(60)], state=state)
    assert seen[-1].stop.fault is Fault.MOTION_OVERLOAD
    assert np.linalg.norm(seen[-1].load[:3]) == pytest.approx(70.0, abs=3.0)


def test_an_old_baseline_forbids_forceful_motion():
    rig = Rig(SOFT, baseline_time=-7 * 3600.0)
    engagement = rig.controller.engage(rig.reading(0, rig.q_start, (0.0,) * 6))
    assert not engagement.is_engaged
    assert engagement.refusals[0].cause is RefusalCause.BIAS
    assert "new baseline" in engagement.refusals[0].words
    with pytest.raises(InputError, match="new baseline"):
        engagement.require()


def test_a_baseline_by_another_clock_forbids_forceful_motion():
    """Its bias would count as new for ever."""
    rig = Rig(SOFT, baseline_time=1.7e9)
    engagement = rig.controller.engage(rig.reading(0, rig.q_start, (0.0,) * 6))
    assert [one.cause for one in engagement.refusals] == [RefusalCause.BIAS]
    assert "clock of the readings" in engagement.refusals[0].words


def test_a_baseline_may_be_judged_just_after_the_first_reading():
    assert Rig(SOFT, baseline_time=0.02).engaged()


def test_engagement_is_refused_away_from_the_leg():
    rig = Rig(SOFT)
    q = np.array(rig.q_start)
    q[2] += 0.03
    engagement = rig.controller.engage(rig.reading(0, q, (0.0,) * 6))
    assert "from the start of the leg" in engagement.refusals[0].words


def test_a_first_reading_must_be_whole_and_recent():
    rig = Rig(SOFT)
    good = rig.reading(0, rig.q_start, (0.0,) * 6)
    with pytest.raises(InputError, match="first reading"):
        rig.controller.engage(good._replace(wrench_ft=(np.nan,) * 6))
    with pytest.raises(InputError, match="first reading"):
        rig.controller.engage(good._replace(q=(0.0,)))
    with pytest.raises(
        InputError,
        match=r"age of the first wrench \[s\]: got 0\.024, expected at most 0\.012 "
        r"\(SafetyConfig\.hold_after\)\. .*WrenchReading\.time",
    ):
        rig.controller.engage(good._replace(wrench_time=-0.024))


def test_an_inverted_sensor_reads_the_same_load():
    usual, inverted = Rig(SOFT), Rig(SOFT)
    inverted.loads = LoadModel(
        T_ee_ft=T_EE_FT,
        tool=usual.loads.tool,
        bias=usual.loads.bias,
        wrench_sign=-1.0,
    )
    raw = inverted.raw(usual.q_start, (1.0, 2, 3, 0.1, 0.2, 0.3))
    R, _ = usual.controller._servo.kinematics.pose(usual.q_start)
    np.testing.assert_allclose(
        inverted.loads.load_ee(raw, R), (1, 2, 3, 0.1, 0.2, 0.3), atol=1e-9
    )
    np.testing.assert_allclose(
        inverted.loads.reading((1.0, 2, 3, 0.1, 0.2, 0.3), R), raw, atol=1e-9
    )


def test_settings_out_of_range_are_refused():
    with pytest.raises(ConfigError, match="stop_after"):
        SafetyConfig(stop_after=0.001)
    with pytest.raises(ConfigError, match=r"trend.*0.02"):
        SafetyConfig(trend=1.0)  # no growth would be judged before it is too late
    with pytest.raises(ConfigError, match=r"period.*got 0.05, expected 0.0001 to 0.04"):
        ControllerConfig(period=0.05)  # each tick would be a gap of the clock
    assert ControllerConfig(period=0.05, safety=SafetyConfig(stop_after=0.1)).period
    with pytest.raises(ConfigError, match="BiasBound"):
        BiasBound(force=float("nan"))
    with pytest.raises(ConfigError, match="wrench_sign"):
        LoadModel(T_ee_ft=T_EE_FT, wrench_sign=0.5)


def test_limits_are_those_of_the_robots_file():
    assert (LIMITS.force, LIMITS.torque) == (150.0, 40.0)


@pytest.mark.parametrize("time", [np.nan, np.inf, -np.inf])
def test_a_clock_that_gives_no_number_stops_at_once(time):
    rig = Rig(SOFT)
    state, reading = rig.engaged(), rig.reading(1, rig.q_start, (0.0,) * 6)
    state, command = rig.controller.step(state, reading._replace(time=time))
    assert command.stop.fault is Fault.CLOCK_GAP
    assert str(time) in command.stop.message
    assert np.isfinite(command.stop.time)
    held = command.q
    state, command = rig.controller.step(state, rig.reading(2, rig.q_start, (0.0,) * 6))
    assert command.is_stop
    assert command.q == held


@pytest.mark.parametrize("time", [None, "soon", (), [0.004, 0.008]])
def test_a_time_that_is_none_at_all_stops_the_arm_and_not_the_loop(time):
    rig = Rig(SOFT)
    state, reading = rig.engaged(), rig.reading(1, rig.q_start, (0.0,) * 6)
    _, command = rig.controller.step(state, reading._replace(time=time))
    assert command.stop.fault is Fault.CLOCK_GAP
    assert str(time) in command.stop.message
    with pytest.raises(InputError, match="first reading"):
        rig.controller.engage(reading._replace(time=time))


@pytest.mark.parametrize("stamp", [None, "soon", ()])
def test_a_wrench_without_a_time_is_no_wrench(stamp):
    rig = Rig(SOFT)
    state = rig.engaged()
    for k in range(1, 11):
        assert state.safety.stop is None
        reading = rig.reading(k, rig.q_start, (0.0,) * 6)
        state, command = rig.controller.step(state, reading._replace(wrench_time=stamp))
    assert command.stop.fault is Fault.WRENCH_LOST
    with pytest.raises(StartError, match="age of the first wrench"):
        rig.controller.engage(reading._replace(wrench_time=stamp))


@pytest.mark.parametrize("compliance", [None, SOFT])
def test_a_command_that_is_no_number_never_leaves(compliance):
    """Whatever spoiled the leg: the arm stops and stays where it is."""
    rig = Rig(compliance)
    state, _ = pushed(rig, [wrench(0, 0, 0)] * 20)
    rig.controller.leg._way = (0.0, 0.0, np.nan)
    q = state.servo.q
    state, command = rig.controller.step(state, rig.reading(21, q, (0.0,) * 6))
    assert command.stop.fault is Fault.COMMAND_INVALID
    assert command.outcome is LegOutcome.STOPPED
    np.testing.assert_allclose(command.q, q)
    rig.controller.leg._way = (0.0, 0.0, 0.1)
    _, command = rig.controller.step(state, rig.reading(22, q, (0.0,) * 6))
    assert command.stop.fault is Fault.COMMAND_INVALID
    np.testing.assert_allclose(command.q, q)


def test_a_commanded_posture_that_is_no_number_counts_as_not_followed():
    rig = Rig(SOFT)
    state, supervisor = rig.engaged().safety, rig.controller._supervisor
    for k in range(1, 30):
        reading = rig.reading(k, rig.q_start, (0.001 * k, 0, 0, 0, 0, 0))
        state, _ = supervisor.step(
            state, reading, (np.nan,) * 7, (0.0,) * 6, is_moving=True
        )
    assert state.stop.fault is Fault.JOINT_STUCK


def test_a_load_that_is_no_number_counts_as_a_touch():
    nan = (np.nan, *(0.0,) * 5)
    assert ContactGuard().is_touched(nan, (0.0,) * 6)
    assert not ContactGuard().is_touched((0.0,) * 6, (0.0,) * 6)
