"""Tasks in which something is odd from the start, each carried to its end."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from debrisgrasp.cli.clear_command import _summary
from debrisgrasp.control import FaultClass
from debrisgrasp.errors import DriverError
from debrisgrasp.executive import FAULTS, RunEnd, Simulated, State, TaskSettings
from debrisgrasp.geometry import SE3
from debrisgrasp.worlds import World
from tests.tasks import one_beam, run_struck, trust_the_camera
from tests.unit.robot.broken_robots import (
    Changed,
    fewer_fingers,
    forces_only,
    limits_in_degrees,
    lying_limits,
    millimetre_fingers,
    no_limits,
    no_time,
    numberless_fingers,
    shares_of_fingers,
    silent_fingers,
    silent_joints,
    turned_wrench,
    with_limb,
    worded_fingers,
    worded_joints,
    worded_wrench,
)

ONE = TaskSettings(
    arms=("right",), drive_over=0.02, max_removals=1, max_attempts=3, pushes=0
)


def assert_within_limits(done):
    truth = done.fake.truth()
    assert truth.violations == ()
    assert truth.overloads == ()


def test_what_is_too_heavy_is_dragged_to_the_drop_off(pipeline, monkeypatch):
    trust_the_camera(monkeypatch)
    settings = replace(ONE, max_mass=3.0)
    done = run_struck(pipeline, one_beam(4.0), settings)
    (fault,) = done.result.faults
    assert (fault.state, fault.fault) == (State.VERIFY_HOLD, "too_heavy")
    assert [attempt.is_removed for attempt in done.result.attempts] == [False, True]
    assert done.result.end is RunEnd.FINISHED
    assert done.result.fault_class is None
    told = [event for event in done.record.events if event["event"] == "done"]
    ways = [event["way"] for event in told if event["state"] == "select"]
    assert ways == ["pinch", "drag"]
    (pulled,) = (e for e in told if e["state"] == "lift" and "way" in e)
    assert pulled["way"][0] == pytest.approx(-settings.drag_distance, abs=0.03)
    truth = done.fake.truth()
    assert truth.removed == ("beam",)
    place = truth.world.bodies[0].T_base_body.p
    assert abs(place[1]) > 0.5  # beside the way ...
    assert np.linalg.norm(done.fake.base.T_odom_base.p) < 0.1  # ... to which it is back
    limits = pipeline.robot.limits("right").controller
    assert 20.0 < truth.peak_force["right"] < limits.force
    assert truth.peak_torque["right"] < limits.torque
    assert_within_limits(done)


def test_where_nothing_lies_the_way_is_clear_and_that_is_said(pipeline, monkeypatch):
    trust_the_camera(monkeypatch)
    (beam,) = one_beam().bodies
    nowhere = World((beam.at(SE3.from_parts(p=[8.0, 0.0, 0.0445])),))
    done = run_struck(pipeline, nowhere, replace(ONE, max_removals=None))
    assert done.result.end is RunEnd.CLEARED
    assert (done.result.faults, done.result.attempts) == ((), ())
    simulated = Simulated(done.result, done.fake.truth(), (), is_latched=False)
    assert "nothing was taken: nothing lies in the way" in _summary(simulated)
    assert_within_limits(done)


def test_a_drop_off_in_the_pile_ends_the_run_before_anything_is_touched(
    pipeline, monkeypatch
):
    trust_the_camera(monkeypatch)
    (beam,) = one_beam().bodies
    # It lies in the way, and its end where things are to be put down.
    across = SE3.from_parts(beam.T_base_body.R, [0.8, -0.55, 0.0445])
    settings = replace(ONE, drop_off={"right": (0.7, -0.7), "left": (0.25, 0.75)})
    done = run_struck(pipeline, World((beam.at(across),)), settings)
    (fault,) = done.result.faults
    assert (fault.state, fault.fault) == (State.SEGMENT, "plan_collision")
    assert "lies in the pile" in fault.message
    assert "Give a place beside the pile" in fault.message
    assert done.result.end is RunEnd.ABORTED
    assert done.fake.truth().world.bodies[0].T_base_body.p == pytest.approx(across.p)


@pytest.mark.parametrize("state", [State.SELF_TEST, State.PREGRASP, State.LIFT])
def test_joints_that_are_no_numbers_stop_the_robot(pipeline, beam, monkeypatch, state):
    trust_the_camera(monkeypatch)

    def blind(robot, record):
        arm = robot.limbs["right"].arm

        def read():
            now = [e["state"] for e in record.events if e["event"] == "state"]
            reading = arm.read()
            if state.value not in now:
                return reading
            return reading._replace(q=np.full(len(reading.q), np.nan))

        return with_limb(robot, "arm", read=read)

    done = run_struck(pipeline, beam, ONE, change=blind)
    assert done.result.end is RunEnd.STOPPED
    assert done.result.faults[0].state is state
    found = {fault.fault for fault in done.result.faults}
    assert found == {"encoder_jump"}, done.result.faults[0].message
    assert all(arm.is_stopped for arm in done.fake.arms.values())
    assert_within_limits(done)


@pytest.mark.parametrize("lie", [lying_limits, limits_in_degrees])
def test_limits_that_are_said_to_be_wider_than_they_are_are_not_made_use_of(
    pipeline, beam, lie
):
    done = run_struck(
        pipeline,
        beam,
        ONE,
        ends_after=FAULTS,
        change=lambda robot, record: ended_at(State.CAPTURE, lie(robot), record),
    )
    assert done.result.end is RunEnd.INTERRUPTED
    assert done.result.faults == ()
    assert_within_limits(done)


def ended_at(state, robot, record):
    """The same robot; but as a state begins, a person ends the run."""
    arm = robot.limbs["right"].arm

    def read():
        if record.events and record.events[-1].get("state") == state.value:
            raise KeyboardInterrupt
        return arm.read()

    return with_limb(robot, "arm", read=read)


@pytest.mark.parametrize(
    ("device", "state"),
    [("arm", "calib_check"), ("sensor", "calib_check"), ("gripper", "pregrasp")],
)
def test_a_device_that_is_gone_for_good_stops_the_robot(
    pipeline, beam, monkeypatch, device, state
):
    if state != "calib_check":
        trust_the_camera(monkeypatch)

    def gone(robot, record):
        here = getattr(robot.limbs["right"], device)

        def read():
            if any(event.get("state") == state for event in record.events):
                raise DriverError(device, "no answer")
            return here.read()

        return with_limb(robot, device, read=read)

    done = run_struck(pipeline, beam, ONE, change=gone)
    assert done.result.end is RunEnd.STOPPED
    assert {fault.fault for fault in done.result.faults} == {"connection_lost"}
    assert all(arm.is_stopped for arm in done.fake.arms.values())
    assert_within_limits(done)


@pytest.mark.parametrize(
    ("broken", "words"),
    [
        (worded_joints, "sends nonsense: its arm: reads"),
        (silent_joints, "sends nonsense: its arm: reads None without q"),
        (worded_wrench, "sends nonsense: its force sensor: reads"),
        (worded_fingers, "sends nonsense: its gripper's forces: reads"),
        (silent_fingers, "its gripper's openings: reads None without openings"),
        (fewer_fingers, "its gripper's openings: reads 1 values; 3 are needed"),
        (millimetre_fingers, "sends nonsense: opening 1[0-9.]+; metres, not"),
        (numberless_fingers, r"sends nonsense: openings read \[nan, nan, nan\]"),
        (shares_of_fingers, r"sends nonsense: opening [0-9.]+ of a hand that opens"),
        (no_limits, "sends nonsense: its arm's limits are None"),
    ],
)
def test_a_driver_that_sends_nonsense_is_named_before_anything_moves(
    pipeline, beam, broken, words
):
    done = run_struck(pipeline, beam, ONE, change=lambda robot, _: broken(robot))
    fault = done.result.faults[0]
    assert fault.state is State.SELF_TEST
    assert fault.fault_class is FaultClass.DRIVER
    assert re.search(f"the right arm .*{words}", fault.message)
    assert done.fake.truth().peak_force == dict.fromkeys(("left", "right"), 0.0)
    assert done.result.end in (RunEnd.ABORTED, RunEnd.STOPPED)


@pytest.mark.parametrize(
    ("device", "answer", "state", "words"),
    [
        ("arm", None, State.CALIB_CHECK, "its arm: reads None without q"),
        ("arm", {"q": ("a",) * 8}, State.LIFT, "its arm: reads"),
        ("sensor", None, State.PREGRASP, "its force sensor: reads None"),
        ("sensor", {"wrench_ft": ("x",) * 6}, State.LIFT, "its force sensor: reads"),
        ("gripper", None, State.LIFT, "its gripper's openings: reads None"),
        ("gripper", {"forces": None}, State.CLOSE, "its gripper's forces: reads None"),
        ("sensor", ValueError("bug"), State.PREGRASP, "it raises ValueError: bug"),
    ],
)
def test_a_driver_that_begins_to_send_nonsense_is_named_and_no_error_of_ours(
    pipeline, beam, monkeypatch, device, answer, state, words
):
    if state is not State.CALIB_CHECK:
        trust_the_camera(monkeypatch)

    def broken(robot, record):
        here = getattr(robot.limbs["right"], device)

        def read():
            reading = here.read()
            if not any(event.get("state") == state.value for event in record.events):
                return reading
            if isinstance(answer, Exception):
                raise answer
            return reading._replace(**answer) if answer else None

        return with_limb(robot, device, read=read)

    done = run_struck(pipeline, beam, ONE, change=broken)
    found = {fault.fault for fault in done.result.faults}
    assert "software_error" not in found, done.result.faults[0].message
    fault = next(f for f in done.result.faults if f.fault == "connection_lost")
    assert "right arm" in fault.message
    assert words in fault.message
    assert done.result.end is RunEnd.STOPPED
    assert all(arm.is_stopped for arm in done.fake.arms.values())
    assert_within_limits(done)


class Raising(Changed):
    """A device of somebody's own, of which some members raise."""

    def __init__(self, device, *names, error) -> None:
        super().__init__(device, **dict.fromkeys(names, self._fail))
        self._error = error

    def _fail(self, *_args):
        raise self._error


@pytest.mark.parametrize(
    ("device", "member", "words"),
    [
        ("arm", "engage", "driver of the right arm raises OSError: no bus"),
        ("gripper", "preshape", "driver of the gripper of the right arm raises"),
        ("camera", "capture", "the driver of the camera raises OSError: no bus"),
    ],
)
def test_what_a_driver_raises_is_its_own_and_no_error_of_ours(
    pipeline, beam, device, member, words
):
    def broken(robot, _):
        error = OSError("no bus")
        if device == "camera":
            return replace(robot, camera=Raising(robot.camera, member, error=error))
        limb = robot.limbs["right"]
        limb = replace(
            limb, **{device: Raising(getattr(limb, device), member, error=error)}
        )
        return replace(robot, limbs={**robot.limbs, "right": limb})

    done = run_struck(pipeline, beam, ONE, change=broken)
    assert {fault.fault for fault in done.result.faults} == {"connection_lost"}
    assert words in done.result.faults[0].message
    assert done.result.end in (RunEnd.ABORTED, RunEnd.STOPPED)
    assert_within_limits(done)


def test_an_arm_that_can_not_tell_the_time_moves_nothing(pipeline, beam):
    done = run_struck(pipeline, beam, ONE, change=lambda robot, _: no_time(robot))
    fault = done.result.faults[0]
    assert (fault.state, fault.fault) == (State.SELF_TEST, "connection_lost")
    assert "the right arm measures at nan s" in fault.message
    assert done.fake.truth().peak_force == dict.fromkeys(("left", "right"), 0.0)


def test_a_wrist_beyond_all_numbers_is_no_finger(pipeline, beam):
    def broken(robot, _):
        sensor = robot.limbs["right"].sensor
        return with_limb(
            robot,
            "sensor",
            read=lambda: sensor.read()._replace(wrench_ft=(np.inf,) * 6),
        )

    done = run_struck(pipeline, beam, ONE, change=broken)
    assert {fault.fault for fault in done.result.faults} == {"wrench_nan"}
    assert done.result.end is RunEnd.STOPPED


def test_a_loop_that_often_comes_late_is_told(pipeline, beam, caplog):
    def broken(robot, _):
        clock, rng = robot.clock, np.random.default_rng(0)

        def wait_until(time):
            clock.wait_until(time + 0.008 * (rng.random() < 0.1))

        robot = replace(robot, clock=Changed(clock, wait_until=wait_until))
        return forces_only(robot)  # which ends it after the looks

    done = run_struck(pipeline, beam, ONE, change=broken)
    assert done.result.faults[0].fault == "wrench_frozen"
    assert re.search(r"\d+ % of the ticks come late by more than half", caplog.text)


def test_a_wrist_that_is_mounted_otherwise_touches_nothing(pipeline, beam):
    done = run_struck(pipeline, beam, ONE, change=lambda robot, _: turned_wrench(robot))
    fault = done.result.faults[0]
    assert (fault.state, fault.fault) == (State.SELF_TEST, "baseline_contact")
    assert "the sensor is turned otherwise than LoadModel.T_ee_ft" in fault.message
    assert done.fake.truth().peak_force["right"] == 0.0


def test_a_wrist_that_feels_no_torque_touches_nothing(pipeline, beam):
    done = run_struck(pipeline, beam, ONE, change=lambda robot, _: forces_only(robot))
    fault = done.result.faults[0]
    assert (fault.state, fault.fault) == (State.SELF_TEST, "wrench_frozen")
    assert "its torques are [0.0, 0.0, 0.0]" in fault.message
    assert done.fake.truth().peak_force["right"] == 0.0
    assert done.result.n_removed == 0


def test_a_mark_of_no_yes_and_no_is_refused(pipeline, beam, monkeypatch):
    trust_the_camera(monkeypatch)
    task = replace(ONE, mark=lambda taken: np.full(taken.depth.shape, np.nan))
    done = run_struck(pipeline, beam, task)
    assert (
        "mark of the task: got a mask of type float64" in done.result.faults[0].message
    )
    assert done.result.n_removed == 0


def test_a_head_that_sends_nonsense_is_named(pipeline, beam):
    def broken(robot, _record):
        return replace(robot, head=Changed(robot.head, read=lambda: None))

    done = run_struck(pipeline, beam, ONE, change=broken)
    found = {(fault.fault, fault.message) for fault in done.result.faults}
    words = "the driver of the head sends nonsense: reads None without q"
    assert found == {("connection_lost", words)}
    assert done.result.end is RunEnd.STOPPED


@pytest.mark.parametrize("depth", [0.0, np.nan, np.inf, -1.0])
def test_a_camera_that_is_dark_from_the_start_is_an_empty_image(pipeline, beam, depth):
    def dark(robot, _record):
        frame = robot.camera.capture()

        def capture():
            covered = np.full(np.shape(frame.depth), depth)
            return replace(robot.camera.capture(), depth=covered)

        return replace(robot, camera=Changed(robot.camera, capture=capture))

    done = run_struck(pipeline, beam, ONE, change=dark)
    assert {fault.fault for fault in done.result.faults} == {"empty_cloud"}
    assert done.result.fault_class is FaultClass.PERCEPTION
    assert done.result.end is RunEnd.ABORTED


@pytest.mark.parametrize(
    ("depth", "words"),
    [
        (None, "gives None without time, depth"),
        (np.full((180, 320), 1310.0), "depth up to 1310; metres, not millimetres?"),
        (np.full((180, 320), 1310, dtype=np.uint16), "not millimetres?"),
        (np.ones((50, 320)), "depth of (50, 320), intrinsics of (180, 320)"),
        (np.zeros((0, 0)), r"shape (0, 0)"),
        (np.full((4, 4), "far"), "type <U3"),
        ([[1.0], [1.0, 2.0]], "shape (0,)"),
    ],
)
def test_a_camera_that_sends_no_image_is_named(pipeline, beam, depth, words):
    def broken(robot, _record):
        frame = robot.camera.capture()
        given = None if depth is None else replace_depth(frame, depth)
        return replace(robot, camera=Changed(robot.camera, capture=lambda: given))

    done = run_struck(pipeline, beam, replace(ONE, max_attempts=1), change=broken)
    fault = done.result.faults[-1]
    assert fault.fault_class is FaultClass.DRIVER
    assert fault.message.startswith("camera: gives")
    assert words in fault.message


def replace_depth(frame, depth):
    named = {name: getattr(frame, name) for name in frame.__slots__}
    return SimpleNamespace(**{**named, "depth": depth})
