"""Sums over the points of each pose, against loops."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from debrisgrasp.planning.near_pads import NearPads


def pads(poses: list[int], n_poses: int, rng: np.random.Generator) -> NearPads:
    pose, m = np.array(sorted(poses), dtype=np.int64), len(poses)
    values = rng.normal(size=(5, m)).astype(np.float32)
    x, y, z, along, facing = values
    return NearPads(pose, np.arange(m), x, y, z, along, facing, n_poses)


@given(st.lists(st.integers(0, 6), max_size=40), st.integers(7, 9))
def test_each_pose_counts_its_own_points_also_if_it_has_none(poses, n_poses):
    rng = np.random.default_rng(len(poses))
    near = pads(poses, n_poses, rng)
    which = rng.random(len(poses)) < 0.5
    own = [near.pose == k for k in range(n_poses)]
    assert near.count(which).tolist() == [int((which & mine).sum()) for mine in own]
    assert near.n_each.tolist() == [int(mine.sum()) for mine in own]
    expected = [max([-1.0, *near.x[mine].tolist()]) for mine in own]
    np.testing.assert_array_equal(near.greatest(near.x, -1.0), np.float32(expected))


def test_the_curve_of_a_circle_is_its_middle_and_radius(rng):
    turn = rng.uniform(-1.2, 1.2, size=60)
    along = np.sin(turn).astype(np.float32)
    x = (0.02 + 0.05 * along).astype(np.float32)
    zero = np.zeros_like(x)
    near = NearPads(np.repeat([1, 3], 30), np.arange(60), x, zero, zero, along, zero, 5)
    middle, radius, turns = near.curve()
    assert np.isnan(radius[[0, 2, 4]]).all()
    np.testing.assert_allclose(middle[[1, 3]], 0.02, atol=1e-3)
    np.testing.assert_allclose(radius[[1, 3]], 0.05, atol=2e-3)
    assert turns.tolist() == [False, True, False, True, False]


def test_faces_go_on_flat_and_round_things_grow_steeper_below_what_was_seen():
    turn = np.linspace(0.3, 0.9, 30)
    flat = np.full(30, 0.6, dtype=np.float32)
    cosine = np.concatenate([flat, np.sin(turn)]).astype(np.float32)
    heights = np.concatenate([0.05 + 0.05 * turn, 0.08 - 0.08 * np.cos(turn)])
    z, zero = heights.astype(np.float32), np.zeros(60, dtype=np.float32)
    pose = np.repeat([0, 2], 30)
    near = NearPads(pose, np.arange(60), zero, zero, z, cosine, zero, 3)
    below = near.turned_below(cosine, cosine > 0.1, np.full(3, 0.08, np.float32))
    np.testing.assert_allclose(below[0], 0.6, rtol=1e-5)
    assert np.isnan(below[1])
    assert 0.95 < below[2] <= 1.0
    edge = NearPads(pose, np.arange(60), zero, zero, 0.3 * z, cosine, zero, 3)
    low = edge.turned_below(cosine, cosine > 0.1, np.full(3, 0.08, np.float32))
    assert np.isnan(low).all()


def test_a_bulge_is_no_wider_than_what_was_seen_of_it_and_its_middle_moves_along():
    turn = np.linspace(-1.0, 1.0, 30)
    facing = np.cos(turn).astype(np.float32)
    z = (0.08 - 0.02 * facing).astype(np.float32)
    zero, one = np.zeros_like(z), np.zeros(30, dtype=np.int64)
    near = NearPads(one, np.arange(30), zero, zero, z, zero, facing, 1)
    for most, radius in ((np.inf, 0.02), (0.015, 0.015)):
        middle, found, is_round = near.bulge(np.array([most]))
        np.testing.assert_allclose(found, radius, rtol=0.05)
        np.testing.assert_allclose(middle, z.mean() + found * facing.mean(), rtol=1e-5)
        assert is_round.all()


def test_what_lies_askew_is_straightened():
    y = np.linspace(0.0, 0.1, 20, dtype=np.float32)
    zero, pose = np.zeros_like(y), np.repeat([0, 1], 10)
    x = 0.01 + np.where(pose, 0.3, -0.2) * y
    near = NearPads(pose, np.arange(20), x.astype(np.float32), y, zero, zero, zero, 2)
    width = np.array([0.1, 0.05], dtype=np.float32)
    straight = near.straightened(np.array([-0.2, 0.3]), width)
    middle = np.repeat([-0.2 * 0.05, 0.3 * 0.025], 10)
    np.testing.assert_allclose(straight.x, 0.01 + middle, atol=1e-6)
