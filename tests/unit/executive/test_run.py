"""The executive itself: always an end, always one class, never a raised exception."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from debrisgrasp.control import FaultClass
from debrisgrasp.errors import DriverError, InputError, UnknownNameError
from debrisgrasp.executive import (
    STAGES,
    Action,
    Executive,
    RunEnd,
    State,
    TaskSettings,
)
from debrisgrasp.executive import run as module
from debrisgrasp.executive.drive import Drive
from debrisgrasp.executive.gaze import look_of, turn_head
from debrisgrasp.executive.guarded import nonsense
from debrisgrasp.executive.noticed import misplaced
from debrisgrasp.executive.prepare import _turn, self_test
from debrisgrasp.executive.recover import recover
from debrisgrasp.executive.result import Done, FaultFound
from debrisgrasp.io import data_path
from debrisgrasp.kinematics import RobotModel
from tests.unit.executive.rigs import PERIOD, POINTS, brick_at, holding, task_before
from tests.unit.executive.stepped import choose, failing
from tests.unit.robot.broken_robots import with_limb


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
    ("settings", "words"),
    [
        (TaskSettings(rest="nowhere"), "unknown posture.*nowhere"),
        (TaskSettings(look={"neck": 0.1}), "unknown joint.*neck"),
        (TaskSettings(look={"torso_joint": 0.1}), "joint of the head in look.*torso"),
        (TaskSettings(look={"ptu_pan_joint": float("nan")}), "ptu_pan_joint.*number"),
        (
            TaskSettings(look={"ptu_pan_joint": 50.0}),
            "ptu_pan_joint: got 50.0.*radians",
        ),
    ],
    ids=("rest", "joint", "trunk", "nan", "degrees"),
)
def test_a_rest_or_a_look_that_the_robot_lacks_is_refused(
    fake, pipeline, settings, words
):
    with pytest.raises((InputError, UnknownNameError), match=words):
        Executive(fake.robot, settings, pipeline=pipeline, rng=np.random.default_rng(0))


@pytest.mark.parametrize("names", [None, ("a",) * 8, 8])
def test_a_driver_that_names_other_joints_than_the_model_is_refused(
    fake, pipeline, names
):
    robot = with_limb(fake.robot, "arm", joint_names=names)
    with pytest.raises(InputError, match="joint_names of the right arm"):
        Executive(robot, pipeline=pipeline, rng=np.random.default_rng(0))


def test_a_sensor_that_can_not_feel_the_limits_is_refused(fake, pipeline):
    limb = fake.robot.limbs["right"]
    loads = replace(limb.loads, sensor_range=(100.0, 60.0))
    limbs = {**fake.robot.limbs, "right": replace(limb, loads=loads)}
    robot = replace(fake.robot, limbs=limbs)
    with pytest.raises(InputError, match="got 150, expected below 98: the sensor ends"):
        Executive(robot, pipeline=pipeline, rng=np.random.default_rng(0))


def test_a_base_above_the_ground_is_refused(fake, pipeline, tmp_path):
    file = data_path("robots", "roman.yaml")
    high = "frames: {high: {parent: base_link, position: [0, 0, 0.8]}}"
    text = file.read_text("utf-8").replace("base: base_link", f"base: high\n{high}")
    text = text.replace("urdf: roman.urdf", f"urdf: {file.with_name('roman.urdf')}")
    (tmp_path / "roman.yaml").write_text(text, "utf-8")
    model = RobotModel.load(tmp_path / "roman.yaml")
    robot = replace(fake.robot, model=model)
    words = "base of roman.*above .* of the right arm at rest .'travel'.*on the ground"
    with pytest.raises(InputError, match=words):
        Executive(robot, pipeline=pipeline, rng=np.random.default_rng(0))


@pytest.mark.parametrize(
    ("high", "words"),
    [
        (-0.7, "camera of roman: got low, 1.40 m below the ground.*`frames`"),
        (15.0, "camera of roman: got a coordinate of 30.*millimetres"),
    ],
)
def test_a_camera_that_can_not_be_there_is_refused(
    fake, pipeline, tmp_path, high, words
):
    content = yaml.safe_load(data_path("robots", "roman.yaml").read_text("utf-8"))
    place = {"position": [0.0, 0.0, high]}
    content["frames"] = {
        "stand": {"parent": "base_link"} | place,
        "low": {"parent": "stand"} | place,
    }
    content |= {"camera": "low", "urdf": str(data_path("robots", "roman.urdf"))}
    (tmp_path / "roman.yaml").write_text(yaml.safe_dump(content), "utf-8")
    robot = replace(fake.robot, model=RobotModel.load(tmp_path / "roman.yaml"))
    with pytest.raises(InputError, match=words):
        Executive(robot, pipeline=pipeline, rng=np.random.default_rng(0))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (TaskSettings(lift=2.0), "TaskSettings.lift: got 2 m, .* right arm .*lower it"),
        (
            TaskSettings(workspace=((3.5, -0.6, -0.1), (4.0, 0.6, 1.3))),
            "TaskSettings.lift: got 0.15 m, .* right arm .*At none below",
        ),
        (TaskSettings(drop_height=1.0), "1.2 m above .* lower drop_height.* is 1 m"),
    ],
)
def test_a_height_beyond_the_arm_is_refused_by_its_name(
    fake, pipeline, settings, words
):
    with pytest.raises(InputError, match=words):
        Executive(fake.robot, settings, pipeline=pipeline, rng=np.random.default_rng(0))


def test_a_wrist_that_can_not_be_turned_says_what_is_in_the_way(fake, pipeline):
    task = Executive(fake.robot, pipeline=pipeline, rng=np.random.default_rng(0))
    limb = task.context.limbs["right"]
    hand = limb.pose(task.context.posture(limb)).p
    task.context.memory.settled.append(hand + POINTS)
    found = _turn(task.context, limb)
    assert isinstance(found, FaultFound)
    assert "no free turn of the wrist" in found.message
    assert "touches" in found.message


def test_a_robot_without_a_camera_is_refused(fake, pipeline):
    robot = replace(fake.robot, camera=None)
    with pytest.raises(InputError, match="camera of the robot: got none"):
        Executive(robot, pipeline=pipeline, rng=np.random.default_rng(0))


@pytest.mark.parametrize("other", ["none", "a_second"])
def test_a_pipeline_that_plans_for_another_robot_is_refused(fake, pipeline, other):
    robot = None if other == "none" else replace(pipeline.robot, name=other)
    stranger = copy(pipeline)
    stranger.robot = robot
    with pytest.raises(InputError, match=r"pipeline of the task.*expected one for rom"):
        Executive(fake.robot, pipeline=stranger, rng=np.random.default_rng(0))


def test_a_hand_that_is_not_the_one_of_the_model_is_refused(fake, pipeline):
    limb = fake.robot.limbs["right"]
    other = replace(limb, gripper=SimpleNamespace(name="camhand"))
    robot = replace(fake.robot, limbs={**fake.robot.limbs, "right": other})
    with pytest.raises(InputError, match=r"right arm.*'camhand'.*'robotiq_3f'"):
        Executive(robot, pipeline=pipeline, rng=np.random.default_rng(0))


def test_what_the_robot_may_drive_back_to_is_no_drop_off(fake, pipeline):
    settings = TaskSettings(arms=("right",), drop_off={"right": (-0.8, 0.0)})
    with pytest.raises(InputError, match="where the robot may drive back to"):
        Executive(fake.robot, settings, pipeline=pipeline, rng=np.random.default_rng(0))


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


@pytest.mark.parametrize("fault", ["plan_collision", "object_swings"])
def test_what_slips_as_the_hand_goes_on_with_it_is_put_down(run, monkeypatch, fault):
    answers, touches = [], failing(fault, 1)

    def touching(context):
        context.held = holding()
        return touches(context)

    def slipping(context, _event, answer):
        answers.append(answer)
        if not answer.is_cleared_up:
            return FaultFound("slip", "as asked")
        context.held = None
        return Done()

    monkeypatch.setattr(module, "recover", slipping)
    result, record = run({State.TRANSPORT: touching}, TaskSettings(max_removals=1))
    first, second = answers
    assert first.resume in (State.LIFT, State.TRANSPORT)
    assert second == replace(
        first, action=Action.RETRY, is_cleared_up=True, resume=State.CAPTURE
    )
    assert [event.fault for event in result.faults] == [fault, "slip"]
    assert not result.attempts[0].is_removed
    (resumed,) = [e["resume"] for e in record.events if e["event"] == "recovered"]
    assert resumed == "capture"
    assert result.end is RunEnd.FINISHED


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


@pytest.mark.parametrize(
    ("state", "fault", "n"),
    [(State.APPROACH, "early_contact", 5), (State.PLAN_GRASP, "no_grasp", 15)],
)
def test_a_run_without_progress_ends(run, state, fault, n):
    result, _ = run({state: failing(fault)}, TaskSettings(max_attempts=5))
    assert result.end is RunEnd.LEFT
    assert result.fault_class is FaultClass.PLANNING
    assert len(result.attempts) == n
    assert sum(attempt.has_set_out for attempt in result.attempts) in (0, n)


def test_a_last_look_tells_that_the_last_try_allowed_cleared_the_way(run):
    looks = []

    def select(context):
        looks.append(context.n_removed)
        if context.n_removed == 2:
            return Done({"cleared": True}, State.CLEARED)
        return choose(context)

    result, _ = run({State.SELECT: select}, TaskSettings(max_attempts=2))
    assert looks == [0, 1, 2]
    assert result.end is RunEnd.CLEARED
    assert len(result.attempts) == 2


def test_arms_that_the_robot_has_not_are_refused(fake, pipeline):
    with pytest.raises(UnknownNameError, match="left"):
        Executive(
            fake.robot,
            TaskSettings(arms=("middle",)),
            pipeline=pipeline,
            rng=np.random.default_rng(0),
        )


@pytest.mark.parametrize("said", [("ptu_pan_joint", "tilt"), ("tilt",), None])
def test_joints_of_a_head_that_the_model_has_not_are_refused(fake, pipeline, said):
    robot = replace(fake.robot, head=SimpleNamespace(joint_names=said))
    with pytest.raises(UnknownNameError, match="unknown joint of the head"):
        Executive(robot, pipeline=pipeline, rng=np.random.default_rng(0))


def test_a_robot_without_arms_is_refused(fake, pipeline):
    robot = replace(fake.robot, limbs={})
    with pytest.raises(InputError, match="expected one or more of right, left"):
        Executive(robot, pipeline=pipeline, rng=np.random.default_rng(0))


def test_an_arm_without_a_drop_off_is_refused(fake, pipeline):
    settings = TaskSettings(drop_off={"right": (0.2, -0.7)})
    with pytest.raises(
        InputError, match="drop-off of the left arm: got places of right"
    ):
        Executive(fake.robot, settings, pipeline=pipeline, rng=np.random.default_rng(0))


def test_a_drop_off_where_the_robot_stands_is_refused(fake, pipeline):
    settings = TaskSettings(drop_off={"right": (0.1, -0.25), "left": (0.25, 0.75)})
    with pytest.raises(InputError, match="where the robot stands"):
        Executive(fake.robot, settings, pipeline=pipeline, rng=np.random.default_rng(0))


def test_a_camera_on_a_hand_is_refused(fake, pipeline):
    robot = fake.robot
    on_hand = replace(robot.model, camera=robot.model.arm("right").tip)
    with pytest.raises(InputError, match="which the right arm carries"):
        Executive(
            replace(robot, model=on_hand),
            TaskSettings(),
            pipeline=pipeline,
            rng=np.random.default_rng(0),
        )


LEFT, RIGHT = TaskSettings().drop_off["left"], TaskSettings().drop_off["right"]


@pytest.mark.parametrize(
    "places",
    [
        {"left": RIGHT, "right": LEFT},
        {"left": LEFT, "right": LEFT},
        {"left": RIGHT, "right": RIGHT},
    ],
)
def test_a_drop_off_beside_the_other_arm_is_refused(fake, pipeline, places):
    with pytest.raises(InputError, match="a place on the side of the"):
        Executive(
            fake.robot,
            TaskSettings(drop_off=places),
            pipeline=pipeline,
            rng=np.random.default_rng(0),
        )


def test_a_drop_off_out_of_reach_is_refused_with_the_place(fake, pipeline):
    settings = TaskSettings(drop_off={"right": (-2.0, -2.0), "left": (0.25, 0.75)})
    with pytest.raises(InputError, match=r"right arm: got \(-2, -2\)"):
        Executive(fake.robot, settings, pipeline=pipeline, rng=np.random.default_rng(0))


def test_every_state_is_recorded(run):
    _, record = run({})
    states = [e["state"] for e in record.events if e["event"] == "state"]
    assert states[: len(STAGES)] == [state.value for state in STAGES]


@pytest.mark.parametrize("n_touches", [2, 3])
def test_a_hand_that_met_something_before_the_camera_is_checked_again_or_left_out(
    run, n_touches
):
    touches = iter([FaultFound("plan_collision", "touched", "right")] * n_touches)
    settings = TaskSettings(max_removals=1)
    result, _ = run({State.CALIB_CHECK: lambda _c: next(touches, Done())}, settings)
    assert result.end is RunEnd.FINISHED
    actions = [Action.RETRY, Action.RETRY, Action.NEXT]
    assert [fault.action for fault in result.faults] == actions[:n_touches]


def test_joints_that_may_be_told_in_degrees_are_asked_about(fake):
    limits = fake.robot.model.limits("right").controller
    for scale, is_asked in ((np.rad2deg(1.0), True), (1.0, False)):
        found = misplaced(scale * (limits.upper + 0.1), limits, "right")
        assert found.fault == "start_outside_limits"
        assert ("not degrees or millimetres" in found.message) == is_asked


def test_an_executive_that_ran_is_not_run_again(fake, pipeline, run):
    """It would count what was removed before, and take the base for where it was."""
    run({})  # replaces the steps
    settings, rng = TaskSettings(max_removals=1), np.random.default_rng(0)
    executive = Executive(fake.robot, settings, pipeline=pipeline, rng=rng)
    assert executive.run().n_removed == 1
    with pytest.raises(InputError, match="Make another Executive"):
        executive.run()


def test_a_zero_that_is_configured_is_as_sure_as_when_the_run_began(run, fake):
    """Days after the clock began its drift would be taken off all limits."""
    fake.robot.clock.wait_until(40.0)
    since = []

    def begin(context):
        since.append(Drive(context, "right").supervised()[0].baseline_time)
        return Done()

    run({State.SELF_TEST: begin})
    assert since == [pytest.approx(40.0, abs=0.02)]


def test_a_run_lasts_from_its_begin_whatever_the_clock_said(run, fake):
    fake.robot.clock.wait_until(40.0)
    result, record = run({State.CAPTURE: lambda context: context.wait(0.5) or Done()})
    assert result.duration == pytest.approx(1.0, abs=0.02)
    assert record.events[-1]["time"] == pytest.approx(41.0, abs=0.02)


@pytest.mark.parametrize("said", [None, (0.0, 0.0, 0.0), np.eye(4)])
def test_a_base_that_tells_no_pose_is_named_before_anything_moves(
    fake, pipeline, monkeypatch, said
):
    monkeypatch.setattr(fake.base, "read", lambda: said)
    rng = np.random.default_rng(0)
    found = nonsense(Executive(fake.robot, pipeline=pipeline, rng=rng).context)
    assert found.fault == "connection_lost"
    assert found.message.startswith("the driver of the base sends nonsense: reads ")


def test_an_arm_that_is_not_used_is_planned_around_where_it_stands(pipeline):
    settings = TaskSettings(period=PERIOD, arms=("right",))
    brick, aside = brick_at(1.0), {"left": "ready"}
    fake, task = task_before(pipeline, brick, settings=settings, start=aside)
    before = fake.arms["left"].read().q
    assert isinstance(self_test(task.context), Done)
    assert fake.arms["left"].read().q == before
    robots = [task.context.limbs["right"].reach.robot]
    robots += [arm.robot for arm in task.context.pipeline.arms]
    stands = pipeline.robot.posture("left", "ready")
    for robot in robots:
        values = robot.joint_values()
        own = {k: v for k, v in stands.items() if k not in robot.arm("right").joints}
        assert {k: values[k] for k in own} == pytest.approx(own, abs=1e-3)


def test_an_arm_that_is_not_used_must_stay_where_it_is_planned_around(
    pipeline, monkeypatch
):
    settings = TaskSettings(period=PERIOD, arms=("right",))
    fake, task = task_before(pipeline, brick_at(1.0), settings=settings)
    left, before = fake.arms["left"], fake.arms["right"].read().q
    told = left.read()
    aside = told._replace(q=(told.q[0], told.q[1] + 0.1, *told.q[2:]))
    monkeypatch.setattr(left, "read", lambda: aside)
    found = self_test(task.context)
    assert (found.fault, found.arm) == ("plan_collision", "left")
    assert "left_arm_joint1 of the left arm, which is not used, is at" in found.message
    assert fake.arms["right"].read().q == before


@pytest.mark.parametrize("q", [None, (np.nan,) * 8, (0.1,)])
def test_an_unused_arm_that_cannot_tell_where_it_stands_is_left_to_the_self_test(
    fake, pipeline, monkeypatch, q
):
    left = fake.robot.limbs["left"].arm
    odd = left.read()._replace(q=q)
    monkeypatch.setattr(left, "read", lambda: odd)
    settings = TaskSettings(period=PERIOD, arms=("right",))
    rng = np.random.default_rng(0)
    task = Executive(fake.robot, settings, pipeline=pipeline, rng=rng)
    assert task.context.pipeline is pipeline
    found = self_test(task.context)
    assert found.arm == "left"
    assert found.fault in ("connection_lost", "encoder_jump")


def test_an_arm_is_planned_around_the_other_where_that_rests(fake, pipeline):
    settings, rng = TaskSettings(rest="ready"), np.random.default_rng(0)
    context = Executive(fake.robot, settings, rng=rng).context
    for name, other in (("right", "left"), ("left", "right")):
        rest = pipeline.robot.posture(other, "ready")
        robots = [context.limbs[name].reach.robot]
        robots += [arm.robot for arm in context.pipeline.arms if arm.name == name]
        for robot in robots:
            values = robot.joint_values()
            assert {joint: values[joint] for joint in rest} == rest


def test_a_look_to_a_side_stays_as_low_as_at_rest(fake, pipeline):
    settings, rng = TaskSettings(look={"ptu_pan_joint": 0.2}), np.random.default_rng(0)
    context = Executive(fake.robot, settings, pipeline=pipeline, rng=rng).context
    turn_head(context, look_of(context))
    pan, tilt = fake.robot.head.read().q
    assert (pan, tilt) == pytest.approx((0.2, pipeline.robot.rest["ptu_tilt_joint"]))
