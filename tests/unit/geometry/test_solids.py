"""Distances, meshes and sphere covers of the primitive solids."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose

from debrisgrasp.errors import InputError, ShapeError
from debrisgrasp.geometry import SE3, Box, Capsule, Cylinder, Sphere, so3

T = SE3.from_parts(so3.exp(np.array([0.4, -0.7, 1.1])), [0.3, -0.2, 0.5])
SOLIDS = [
    Box([0.1, 0.2, 0.03], T),
    Sphere(0.1, [0.3, 0.1, -0.2]),
    Cylinder(0.05, 0.3, T),
    Cylinder(0.2, 0.02, T),
    Capsule(0.05, 0.3, T),
    Capsule(0.08, 0.0, T),
]
each_solid = pytest.mark.parametrize("solid", SOLIDS, ids=lambda s: type(s).__name__)


def points_around(solid, rng, n=4000):
    bounds = solid.bounds.grown(0.05)
    return rng.uniform(bounds.lower, bounds.upper, (n, 3))


@each_solid
def test_distance_to_the_surface_is_that_to_the_nearest_surface_point(solid, rng):
    points = points_around(solid, rng, 150)
    surface = trimesh.Trimesh(*solid.mesh(), process=False)
    _, distance, _ = trimesh.proximity.closest_point_naive(surface, points)
    facet_error = 0.01 * float(solid.bounds.size.max())
    assert_allclose(np.abs(solid.signed_distance(points)), distance, atol=facet_error)


@each_solid
def test_distance_changes_at_most_as_fast_as_the_point_moves(solid, rng):
    a, b = points_around(solid, rng), points_around(solid, rng)
    change = np.abs(solid.signed_distance(a) - solid.signed_distance(b))
    assert (change <= np.linalg.norm(a - b, axis=1) + 1e-12).all()


@each_solid
def test_vertices_lie_on_the_surface_and_triangles_face_outwards(solid):
    vertices, faces = solid.mesh()
    assert_allclose(solid.signed_distance(vertices), 0.0, atol=1e-12)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0


@pytest.mark.parametrize(
    ("solid", "volume"),
    [
        (SOLIDS[0], 8 * 0.1 * 0.2 * 0.03),
        (SOLIDS[1], 4 / 3 * np.pi * 0.1**3),
        (SOLIDS[2], np.pi * 0.05**2 * 0.3),
        (SOLIDS[4], np.pi * 0.05**2 * 0.3 + 4 / 3 * np.pi * 0.05**3),
    ],
    ids=["Box", "Sphere", "Cylinder", "Capsule"],
)
def test_the_share_of_random_points_inside_is_the_volume(solid, volume, rng):
    bounds = solid.bounds
    inside = solid.contains(rng.uniform(bounds.lower, bounds.upper, (200_000, 3)))
    assert_allclose(inside.mean() * np.prod(bounds.size), volume, rtol=0.02)


@each_solid
@pytest.mark.parametrize("max_radius", [0.02, 0.06, 0.4])
def test_every_point_of_the_solid_lies_in_some_sphere(solid, max_radius, rng):
    centers, radii = solid.sphere_cover(max_radius)
    assert radii.max() <= max_radius + 1e-12
    points = points_around(solid, rng)
    points = np.concatenate([points[solid.contains(points)], solid.mesh()[0]])
    gaps = np.linalg.norm(points[:, None] - centers, axis=-1) - radii
    assert gaps.min(axis=1).max() <= 1e-12


@each_solid
def test_no_sphere_of_the_cover_is_apart_from_the_solid(solid):
    centers, radii = solid.sphere_cover(0.03)
    assert (solid.signed_distance(centers) <= radii).all()


@each_solid
def test_bounds_touch_the_solid_on_all_sides(solid):
    lower, upper = solid.bounds.lower, solid.bounds.upper
    vertices, _ = solid.mesh()
    slack = 0.01 * float(solid.bounds.size.max())
    assert (vertices >= lower - 1e-12).all()
    assert (vertices <= upper + 1e-12).all()
    assert_allclose(vertices.min(axis=0), lower, atol=slack)
    assert_allclose(vertices.max(axis=0), upper, atol=slack)


@each_solid
def test_moving_solid_and_points_together_changes_no_distance(solid, rng):
    T_new_base = SE3.from_parts(so3.exp(rng.normal(size=3)), rng.normal(size=3))
    points = points_around(solid, rng, 200)
    moved = solid.moved(T_new_base)
    assert type(moved) is type(solid)
    assert_allclose(
        moved.signed_distance(T_new_base.apply(points)),
        solid.signed_distance(points),
        atol=1e-12,
    )


@each_solid
def test_any_leading_axes_of_points_are_kept(solid, rng):
    points = rng.normal(size=(2, 3, 4, 3))
    assert solid.signed_distance(points).shape == (2, 3, 4)
    assert solid.contains(points[0, 0, 0]).shape == ()


@pytest.mark.parametrize(
    "build",
    [
        lambda: Box([0.1, 0.0, 0.1]),
        lambda: Box([0.1, np.nan, 0.1]),
        lambda: Sphere(-0.1),
        lambda: Cylinder(0.1, 0.0),
        lambda: Cylinder(np.inf, 0.1),
        lambda: Capsule(0.0, 0.1),
        lambda: Capsule(0.1, -0.1),
        lambda: Box([0.1, 0.1, 0.1]).sphere_cover(0.0),
        lambda: Sphere(0.1).sphere_cover(np.nan),
    ],
)
def test_sizes_without_sense_are_refused(build):
    with pytest.raises(InputError):
        build()


def test_a_batch_of_poses_is_refused():
    with pytest.raises(ShapeError, match="pose of a solid"):
        Cylinder(0.1, 0.1, SE3(np.tile(np.eye(4), (2, 1, 1))))


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (
            lambda: Box([1, 1, 1], np.eye(4)),
            r"pose of a solid: got ndarray.*from_matrix",
        ),
        (lambda: Box(np.ones((2, 3))), "half extents of a box"),
        (lambda: Sphere([0.1, 0.2]), r"radius of a sphere: got \[\[0.1, 0.2\]\]"),
        (lambda: Sphere(0.1, np.zeros((2, 3))), "center of a solid: got a batch"),
        (lambda: Cylinder("a", 1.0), "radius and length of a cylinder: got tuple"),
        (lambda: Capsule(0.1, np.nan), "length of a capsule"),
        (lambda: Capsule(0.1, -1.0), "length of a capsule"),
    ],
)
def test_what_is_not_one_solid_is_refused_in_words(build, words):
    with pytest.raises(InputError, match=words):
        build()
