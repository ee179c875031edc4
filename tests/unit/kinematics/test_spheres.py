from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3, Box, Capsule, Cylinder, Solid, Sphere, so3
from debrisgrasp.kinematics.gaps import SolidGap
from debrisgrasp.kinematics.hull import Hull
from debrisgrasp.kinematics.spheres import covering_spheres

length = st.floats(0.005, 0.4)


@st.composite
def solids(draw: st.DrawFn) -> Solid:
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    T = SE3.from_parts(so3.exp(rng.normal(size=3)), rng.normal(size=3))
    a, b, c = draw(length), draw(length), draw(length)
    kind = draw(st.sampled_from(["box", "sphere", "cylinder", "capsule", "hull"]))
    if kind == "box":
        return Box(np.array([a, b, c]), T)
    if kind == "sphere":
        return Sphere(a, T.p)
    if kind == "cylinder":
        return Cylinder(a, b, T)
    if kind == "capsule":
        return Capsule(a, b, T)
    return Hull(rng.normal(size=(draw(st.integers(5, 200)), 3)) * (a, b, c), T)


def _inside(solid: Solid, n: int) -> np.ndarray:
    """Points of a solid, corners and surface among them."""
    rng = np.random.default_rng(0)
    vertices, faces = solid.mesh()
    weights = rng.dirichlet((0.3, 0.3, 0.3), n)
    surface = vertices[faces[rng.integers(len(faces), size=n)]] * weights[..., None]
    return np.concatenate([vertices, surface.sum(axis=1)])


@given(solids(), st.floats(0.003, 0.1), st.sampled_from([np.inf, 0.08]))
def test_spheres_cover_every_point_of_a_solid(
    solid: Solid, excess: float, max_radius: float
) -> None:
    centers, radii = covering_spheres(solid, excess, max_radius)
    assert (radii <= max_radius + 1e-12).all()
    points = _inside(solid, 300)
    gap = np.linalg.norm(points[:, None] - centers, axis=-1) - radii
    assert gap.min(axis=1).max() < 1e-9


@given(solids(), st.integers(0, 1000))
def test_single_precision_gaps_equal_the_solid_s_own(solid: Solid, seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(scale=0.5, size=(40, 3)) + solid.bounds.lower
    gap = SolidGap.of(solid)(points.T.astype(np.float32))
    np.testing.assert_allclose(gap, solid.signed_distance(points), atol=5e-6)


def test_spheres_of_a_box_stand_out_no_more_than_allowed() -> None:
    box = Box(np.array([0.05, 0.06, 0.08]))
    centers, radii = covering_spheres(box, 0.03)
    assert (box.signed_distance(centers) + radii).max() <= 0.03
    finer = covering_spheres(box, 0.02)
    assert len(finer[1]) > len(radii)


def test_planes_of_a_hull_enclose_it_and_few_faces_are_exact(
    rng: np.random.Generator,
) -> None:
    corners = np.array(list(np.ndindex(2, 2, 2))) - 0.5
    cube = Hull(corners)
    assert cube.is_exact
    points = rng.uniform(-1, 1, (200, 3))
    inside = (np.abs(points) < 0.5).all(axis=1)
    np.testing.assert_array_equal(cube.contains(points), inside)
    ball = rng.normal(size=(2000, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    many = Hull(ball)
    assert not many.is_exact
    assert many.signed_distance(ball).max() < 1e-9
    far = 3.0 * ball[:50]
    distance = many.signed_distance(far)
    assert (distance <= 2.0 + 1e-9).all()
    assert (distance > 1.8).all()


def test_a_hull_s_mesh_is_wound_outwards() -> None:
    vertices, faces = Hull(np.random.default_rng(1).normal(size=(30, 3))).mesh()
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    volume = (np.cross(a, b) * c).sum() / 6.0
    assert volume > 0
    outwards = (np.cross(b - a, c - a) * (a - vertices.mean(axis=0))).sum(axis=1)
    assert (outwards > 0).all()


def test_points_in_a_plane_span_no_hull() -> None:
    flat = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.0]])
    with pytest.raises(InputError, match="one plane"):
        Hull(flat)
