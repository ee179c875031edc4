"""Sampled surfaces: on the surface, outward, evenly dense, symmetric as claimed."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from debrisgrasp.geometry.sampling import fibonacci_sphere
from debrisgrasp.prototypes.shapes import (
    BarShape,
    BoxShape,
    CellShape,
    CylinderShape,
    EdgeShape,
    HandleShape,
    RimShape,
    RungShape,
    Shape,
)
from debrisgrasp.prototypes.surfaces import sample
from debrisgrasp.prototypes.visibility import visible_points

SHAPES = {
    "cylinder": CylinderShape(diameter=0.05, length=0.14),
    "closed cylinder": CylinderShape(diameter=0.08, length=0.1, ends="closed"),
    "bar": BarShape(width=0.038, height=0.089, length=0.14),
    "square bar": BarShape(width=0.089, height=0.089, length=0.14),
    "box": BoxShape(width=0.065, length=0.215, height=0.102),
    "cube": BoxShape(width=0.1, length=0.1, height=0.1),
    "edge": EdgeShape(thickness=0.019, length=0.14, depth=0.08),
    "corner": EdgeShape(thickness=0.019, length=0.14, depth=0.08, ends="one"),
    "plank end": EdgeShape(thickness=0.038, length=0.089, depth=0.08, ends="both"),
    "rim": RimShape(thickness=0.01, diameter=0.3, length=0.14, depth=0.08),
    "half pipe": RimShape(thickness=0.02, diameter=0.1, length=0.5, depth=0.05),
    "handle": HandleShape(diameter=0.025, length=0.16, standoff=0.06, plate=0.12),
    "rung": RungShape(diameter=0.028, length=0.3),
    "cell": CellShape(thickness=0.03, length=0.14, depth=0.09, web=0.03, reach=0.1),
    "free handle": HandleShape(diameter=0.032, length=0.2, standoff=0.07),
}

# Closed forms, in square metres, of what is a surface and not a cut.
AREAS = {
    "cylinder": np.pi * 0.05 * 0.14,
    "closed cylinder": np.pi * (0.08 * 0.1 + 2 * 0.04**2),
    "bar": 2 * (0.038 + 0.089) * 0.14,
    "box": 2 * (0.065 * 0.215 + 0.065 * 0.102 + 0.215 * 0.102),
    "edge": (0.019 + 2 * 0.08) * 0.14,
    "corner": (0.019 + 2 * 0.08) * 0.14 + 0.019 * 0.08,
    "plank end": (0.038 + 2 * 0.08) * 0.089 + 2 * 0.038 * 0.08,
    "cell": 0.2 * 0.09 + (0.14 + 2 * 0.1) * 0.09 + 0.03 * 0.2 + 2 * 0.03 * 0.1,
    "half pipe": np.pi * (0.05 + 0.03) * 0.05 + np.pi / 2 * (0.05**2 - 0.03**2),
}


@pytest.fixture(params=SHAPES)
def shape(request: pytest.FixtureRequest) -> Shape:
    return SHAPES[request.param]


def distance(shape: Shape, points: np.ndarray) -> np.ndarray:
    return np.min([part.signed_distance(points) for part in shape.parts()], axis=0)


def test_points_lie_on_the_surface_and_normals_point_out(shape: Shape) -> None:
    points, normals = sample(shape.patches(), shape.parts(), 2e4)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1)
    assert np.abs(distance(shape, points)).max() < 2e-6
    assert (distance(shape, points + 1e-3 * normals) > 1e-5).mean() > 0.97
    assert (distance(shape, points - 1e-3 * normals) < 0).all()


@pytest.mark.parametrize("name", AREAS)
def test_every_shape_gets_one_point_per_square_centimetre(name: str) -> None:
    points, _ = sample(SHAPES[name].patches(), SHAPES[name].parts(), 1e4)
    assert len(points) == pytest.approx(1e4 * AREAS[name], abs=3)


def test_points_are_spread_evenly(shape: Shape) -> None:
    points, _ = sample(shape.patches(), shape.parts(), 1e4)
    nearest = cKDTree(points).query(points, k=2)[0][:, 1]
    # 1 cm is the mean distance; clumps and holes would show as far smaller, or larger.
    assert np.median(nearest) == pytest.approx(0.008, abs=0.0025)
    dense, _ = sample(shape.patches(), shape.parts(), 2e5)
    assert cKDTree(points).query(dense)[0].max() < 0.016


def test_symmetries_map_the_surface_onto_itself(shape: Shape) -> None:
    points, normals = sample(shape.patches(), shape.parts(), 1e4)
    dense, dense_normals = sample(shape.patches(), shape.parts(), 4e5)
    tree = cKDTree(dense)
    elements = shape.symmetry().elements(5)
    assert np.allclose(elements.matrix[0], np.eye(4))
    for index in range(elements.batch[0]):
        away, nearest = tree.query(elements[index].apply(points))
        # Points that share a place, at edges, may differ in their normals.
        turned = (elements[index].rotate(normals) * dense_normals[nearest]).sum(axis=1)
        assert away.max() < 0.004
        assert (turned > 0.95).mean() > 0.9


@pytest.mark.parametrize(
    ("name", "count"),
    [("bar", 4), ("square bar", 8), ("box", 4), ("cube", 24), ("edge", 2), ("rim", 1)],
)
def test_symmetry_groups_have_the_known_sizes(name: str, count: int) -> None:
    assert SHAPES[name].symmetry().turns.batch == (count,)


def test_visibility_agrees_with_marching_along_the_line_of_sight(
    shape: Shape,
) -> None:
    points, normals = sample(shape.patches(), shape.parts(), 5e3)
    directions = fibonacci_sphere(24)
    seen = visible_points(points, normals, shape.parts(), directions)
    view, point = np.nonzero(directions @ normals.T > np.cos(np.deg2rad(80)))
    steps = np.linspace(0.001, 0.4, 800)
    start = points[point] + 1e-4 * normals[point]
    along = start[:, None] + steps[:, None] * directions[view][:, None]
    is_blocked = (distance(shape, along) < 0).any(axis=1)
    # Marching can miss a chord shorter than its step, so a few rays may differ.
    assert (seen[view, point] == ~is_blocked).mean() > 0.995
    assert seen.sum() == seen[view, point].sum()


def test_surface_seen_at_more_than_80_degrees_is_hidden() -> None:
    edge = SHAPES["edge"]
    points, normals = sample(edge.patches(), edge.parts(), 1e4)
    angle = np.deg2rad([79.0, 81.0])
    towards = np.stack([np.cos(angle), 0 * angle, -np.sin(angle)], axis=1)
    seen = visible_points(points, normals, edge.parts(), towards)
    is_broad = normals[:, 0] > 0.5
    assert seen[0, is_broad].all()
    assert not seen[1, is_broad].any()


def test_the_handle_hides_part_of_its_plate() -> None:
    handle = SHAPES["handle"]
    points, normals = sample(handle.patches(), handle.parts(), 2e4)
    seen = visible_points(points, normals, handle.parts(), np.array([[0.0, 0, -1]]))[0]
    on_plate = np.isclose(points[:, 2], 0.06) & (normals[:, 2] < -0.5)
    below_bar = (np.abs(points[:, 0]) < 0.012) & (np.abs(points[:, 1]) < 0.08)
    assert not seen[on_plate & below_bar].any()
    assert seen[on_plate & (np.abs(points[:, 0]) > 0.014)].all()
