"""What a plot of the load shows is what there was."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.control import (
    Fault,
    FingerReading,
    GripCommand,
    GripPhase,
    Reading,
    Stop,
)
from debrisgrasp.executive.drive import Drive
from debrisgrasp.executive.noticed import fault_of_stop
from debrisgrasp.executive.states import State
from tests.unit.executive.rigs import before_a_brick, holding


def test_the_trace_leaves_out_no_peak(pipeline, rng):
    _, task = before_a_brick(pipeline)
    context, drive = task.context, Drive(task.context, "right")
    n = 10 * context.settings.finger_ticks + 3
    loads = rng.normal(scale=20.0, size=(n, 6))
    for k, load in enumerate(loads):
        drive._note(0.004 * k, tuple(load.tolist()))
    time, force, torque = np.array(context.trace).T
    assert (np.diff(time) > 0.0).all()
    assert len(time) <= 12
    assert force.max() == context.cycle.peak_force
    assert torque.max() == context.cycle.peak_torque
    assert force.max() == pytest.approx(np.linalg.norm(loads[:, :3], axis=1).max())


@pytest.mark.parametrize(
    ("force", "fault", "name"),
    [
        (0.0, Fault.SWING, "object_swings"),
        (20.0, Fault.MOTION_OVERLOAD, "plan_collision"),
    ],
)
def test_what_turns_the_hand_without_a_push_swings(pipeline, force, fault, name):
    _, task = before_a_brick(pipeline)
    context = task.context
    context.state = State.TRANSPORT
    context.held = holding(is_lifted=True)
    supervisor, state = Drive(context, "right").supervised(is_planned=True)
    limb = context.limbs["right"]
    for k in range(1, 40):
        felt = np.array([force * k / 40, 0.0, 0.0, 0.0, 0.6 * k, 0.0])
        raw = np.asarray(limb.limb.sensor.read().wrench_ft) + felt
        time = state.time + context.settings.period
        reading = Reading(time, state.q, raw, time)
        state, _ = supervisor.step(state, reading, state.q, (0.0,) * 6, is_moving=False)
        if state.stop is not None:
            break
    assert state.stop.fault is fault
    assert fault_of_stop(state.stop, reading, State.TRANSPORT, "right").fault == name
    # On its way without a load a hand that is turned has touched something.
    empty = fault_of_stop(state.stop, reading, State.PREGRASP, "right").fault
    assert empty == "plan_collision"


def test_a_touch_that_ends_a_motion_is_called_one():
    stop = Stop(Fault.MOTION_OVERLOAD, "the load changed by 31 of 30 N", 1.0)
    reading = Reading(1.0, [0.0], [0.0] * 6, 1.0)
    found = fault_of_stop(stop, reading, State.TRANSPORT, "left")
    assert found.fault == "plan_collision"
    assert found.message.startswith("touched something")
    assert "31 of 30 N" in found.message


@pytest.mark.parametrize("is_lifted", [False, True])
def test_fingers_that_lose_what_still_lies_close_no_further(
    pipeline, monkeypatch, is_lifted
):
    _, task = before_a_brick(pipeline)
    context, drive = task.context, Drive(task.context, "right")
    context.state = State.LIFT
    openings = drive.fingers().openings
    squeeze = GripCommand((0.0,) * 3, 54.0)
    context.held = held = holding(is_lifted=is_lifted)
    state = held.state._replace(phase=GripPhase.SLIPPED, held_openings=openings)

    class Watch:
        def step(self, _state, _fingers):
            return state, squeeze

    held.watch, held.state = Watch(), state
    sent = []
    monkeypatch.setattr(drive.devices.gripper, "command", sent.append)
    found = drive._watched_fingers((0.0,) * 6)
    assert found is not None
    assert found.fault == "slip"
    if is_lifted:
        assert sent == [squeeze]
    else:
        assert sent[-1].openings == openings
        assert sent[-1].force < 0.5 * squeeze.force


@pytest.mark.parametrize(
    ("fault", "state", "name"),
    [
        (Fault.OVERLOAD, State.APPROACH, "early_contact"),
        (Fault.OVERLOAD, State.LIFT, "too_heavy"),
        (Fault.OVERLOAD, State.TRANSPORT, "too_heavy"),
        (Fault.TORQUE_OVERLOAD, State.APPROACH, "early_contact"),
        (Fault.TORQUE_OVERLOAD, State.LIFT, "too_heavy"),
        (Fault.TORQUE_OVERLOAD, State.TRANSPORT, "object_swings"),
    ],
)
def test_what_overloads_a_hand_is_named_by_what_it_does(fault, state, name):
    reading = Reading(1.0, (0.0,), (0.0,) * 6, 1.0)
    found = fault_of_stop(Stop(fault, "whatever", 1.0), reading, state, "right")
    assert found.fault == name


@pytest.mark.parametrize("fault", [Fault.OVERLOAD, Fault.OSCILLATION, Fault.SWING])
def test_fingers_close_no_more_whatever_stopped_the_arm(pipeline, monkeypatch, fault):
    """Those of one side would press the hand off what the others have lost."""
    _, task = before_a_brick(pipeline)
    context, drive = task.context, Drive(task.context, "right")
    context.state, context.held, sent = State.LIFT, holding(), []
    openings = drive.fingers().openings
    monkeypatch.setattr(drive.devices.gripper, "command", sent.append)
    drive._stopped(Stop(fault, "as asked", 1.0), drive.read())
    assert sent == [GripCommand(openings, context.held.grip.config.squeeze)]


def test_what_both_sides_feel_is_squeezed_on_when_the_arm_stops(pipeline, monkeypatch):
    """Fingers that tell where their joints are would let go of it, sent to there."""
    _, task = before_a_brick(pipeline)
    context, drive = task.context, Drive(task.context, "right")
    context.state, context.held, sent = State.TRANSPORT, holding(), []
    felt = FingerReading((0.05,) * 3, (40.0, 20.0, 20.0))
    monkeypatch.setattr(drive, "fingers", lambda: felt)
    monkeypatch.setattr(drive.devices.gripper, "command", sent.append)
    drive._stopped(Stop(Fault.TORQUE_OVERLOAD, "as asked", 1.0), drive.read())
    assert sent == []
    one_sided = felt._replace(forces=(40.0, 0.0, 0.0))
    monkeypatch.setattr(drive, "fingers", lambda: one_sided)
    drive._stopped(Stop(Fault.TORQUE_OVERLOAD, "as asked", 1.0), drive.read())
    assert sent == [GripCommand(felt.openings, context.held.grip.config.squeeze)]


def test_while_it_calms_down_what_is_held_is_squeezed_and_watched(pipeline):
    fake, task = before_a_brick(pipeline)
    context, drive = task.context, Drive(task.context, "right")
    context.state, context.held, begun = State.TRANSPORT, holding(), context.now()
    context.held.state = context.held.state._replace(
        phase=GripPhase.HOLDING, held_openings=drive.fingers().openings
    )
    found = drive.squeezed_on(1.0)
    assert found is not None  # there is nothing between the fingers
    assert context.now() - begun < 1.0
    context.held = None
    assert drive.squeezed_on(1.0) is None
    assert context.now() - begun > 1.0
    assert fake.truth().violations == ()
