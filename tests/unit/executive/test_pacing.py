"""How fast a motion is run: even, and slower where something is near."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from debrisgrasp.executive import TaskSettings
from debrisgrasp.executive.pacing import careful, feasible, times_at
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import Trajectory

PERIOD, GAIN = 0.004, 0.4


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
    most, fastest = 2.0, 1.5
    times = np.array([0.0, 0.75, 2.0, 2.75])
    dq = np.array([0.0, fastest, fastest, 0.0])[:, None]
    q = np.array([0.0, 0.5625, 2.4375, 3.0])[:, None]
    trajectory = Trajectory(
        joint_names=("slide",), times=times, q=q, dq=dq, limits_hash=""
    )
    limit = np.array([most])
    assert (feasible(trajectory, paces[:1], limit) == paces[:1]).all()
    ticks = times_at(trajectory, feasible(trajectory, paces, limit), PERIOD)
    path = trajectory.at(np.append(0.0, ticks))[0][:-1, 0]
    assert np.abs(np.diff(path, 2)).max(initial=0.0) / PERIOD**2 < 1.02 * most


@pytest.mark.parametrize(
    ("height", "is_faster"), [(0.015, False), (0.045, True), (2.0, False)]
)
def test_an_empty_hand_is_slow_only_where_the_ground_is_very_near(height, is_faster):
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
    limb = SimpleNamespace(reach=SimpleNamespace(chain=chain))

    def paces(held):
        none = np.zeros((0, 3))
        context = SimpleNamespace(
            cycle=SimpleNamespace(seen=object(), around=none),
            held=held,
            put_down=[],
            fallen=[],
            settings=TaskSettings(),
        )
        return careful(context, limb, np.zeros((1, 3)), trajectory, 1.0)

    empty, full = paces(None), paces(object())
    if is_faster:
        assert empty.min() > 3.0 * full.max()
    else:
        np.testing.assert_allclose(empty, full)
    assert full.max() <= 1.0
    if height < 0.05:
        np.testing.assert_allclose(full, TaskSettings().lift_speed / 0.5, rtol=1e-6)
