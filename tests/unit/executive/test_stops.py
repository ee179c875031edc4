"""Whatever happens, the arms are stopped, and who does not stop is named."""

from __future__ import annotations

from dataclasses import replace
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest

from debrisgrasp.control import FaultClass
from debrisgrasp.errors import DriverError, InputError
from debrisgrasp.executive import (
    STAGES,
    Executive,
    RunEnd,
    RunRecord,
    State,
    TaskSettings,
    differences,
    load_run,
)
from debrisgrasp.executive import run as module
from debrisgrasp.executive.replay import decisions
from debrisgrasp.executive.result import Done, FaultFound, FaultRaised
from debrisgrasp.executive.stopping import reset_stops
from debrisgrasp.executive.table import FOLLOWING
from tests.unit.executive.rigs import brick_at, task_before
from tests.unit.executive.stepped import failing, raising
from tests.unit.robot.broken_robots import Changed, nothing
from tests.unit.robot.broken_robots import raising as no_answer


@pytest.mark.parametrize(
    ("state", "error"),
    [
        *((state, RuntimeError("bug")) for state in STAGES[::2]),
        *((state, InputError("x", got=1, expected="2")) for state in STAGES[1::2]),
    ],
)
def test_an_error_that_nobody_foresaw_is_the_softwares_and_stops_for_good(
    run, fake, state, error
):
    result, record = run({state: raising(error)})
    assert result.end is RunEnd.STOPPED
    assert result.fault_class is FaultClass.SOFTWARE
    assert [event.fault for event in result.faults] == ["software_error"]
    assert f"{type(error).__name__} in stepped.py, line" in result.faults[0].message
    assert all(arm.is_stopped for arm in fake.arms.values())
    assert record.events[-1]["class"] == "software"


def test_an_error_while_a_fault_is_answered_is_the_softwares(run, fake, monkeypatch):
    monkeypatch.setattr(module, "recover", raising(RuntimeError("bug")))
    result, _ = run({State.CAPTURE: failing("empty_cloud")})
    assert result.end is RunEnd.STOPPED
    assert result.fault_class is FaultClass.SOFTWARE
    assert all(arm.is_stopped for arm in fake.arms.values())


@pytest.mark.parametrize("state", STAGES)
def test_ctrl_c_in_any_state_stops_the_arms_and_keeps_the_record(run, fake, state):
    result, record = run({state: raising(KeyboardInterrupt())})
    assert result.end is RunEnd.INTERRUPTED
    assert all(arm.is_stopped for arm in fake.arms.values())
    assert record.events[-1]["end"] == "interrupted"


class Person:
    """Ends the run as a state begins."""

    def __init__(self, state):
        self.state = state

    def on_state(self, now):
        if now is self.state:
            raise KeyboardInterrupt


LEADING_TO = {
    State.PUSH: (State.SELECT, lambda _c: Done({}, State.PUSH)),
    State.RECOVER: (State.CAPTURE, lambda _c: FaultFound("empty_cloud", "as asked")),
    State.SAFE_STOP: (State.APPROACH, lambda _c: FaultFound("wrench_nan", "as asked")),
    State.ABORT: (State.SELF_TEST, lambda _c: FaultFound("limit_mismatch", "so")),
    State.CLEARED: (State.SELECT, lambda _c: Done({}, State.CLEARED)),
}
"""State, and what happens in it, from which those follow that no removal passes."""


@pytest.mark.parametrize("state", State)
def test_a_run_that_a_person_ends_is_recorded_up_to_there(run, fake, state, tmp_path):
    steps = dict([LEADING_TO[state]]) if state in LEADING_TO else {}
    _, whole = run(steps, TaskSettings(max_removals=1, max_attempts=3))
    for arm in fake.arms.values():
        arm.reset()
    record = RunRecord(tmp_path / "run", {})
    result, _ = run(steps, observers=[Person(state)], record=record)
    assert result.end is RunEnd.INTERRUPTED
    assert all(arm.is_stopped for arm in fake.arms.values())
    stored = load_run(tmp_path / "run")
    assert stored.end["end"] == "interrupted"
    taken = decisions(stored.events)
    (stop,) = (i for i, event in enumerate(taken) if event["event"] == "stop")
    assert taken[stop]["why"] == "interrupted"
    # A replay takes the same decisions until then.
    assert differences(taken[:stop], decisions(whole.events)[:stop]) == []
    begun = [e["state"] for e in stored.events if e["event"] == "state"]
    assert begun[-1] == state.value


@pytest.mark.parametrize("state", STAGES[::4])
def test_what_an_observer_raises_comes_out_once_the_arms_are_stopped(
    fake, pipeline, run, state
):
    class Bad:
        def on_state(self, now):
            if now is state:
                raise RuntimeError("bug of an observer")

    run({})  # replaces the steps
    rng = np.random.default_rng(0)
    executive = Executive(fake.robot, pipeline=pipeline, observers=[Bad()], rng=rng)
    with pytest.raises(RuntimeError, match="observer"):
        executive.run()
    assert all(arm.is_stopped for arm in fake.arms.values())


def test_what_an_observer_raises_names_the_arms_that_do_not_stop(
    fake, pipeline, monkeypatch
):
    bad = SimpleNamespace(on_state=raising(RuntimeError("bug of an observer")))
    monkeypatch.setattr(fake.arms["right"], "stop", nothing)
    rng = np.random.default_rng(0)
    executive = Executive(fake.robot, pipeline=pipeline, observers=[bad], rng=rng)
    with pytest.raises(RuntimeError) as raised:
        executive.run()
    (note,) = raised.value.__notes__
    assert note.startswith("NOT STOPPED: right arm: it does not stop")


@pytest.mark.parametrize("state", FOLLOWING)
def test_a_device_that_never_answers_again_ends_in_a_stop(run, fake, state):
    steps = dict([LEADING_TO[state]]) if state in LEADING_TO else {}
    result, _ = run({**steps, state: raising(DriverError("arm", "no answer"))})
    assert result.end is RunEnd.STOPPED
    assert result.fault_class is FaultClass.DRIVER
    assert all(arm.is_stopped for arm in fake.arms.values())


def test_an_arm_that_the_task_does_not_use_is_stopped_too(run, fake):
    settings = TaskSettings(arms=("right",), max_removals=1)
    result, _ = run({State.APPROACH: failing("wrench_nan")}, settings)
    assert result.end is RunEnd.STOPPED
    assert all(arm.is_stopped for arm in fake.arms.values())


@pytest.mark.parametrize("stop", [nothing, no_answer])
@pytest.mark.parametrize("state", [State.SEGMENT, State.PREGRASP])
def test_an_arm_that_does_not_stop_is_named_and_holds_by_itself(
    fake, run, monkeypatch, stop, state
):
    monkeypatch.setattr(fake.arms["right"], "stop", stop)
    fake.arms["right"].engage()
    fault = FaultFound("encoder_jump", "a joint's reading jumped", "right")
    result, record = run({state: lambda _context: fault})
    assert result.end is RunEnd.STOPPED
    (words,) = result.silent
    assert words.startswith("right arm: it does not stop")
    assert not fake.arms["right"].is_engaged
    assert fake.arms["left"].is_stopped
    told = [event["silent"] for event in record.events if event["event"] == "stop"]
    assert told[-1] == [words]


def test_a_second_interrupt_keeps_no_arm_from_being_stopped(fake, run, monkeypatch):
    pressed = raising(KeyboardInterrupt())
    monkeypatch.setattr(fake.arms["left"], "stop", pressed)
    result, _ = run({State.SEGMENT: pressed})
    assert result.end is RunEnd.INTERRUPTED
    assert fake.arms["right"].is_stopped
    assert not fake.arms["left"].is_engaged
    assert [words.split(":")[0] for words in result.silent] == ["left arm"]


def test_a_driver_that_exits_ends_the_run_and_not_the_program(run):
    result, _ = run({State.SEGMENT: raising(SystemExit(3))})
    assert result.faults[-1].fault == "software_error"
    assert result.end is RunEnd.STOPPED


def test_a_stop_is_never_followed_by_a_motion(run, fake):
    run({State.APPROACH: failing("wrench_nan")})
    before = [tuple(arm.read().q) for arm in fake.arms.values()]
    for arm in fake.arms.values():
        arm.engage()
        arm.command([0.1] * len(arm.joint_names))
    fake.robot.clock.wait_until(fake.robot.clock.now() + 0.5)
    assert [tuple(arm.read().q) for arm in fake.arms.values()] == before


class Clock:
    """Tells another time than it is, from some time on."""

    def __init__(self, clock, told, since=0.2):
        self._clock, self._told, self._since = clock, told, since

    def now(self):
        now = self._clock.now()
        return now if now < self._since else self._told(now)

    def wait_until(self, time):
        self._clock.wait_until(time)


@pytest.mark.parametrize(
    "told",
    [
        lambda _now: 0.2,
        lambda now: 0.4 - now,
        lambda now: now - 3600.0,
        lambda _now: np.nan,
        lambda _now: "noon",
        raising(DriverError("clock", "no answer")),
    ],
    ids=("stands", "falls", "fell", "nan", "text", "silent"),
)
def test_a_clock_that_goes_wrong_ends_the_run_with_all_arms_stopped(
    fake, pipeline, told
):
    robot = replace(fake.robot, clock=Clock(fake.robot.clock, told))
    rng = np.random.default_rng(0)
    result = Executive(robot, pipeline=pipeline, rng=rng).run()
    assert result.end is RunEnd.STOPPED
    assert result.fault_class in (FaultClass.DRIVER, FaultClass.SOFTWARE)
    assert all(arm.is_stopped for arm in fake.arms.values())


@pytest.mark.parametrize("told", [lambda now: -now, lambda _now: 0.0])
def test_a_clock_that_never_goes_right_keeps_no_loop_going(fake, pipeline, told):
    robot = replace(fake.robot, clock=Clock(fake.robot.clock, told, since=-1.0))
    rng = np.random.default_rng(0)
    result = Executive(robot, pipeline=pipeline, rng=rng).run()
    assert result.end is RunEnd.STOPPED
    assert result.faults[-1].fault == "clock_disorder"


@pytest.mark.parametrize("device", ["base", "right"])
def test_what_does_not_obey_a_stop_ends_the_run_for_good(
    run, fake, monkeypatch, device
):
    """Asked again it would answer, and the task would go on as it moves."""
    thing = fake.base if device == "base" else fake.arms["right"]
    monkeypatch.setattr(thing, "stop", no_answer)
    result, _ = run({State.SELECT: raising(DriverError("base", "no answer"))})
    assert result.end is RunEnd.STOPPED
    assert [event.fault for event in result.faults] == [
        "connection_lost",
        "joint_stuck",
    ]
    assert "does not obey a stop" in result.faults[-1].message
    assert device in result.faults[-1].message


@pytest.mark.parametrize(
    ("reading", "fault"),
    [
        (lambda _: [np.nan] * 8, "encoder_jump"),
        (lambda _: [np.inf] * 8, "encoder_jump"),
        (lambda k: [0.1 * k] * 8, "joint_stuck"),
        (lambda k: [1e-3 * k] + [0.0] * 7, "joint_stuck"),
    ],
    ids=["nan", "inf", "fast", "slow"],
)
def test_a_stop_is_not_ended_unless_the_arm_is_seen_to_stand(pipeline, reading, fault):
    fake, task = task_before(pipeline, brick_at(1.0))
    context, arm = task.context, fake.arms["right"]
    arm.stop()
    looks = count()
    limb = replace(
        fake.robot.limbs["right"],
        arm=Changed(arm, read=lambda: arm.read()._replace(q=reading(next(looks)))),
    )
    limbs = {**fake.robot.limbs, "right": limb}
    context.robot = replace(context.robot, limbs=limbs)
    with pytest.raises(FaultRaised) as raised:
        reset_stops(context)
    assert (raised.value.found.fault, raised.value.found.arm) == (fault, "right")
    assert arm.is_stopped


def test_a_stop_is_ended_once_the_arm_stands_but_for_noise(pipeline):
    fake, task = task_before(pipeline, brick_at(1.0))
    context, arm = task.context, fake.arms["right"]
    arm.stop()
    rng = np.random.default_rng(0)
    read = arm.read

    def noisy():
        reading = read()
        return reading._replace(q=np.array(reading.q) + rng.uniform(0.0, 3e-4, 8))

    limb = replace(fake.robot.limbs["right"], arm=Changed(arm, read=noisy))
    limbs = {**fake.robot.limbs, "right": limb}
    context.robot = replace(context.robot, limbs=limbs)
    reset_stops(context)
    assert not arm.is_stopped
