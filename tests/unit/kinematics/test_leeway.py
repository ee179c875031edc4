"""An arm gives way where its joints have room, and not at the edge of its reach."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import ArmReach, DeflectionLimits, RobotModel
from debrisgrasp.kinematics.leeway import leeway

PUSH = DeflectionLimits(translation=0.03, rotation=0.1)
UP = np.array([0.0, 0.0, 0.05])


@pytest.fixture(scope="module")
def arm() -> ArmReach:
    robot = RobotModel.load("roman")
    return ArmReach(robot, next(iter(robot.arms)))


def share(arm, q, push=PUSH, way=UP) -> np.ndarray:
    """Leeway of postures (k, d), with one straight way from each."""
    Ts = arm.chain.fk(q).matrix
    away = Ts[:, None].copy()
    away[..., :3, 3] += way
    rng = np.random.default_rng(0)
    return leeway(arm.chain, q, SE3(Ts), SE3(away), push, rng=rng)


def test_a_posture_far_from_its_limits_gives_way_to_small_pushes(arm):
    assert share(arm, arm.q_present[None]) == pytest.approx(1.0)


def test_nothing_gives_way_beyond_the_reach_of_the_arm(arm):
    far = share(arm, arm.q_present[None], way=np.array([0.0, 0.0, 5.0]))
    assert far == pytest.approx(0.0)
    assert share(arm, arm.q_present[None], replace(PUSH, translation=4.0))[0] <= 0.5


def test_wider_pushes_are_followed_less_often(arm, rng):
    low, high = arm.chain.lower, arm.chain.upper
    low, high = np.maximum(low, -3.0), np.minimum(high, 3.0)
    q = low + (high - low) * rng.random((40, arm.chain.n_joints))
    shares = [
        share(arm, q, DeflectionLimits(translation=t, rotation=10 * t)).mean()
        for t in (0.002, 0.03, 0.1)
    ]
    assert shares[0] > shares[1] > shares[2]


def test_postures_are_judged_one_by_one(arm, rng):
    q = arm.q_present + 0.2 * rng.standard_normal((5, arm.chain.n_joints))
    q = arm.chain.clipped(q)
    together = share(arm, q)
    assert together == pytest.approx([share(arm, row[None])[0] for row in q], abs=0.1)


def test_a_stiff_posture_is_exchanged_for_one_that_gives_way(arm, rng):
    chain = arm.chain
    low, high = np.maximum(chain.lower, -3.0), np.minimum(chain.upper, 3.0)
    q = low + (high - low) * rng.random((60, chain.n_joints))
    Ts = chain.fk(q)
    away = SE3(np.stack([Ts.matrix, (SE3.from_parts(p=UP) @ Ts).matrix], axis=1))
    before = arm.leeway(q, Ts, away, rng=rng)

    def free(points) -> np.ndarray:
        return np.ones(points.shape[:-1])

    found = arm.yielding(Ts, away, free, 0.9, rng=rng)
    rows = np.flatnonzero(np.isfinite(found).all(axis=1))
    assert (before[rows] < 0.9).any()
    assert (arm.leeway(found[rows], Ts[rows], away[rows], rng=rng) >= 0.9).all()
    np.testing.assert_allclose(chain.fk(found[rows]).p, Ts[rows].p, atol=2e-3)
    assert not arm.collision.hits_itself(found[rows]).any()

    def blocked(points) -> np.ndarray:
        return np.zeros(points.shape[:-1])

    assert np.isnan(arm.yielding(Ts, away, blocked, 0.9, rng=rng)).all()
