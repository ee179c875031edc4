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
