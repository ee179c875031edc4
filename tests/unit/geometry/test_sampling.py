"""Distributions of random rotations and poses, evenness of directions."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3, fibonacci_sphere, perturbed, random_rotations, so3


def test_random_rotations_follow_the_uniform_law_of_the_angle(rng):
    R = random_rotations(20_000, rng=rng)
    assert_allclose(
        R @ np.swapaxes(R, 1, 2), np.tile(np.eye(3), (20_000, 1, 1)), atol=1e-13
    )
    angles = np.sort(np.linalg.norm(so3.log(R), axis=-1))
    uniform_law = (angles - np.sin(angles)) / np.pi
    assert np.abs(uniform_law - np.linspace(0, 1, len(angles))).max() < 0.015
    assert_allclose(R.mean(axis=0), 0.0, atol=0.02)


def test_perturbations_have_the_given_spread(rng):
    T = SE3.from_parts(so3.exp(np.array([0.5, 1.0, -0.3])), [1.0, 2.0, 3.0])
    Ts = SE3(np.broadcast_to(T.matrix, (20_000, 4, 4)))
    moved = perturbed(Ts, 0.02, 0.05, rng=rng)
    assert_allclose(np.std(moved.p, axis=0), 0.02, rtol=0.03)
    assert_allclose(np.mean(moved.p, axis=0), T.p, atol=1e-3)
    turns = so3.log(np.swapaxes(Ts.R, 1, 2) @ moved.R)
    assert_allclose(np.std(turns, axis=0), 0.05, rtol=0.03)


def test_each_pose_may_have_its_own_spread(rng):
    Ts = SE3(np.tile(np.eye(4), (2, 1, 1)))
    moved = perturbed(Ts, np.array([0.0, 1.0]), np.array([0.0, 0.1]), rng=rng)
    assert_allclose(moved.matrix[0], np.eye(4))
    assert np.abs(moved.matrix[1] - np.eye(4)).max() > 1e-3


def test_the_same_seed_gives_the_same_poses():
    first, second = (
        random_rotations(3, rng=np.random.default_rng(5)) for _ in range(2)
    )
    assert_allclose(first, second, rtol=0)


def test_directions_on_the_sphere_are_even():
    directions = fibonacci_sphere(400)
    assert_allclose(np.linalg.norm(directions, axis=1), 1.0)
    assert_allclose(directions.mean(axis=0), 0.0, atol=3e-3)
    cosines = directions @ directions.T - 2 * np.eye(400)
    nearest = np.arccos(cosines.max(axis=1))
    ideal = np.sqrt(4 * np.pi / 400)
    assert nearest.min() > 0.75 * ideal
    assert nearest.max() < 1.25 * ideal


@pytest.mark.parametrize("n", [-1, 2.5, True, "3", None])
def test_no_number_of_rotations_or_directions_is_refused(rng, n):
    with pytest.raises(InputError, match=f"number of rotations: got {n!s}"):
        random_rotations(n, rng=rng)
    with pytest.raises(InputError, match=f"number of directions: got {n!s}"):
        fibonacci_sphere(n)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"Ts": np.eye(4)}, r"Ts: got ndarray.*SE3\.from_matrix"),
        ({"position_sigma": -0.01}, "position_sigma: got -0.01"),
        ({"rotation_sigma": np.nan}, "rotation_sigma: got nan"),
        ({"position_sigma": [0.1, 0.2, 0.3]}, r"position_sigma: got \(3,\).*\(2,\)"),
        ({"rotation_sigma": "wide"}, "rotation_sigma: got str"),
        ({"rng": 0}, "rng: got int"),
    ],
    ids=str,
)
def test_no_spread_is_refused(rng, wrong, words):
    Ts = SE3(np.tile(np.eye(4), (2, 1, 1)))
    right = {"Ts": Ts, "position_sigma": 0.01, "rotation_sigma": 0.1, "rng": rng}
    with pytest.raises(InputError, match=words):
        perturbed(**{**right, **wrong})
