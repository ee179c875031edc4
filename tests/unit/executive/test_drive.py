"""Loops of one limb: legs, motions and fingers, on the robot in memory."""

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
from debrisgrasp.executive.context import Held
from debrisgrasp.executive.drive import Drive
from debrisgrasp.executive.fingers import open_hand
from debrisgrasp.executive.moves import (
    planned,
    reversed_motion,
    within_limits,
)
from debrisgrasp.executive.obstacles import space_of
from debrisgrasp.executive.result import LegEnd
from debrisgrasp.executive.states import State
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.kinematics import Trajectory
from debrisgrasp.motion import UnknownSpace
from debrisgrasp.worlds import make_body
from tests.unit.executive.rigs import before_a_brick
from tests.unit.robot.rigs import CHAINS, posture


def test_the_load_is_judged_until_the_arm_has_come_to_rest(pipeline, monkeypatch):
    _, task = before_a_brick(pipeline)
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
    _, task = before_a_brick(pipeline)
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
    fake, task = before_a_brick(pipeline)
    context = task.context
    drive = Drive(context, "right")
    context.wait(0.1)
    for _ in range(3):
        assert isinstance(drive.leg([0.0, 0.0, -0.02], speed=0.03), LegEnd)
    assert fake.truth().violations == ()


def test_a_joint_at_the_end_of_its_range_may_read_a_little_beyond_it(pipeline):
    _, task = before_a_brick(pipeline)
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
    fake, task = before_a_brick(pipeline, block, start=start)
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
    assert 25.0 < force < limb.limits.hardware.force
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
    fake, task = before_a_brick(pipeline, *walls, start=start)
    drive = Drive(task.context, "right")
    hand = fake.hands["right"]
    shape = next(iter(hand.model.preshapes))
    hand.openings = hand._goals = [0.03] * 3
    task.context.wait(0.1)
    found = open_hand(drive, shape, hand.model.preshape(shape).widths[1])
    assert found is None or found.fault == "finger_jammed"
    assert fake.truth().peak_force["right"] < 0.5 * drive.limb.limits.hardware.force


@pytest.mark.parametrize(("share", "fastest"), [(0.8, 0.0334), (0.95, 0.0084)])
def test_a_straight_way_is_as_slow_as_what_is_left_of_the_limits_asks(
    pipeline, monkeypatch, share, fastest
):
    _, task = before_a_brick(pipeline)
    settings = replace(task.context.settings, load_share=share)
    monkeypatch.setattr(task.context, "settings", settings)
    drive, places = Drive(task.context, "right"), []
    send = Drive._send

    def noted(self, q):
        places.append(self.limb.kinematics.pose(np.asarray(q).tolist())[1])
        send(self, q)

    monkeypatch.setattr(Drive, "_send", noted)
    assert drive.straight_speed == pytest.approx(fastest, rel=0.01)
    assert isinstance(drive.leg([0.0, 0.0, -0.03], speed=0.05), LegEnd)
    speed = np.linalg.norm(np.diff(places, axis=0), axis=1) / drive.period
    assert 0.7 * fastest < speed.max() < 1.02 * fastest


def test_a_leg_begins_with_a_command_to_stay(pipeline, monkeypatch):
    fake, task = before_a_brick(pipeline)
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
    fake, task = before_a_brick(pipeline)
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
    _, task = before_a_brick(pipeline)
    limb = task.context.limbs["right"]
    q = task.context.posture(limb)
    q[0] = limb.limits.controller.lower[0] - 2e-4  # as it reads under a load
    inside = within_limits(limb, q)
    assert inside[0] == limb.limits.planner.lower[0]
    q[0] -= 0.01
    assert "exceeded" in within_limits(limb, q).message


def to(q, goal, limits, seconds, dq=0.0):
    """Motion between two postures (d,), its last joint with a speed at both ends."""
    speeds = np.zeros((2, len(q)))
    speeds[:, -1] = dq
    return Trajectory(
        joint_names=limits.joint_names,
        times=np.array([0.0, seconds]),
        q=np.array([q, goal]),
        dq=speeds,
        limits_hash=limits.hash,
    )


@pytest.mark.parametrize(
    ("way", "seconds", "dq", "words"),
    [
        (0.3, 0.1, 0.0, "velocity of right_arm_joint7"),
        (0.1, 0.5, 0.0, "acceleration of right_arm_joint7"),
        (9.0, 60.0, 0.0, "position of right_arm_joint7"),
        (0.1, 0.25, 0.4, "begins with right_arm_joint7"),
    ],
    ids=["speed", "acceleration", "position", "start"],
)
def test_a_motion_that_breaks_its_limits_is_refused_before_the_first_command(
    pipeline, monkeypatch, way, seconds, dq, words
):
    _, task = before_a_brick(pipeline)
    drive, sent = Drive(task.context, "right"), []
    monkeypatch.setattr(drive.devices.arm, "command", sent.append)
    q = task.context.posture(drive.limb)
    goal = q.copy()
    goal[-1] += way
    limits = drive.limb.limits.planner
    found = drive.follow(to(q, goal, limits, seconds, dq))
    assert found.fault == "limit_mismatch"
    assert words in found.message
    assert not sent


def test_what_would_be_commanded_is_checked_before_the_first_command(
    pipeline, monkeypatch
):
    """Where the arm stands, and the pace, make of a motion another one."""
    _, task = before_a_brick(pipeline)
    drive, sent = Drive(task.context, "right"), []
    monkeypatch.setattr(drive.devices.arm, "command", sent.append)
    monkeypatch.setattr(
        "debrisgrasp.executive.drive.paced",
        lambda way, *_: np.concatenate([way.q[:1], way.q[:1] + 0.02, way.q[-1:]]),
    )
    q = task.context.posture(drive.limb)
    found = drive.follow(to(q, q + 0.01, drive.limb.limits.planner, 2.0))
    assert found.fault == "limit_mismatch"
    assert "exceeded" in found.message
    assert not sent


def test_a_short_motion_that_begins_beside_the_arm_ends_where_it_should(pipeline):
    fake, task = before_a_brick(pipeline)
    context, drive = task.context, Drive(task.context, "right")
    q = context.posture(drive.limb)
    beside, goal = q.copy(), q.copy()
    beside[3] += 0.025
    goal[3], goal[-1] = beside[3], q[-1] + 0.02
    assert drive.follow(to(beside, goal, drive.limb.limits.planner, 0.5)) is None
    np.testing.assert_allclose(context.posture(drive.limb), goal, atol=1e-3)
    assert fake.truth().violations == ()
