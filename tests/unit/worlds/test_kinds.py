from __future__ import annotations

import numpy as np
import pytest
import trimesh

from debrisgrasp.errors import InputError, UnknownNameError
from debrisgrasp.geometry import SE3, Box
from debrisgrasp.worlds import (
    KINDS,
    Body,
    World,
    draw_body,
    make_body,
    volume_and_centroid,
)


@pytest.mark.parametrize("kind", KINDS)
def test_every_part_is_watertight_and_has_the_volume_of_its_formula(kind, rng):
    body = draw_body(kind, rng=rng)
    for part in body.parts:
        vertices, faces = part.mesh()
        mesh = trimesh.Trimesh(vertices, faces, process=False)
        volume, centroid = volume_and_centroid(part)
        assert mesh.is_watertight
        # Meshes of round solids are inscribed: 24 sides lose 1.1 % of a cylinder.
        assert mesh.volume == pytest.approx(volume, rel=0.025)
        np.testing.assert_allclose(mesh.center_mass, centroid, atol=1e-6)
    whole = trimesh.Trimesh(*body.mesh(), process=False)
    assert whole.is_watertight
    assert whole.volume == pytest.approx(body.volume, rel=0.025)


@pytest.mark.parametrize("kind", KINDS)
def test_sizes_and_mass_are_in_range_and_rebuild_the_body(kind, rng):
    for _ in range(3):
        body = draw_body(kind, rng=rng)
        low, high = KINDS[kind].mass
        assert 0.5 <= low <= body.mass <= high <= 8.0
        assert body.density == pytest.approx(body.mass / body.volume)
        for size, value in body.sizes.items():
            assert KINDS[kind].sizes[size][0] <= value <= KINDS[kind].sizes[size][1]
        again = make_body(kind, body.sizes, body.mass)
        np.testing.assert_array_equal(again.mesh()[0], body.mesh()[0])
        np.testing.assert_allclose(body.center_of_mass, 0.0, atol=1e-9)


def test_the_center_of_mass_of_an_open_crate_is_below_its_middle():
    sizes = {"length": 0.4, "width": 0.3, "height": 0.2, "wall": 0.01}
    low, high = make_body("crate", sizes, 1.0).mesh()[0][:, 2][[0, -1]]
    body = make_body("crate", sizes, 1.0)
    heights = body.mesh()[0][:, 2]
    # By hand: bottom 1.2e-3 m3 at 0.5 cm, walls 2.584e-3 m3 at 10.5 cm.
    expected = (1.2e-3 * 0.005 + 2.584e-3 * 0.105) / (1.2e-3 + 2.584e-3)
    assert heights.min() == pytest.approx(-expected)
    assert heights.max() == pytest.approx(0.2 - expected)
    assert low < high


@pytest.mark.parametrize("mass", [0.0, -1.0, 2e5, np.nan, np.inf])
def test_a_mass_that_no_body_has_is_refused(mass):
    with pytest.raises(InputError, match="mass"):
        Body("it", "box", (Box(np.ones(3)),), mass)


@pytest.mark.parametrize(
    "matrix",
    [np.full((4, 4), np.nan), 2.0 * np.eye(4), np.diag([1.0, 1.0, -1.0, 1.0])],
    ids=["nan", "scaled", "mirrored"],
)
def test_a_pose_that_is_not_rigid_is_refused(matrix):
    body = Body("it", "box", (Box(np.ones(3)),), 1.0)
    with pytest.raises(InputError, match="pose of it"):
        body.at(SE3(matrix))


def test_bodies_without_parts_and_worlds_without_or_with_equal_bodies_are_refused():
    with pytest.raises(InputError, match="parts of it"):
        Body("it", "box", (), 1.0)
    with pytest.raises(InputError, match="bodies of a world"):
        World(())
    body = Body("it", "box", (Box(np.ones(3)),), 1.0)
    with pytest.raises(InputError, match="names of bodies"):
        World((body, body))
    with pytest.raises(UnknownNameError, match="Did you mean 'it'"):
        World((body,)).without("itt")


def test_unknown_kinds_and_sizes_are_refused(rng):
    with pytest.raises(UnknownNameError, match="'bucket'"):
        draw_body("buckets", rng=rng)
    with pytest.raises(InputError, match="sizes of a pipe"):
        make_body("pipe", {"length": 1.0}, 1.0)
    with pytest.raises(InputError, match="radius of a pipe"):
        make_body("pipe", {"length": 1.0, "radius": -0.1}, 1.0)
    with pytest.raises(InputError, match="mass of pipe: got 1500000"):
        make_body("pipe", {"length": 1.0, "radius": 0.1}, 1.5e6)
