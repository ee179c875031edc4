from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3, Box
from debrisgrasp.kinematics import hull as kinematics_hull
from debrisgrasp.worlds import (
    Hull,
    frustum,
    named_scene,
    prism,
    staves,
    volume_and_centroid,
)
from tests.strategies import poses

BOX = Box(np.array([0.3, 0.1, 0.05]))


@given(T=poses)
def test_the_hull_of_a_box_has_the_distances_of_the_box(T):
    points = np.random.default_rng(1).uniform(-0.6, 0.6, (200, 3))
    hull = Hull.around(BOX.mesh()[0]).moved(T)
    there = T.apply(points)
    np.testing.assert_allclose(
        hull.signed_distance(there), BOX.signed_distance(points), atol=1e-9
    )
    assert len(hull.normals) == 6


def test_containment_is_a_distance_of_zero_or_less(rng):
    hull = Hull.around(rng.standard_normal((20, 3)))
    points = rng.standard_normal((500, 3))
    inside = hull.contains(points)
    assert 20 < inside.sum() < 480
    np.testing.assert_array_equal(inside, hull.signed_distance(points) <= 0.0)


def test_the_sphere_cover_holds_every_corner_and_the_middle():
    hull = frustum(0.12, 0.03, 0.0, 0.4)
    centers, radii = hull.sphere_cover(0.05)
    assert radii.max() <= 0.05 + 1e-12
    probes = np.concatenate([hull.vertices, [[0.0, 0.0, 0.2]]])
    reach = np.linalg.norm(probes[:, None] - centers, axis=-1) - radii
    assert (reach.min(axis=1) <= 1e-9).all()


def test_volume_and_centroid_of_a_cone_are_those_of_the_formula():
    low, high, height = 0.2, 0.05, 0.5
    volume, centroid = volume_and_centroid(frustum(low, high, 0.0, height))
    # A regular polygon of 48 sides covers this share of its circle.
    share = 24 * np.sin(2 * np.pi / 48) / np.pi
    squares = low**2 + low * high + high**2
    assert volume == pytest.approx(share * np.pi * height / 3 * squares)
    moment = low**2 + 2 * low * high + 3 * high**2
    assert centroid == pytest.approx([0, 0, height / 4 * moment / squares], abs=1e-12)


def test_staves_make_a_closed_wall_of_the_right_volume():
    wall = staves((0.08, 0.1), (0.08, 0.1), -0.2, 0.2)
    outside = 24 * np.sin(2 * np.pi / 48) * 0.1**2
    inside = 8 * np.sin(2 * np.pi / 16) * 0.08**2
    total = sum(volume_and_centroid(part)[0] for part in wall)
    assert total == pytest.approx(0.4 * (outside - inside))
    ring = np.linspace(0, 2 * np.pi, 400)
    middle = np.stack([0.09 * np.cos(ring), 0.09 * np.sin(ring), 0 * ring], axis=-1)
    nearest = np.min([part.signed_distance(middle) for part in wall], axis=0)
    assert (nearest <= 1e-9).all()
    assert min(part.signed_distance(np.zeros(3)) for part in wall) > 0.07


def test_a_prism_has_the_area_of_its_profile_times_its_length():
    volume, centroid = volume_and_centroid(prism([(0, 0), (0.3, 0), (0, 0.2)], 0.5))
    assert volume == pytest.approx(0.5 * 0.03)
    assert centroid == pytest.approx([0.0, 0.1, 0.2 / 3])


@pytest.mark.parametrize(
    "points",
    [np.zeros((4, 3)), np.eye(3), np.full((5, 3), np.nan), np.zeros((0, 3))],
    ids=["one place", "three points", "nan", "none"],
)
def test_points_that_span_no_volume_are_refused(points):
    with pytest.raises(InputError, match="points of a hull"):
        Hull.around(points)


def test_moving_there_and_back_changes_nothing():
    hull = frustum(0.1, 0.05, 0.0, 0.3)
    T = SE3.exp(np.array([0.3, -0.2, 0.5, 0.4, -0.1, 0.9]))
    back = hull.moved(T).moved(T.inverse())
    np.testing.assert_allclose(back.vertices, hull.vertices, atol=1e-12)
    np.testing.assert_allclose(back.offsets, hull.offsets, atol=1e-12)


def test_worlds_and_hulls_are_written_in_one_line():
    world = named_scene("hedgehog")
    assert repr(world) == "World('hedgehog', bodies=1)"
    corners = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, 8).T
    said = repr(Hull.around(corners))
    assert said == "Hull(8 corners, 12 faces, at [0.0, 0.0, 0.0])"
    assert len(repr(kinematics_hull.Hull(corners))) < 80
