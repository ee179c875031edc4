"""Joints that stand outside their limits are moved back inside, and no farther."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from debrisgrasp.executive.drive import Drive
from debrisgrasp.executive.faults import Action
from debrisgrasp.executive.inside import _way_inside, moved_inside
from debrisgrasp.executive.result import FaultFound
from debrisgrasp.executive.states import State
from debrisgrasp.executive.table import answer_to
from debrisgrasp.kinematics import LimitSet
from tests.unit.executive.rigs import before_a_brick


def test_joints_are_moved_back_inside_from_where_they_are_by_then(pipeline):
    fake, task = before_a_brick(pipeline)
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
    assert moved_inside(context, "") is None
    assert arm.q[7] == pytest.approx(limits.planner.upper[7], abs=1e-6)
    assert fake.truth().violations == ()


def test_a_sensor_that_fails_on_the_way_back_inside_stops_the_arms(
    pipeline, monkeypatch
):
    fake, task = before_a_brick(pipeline)
    arm, limit = fake.arms["right"], task.context.limbs["right"].limits.planner.upper[7]
    fake._drives.put(arm.joints[7], limit + 0.15)
    forces = iter([5.0] * 20)
    monkeypatch.setattr(
        Drive, "weighed", lambda _drive: (next(forces, np.nan), *[0.0] * 5)
    )
    assert "on the way back" in moved_inside(task.context, "").message
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
    fake, task = before_a_brick(pipeline)
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
    fake, task = before_a_brick(pipeline)
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
    found = moved_inside(task.context, "")
    assert (found.fault, found.arm) == ("encoder_jump", "left")
    assert len(sent) == 20
    assert all(arm.is_stopped for arm in fake.arms.values())


def test_a_jump_of_one_arm_is_noticed_though_the_other_was_moved_back_inside(pipeline):
    fake, task = before_a_brick(pipeline)
    context, left = task.context, fake.arms["left"]
    limb, limits = context.limbs["left"], context.limbs["right"].limits.planner
    limb.feel(tuple(left.q), (0.0,) * 6)
    own = int(np.flatnonzero(limb.is_own_joint)[3])
    fake._drives.put(left.joints[own], left.q[own] + 0.3)
    fake._drives.put(fake.arms["right"].joints[7], limits.upper[7] + 0.05)
    found = moved_inside(context, "")
    assert (found.fault, found.arm) == ("encoder_jump", "left")
    assert Drive(context, "left").engage().fault == "encoder_jump"


@settings(max_examples=100, deadline=None)
@given(
    arrays(np.float64, 3, elements=st.floats(-0.2, 0.2)),
    arrays(np.float64, 3, elements=st.floats(0.01, 2.0)),
    arrays(np.float64, 3, elements=st.floats(0.05, 10.0)),
)
def test_a_way_back_inside_keeps_speeds_and_accelerations(away, velocity, acceleration):
    limits = LimitSet(
        joint_names=("a", "b", "c"),
        lower=-np.ones(3),
        upper=np.ones(3),
        velocity=velocity,
        acceleration=acceleration,
    )
    q = np.sign(away) + away
    rows = _way_inside(q, limits, 0.004)
    np.testing.assert_allclose(rows[-1], np.clip(q, -1.0, 1.0), atol=1e-12)
    np.testing.assert_allclose(rows[0], q)
    rows = np.concatenate([rows[:1], rows, rows[-1:]])
    speeds = np.diff(rows, axis=0) / 0.004
    assert (np.abs(speeds) <= velocity).all()
    assert (np.abs(np.diff(speeds, axis=0)) / 0.004 <= acceleration).all()
