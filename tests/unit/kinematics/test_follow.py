"""Postures of poses that move a little at a time."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import ArmReach, KinematicChain, ReachMap, follow


def _stepped(T: SE3, rng: np.random.Generator, size: float) -> SE3:
    n = len(T.matrix)
    step = rng.normal(0.0, size, (n, 6)) * np.repeat([0.01, 0.07], 3)
    return T @ SE3.exp(step)


@pytest.mark.parametrize("n", [1, 20, 300])
def test_small_steps_are_followed_by_postures_near_those_before(
    arm: KinematicChain, arm_map: ReachMap, rng: np.random.Generator, n: int
) -> None:
    q = 0.8 * arm.sampled(n, rng=rng)
    T = _stepped(arm.fk(q), rng, 1.0)
    found = follow(arm, T, q, reach_map=arm_map, rng=rng)
    assert found.is_solved.mean() > 0.9
    solved = found.is_solved
    gap = arm.fk(found.q[solved]).matrix - T.matrix[solved]
    assert np.abs(gap).max() < 2e-3
    assert (found.q >= arm.lower).all()
    assert (found.q <= arm.upper).all()
    travel = np.abs(arm.difference(found.q, q)).max(axis=1)
    assert np.median(travel) < 0.6


@pytest.mark.parametrize("n", [5, 300])
def test_poses_without_a_posture_before_start_from_the_map(
    arm: KinematicChain, arm_map: ReachMap, rng: np.random.Generator, n: int
) -> None:
    T = arm.fk(arm.sampled(n, rng=rng))
    unknown = np.full((n, arm.n_joints), np.nan)
    found = follow(arm, T, unknown, reach_map=arm_map, rng=rng)
    assert found.is_solved.mean() > 0.85
    assert np.isfinite(found.q).all()


def test_what_is_out_of_reach_has_no_posture(
    right_reach: ArmReach, rng: np.random.Generator
) -> None:
    chain = right_reach.chain
    q = chain.sampled(40, rng=rng)
    T = chain.fk(q).matrix.copy()
    T[::2, :3, 3] += 5.0
    joints = right_reach.follow(SE3(T), q, rng=rng)
    assert np.isnan(joints[::2]).all()
    assert np.abs(joints[1::2] - q[1::2]).max() < 1e-2


def test_a_batch_without_poses_is_answered(
    arm: KinematicChain, arm_map: ReachMap, rng: np.random.Generator
) -> None:
    found = follow(
        arm,
        SE3(np.zeros((0, 4, 4))),
        np.zeros((0, arm.n_joints)),
        reach_map=arm_map,
        rng=rng,
    )
    assert found.q.shape == (0, arm.n_joints)


def test_postures_of_another_shape_are_refused(
    arm: KinematicChain, rng: np.random.Generator
) -> None:
    T = arm.fk(arm.sampled(3, rng=rng))
    with pytest.raises(InputError, match="q_before"):
        follow(arm, T, np.zeros((2, arm.n_joints)), rng=rng)
