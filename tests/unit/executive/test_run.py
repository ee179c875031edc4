"""The executive itself: always an end, always one class, never a raised exception."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.control import FaultClass
from debrisgrasp.errors import DriverError, InputError, UnknownNameError
from debrisgrasp.executive import (
    STAGES,
    Action,
    Executive,
    MemoryRecord,
    RunEnd,
    RunRecord,
    State,
    TaskSettings,
    differences,
    load_run,
)
from debrisgrasp.executive import run as module
from debrisgrasp.executive.recover import recover
from debrisgrasp.executive.replay import decisions
from debrisgrasp.executive.result import Done, FaultFound
from debrisgrasp.executive.table import FOLLOWING
from tests.unit.executive.rigs import brick_at, task_before
from tests.unit.robot.broken_robots import nothing
from tests.unit.robot.broken_robots import raising as no_answer


@pytest.fixture
def fake(pipeline):
    return task_before(pipeline, brick_at(1.0))[0]


@pytest.fixture
def run(fake, pipeline, monkeypatch):
    """Run with all steps replaced: by nothing, or by what a test wants."""

    def go(steps, settings=None, *, observers=(), record=None):
        for state in STAGES:
            monkeypatch.setitem(module.STEPS, state, lambda _context: Done())
        monkeypatch.setitem(module.STEPS, State.SELECT, choose)
        monkeypatch.setitem(module.STEPS, State.VERIFY_RELEASE, put_down)
        for state, step in steps.items():
            monkeypatch.setitem(module.STEPS, state, step)
        record = record or MemoryRecord()
        executive = Executive(
            fake.robot,
            settings or TaskSettings(max_removals=2),
            pipeline=pipeline,
            observers=observers,
            record=record,
            rng=np.random.default_rng(0),
        )
        return executive.run(), record

    return go


def choose(context):
    context.cycle.label, context.cycle.centroid = 1, (1.0, 0.0, 0.1)
    return Done()


def put_down(context):
    context.n_removed += 1
    context.cycle.is_removed = True
    return Done()


def failing(fault, times=99):
    left = [times]

    def step(_context):
        left[0] -= 1
        return FaultFound(fault, "as asked") if left[0] >= 0 else Done()

    return step


def raising(error):
    def step(*_):
        raise error

    return step


def test_as_many_removals_as_asked_for_end_the_run(run):
    result, record = run({})
    assert result.end is RunEnd.FINISHED
    assert result.n_removed == 2
    assert result.fault_class is None
    assert result.attempts[0].reached == STAGES
    assert record.events[-1]["event"] == "end"


def hanging(context):
    context.is_in_pile = "right"
    return FaultFound("not_released", "as asked")


def test_what_came_off_the_hand_only_as_that_was_felt_out_is_removed_all_the_same(run):
    settings = TaskSettings(max_removals=1, max_attempts=3)
    result, _ = run({State.VERIFY_RELEASE: hanging}, settings)
    assert [fault.action for fault in result.faults] == [Action.RETRY, Action.NEXT]
    assert result.n_removed == 1
    assert result.end is RunEnd.FINISHED


def test_what_a_hand_lost_before_the_drop_off_is_not_removed(run):
    def lost(context):
        context.is_in_pile = "right"
        return FaultFound("slip", "as asked")

    settings = TaskSettings(max_removals=1, max_attempts=3)
    result, _ = run({State.TRANSPORT: lost}, settings)
    assert result.n_removed == 0
    assert result.end is not RunEnd.FINISHED


def test_the_way_is_clear_when_select_says_so(run):
    result, _ = run({State.SELECT: lambda _c: Done({}, State.CLEARED)})
    assert result.end is RunEnd.CLEARED
    assert result.attempts == ()


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
    assert f"{type(error).__name__} in test_run.py, line" in result.faults[0].message
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


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (TaskSettings(rest="nowhere"), "unknown posture.*nowhere"),
        (TaskSettings(look={"neck": 0.1}), "unknown joint.*neck"),
        (TaskSettings(look={"ptu_pan_joint": float("nan")}), "ptu_pan_joint.*number"),
    ],
    ids=("rest", "joint", "nan"),
)
def test_a_rest_or_a_look_that_the_robot_lacks_is_refused(
    fake, pipeline, settings, words
):
    with pytest.raises((InputError, UnknownNameError), match=words):
        Executive(fake.robot, settings, pipeline=pipeline, rng=np.random.default_rng(0))


@pytest.mark.parametrize("state", FOLLOWING)
def test_a_device_that_never_answers_again_ends_in_a_stop(run, fake, state):
    steps = dict([LEADING_TO[state]]) if state in LEADING_TO else {}
    result, _ = run({**steps, state: raising(DriverError("arm", "no answer"))})
    assert result.end is RunEnd.STOPPED
    assert result.fault_class is FaultClass.DRIVER
    assert all(arm.is_stopped for arm in fake.arms.values())


def test_a_device_that_is_lost_for_a_moment_in_a_recovery_is_asked_again(
    run, monkeypatch
):
    answered = []

    def once(context, event, answer):
        answered.append(event.fault)
        if len(answered) == 1:
            raise DriverError("arm", "no answer")
        return recover(context, event, answer)

    monkeypatch.setattr(module, "recover", once)
    result, _ = run({State.CAPTURE: failing("empty_cloud", 1)})
    assert answered == ["empty_cloud", "connection_lost"]
    assert [event.fault for event in result.faults] == answered
    assert result.end is RunEnd.FINISHED


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


def test_a_device_that_answers_again_costs_one_retry(run):
    left = [1]

    def once(_context):
        left[0] -= 1
        if left[0] >= 0:
            raise DriverError("arm", "no answer")
        return Done()

    result, _ = run({State.LIFT: once})
    assert result.end is RunEnd.FINISHED
    assert [event.action for event in result.faults] == [Action.RETRY]


def test_retries_are_bounded_and_then_the_answer_changes(run):
    result, _ = run({State.CAPTURE: failing("empty_cloud")})
    assert [e.action for e in result.faults] == [
        Action.RETRY,
        Action.RETRY,
        Action.ABORT,
    ]
    assert result.end is RunEnd.ABORTED
    assert result.fault_class is FaultClass.PERCEPTION
    assert result.n_removed == 0


def test_an_arm_that_is_cleared_up_on_its_way_back_has_removed_the_object(
    run,
):
    for times in (2, 3):
        result, _ = run({State.RETREAT: failing("plan_collision", times)})
        assert result.end is RunEnd.FINISHED
        assert result.n_removed == 2
        assert [attempt.is_removed for attempt in result.attempts] == [True, True]
        last = Action.RETRY if times == 2 else Action.NEXT
        assert result.faults[-1].action is last


def test_a_skipped_step_is_reported_and_the_run_goes_on(run):
    result, _ = run({State.SEGMENT: failing("plane_eats_pile", times=1)})
    assert result.end is RunEnd.FINISHED
    assert result.faults[0].action is Action.SKIP


def test_an_object_without_a_grasp_is_one_attempt_and_the_next_follows(run):
    result, _ = run({State.PLAN_GRASP: failing("no_grasp", times=1)})
    assert [a.is_removed for a in result.attempts] == [False, True, True]
    assert result.attempts[0].faults[0].fault == "no_grasp"
    assert State.PREGRASP not in result.attempts[0].reached


def test_the_first_fault_in_stage_order_is_told_apart_from_the_last(run):
    steps = {State.PLAN_MOTION: failing("plan_collision", times=1),
             State.LIFT: failing("wrench_frozen")}  # fmt: skip
    result, _ = run(steps)
    assert result.end is RunEnd.STOPPED
    assert result.first_fault.fault == "plan_collision"
    assert result.fault_class is FaultClass.DRIVER


def test_objects_that_no_try_could_take_end_the_run_in_order_with_their_reasons(run):
    def nothing_more(context):
        context.left = {"object 1": "no arm gets there"}
        return FaultFound("no_grasp", "no candidate is left to try")

    result, record = run({State.SELECT: nothing_more})
    assert result.end is RunEnd.LEFT
    assert result.left == {"object 1": "no arm gets there"}
    assert result.fault_class is FaultClass.PLANNING
    assert record.events[-1]["end"] == "left"


def test_a_run_without_progress_ends(run):
    result, _ = run(
        {State.PLAN_GRASP: failing("no_grasp")}, TaskSettings(max_attempts=5)
    )
    assert result.end is RunEnd.LEFT
    assert result.fault_class is FaultClass.PLANNING
    assert len(result.attempts) == 5


def test_a_stop_is_never_followed_by_a_motion(run, fake):
    run({State.APPROACH: failing("wrench_nan")})
    before = [tuple(arm.read().q) for arm in fake.arms.values()]
    for arm in fake.arms.values():
        arm.engage()
        arm.command([0.1] * len(arm.joint_names))
    fake.robot.clock.wait_until(fake.robot.clock.now() + 0.5)
    assert [tuple(arm.read().q) for arm in fake.arms.values()] == before


def test_arms_that_the_robot_has_not_are_refused(fake, pipeline):
    with pytest.raises(UnknownNameError, match="left"):
        Executive(
            fake.robot,
            TaskSettings(arms=("middle",)),
            pipeline=pipeline,
            rng=np.random.default_rng(0),
        )


def test_an_arm_without_a_drop_off_is_refused(fake, pipeline):
    settings = TaskSettings(drop_off={"right": (0.2, -0.7)})
    with pytest.raises(InputError, match="drop-off of the left arm"):
        Executive(fake.robot, settings, pipeline=pipeline, rng=np.random.default_rng(0))


def test_a_drop_off_where_the_robot_stands_is_refused(fake, pipeline):
    settings = TaskSettings(drop_off={"right": (0.1, -0.25), "left": (0.25, 0.75)})
    with pytest.raises(InputError, match="where the robot stands"):
        Executive(fake.robot, settings, pipeline=pipeline, rng=np.random.default_rng(0))


def test_a_drop_off_out_of_reach_is_refused_with_the_place(fake, pipeline):
    settings = TaskSettings(drop_off={"right": (-2.0, -2.0), "left": (0.25, 0.75)})
    with pytest.raises(InputError, match=r"right arm: got \(-2, -2\)"):
        Executive(fake.robot, settings, pipeline=pipeline, rng=np.random.default_rng(0))


def test_every_state_is_recorded(run):
    _, record = run({})
    states = [e["state"] for e in record.events if e["event"] == "state"]
    assert states[: len(STAGES)] == [state.value for state in STAGES]
