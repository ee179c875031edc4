"""Normals of unorganised clouds."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3, neighborhood_normals, random_rotations


def sphere_points(rng, n):
    directions = rng.normal(size=(n, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def test_normals_of_a_sphere_seen_from_inside_point_inwards(rng):
    directions = sphere_points(rng, 4000)
    normals = neighborhood_normals(directions, np.zeros(3))
    cosines = -(normals * directions).sum(axis=1)
    assert np.nanpercentile(cosines, 1) > np.cos(np.radians(6))
    assert np.isfinite(cosines).mean() > 0.99


@pytest.mark.parametrize("max_support", [200_000, 3000])
def test_thinning_keeps_the_normals_of_a_plane(max_support, rng):
    points = rng.uniform(-1, 1, (20_000, 3)) * [1, 1, 0]
    points[:, 2] = 0.3 * points[:, 0] + rng.normal(0, 1e-3, 20_000)
    normals = neighborhood_normals(
        points, [0, 0, 3.0], max_support=max_support, n_neighbors=16
    )
    truth = np.array([-0.3, 0, 1]) / np.hypot(0.3, 1)
    assert np.isfinite(normals).all()
    angles = np.degrees(np.arccos(np.clip(normals @ truth, -1, 1)))
    assert np.percentile(angles, 99) < 8.0


def test_lines_and_balls_of_points_have_no_normal(rng):
    line = np.outer(np.linspace(0, 1, 100), [1.0, 2.0, 3.0])
    assert np.isnan(neighborhood_normals(line, np.zeros(3))).all()
    ball = rng.normal(size=(24, 3))
    assert np.isnan(neighborhood_normals(ball, np.zeros(3), flatness=0.1)).all()


def test_too_few_points_have_no_normal():
    assert np.isnan(neighborhood_normals(np.zeros((2, 3)), np.ones(3))).all()
    assert neighborhood_normals(np.empty((0, 3)), np.ones(3)).shape == (0, 3)


def test_many_copies_of_one_point_have_no_normal():
    normals = neighborhood_normals(np.ones((40, 3)), np.zeros(3), max_support=10)
    assert np.isnan(normals).all()


def test_points_in_one_place_share_the_normal_that_one_of_them_would_have(rng):
    points = sphere_points(rng, 2000)
    often = np.repeat(np.arange(3), 4000)
    repeated = np.concatenate([points, points[::2], points[often]])
    alone = neighborhood_normals(points, np.zeros(3))
    normals = neighborhood_normals(repeated, np.zeros(3))
    expected = np.concatenate([alone, alone[::2], alone[often]])
    assert_array_equal(normals, expected)


def test_turning_cloud_and_viewpoint_turns_the_normals(rng):
    T = SE3.from_parts(random_rotations(1, rng=rng)[0], [0.5, 1.0, -2.0])
    points, viewpoint = sphere_points(rng, 500), np.array([0.1, 0.2, 3.0])
    normals = neighborhood_normals(points, viewpoint)
    turned = neighborhood_normals(T.apply(points), T.apply(viewpoint))
    assert_allclose(turned, T.rotate(normals), atol=1e-6)


def test_points_that_are_not_finite_are_refused():
    with pytest.raises(InputError, match="points"):
        neighborhood_normals(np.array([[0, 0, np.nan]]), np.zeros(3))


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"points": np.ones((4, 5, 3))}, r"\(4, 5, 3\), expected \(n, 3\)"),
        ({"viewpoint": [0.0, 0.0]}, r"shape of viewpoint: got \(2,\)"),
        ({"viewpoint": [0.0, 0.0, np.nan]}, "viewpoint: got 1 of 3 values NaN"),
        ({"n_neighbors": 0}, "n_neighbors: got 0"),
        ({"max_support": 0}, "max_support: got 0"),
        ({"flatness": -1.0}, "flatness: got -1"),
    ],
    ids=str,
)
def test_what_gives_no_normals_at_all_is_refused(wrong, words):
    right = {"points": np.eye(3), "viewpoint": np.zeros(3)}
    with pytest.raises(InputError, match=words):
        neighborhood_normals(**{**right, **wrong})
