"""How fast a motion is run: even, and slower where something is near."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from debrisgrasp.executive import TaskSettings
from debrisgrasp.executive.drive import Drive
from debrisgrasp.executive.moves import planned
from debrisgrasp.executive.obstacle_memory import ObstacleMemory
from debrisgrasp.executive.obstacles import space_of
from debrisgrasp.executive.pacing import (
    broken_by,
    careful,
    feasible,
    met_safely,
    paced,
    times_at,
)
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import LimitSet, Trajectory
from debrisgrasp.motion import UnknownSpace
from debrisgrasp.worlds import make_body
from tests.unit.executive.rigs import before_a_brick

PERIOD, GAIN = 0.004, 0.4


MOST, FASTEST = 2.0, 1.5


def slide():
    """Motion of one joint: as fast as it can."""
    times = np.array([0.0, 0.75, 2.0, 2.75])
    dq = np.array([0.0, FASTEST, FASTEST, 0.0])[:, None]
    q = np.array([0.0, 0.5625, 2.4375, 3.0])[:, None]
    return Trajectory(joint_names=("slide",), times=times, q=q, dq=dq, limits_hash="")


def run(duration, paces):
    return times_at(SimpleNamespace(duration=duration), np.asarray(paces), PERIOD)


def test_half_the_pace_takes_twice_the_time():
    times = run(3.0, [0.5])
    assert len(times) == 1500
    assert np.allclose(np.diff(times), 0.5 * PERIOD)


def test_a_slow_part_is_slow_and_the_rest_is_not():
    times = run(10.0, [1.0] * 40 + [0.1] * 5 + [1.0] * 40)
    pace = np.diff(times[:-1]) / PERIOD
    middle = np.abs(times[1:-1] - 5.0) < 0.2
    assert pace[middle].max() < 0.11
    assert pace.max() == pytest.approx(1.0, abs=1e-6)


@settings(max_examples=40, deadline=None)
@given(
    st.floats(0.05, 12.0),
    st.integers(1, 30).flatmap(
        lambda n: arrays(np.float64, n, elements=st.floats(0.02, 1.0))
    ),
)
def test_the_pace_changes_no_faster_than_the_arm_can(duration, paces):
    times = run(duration, paces)
    assert times[-1] == pytest.approx(duration, abs=1e-9)
    steps = np.diff(np.concatenate([[0.0], times]))
    assert steps.min() > 0.0
    assert steps.max() <= PERIOD * paces.max() * (1.0 + 1e-9)
    assert np.abs(np.diff(steps[:-1])).max(initial=0.0) <= GAIN * PERIOD**2 * 1.01


@settings(max_examples=40, deadline=None)
@given(
    st.integers(2, 30).flatmap(
        lambda n: arrays(np.float64, n, elements=st.floats(0.02, 1.0))
    )
)
@example(np.array([0.8, 0.87, 0.94, *[1.0] * 9]))
def test_a_pace_that_changes_asks_no_more_than_the_arm_can(paces):
    trajectory, limit = slide(), np.array([MOST])
    assert (feasible(trajectory, paces[:1], limit) == paces[:1]).all()
    ticks = times_at(trajectory, feasible(trajectory, paces, limit), PERIOD)
    path = trajectory.at(np.append(0.0, ticks))[0][:-1, 0]
    assert np.abs(np.diff(path, 2)).max(initial=0.0) / PERIOD**2 < 1.02 * MOST


def straight(way, limits):
    """Straight from 0 to a posture (d,), as fast as four fifths of the limits allow."""
    way = np.asarray(way)
    times = (1.5 * np.abs(way) / limits.velocity, np.sqrt(6.0 * np.abs(way) / MOST))
    return Trajectory(
        joint_names=limits.joint_names,
        times=np.array([0.0, max(float(np.max(times)) / 0.8, 1e-3)]),
        q=np.array([0.0 * way, way]),
        dq=np.zeros((2, len(way))),
        limits_hash="",
    )


@settings(max_examples=200, deadline=None)
@given(
    arrays(np.float64, 2, elements=st.floats(-1.0, 1.0)),
    arrays(np.float64, 2, elements=st.floats(-0.03, 0.03)),
    arrays(np.float64, 2, elements=st.floats(0.05, 2.0)),
    st.lists(st.floats(0.05, 1.0), min_size=1, max_size=5),
)
@example(np.array([0.02, 0.0]), np.array([0.0, 0.029]), np.full(2, 0.5), [1.0])
@example(np.zeros(2), np.array([0.03, 0.0]), np.full(2, 0.5), [1.0])
def test_a_run_that_begins_beside_a_motion_ends_where_it_does_within_the_limits(
    way, beside, velocity, paces
):
    limits = LimitSet(
        joint_names=("a", "b"),
        lower=np.full(2, -1.1),
        upper=np.full(2, 1.1),
        velocity=velocity,
        acceleration=np.full(2, MOST),
    )
    path = paced(straight(way, limits), np.array(paces), beside, PERIOD, limits)
    np.testing.assert_allclose(path[0], beside)
    np.testing.assert_allclose(path[-1], way, atol=1e-9)
    assert broken_by(path, limits, PERIOD) == ""


@pytest.mark.parametrize("at", [0, 40, 99])
@pytest.mark.parametrize(
    ("off", "words"), [(2.0, "position of a"), (0.01, "of a"), (np.nan, "position of")]
)
def test_a_run_that_breaks_a_limit_is_told_by_its_joint(at, off, words):
    limits = LimitSet(
        joint_names=("a", "b"),
        lower=-np.ones(2),
        upper=np.ones(2),
        velocity=np.ones(2),
        acceleration=np.ones(2),
    )
    path = np.zeros((100, 2))
    assert broken_by(path, limits, PERIOD) == ""
    path[at, 0] += off
    assert words in broken_by(path, limits, PERIOD)
    # From rest to rest, or it is none.
    path = np.linspace(0.0, 0.1, 100)[:, None] * [0.0, 1.0]
    assert "acceleration of b" in broken_by(path, limits, PERIOD)


def slid_along_x(height, *, is_holding=False, memory=None):
    """Paces of a hand that slides by 1 m at a height, at 0.5 m/s; room 105 N."""
    q = np.linspace(0.0, 1.0, 21)[:, None]
    trajectory = Trajectory(
        joint_names=("slide",),
        times=np.linspace(0.0, 2.0, 21),
        q=q,
        dq=np.full_like(q, 0.5),
        limits_hash="",
    )
    chain = SimpleNamespace(
        fk=lambda rows: SE3.from_parts(
            p=np.column_stack([rows[:, 0], 0.0 * rows[:, 0], 0.0 * rows[:, 0] + height])
        )
    )
    limits = SimpleNamespace(planner=SimpleNamespace(acceleration=np.array([2.0])))
    context = SimpleNamespace(
        cycle=SimpleNamespace(seen=object(), around=np.zeros((0, 3))),
        held=object() if is_holding else None,
        memory=memory or ObstacleMemory(),
        settings=TaskSettings(),
    )
    limb = SimpleNamespace(reach=SimpleNamespace(chain=chain), limits=limits)
    return careful(context, limb, np.zeros((1, 3)), trajectory, 1.0, (105, 28.0))


@pytest.mark.parametrize(
    ("height", "is_near"), [(0.015, (True, True)), (0.045, (False, True)), (2.0, ())]
)
@pytest.mark.parametrize("is_holding", [False, True])
def test_a_hand_is_no_faster_than_a_touch_allows_and_slower_near_the_ground(
    height, is_near, is_holding
):
    paces = slid_along_x(height, is_holding=is_holding)
    way = 0.5 * paces * 0.02 + paces**2 * 0.5 * (0.5 / 2.0) / 2.0
    if is_near and is_near[is_holding]:
        assert (3e4 * way < 105).all()
        np.testing.assert_allclose(paces, TaskSettings().lift_speed / 0.5)
    else:
        np.testing.assert_allclose(3e4 * way, 105)


@pytest.mark.parametrize("kind", ["dropped", "settled", "fallen", "felt"])
def test_a_hand_is_slower_near_what_is_remembered(kind):
    memory = ObstacleMemory(**{kind: [np.array([[0.5, 0.0, 2.0]])]})
    free, paces = slid_along_x(2.0), slid_along_x(2.0, memory=memory)
    slow = TaskSettings().lift_speed / 0.5
    assert paces[len(paces) // 2] == pytest.approx(slow)
    assert slow < free.min()
    np.testing.assert_allclose(paces[[0, -1]], free[[0, -1]])


@pytest.fixture(scope="module")
def way(pipeline):
    """From rest to before the pile, and the limb that goes it."""
    _, task = before_a_brick(pipeline)
    limb = task.context.limbs["right"]
    goal = pipeline.robot.posture("right", pipeline.robot.arm("right").present)
    space = space_of(task.context, unknown=UnknownSpace.IGNORED)
    found = planned(task.context, limb, limb.reach.chain.vector(goal), space)
    return found.trajectory, limb


def met(pipeline, way, share, offset, size, period=PERIOD):
    """Run into a body that came after the last look; the fault, and what was true."""
    trajectory, limb = way
    T = limb.pose(trajectory.at(np.array([share * trajectory.duration]))[0][0])
    sizes = dict.fromkeys(("length", "width", "height"), size)
    body = make_body("brick", sizes, 500.0, name="unseen")
    body = body.at(SE3.from_parts(p=T.p + offset))
    fake, task = before_a_brick(pipeline, body, settings=TaskSettings(period=period))
    context = task.context
    drive = Drive(context, "right")
    context.wait(0.01)
    drive.limb.baseline_time = context.now()
    fault = drive.follow(trajectory)
    context.wait(0.6)
    return fault, fake.truth()


def test_a_motion_to_where_the_arm_stands_is_followed(pipeline):
    _, task = before_a_brick(pipeline)
    drive = Drive(task.context, "right")
    q = np.array([task.context.posture(drive.limb)])
    still = Trajectory(
        joint_names=drive.limb.reach.chain.joint_names,
        times=np.zeros(1),
        q=q,
        dq=np.zeros_like(q),
        limits_hash=drive.limb.limits.planner.hash,
    )
    assert still.duration == 0.0
    assert drive.follow(still) is None
    np.testing.assert_allclose(task.context.posture(drive.limb), q[0], atol=1e-3)


@settings(max_examples=8, deadline=None)
@given(
    st.floats(0.2, 0.95),
    arrays(np.float64, 3, elements=st.floats(-0.1, 0.1)),
    st.sampled_from([0.03, 0.08, 0.2]),
)
@example(0.95, np.array([0.04, -0.06, -0.02]), 0.03)
@example(0.87, np.array([0.08, -0.03, 0.0]), 0.2)
def test_a_hand_that_meets_what_nobody_saw_stays_below_its_limits(
    pipeline, way, share, offset, size
):
    fault, truth = met(pipeline, way, share, offset, size)
    assert truth.overloads == ()
    assert truth.violations == ()
    assert truth.peak_force["right"] < 150.0
    assert fault is None or fault.fault == "plan_collision"
    assert (fault is None) == (truth.peak_force["right"] < 25.0)


@pytest.mark.parametrize("period", [0.002, 0.01])
def test_so_it_does_at_any_rate_of_the_loop(pipeline, way, period):
    offset = np.array([0.08, -0.03, 0.0])
    fault, truth = met(pipeline, way, 0.87, offset, 0.2, period)
    assert fault.fault == "plan_collision"
    assert truth.overloads == ()
    assert 25.0 < truth.peak_force["right"] < 150.0


def test_what_is_met_is_met_with_what_the_arm_can_still_stop():
    speed, braking = np.array([0.4, 0.1, 1.5]), np.array([0.25, 0.02, 0.6])
    pace = met_safely(speed, braking, (105.0, 28.0), 0.2, PERIOD)
    way = pace * speed * 0.02 + pace**2 * speed * braking / 2.0
    np.testing.assert_allclose(3e4 * way, 105.0)
    assert (met_safely(speed, braking, (105.0, 28.0), 0.5, PERIOD) < pace).all()
    for reach in (0.3, 0.5, 1.0):
        pace = met_safely(speed, braking, (1e3, 28.0), reach, PERIOD)
        way = pace * speed * 0.02 + pace**2 * speed * braking / 2.0
        levers = np.linspace(1e-3, reach, 500)[:, None]
        torque = way * levers / (1.0 / 3e4 + levers**2 / 1e4)
        np.testing.assert_allclose(torque.max(axis=0), 28.0, rtol=1e-4)
    assert (met_safely(speed, braking, (-1.0, 28.0), 0.5, PERIOD) == 0.0).all()
