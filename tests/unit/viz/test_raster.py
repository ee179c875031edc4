from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.geometry import Box, Sphere
from debrisgrasp.viz.raster import Mesh, Splats, render
from debrisgrasp.viz.scene import merged
from debrisgrasp.viz.view import View

WHITE = np.ones(3)
SIZE = (200, 150)
FORWARD = np.array([1.0, 0.0, 0.0])


def front_view(half: float = 1.0) -> View:
    """Look along x at a square of the given half width around the origin."""
    corners = half * np.array([[0, a, b] for a in (-1, 1) for b in (-1, 1)])
    return View.fitted(corners, FORWARD, SIZE, margin=1.0)


def wall(x: float, half: float, color: tuple[float, float, float]) -> Mesh:
    """A square across the line of sight that faces the eye."""
    corners = [[x, -half, -half], [x, half, -half], [x, half, half], [x, -half, half]]
    faces = np.array([[0, 2, 1], [0, 3, 2]])
    return Mesh(np.array(corners), faces, color)


def test_a_fitted_view_just_contains_its_points(rng: np.random.Generator) -> None:
    points = rng.normal(size=(300, 3)) * [1.0, 0.3, 0.2]
    view = View.fitted(points, [0.5, 0.4, -0.7], SIZE, margin=1.0)
    uv, depth = view.project(points)
    assert (depth > 0).all()
    edge = np.array(SIZE) / 2.0
    reach = np.abs(uv - (np.array(SIZE) - 1) / 2.0).max(axis=0)
    assert (reach <= edge + 1e-6).all()
    assert np.isclose(reach, edge).any()


def test_looking_straight_down_puts_x_up_and_y_left() -> None:
    corners = np.array([[-1, -1, 0], [1, 1, 0]], dtype=float)
    view = View.fitted(corners, [0.0, 0.0, -1.0], SIZE)
    (origin, ahead, left), _ = view.project(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]))
    assert ahead[1] < origin[1] - 10
    assert left[0] < origin[0] - 10


def test_the_nearer_of_two_walls_hides_the_other_whatever_the_order() -> None:
    near, far = wall(-0.2, 0.5, (1.0, 0.0, 0.0)), wall(0.2, 0.9, (0.0, 0.0, 1.0))
    pictures = [
        render(front_view(), meshes=order, background=WHITE).colors
        for order in ((near, far), (far, near))
    ]
    np.testing.assert_array_equal(*pictures)
    center, aside = pictures[0][75, 100], pictures[0][75, 45]
    assert center[0] > 0.3
    assert center[2] == 0.0
    assert aside[0] == 0.0
    assert aside[2] > 0.3


def test_walls_that_cross_hide_each_other_where_they_are_farther() -> None:
    upright = wall(0.0, 0.8, (1.0, 0.0, 0.0))
    slanted = Mesh(
        upright.vertices + upright.vertices[:, 1:2] * [0.5, 0.0, 0.0],
        upright.faces,
        (0.0, 0.0, 1.0),
    )
    shown = render(front_view(), meshes=(upright, slanted), background=WHITE).colors
    # y points left in the picture; there the slanted wall (x = y / 2) is farther.
    assert shown[75, 60, 0] > 0.3
    assert shown[75, 140, 2] > 0.3


def test_nearness_is_one_over_the_depth_of_a_slanted_triangle() -> None:
    corners = np.array([[-0.3, -0.9, -0.8], [0.4, 0.9, -0.7], [0.1, 0.2, 0.9]])
    mesh = Mesh(corners, np.array([[0, 2, 1]]))
    view = front_view()
    picture = render(view, meshes=[mesh], background=WHITE, oversampling=1)
    rows, columns = np.nonzero(picture.nearness)
    assert len(rows) > 1000
    k = view.intrinsics
    ray_eye = np.stack(
        [(columns - k.cx) / k.fx, (rows - k.cy) / k.fy, np.ones(len(rows))], axis=1
    )
    ray = view.T_base_eye.rotate(ray_eye)
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    depth = ((corners[0] - view.T_base_eye.p) @ normal) / (ray @ normal)
    np.testing.assert_allclose(picture.nearness[rows, columns], 1 / depth, rtol=1e-5)


def test_a_triangle_covers_as_many_pixels_as_its_area() -> None:
    corners = np.array([[0.0, -0.9, -0.8], [0.0, 0.9, -0.7], [0.0, 0.2, 0.9]])
    view = front_view()
    mesh = Mesh(corners, np.array([[0, 2, 1]]))
    picture = render(view, meshes=[mesh], background=WHITE, oversampling=1)
    a, b, c = view.project(corners)[0]
    area = 0.5 * abs((b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0])
    assert np.count_nonzero(picture.nearness) == pytest.approx(area, rel=0.02)


def test_a_closed_solid_has_no_cracks() -> None:
    ball = merged([Sphere(0.8, np.zeros(3))], (0.5, 0.5, 0.5))
    picture = render(front_view(), meshes=[ball], background=WHITE, oversampling=1)
    drawn = picture.nearness > 0
    first, last = drawn.argmax(axis=1), SIZE[0] - 1 - drawn[:, ::-1].argmax(axis=1)
    rows = drawn.any(axis=1)
    np.testing.assert_array_equal(drawn.sum(axis=1)[rows], (last - first + 1)[rows])


def test_triangles_that_face_away_are_not_drawn() -> None:
    shown = wall(0.0, 0.5, (1.0, 0.0, 0.0))
    turned = Mesh(shown.vertices, shown.faces[:, ::-1], shown.color)
    picture = render(front_view(), meshes=[turned], background=WHITE)
    assert not picture.nearness.any()


def test_what_lies_behind_the_eye_is_not_drawn() -> None:
    view = front_view()
    behind = view.T_base_eye.p - [0.5, 0.0, 0.0]
    box = merged([Box(np.full(3, 0.1))], (0.0, 0.0, 0.0))
    mesh = Mesh(box.vertices + behind, box.faces, box.color)
    dots = Splats(behind[None], np.zeros((1, 3)), np.full(1, 0.1))
    picture = render(view, [dots], [mesh], background=WHITE)
    np.testing.assert_array_equal(picture.colors, 1.0)


def test_sources_name_the_splat_and_not_the_mesh() -> None:
    dots = Splats(
        np.array([[0.0, 0.5, 0.0], [0.0, -0.5, 0.0]]), np.zeros((2, 3)), np.full(2, 0.1)
    )
    picture = render(
        front_view(), [dots], [wall(0.3, 0.2, (1.0, 0.0, 0.0))], background=WHITE
    )
    assert picture.sources[75, 62] == 0
    assert picture.sources[75, 137] == 1
    assert picture.sources[75, 100] == -1
    assert picture.nearness[75, 100] > 0


def test_a_splat_at_the_border_is_cut_and_not_wrapped() -> None:
    view = front_view()
    left_edge = np.array([[0.0, 1.0 * SIZE[0] / SIZE[1], 0.0]])
    dots = Splats(left_edge, np.zeros((1, 3)), np.full(1, 0.05))
    picture = render(view, [dots], background=WHITE)
    assert picture.nearness[:, :4].any()
    assert not picture.nearness[:, 100:].any()


def test_an_empty_scene_is_background() -> None:
    nothing = Splats(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    picture = render(front_view(), [nothing], [merged((), (0, 0, 0))], background=WHITE)
    np.testing.assert_array_equal(picture.colors, 1.0)
