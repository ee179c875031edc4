"""Planned legs in time, wherever joints begin or come to a limit."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from debrisgrasp.control import CartesianLeg, LegPlan, LegPlanner
from debrisgrasp.kinematics import Trajectory

from .rigs import CHAIN, LIMITS

BOUNDED = np.flatnonzero(np.isfinite(LIMITS.upper))
SEEDS = st.integers(0, 2**32 - 1)


def planned(seed: int, n_at_limit: int) -> LegPlan:
    """A leg of 20 cm any way, from a posture with so many joints at a limit."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(LIMITS.lower, LIMITS.upper)
    stopped = rng.choice(BOUNDED, n_at_limit, replace=False)
    ends = np.where(rng.random(7) < 0.5, LIMITS.lower, LIMITS.upper)
    q[stopped] = ends[stopped]
    way = rng.standard_normal(3)
    goal = CartesianLeg.along(CHAIN.fk(q), 0.2 * way / np.linalg.norm(way)).goal
    return LegPlanner(CHAIN, LIMITS).plan(q, goal)


@settings(max_examples=150, deadline=None)
@given(seed=SEEDS, n_at_limit=st.integers(0, 3))
def test_no_leg_leaves_the_limits_between_its_waypoints(seed, n_at_limit):
    plan = planned(seed, n_at_limit)
    trajectory: Trajectory = plan.trajectory
    trajectory.require_executable(LIMITS)
    assert trajectory.violation(LIMITS, period=1e-3) == ""
    np.testing.assert_allclose(trajectory.q[[0, -1]], plan.q[[0, -1]], atol=1e-9)
    np.testing.assert_allclose(trajectory.dq[[0, -1]], 0.0, atol=1e-9)


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS)
def test_joints_that_are_held_back_leave_the_hand_on_its_line(seed):
    plan = planned(seed, 2)
    if not plan.is_done:
        return
    poses = CHAIN.fk(
        plan.trajectory.at(np.linspace(0, plan.trajectory.duration, 200))[0]
    )
    start = CHAIN.fk(plan.q[0])
    way = (plan.reached.p - start.p) / np.linalg.norm(plan.reached.p - start.p)
    off = (poses.p - start.p) - np.outer((poses.p - start.p) @ way, way)
    assert np.linalg.norm(off, axis=1).max() < 1e-3
