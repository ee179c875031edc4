"""What is known to be free: seen, or passed, and nothing else."""

from __future__ import annotations

import numpy as np

from debrisgrasp.executive.known import KnownSpace
from debrisgrasp.geometry import SE3, Bounds, DepthSight, Intrinsics

CAMERA = Intrinsics(fx=100.0, fy=100.0, cx=49.5, cy=49.5, width=100, height=100)


def seen(depth):
    """Know what a camera at the origin, looking along z, has seen."""
    space = KnownSpace()
    space.saw(DepthSight(np.asarray(depth, np.float32), CAMERA, SE3.identity()))
    return space


def test_before_anything_was_seen_nothing_is_free():
    space = KnownSpace()
    assert space.is_new
    assert not space.is_free(np.random.default_rng(0).normal(size=(50, 3))).any()


def test_only_what_lies_in_front_of_what_was_measured_is_free():
    space = seen(np.full((100, 100), 1.0))
    points = [[0.0, 0.0, 0.9], [0.0, 0.0, 0.99], [0.0, 0.0, 1.2], [0.0, 0.0, -0.5]]
    assert space.is_free(np.array(points)).tolist() == [True, False, False, False]
    beside = np.array([[0.0, -0.6, 0.9], [0.6, 0.0, 0.9]])
    assert not space.is_free(beside).any()


def test_where_nothing_came_back_there_is_nothing_nearer_than_around_it():
    depth = np.full((100, 100), np.nan)
    depth[:, :50] = 1.0
    depth[40:43, 20:23] = 0.0
    space = seen(depth)
    hole = np.array([[-0.28 * z, -0.08 * z, z] for z in (0.9, 1.1)])
    assert space.is_free(hole).tolist() == [True, False]
    at_edge, sky = np.array([0.02, 0.0, 1.0]), np.array([0.4, 0.0, 1.0])
    assert not space.is_free(1.5 * at_edge)
    assert space.is_free(3.0 * sky)


def test_where_a_hand_was_and_what_is_behind_the_robot_is_free():
    space = KnownSpace()
    space.passed(np.array([[[0.5, 0.1, 0.4], [0.5, 0.1, 0.6]]]))
    space.stands([Bounds(np.array([-0.5, -0.3, 0.0]), np.array([0.4, 0.3, 1.0]))])
    assert not space.is_new
    points = np.array([[0.51, 0.11, 0.41], [0.5, 0.1, 0.5], [-0.8, 0.2, 0.5]])
    assert space.is_free(points).tolist() == [True, False, True]
    assert not space.is_free(np.array([0.2, 0.0, 0.5]))


def test_where_something_moved_only_a_later_look_counts():
    depth = np.full((100, 100), 1.0)
    space, sight = (
        seen(depth),
        DepthSight(np.asarray(depth, np.float32), CAMERA, SE3.identity()),
    )
    places = np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 0.8]])
    hand = np.array([[0.02, 0.02, 1.31], [0.02, 0.02, 1.52]])
    space.passed(hand)
    assert space.is_free(np.concatenate([places, hand])).all()
    space.stirred(Bounds.around(np.array([[0.0, 0.0, 0.8], [0.0, 0.0, 1.3]]), 0.1))
    expected = [True, False, False, True]
    assert space.is_free(np.concatenate([places, hand])).tolist() == expected
    space.saw(sight)
    assert space.is_free(places).all()
    assert not space.is_free(hand[:1]).any()  # behind what is seen there
    space.passed(hand[:1])
    assert space.is_free(hand).all()


def test_a_surface_in_free_space_contradicts_what_was_seen_and_some_noise_does_not():
    space = seen(np.full((100, 100), 1.0))
    rng = np.random.default_rng(3)
    wall = np.column_stack([rng.uniform(-0.3, 0.3, (4000, 2)), np.full(4000, 1.0)])
    assert not space.is_contradicted(wall)
    assert not space.is_contradicted(wall[:0])
    noisy = wall.copy()
    noisy[::200, 2] = 0.7  # edges in the air
    assert not space.is_contradicted(noisy)
    bars = wall.copy()
    bars[::8, 2] = 0.7
    assert space.is_contradicted(bars)
    space.stirred(Bounds.around(bars[::8], 0.1))
    assert not space.is_contradicted(bars)  # what we moved lies elsewhere now


def test_few_measurements_contradict_nothing():
    space = seen(np.full((100, 100), 1.0))
    assert not space.is_contradicted(np.full((30, 3), [0.0, 0.0, 0.5]))
