from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError
from debrisgrasp.kinematics import LimitSet
from debrisgrasp.motion.timing import timed


def everywhere(q: np.ndarray) -> np.ndarray:
    return np.ones(len(q), dtype=bool)


def nowhere(q: np.ndarray) -> np.ndarray:
    return np.zeros(len(q), dtype=bool)


def limits(d: int = 3) -> LimitSet:
    return LimitSet(
        joint_names=tuple("abcdefgh"[:d]),
        lower=np.full(d, -2.0),
        upper=np.full(d, 2.0),
        velocity=np.linspace(0.5, 1.0, d),
        acceleration=np.linspace(2.0, 3.0, d),
    )


def test_no_limit_is_broken_at_any_rate_of_sampling(rng):
    kept = limits()
    for _ in range(40):
        path = rng.uniform(-2.0, 2.0, (int(rng.integers(1, 7)), 3))
        motion = timed(path, kept, everywhere, step=0.02)
        assert not motion.violation(kept, period=1e-3)
        np.testing.assert_allclose(motion.q[[0, -1]], path[[0, -1]], atol=1e-6)
        np.testing.assert_allclose(motion.dq[[0, -1]], 0.0, atol=1e-4)
        assert motion.limits_hash == kept.hash


def test_a_straight_edge_takes_the_least_time():
    kept = limits(1)
    motion = timed(np.array([[0.0], [1.0]]), kept, everywhere, step=0.02)
    # Cruise at v, and half of it while speeding up and slowing down.
    assert motion.duration == pytest.approx(1.0 / 0.5 + 0.5 / 2.0, rel=0.015)


def test_a_rounded_corner_saves_time_and_stays_near_it():
    path = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.5]])
    stopping = timed(path, limits(), nowhere, step=0.02)
    rounded = timed(path, limits(), everywhere, step=0.02)
    assert rounded.duration < stopping.duration - 0.2
    t = np.linspace(0.0, stopping.duration, 2000)
    corner = np.abs(stopping.at(t)[0] - path[1]).max(axis=1).min()
    assert corner < 1e-3
    q, _, _ = rounded.at(np.linspace(0.0, rounded.duration, 2000))
    assert np.linalg.norm(q - path[1], axis=1).min() < 0.3


def test_a_corner_is_rounded_only_where_that_is_free():
    path = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]])

    def outside(q):
        return (q[:, 0] > 0.999) | (q[:, 1] < 0.001)

    motion = timed(path, limits(), outside, step=0.005)
    q, _, _ = motion.at(np.linspace(0.0, motion.duration, 3000))
    assert ((q[:, 0] > 0.99) | (q[:, 1] < 0.01)).all()


def test_a_path_of_one_posture_stands_still():
    motion = timed(np.ones((1, 3)), limits(), everywhere, step=0.02)
    assert motion.duration == 0.0
    np.testing.assert_array_equal(motion.at(0.3)[0], np.ones(3))


def test_a_robot_with_other_limits_refuses_the_motion():
    motion = timed(np.array([[0.0] * 3, [1.0] * 3]), limits(), everywhere, step=0.02)
    motion.require_executable(limits())
    with pytest.raises(ConfigError, match="limits of a trajectory"):
        motion.require_executable(limits().scaled(velocity=0.5))
