"""Single steps on the robot in memory: the look at the own hand, and the drag."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.control import (
    ContactGuard,
    FingerReading,
    GripConfig,
    GripController,
    GripPhase,
    LegOutcome,
)
from debrisgrasp.errors import DriverError
from debrisgrasp.executive import Executive, TaskSettings
from debrisgrasp.executive.calibrated import calib_check
from debrisgrasp.executive.context import Held
from debrisgrasp.executive.drag import _Pull, drag, drive_back
from debrisgrasp.executive.drive import Drive, LegEnd
from debrisgrasp.executive.faults import Action
from debrisgrasp.executive.fingers import open_hand
from debrisgrasp.executive.moves import (
    _inside,
    planned,
    reversed_motion,
)
from debrisgrasp.executive.obstacles import space_of
from debrisgrasp.executive.perceive import capture, segment
from debrisgrasp.executive.recover import _moved_inside
from debrisgrasp.executive.releasing import release
from debrisgrasp.executive.reposition import repositioned
from debrisgrasp.executive.result import Done, FaultFound
from debrisgrasp.executive.states import State
from debrisgrasp.executive.table import answer_to
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.kinematics import Trajectory
from debrisgrasp.motion import UnknownSpace
from debrisgrasp.pipeline import Pipeline
from debrisgrasp.robot import FakeConfig, fake_robot
from debrisgrasp.worlds import World, make_body
from tests.unit.robot.rigs import CHAINS, posture


@pytest.fixture(scope="module")
def pipeline():
    return Pipeline()


def executive(pipeline, *bodies, **config):
    sizes = {"length": 0.2, "width": 0.1, "height": 0.06}
    brick = make_body("brick", sizes, 2.0).at(SE3.from_parts(p=[1.3, 0.0, 0.03]))
    fake = fake_robot(
        pipeline.robot,
        World((brick, *bodies)),
        rng=np.random.default_rng(0),
        config=FakeConfig(is_initialised=True, **config),
    )
    return fake, Executive(
        fake.robot,
        TaskSettings(),
        pipeline=pipeline,
        rng=np.random.default_rng(0),
    )


def test_a_camera_where_it_should_be_passes(pipeline):
    fake, task = executive(pipeline)
    found = calib_check(task.context)
    assert isinstance(found, Done)
    assert found.facts["hand_seen"]
    assert np.linalg.norm(found.facts["shift_mm"]) < 10.0
    assert found.facts["camera"] == "steady"
    # The next check judges its looks together with these.
    assert isinstance(calib_check(task.context), Done)
    assert len(task.context.camera_watch.looks) == 4
    assert fake.truth().violations == ()


def test_a_camera_that_is_off_by_five_centimetres_is_found_out(pipeline):
    error = SE3.from_parts(p=[0.05, 0.0, 0.0])
    _, task = executive(pipeline, calibration_error=error)
    found = calib_check(task.context)
    assert isinstance(found, FaultFound)
    assert found.fault == "calibration_off"
    assert 0.04 < found.values["shift"] < 0.06
    assert "the mount of the camera" in found.message
    assert len(task.context.camera_watch.looks) == 2


def test_a_base_that_drags_comes_back_to_where_it_was(pipeline, monkeypatch):
    fake, task = executive(pipeline)
    context = task.context
    context.state = State.LIFT
    config = GripConfig(opening=0.1, width=0.05, sides=(-1, 1, 1))
    grip = GripController(config)
    context.held = Held(
        arm="right",
        grip=grip,
        watch=grip,
        state=grip.preshape(),
        is_watched=False,
    )
    found = drag(context)
    assert isinstance(found, Done)
    assert found.next is State.RELEASE
    assert np.linalg.norm(context.dragged.p) > 0.4
    limb = context.limbs["right"]
    there = context.dragged @ limb.pose(context.posture(limb))
    monkeypatch.setattr("debrisgrasp.executive.releasing.put_down", lambda *_: None)
    # Where that is once the base is back.
    assert release(context).facts["place"] == pytest.approx(there.p, abs=2e-3)
    assert drive_back(context) is None
    assert np.linalg.norm(fake.base.T_odom_base.p) < 0.1
    assert fake.truth().violations == ()


def test_a_base_stops_when_an_arm_that_drags_answers_no_more(pipeline, monkeypatch):
    fake, task = executive(pipeline)
    context, base = task.context, fake.robot.base
    context.state = State.LIFT
    grip = GripController(GripConfig(opening=0.1, width=0.05, sides=(-1, 1, 1)))
    context.held = Held(
        arm="right", grip=grip, watch=grip, state=grip.preshape(), is_watched=False
    )
    read, end = Drive.read, context.now() + 2.0

    def silent(self):
        if context.now() > end:
            raise DriverError("arm", "no answer")
        return read(self)

    monkeypatch.setattr(Drive, "read", silent)
    with pytest.raises(DriverError):
        drag(context)
    gone = np.linalg.norm(context.dragged.p)
    assert gone > 0.02
    context.wait(3.0)
    assert np.linalg.norm(base.read().p) < gone + 0.01


def test_the_load_is_judged_until_the_arm_has_come_to_rest(pipeline, monkeypatch):
    _, task = executive(pipeline)
    context, judged = task.context, []
    touched = context.now() + 1.0
    monkeypatch.setattr(
        ContactGuard, "is_touched", lambda *_: bool(context.now() > touched)
    )
    end = Drive(context, "right").leg(
        [0.0, 0.0, 0.05],
        speed=0.01,
        guard=ContactGuard(),
        until=lambda _: judged.append(context.now()),
    )
    assert end.outcome is LegOutcome.CONTACT
    assert judged[-1] == context.now()


@pytest.mark.parametrize("force", [20.0, 60.0])
def test_a_base_that_pulls_too_hard_stops_before_the_arm_has_come_to_rest(
    pipeline, force
):
    fake, task = executive(pipeline)
    context, base = task.context, fake.robot.base
    pull = _Pull(context, base, [(-0.03, 0.0, 10.0)], 50.0)
    assert not pull((0.0,) * 6)
    context.wait(0.5)
    assert pull((0.0, 0.0, force, 0.0, 0.0, 0.0)) is pull.is_too_much is (force > 50.0)
    before = base.read().p
    context.wait(0.1)
    gone = np.linalg.norm(base.read().p - before)
    assert gone < 1e-3 if force > 50.0 else gone > 2e-3


@pytest.mark.parametrize(
    ("openings", "forces", "state", "fault"),
    [
        ((0.05, 0.05, 0.05), (40.0, 20.0, 20.0), State.LIFT, None),
        ((0.05, 0.05, 0.05), (40.0, 20.0, 20.0), State.TRANSPORT, "plan_collision"),
        ((0.03, 0.03, 0.03), (40.0, 20.0, 20.0), State.TRANSPORT, "slip"),
        ((0.05, 0.05, 0.05), (0.0, 0.0, 0.0), State.LIFT, "slip"),
    ],
)
def test_weight_that_goes_while_fingers_stay_is_borne_by_something(
    pipeline, monkeypatch, openings, forces, state, fault
):
    _, task = executive(pipeline)
    context, drive = task.context, Drive(task.context, "right")
    sides = tuple(finger.side for finger in drive.limb.hand.fingers)
    grip = GripController(GripConfig(opening=0.1, width=0.05, sides=sides, period=0.04))
    before = FingerReading((0.05,) * 3, (40.0, 20.0, 20.0))
    held = grip.preshape()._replace(
        phase=GripPhase.HOLDING, held_openings=before.openings, most_carried=30.0
    )
    context.held = Held(arm="right", grip=grip, watch=grip, state=held, is_lifted=True)
    context.state = state
    monkeypatch.setattr(drive, "fingers", lambda: FingerReading(openings, forces))
    monkeypatch.setattr(drive, "carried", lambda _load: 10.0)
    found = [drive._watched_fingers((0.0,) * 6) for _ in range(3)]
    names = [f.fault for f in found if f is not None]
    assert names[:1] == ([] if fault is None else [fault])


def test_a_base_drives_to_where_the_arms_reach_and_takes_along_what_it_knows(pipeline):
    fake, task = executive(pipeline)
    context = task.context
    assert isinstance(capture(context), Done)
    assert isinstance(segment(context), Done)
    place, beside = np.array([1.3, 0.0, 0.05]), np.array([0.25, 0.75, 0.1])
    failed = FaultFound("unreachable", "no arm gets there")
    context.marks.add(place, failed, n_changes=0, is_search=True)
    context.dropped.append(beside[None])
    border = np.array([1.89, 0.0, 0.0])
    assert context.is_in_way(border)
    moved = repositioned(context, [place])
    assert moved == pytest.approx(0.35, abs=0.03)
    assert fake.base.T_odom_base.p[0] == pytest.approx(moved, abs=1e-6)
    shift = np.array([moved, 0.0, 0.0])
    assert context.marks.failures(place - shift) == 1
    assert not context.marks.why_left(place - shift, context.n_changes, tries=1)
    np.testing.assert_allclose(context.dropped[0][0], beside - shift, atol=1e-6)
    assert not context.is_in_way(border)
    assert context.is_in_way(border - shift)
    assert fake.truth().violations == ()


def test_a_base_tries_other_distances_and_goes_nowhere_twice(pipeline):
    fake, task = executive(pipeline)
    context = task.context
    place, stood = np.array([0.98, 0.0, 0.1]), [0.98]

    def moved():
        assert isinstance(capture(context), Done)
        assert isinstance(segment(context), Done)
        way = repositioned(context, [place])
        place[0] -= way
        stood.append(float(place[0]))
        return way

    assert moved() > 0.0
    assert moved() < 0.0
    assert np.allclose(stood[1:], [0.8, 1.1], atol=0.03)
    assert moved() == 0.0
    context.n_removed += 1  # with one less, another distance may do
    assert moved() != 0.0
    assert fake.truth().violations == ()


def test_a_base_stays_where_something_stands_before_it(pipeline):
    fake, task = executive(pipeline)
    context = task.context
    assert isinstance(capture(context), Done)
    assert isinstance(segment(context), Done)
    n = len(context.cycle.seen.cloud.points)
    context.fallen.append(np.tile([[0.5, 0.1, 0.2]], (n // 20, 1)))
    assert repositioned(context, [np.array([1.3, 0.0, 0.1])]) == 0.0
    assert np.linalg.norm(fake.base.T_odom_base.p) == 0.0


def test_a_motion_run_backwards_ends_where_it_began():
    one = Trajectory(
        joint_names=("a",),
        times=np.array([0.0, 1.0, 3.0]),
        q=np.array([[0.0], [0.4], [1.0]]),
        dq=np.array([[0.0], [0.4], [0.0]]),
        limits_hash="x",
    )
    back = reversed_motion(one)
    t = np.linspace(0.0, 3.0, 13)
    q, dq, _ = one.at(t)
    q_back, dq_back, _ = back.at(3.0 - t)
    assert np.allclose(q, q_back)
    assert np.allclose(dq, -dq_back)


def test_a_leg_begins_where_the_arm_was_sent_a_moment_ago(pipeline):
    fake, task = executive(pipeline)
    context = task.context
    drive = Drive(context, "right")
    context.wait(0.1)
    for _ in range(3):
        assert isinstance(drive.leg([0.0, 0.0, -0.02], speed=0.03), LegEnd)
    assert fake.truth().violations == ()


def test_a_joint_at_the_end_of_its_range_may_read_a_little_beyond_it(pipeline):
    _, task = executive(pipeline)
    drive = Drive(task.context, "right")
    reading = drive.read()
    q = np.array(reading.q)
    q[0] = drive.limits.upper[0] + 2e-6
    assert drive._stands_at(reading._replace(q=q))[0] == drive.limits.upper[0]
    q[0] += 0.1
    assert drive._stands_at(reading._replace(q=q))[0] == q[0]


def over_a_block(pipeline, height=0.2):
    """Right hand, open and looking down, over a block that nothing moves."""
    start = {"right": CHAINS["right"].named(posture("right", (0.8, -0.3, 0.5)))}
    sizes = {"length": 0.3, "width": 0.3, "height": height}
    block = make_body("brick", sizes, 500.0, name="block").at(
        SE3.from_parts(p=[0.8, -0.3, 0.5 * height])
    )
    fake, task = executive(pipeline, block, start=start)
    return fake, task, Drive(task.context, "right")


@pytest.mark.parametrize("speed", [0.03, 0.06])
def test_an_empty_hand_on_a_planned_way_stops_at_what_nobody_saw(pipeline, speed):
    fake, task, drive = over_a_block(pipeline)
    limb, bare = drive.limb, space_of(task.context, unknown=UnknownSpace.IGNORED)
    task.context.wait(0.1)
    limb.baseline_time = task.context.now()
    goal = SE3.from_parts(p=[0.0, 0.0, -0.3]) @ limb.pose(task.context.posture(limb))
    way = planned(task.context, limb, goal, bare).trajectory
    heights = limb.reach.chain.fk(way.at(np.linspace(0.0, way.duration, 200))[0]).p
    steps = np.linalg.norm(np.diff(heights, axis=0), axis=1)
    found = drive.follow(way, pace=speed / (steps.max() * 199 / way.duration))
    assert found.fault == "plan_collision"
    force = fake.truth().peak_force["right"]
    assert 40.0 < force < limb.limits.hardware.force
    assert fake.truth().violations == ()


def test_a_hand_that_is_pressed_as_it_opens_opens_no_farther(pipeline):
    wall = make_body(
        "brick", {"length": 0.02, "width": 0.3, "height": 0.6}, 500.0, name="wall"
    )
    walls = [
        replace(wall, name=f"wall {y}").at(
            SE3.from_parts(so3.exp(np.array([0.0, 0.0, np.pi / 2])), [0.8, y, 0.3])
        )
        for y in (-0.4, -0.2)
    ]
    start = {"right": CHAINS["right"].named(posture("right", (0.8, -0.3, 0.4)))}
    fake, task = executive(pipeline, *walls, start=start)
    drive = Drive(task.context, "right")
    hand = fake.hands["right"]
    shape = next(iter(hand.model.preshapes))
    hand.openings = hand._goals = [0.03] * 3
    task.context.wait(0.1)
    found = open_hand(drive, shape, hand.model.preshape(shape).widths[1])
    assert found is None or found.fault == "finger_jammed"
    assert fake.truth().peak_force["right"] < 0.5 * drive.limb.limits.hardware.force


def test_a_leg_begins_with_a_command_to_stay(pipeline, monkeypatch):
    fake, task = executive(pipeline)
    context, sent = task.context, []
    drive, send = Drive(context, "right"), Drive._send
    context.wait(0.01)
    drive.limb.baseline_time = context.now()

    def noted(self, q):
        sent.append(np.asarray(q))
        send(self, q)

    monkeypatch.setattr(Drive, "_send", noted)
    q = context.posture(drive.limb)
    end = drive.leg(np.array([0.0, 0.0, -0.02]), speed=0.1)
    assert end.outcome is LegOutcome.DONE
    np.testing.assert_allclose(sent[0], q, atol=1e-9)
    assert np.abs(sent[1] - q).max() > 1e-6
    assert fake.truth().violations == ()


def test_a_motion_begins_where_the_arm_was_sent_not_where_weight_keeps_it(
    pipeline, monkeypatch
):
    fake, task = executive(pipeline)
    context, drive = task.context, Drive(task.context, "right")
    context.wait(0.1)
    assert isinstance(drive.leg([0.0, 0.0, -0.02], speed=0.03), LegEnd)
    arm, read = drive.devices.arm, drive.devices.arm.read
    sag = np.full(len(read().q), 1e-3)
    monkeypatch.setattr(
        arm, "read", lambda: read()._replace(q=tuple(np.array(read().q) + sag))
    )
    limb, bare = drive.limb, space_of(context, unknown=UnknownSpace.IGNORED)
    goal = SE3.from_parts(p=[0.0, 0.0, 0.05]) @ limb.pose(context.posture(limb))
    way = planned(context, limb, goal, bare).trajectory
    assert drive.follow(way) is None
    assert fake.truth().violations == ()


def test_a_motion_may_begin_where_a_leg_led_a_joint_to_its_end(pipeline):
    _, task = executive(pipeline)
    limb = task.context.limbs["right"]
    q = task.context.posture(limb)
    q[0] = limb.limits.controller.lower[0] - 2e-4  # as it reads under a load
    inside = _inside(limb, q)
    assert inside[0] == limb.limits.planner.lower[0]
    q[0] -= 0.01
    assert "exceeded" in _inside(limb, q)


def test_joints_are_moved_back_inside_from_where_they_are_by_then(pipeline):
    fake, task = executive(pipeline)
    context = task.context
    arm, limb = fake.arms["right"], context.limbs["right"]
    arm.engage()
    context.wait(0.1)
    q, limits = np.array(arm.q), limb.limits
    outside = limits.planner.upper[7] + 0.005
    fake._drives.put(arm.joints[7], outside)
    q[7] = outside
    for k in range(20):
        q[6] += 1e-5 * k
        arm.command(q.tolist())
        context.wait(context.settings.period)
    arm.stop()  # and that joint still moves a little
    arm.reset()
    event = task._event(
        State.TRANSPORT, FaultFound("start_outside_limits", ""), Action.RETRY
    )
    assert _moved_inside(context, event) is None
    assert arm.q[7] == pytest.approx(limits.planner.upper[7], abs=1e-6)
    assert fake.truth().violations == ()


def test_a_sensor_that_fails_on_the_way_back_inside_stops_the_arms(
    pipeline, monkeypatch
):
    fake, task = executive(pipeline)
    arm, limit = fake.arms["right"], task.context.limbs["right"].limits.planner.upper[7]
    fake._drives.put(arm.joints[7], limit + 0.15)
    forces = iter([5.0] * 20)
    monkeypatch.setattr(
        Drive, "weighed", lambda _drive: (next(forces, np.nan), *[0.0] * 5)
    )
    event = task._event(
        State.TRANSPORT, FaultFound("start_outside_limits", ""), Action.RETRY
    )
    assert "on the way back" in _moved_inside(task.context, event).message
    assert all(arm.is_stopped for arm in fake.arms.values())
    assert arm.q[7] > limit + 0.1


@pytest.mark.parametrize(
    ("weight", "lever"), [(0.0, 0.0), (60.0, 0.0), (0.0, 0.5)], ids=str
)
def test_what_a_hand_meets_on_the_way_back_inside_is_not_pressed_on_again(
    pipeline, monkeypatch, weight, lever
):
    """What it meets from below bears at first what the hand carries; far out, it twists
    the hand more than it pushes."""
    fake, task = executive(pipeline)
    arm, limit = fake.arms["right"], task.context.limbs["right"].limits.planner.upper[7]
    fake._drives.put(arm.joints[7], limit + 0.15)
    pressed = []

    def weighed(drive):
        is_right = drive.limb.name == "right"
        push = 1000.0 * max(limit + 0.13 - arm.q[7], 0.0)
        pressed.append(push)
        load = (push - weight) * is_right
        return (load, 0.0, 0.0, 0.0, lever * load, 0.0)

    monkeypatch.setattr(Drive, "weighed", weighed)
    found = FaultFound("start_outside_limits", "")
    event = task._event(State.TRANSPORT, found, Action.RETRY)
    answer = answer_to(State.TRANSPORT, found.fault)
    assert task._recovered(event, answer) is State.SAFE_STOP
    assert max(pressed) < (45.0 if not lever else 25.0)
    assert all(arm.is_stopped for arm in fake.arms.values())


def test_a_jump_on_the_way_back_inside_ends_it(pipeline, monkeypatch):
    fake, task = executive(pipeline)
    arm, left = fake.arms["right"], fake.arms["left"]
    limb = task.context.limbs["right"]
    limit, own = limb.limits.planner.upper[7], int(np.flatnonzero(limb.is_own_joint)[3])
    fake._drives.put(arm.joints[7], limit + 0.15)
    send, sent = arm.command, []

    def command(q):
        send(q)
        sent.append(q)
        if len(sent) == 20:
            fake._drives.put(left.joints[own], left.q[own] + 0.3)

    monkeypatch.setattr(arm, "command", command)
    event = task._event(
        State.TRANSPORT, FaultFound("start_outside_limits", ""), Action.RETRY
    )
    found = _moved_inside(task.context, event)
    assert (found.fault, found.arm) == ("encoder_jump", "left")
    assert len(sent) == 20
    assert all(arm.is_stopped for arm in fake.arms.values())


def test_a_jump_of_one_arm_is_noticed_though_the_other_was_moved_back_inside(pipeline):
    fake, task = executive(pipeline)
    context, left = task.context, fake.arms["left"]
    limb, limits = context.limbs["left"], context.limbs["right"].limits.planner
    limb.feel(tuple(left.q), (0.0,) * 6)
    own = int(np.flatnonzero(limb.is_own_joint)[3])
    fake._drives.put(left.joints[own], left.q[own] + 0.3)
    fake._drives.put(fake.arms["right"].joints[7], limits.upper[7] + 0.05)
    event = task._event(
        State.TRANSPORT, FaultFound("start_outside_limits", ""), Action.RETRY
    )
    found = _moved_inside(context, event)
    assert (found.fault, found.arm) == ("encoder_jump", "left")
    assert Drive(context, "left").engage().fault == "encoder_jump"


@pytest.mark.parametrize("drives", [True, False])
def test_a_robot_whose_file_says_that_it_stands_fast_never_drives(pipeline, drives):
    brick = make_body("brick", {"length": 0.2, "width": 0.1, "height": 0.06}, 2.0)
    world = World((brick.at(SE3.from_parts(p=[1.3, 0.0, 0.03])),))
    model = replace(pipeline.robot, drives=drives)
    fake = fake_robot(model, world, rng=np.random.default_rng(0))
    assert (fake.robot.base is not None) is drives
    # Nor does one that has a base all the same.
    robot = replace(fake.robot, base=fake.base)
    context = Executive(robot, pipeline=pipeline, rng=np.random.default_rng(0)).context
    assert isinstance(capture(context), Done)
    assert isinstance(segment(context), Done)
    assert (repositioned(context, [np.array([1.8, 0.0, 0.2])]) > 0.0) is drives
    assert context.n_moves == drives
    assert bool(np.linalg.norm(fake.base.T_odom_base.p) > 0.05) is drives
