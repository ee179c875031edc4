"""Thousands of states near a few poses become a handful."""

from __future__ import annotations

import numpy as np

from debrisgrasp.geometry import SE3, so3
from debrisgrasp.planning.modes import count_near, distinct

SETTINGS = {"distance": 0.03, "angle": 0.4, "limit": 100}


def crowd(centres: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    twists = np.repeat(centres, n, axis=0)
    twists = twists + rng.normal(0, 0.001, twists.shape)
    return SE3.exp(twists).matrix


def test_each_crowd_becomes_its_best_member(rng):
    centres = np.array([[0, 0, 0, 0, 0, 0], [0.2, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 1.0]])
    Ts = crowd(centres, 200, rng)
    value = rng.random(len(Ts))
    kept = distinct(Ts, np.zeros(len(Ts), int), value, **SETTINGS)
    expected = [
        block * 200 + np.argmax(value[block * 200 :][:200]) for block in range(3)
    ]
    assert sorted(kept) == sorted(expected)
    assert (np.diff(value[kept]) <= 0).all()


def test_poses_of_different_groups_are_never_the_same(rng):
    Ts = crowd(np.zeros((1, 6)), 2, rng)
    assert len(distinct(Ts, np.array([0, 1]), np.ones(2), **SETTINGS)) == 2


def test_limit_and_no_poses_at_all():
    Ts = SE3.exp(np.c_[np.arange(9.0), np.zeros((9, 5))]).matrix
    settings = SETTINGS | {"limit": 4}
    assert len(distinct(Ts, np.zeros(9, int), np.arange(9.0), **settings)) == 4
    none = distinct(Ts[:0], np.zeros(0, int), np.zeros(0), **SETTINGS)
    assert none.shape == (0,)


def test_poses_near_each_other_are_counted_within_their_group():
    Ts = np.tile(np.eye(4), (2, 1, 1))
    Ts[1, 0, 3] = 1.0
    others = np.tile(np.eye(4), (5, 1, 1))
    others[1, 0, 3] = 0.02  # near the first
    others[2, 0, 3] = 0.05  # too far
    others[3, :3, :3] = so3.exp(np.array([0.0, 0.0, 0.5]))  # turned too far
    counts = count_near(
        Ts,
        np.array(["a", "b"]),
        others,
        np.array(["a", "a", "a", "a", "b"]),
        distance=0.03,
        angle=0.4,
    )
    assert counts.tolist() == [2, 0]
