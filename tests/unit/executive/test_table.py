"""Which state follows which, and what is done about each fault."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.control import (
    Fault,
    Reading,
    Refusal,
    RefusalCause,
    StartError,
    Stop,
)
from debrisgrasp.errors import InputError, UnknownNameError
from debrisgrasp.executive import FAULTS, STAGES, Action, State
from debrisgrasp.executive.noticed import cant_start, fault_of_stop, refused
from debrisgrasp.executive.table import ANSWERS, FOLLOWING, HOLDING, answer_to

STILL = Reading(0.0, [0.0], [0.0] * 6, 0.0)
GOING_ON = (Action.RETRY, Action.NEXT, Action.HOLD, Action.SKIP)


def test_every_stage_leads_to_another_and_all_are_passed_in_order():
    assert set(FOLLOWING) == {*STAGES, State.PUSH}
    assert FOLLOWING[State.PUSH] is State.RETREAT
    state, passed = State.SELF_TEST, []
    for _ in STAGES:
        passed.append(state)
        state = FOLLOWING[state]
    assert tuple(passed) == STAGES
    assert state is State.CAPTURE


@pytest.mark.parametrize("state", FOLLOWING)
def test_every_fault_has_an_answer_that_says_where_to_go_on(state):
    for fault in FAULTS:
        answer = answer_to(state, fault)
        if answer.action in GOING_ON:
            assert answer.resume in STAGES


@pytest.mark.parametrize("state", FOLLOWING)
def test_every_answer_that_repeats_a_state_is_bounded(state):
    for fault in FAULTS:
        answer = answer_to(state, fault)
        if answer.action in (Action.RETRY, Action.HOLD):
            assert 1 <= answer.budget <= 3
            after = answer_to(state, fault, used=answer.budget)
            assert after.action not in (Action.RETRY, Action.HOLD)


def test_a_hand_in_the_pile_is_cleared_up_before_the_next_object():
    for state in (State.CLOSE, *HOLDING):
        assert answer_to(state, "empty_grip").is_cleared_up
    assert not answer_to(State.PLAN_GRASP, "no_grasp").is_cleared_up


def test_an_arm_that_finds_no_way_back_is_cleared_up_and_not_given_up():
    answer = answer_to(State.RETREAT, "plan_collision")
    after = answer_to(State.RETREAT, "plan_collision", used=answer.budget)
    assert after.action is Action.NEXT
    assert after.is_cleared_up
    assert after.resume is State.RETREAT


def test_a_hand_that_something_hangs_on_is_shaken_once_and_then_felt_out():
    first = answer_to(State.VERIFY_RELEASE, "not_released")
    assert (first.action, first.resume) == (Action.RETRY, State.RELEASE)
    then = answer_to(State.VERIFY_RELEASE, "not_released", used=1)
    assert (then.action, then.resume) == (Action.NEXT, State.CAPTURE)
    assert then.is_cleared_up  # which ends as a fault where the hand does not come free
    assert answer_to(State.RETREAT, "not_released", used=1).action is Action.ABORT


def test_a_plan_that_fails_leads_to_the_next_object_without_another_look():
    assert answer_to(State.PLAN_GRASP, "no_grasp").resume is State.SELECT
    assert answer_to(State.LIFT, "too_heavy").resume is State.CAPTURE


def test_nothing_left_to_try_ends_the_run_instead_of_asking_forever():
    assert answer_to(State.SELECT, "no_grasp").action is Action.ABORT


def test_faults_of_the_wrench_stop_in_every_state():
    for state in STAGES:
        for fault in ("wrench_nan", "wrench_frozen"):
            assert answer_to(state, fault).action is Action.STOP


@pytest.mark.parametrize("fault", ["bias_jump", "oscillation"])
def test_a_wrench_that_jumps_or_swings_stops_for_good_where_nothing_is_gripped(fault):
    for state in (State.PREGRASP, State.SWITCH, State.APPROACH, State.RETREAT):
        assert answer_to(state, fault).action is Action.STOP


@pytest.mark.parametrize("fault", ["bias_jump", "oscillation"])
@pytest.mark.parametrize("state", [State.CLOSE, *HOLDING])
def test_with_rubble_in_the_hand_the_zero_is_taken_anew_a_few_times(state, fault):
    answer = answer_to(state, fault)
    assert answer.action is Action.RETRY
    assert answer.is_cleared_up
    assert answer.resume is State.SELF_TEST
    then = answer_to(state, fault, used=answer.budget)
    is_held_down = (state, fault) == (State.LIFT, "oscillation")
    assert then.action is (Action.NEXT if is_held_down else Action.STOP)
    assert then.is_cleared_up is is_held_down


def test_an_unknown_fault_is_refused_with_the_known_ones():
    with pytest.raises(UnknownNameError, match="slip"):
        answer_to(State.LIFT, "slipp")


def test_all_answers_are_for_known_faults():
    assert {fault for _, fault in ANSWERS} <= set(FAULTS)


@pytest.mark.parametrize("fault", list(Fault))
@pytest.mark.parametrize("state", FOLLOWING)
def test_whatever_control_notices_is_a_fault_of_the_table(fault, state):
    stop = Stop(fault, "torque too large", 1.0)
    found = fault_of_stop(stop, Reading(1.0, [0.0], [0.0] * 6, 1.0), state, "right")
    assert found.fault in FAULTS
    assert found.arm == "right"


def test_a_lost_wrench_is_told_apart_by_what_was_read():
    stop = Stop(Fault.WRENCH_LOST, "old", 1.0)
    nan = Reading(1.0, [0.0], [float("nan")] * 6, 1.0)
    old = Reading(1.0, [0.0], [0.0] * 6, 0.5)
    assert fault_of_stop(stop, nan, State.LIFT, "left").fault == "wrench_nan"
    assert fault_of_stop(stop, old, State.LIFT, "left").fault == "clock_disorder"


@pytest.mark.parametrize(
    ("causes", "fault"),
    [
        ([RefusalCause.BIAS], "bias_drift"),
        ([RefusalCause.LOADED], "ratchet"),
        ([RefusalCause.ELSEWHERE], "controller_refuses"),
        ([RefusalCause.BRAKING, RefusalCause.SATURATED], "sensor_saturated"),
    ],
)
def test_a_refused_motion_is_named_by_its_causes(causes, fault):
    refusals = [Refusal(cause, f"{cause.value} by 3") for cause in causes]
    found = refused(refusals, STILL, "right")
    assert found.fault == fault
    assert found.refused_for == set(causes)
    assert all(refusal.words in found.message for refusal in refusals)


def test_a_motion_without_a_start_is_named_by_its_cause():
    def fault_of(error):
        return cant_start(error, STILL, "right").fault

    def outside(cause):
        return StartError(cause, "start posture", got=4, expected="less")

    assert fault_of(outside(RefusalCause.OUTSIDE)) == "start_outside_limits"
    assert fault_of(outside(RefusalCause.STALE)) == "clock_disorder"
    other = InputError("leg", got="start posture outside", expected="another")
    assert fault_of(other) == "controller_refuses"


def test_readings_that_are_no_numbers_count_before_any_cause():
    refusals = [Refusal(RefusalCause.BIAS, "the bias may be wrong")]
    for reading, fault in (
        (STILL._replace(wrench_ft=[np.nan] * 6), "wrench_nan"),
        (STILL._replace(q=[np.inf]), "encoder_jump"),
    ):
        assert refused(refusals, reading, "right").fault == fault
