from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3, Box, Capsule, Cylinder, Intrinsics, Sphere, so3
from debrisgrasp.worlds import (
    Body,
    Ground,
    PileConfig,
    World,
    draw_intrinsics,
    draw_view,
    frustum,
    generate_pile,
    look_at,
    render,
)
from debrisgrasp.worlds.raycast import first_hits

CAMERA = Intrinsics(fx=200.0, fy=200.0, cx=80.0, cy=60.0, width=161, height=121)
DOWN = SE3.from_parts(np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, 2.0])


def world_of(*parts, at=(0.0, 0.0, 0.0)):
    return World((Body("it", "part", parts, 1.0, SE3.from_parts(p=at)),))


def scattered(rng, n=4):
    """A pile that has not settled: parts interpenetrate, as they may."""
    config = PileConfig(n_bodies=(n, n), center=(1.2, 0.0), uneven_share=0.0)
    world = generate_pile(rng=rng, config=config)
    lift = SE3.from_parts(p=[0.0, 0.0, 0.3])
    return world.placed([lift @ body.T_base_body for body in world.bodies])


def traced(world, origin, rays):
    """Nearest triangle along each ray, one triangle after the other."""
    depth, label = np.full(len(rays), np.inf), np.zeros(len(rays), int)
    falling = rays[:, 2] < 0
    depth[falling] = -origin[2] / rays[falling, 2]
    for number, body in enumerate(world.bodies, start=1):
        vertices, faces = body.mesh()
        corners = body.T_base_body.apply(vertices)[faces]
        for a, b, c in corners:
            system = np.stack([-rays, *np.broadcast_arrays(b - a, c - a, rays)[:2]], -1)
            solvable = np.abs(np.linalg.det(system)) > 1e-12
            solution = np.full((len(rays), 3), -1.0)
            right = np.broadcast_to((origin - a)[:, None], (solvable.sum(), 3, 1))
            solution[solvable] = np.linalg.solve(system[solvable], right)[..., 0]
            t, u, v = solution.T
            hit = (t > 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t < depth)
            depth[hit], label[hit] = t[hit], number
    return depth, label


@pytest.mark.parametrize(
    ("part", "top"),
    [
        (Box(np.array([0.2, 0.3, 0.1])), 0.1),
        (Cylinder(0.1, 0.5), 0.25),
        (Sphere(0.15), 0.15),
        (Capsule(0.05, 0.3), 0.2),
        (frustum(0.2, 0.1, -0.2, 0.3), 0.3),
    ],
    ids=["box", "cylinder", "sphere", "capsule", "frustum"],
)
def test_the_depth_straight_below_is_height_minus_top(part, top):
    seen = render(world_of(part, at=(0, 0, 0.5)), CAMERA, DOWN)
    assert seen.depth[60, 80] == pytest.approx(1.5 - top)
    assert seen.labels[60, 80] == 1
    assert seen.depth[0, 0] == pytest.approx(2.0)
    assert seen.labels[0, 0] == 0


def test_a_lying_cylinder_is_seen_as_its_formula_says():
    radius = 0.2
    lying = Cylinder(
        radius, 3.0, SE3.from_parts(so3.from_rpy(np.array([0, np.pi / 2, 0])))
    )
    depth = render(world_of(lying, at=(0, 0, radius)), CAMERA, DOWN).depth[:, 80]
    y = (np.arange(CAMERA.height) - CAMERA.cy) / CAMERA.fy
    # Ray (0, y, 1) t from 1.8 above the axis: (1.8 - t)^2 + (y t)^2 = radius^2.
    a, b, c = 1 + y**2, -1.8, 1.8**2 - radius**2
    inner = b**2 - a * c
    expected = np.where(inner >= 0, (1.8 - np.sqrt(np.maximum(inner, 0))) / a, 2.0)
    np.testing.assert_allclose(depth, expected, atol=1e-9)


def test_the_edges_of_a_box_fall_on_the_right_pixels():
    seen = render(
        world_of(Box(np.array([0.1, 0.2, 0.5])), at=(0, 0, 0.5)), CAMERA, DOWN
    )
    rows, columns = np.nonzero(seen.labels == 1)
    assert (columns.min(), columns.max()) == (60, 100)
    assert (rows.min(), rows.max()) == (20, 100)


def test_depth_and_labels_are_those_of_rays_against_the_triangles(rng):
    world = scattered(rng)
    pose = look_at((0.0, 0.1, 1.3), (1.2, 0.0, 0.3))
    seen = render(world, CAMERA, pose)
    some = rng.choice(CAMERA.width * CAMERA.height, 400, replace=False)
    rays = CAMERA.deproject(np.ones((CAMERA.height, CAMERA.width))).reshape(-1, 3)
    depth, labels = traced(world, pose.p, pose.rotate(rays[some]))
    # The triangles of round parts are inscribed: their silhouettes are a bit smaller.
    agree = seen.labels.ravel()[some] == labels
    assert agree.mean() > 0.99
    assert (labels > 0).sum() > 60
    gap = np.abs(seen.depth.ravel()[some] - depth)[agree]
    assert gap.max() < 0.01
    assert np.median(gap) < 1e-9


@given(
    yaw=st.floats(-3.0, 3.0),
    shift=st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)),
    seed=st.integers(0, 50),
)
@settings(max_examples=12)
def test_world_and_camera_moved_together_give_the_same_picture(yaw, shift, seed):
    world = scattered(np.random.default_rng(seed), n=3)
    pose = look_at((0.0, 0.1, 1.3), (1.2, 0.0, 0.3))
    T = SE3.from_parts(so3.from_rpy(np.array([0.0, 0.0, yaw])), [*shift, 0.0])
    moved = world.placed([T @ body.T_base_body for body in world.bodies])
    before, after = render(world, CAMERA, pose), render(moved, CAMERA, T @ pose)
    same = before.labels == after.labels
    # Rounding decides at pixel centres that lie on an edge.
    assert same.mean() > 0.999
    np.testing.assert_allclose(after.depth[same], before.depth[same], atol=1e-6)


def test_rays_meet_uneven_ground_at_its_height(rng):
    ground = Ground.uneven(rng, peak_to_peak=0.05)
    assert np.ptp(ground.heights) == pytest.approx(0.05)
    far = Body("far", "part", (Sphere(0.05),), 1.0, SE3.from_parts(p=[50.0, 0, 0]))
    pose = look_at((0.0, 0.0, 1.3), (1.4, 0.0, 0.0))
    seen = render(World((far,), ground), CAMERA, pose)
    points = pose.apply(CAMERA.deproject(seen.depth))[seen.labels == 0]
    assert len(points) > 15000
    np.testing.assert_allclose(points[:, 2], ground.height(points[:, :2]), atol=2e-4)


def test_above_the_horizon_there_is_nothing():
    level = look_at((0.0, 0.0, 1.0), (1.0, 0.0, 1.0))
    seen = render(world_of(Sphere(0.1), at=(1.0, 0.0, 0.1)), CAMERA, level)
    assert (seen.labels[:60] == -1).all()
    assert (seen.depth[:60] == 0.0).all()
    assert np.isfinite(seen.depth).all()


def test_a_body_beside_and_behind_the_camera_is_cut_where_it_leaves_the_picture():
    # A rail that passes under the camera and on behind it.
    rail = world_of(Box(np.array([5.0, 0.05, 0.05])), at=(0.0, 0.0, 0.05))
    pose = look_at((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    seen = render(rail, CAMERA, pose)
    on_rail = pose.apply(CAMERA.deproject(seen.depth))[seen.labels == 1]
    assert len(on_rail) > 500
    assert np.abs(on_rail[:, 1]).max() <= 0.05 + 1e-9
    assert on_rail[:, 2].max() <= 0.1 + 1e-9


def test_extra_solids_occlude_and_get_the_next_label():
    class Plate:
        """A solid of a kind that the renderer doesn't know."""

        def __init__(self, box):
            self.box = box

        def __getattr__(self, name):
            return getattr(self.box, name)

        def moved(self, T):
            return Plate(self.box.moved(T))

    plate = Plate(Box(np.array([0.05, 0.05, 0.01]), SE3.from_parts(p=[0, 0, 1.0])))
    seen = render(world_of(Sphere(0.1)), CAMERA, DOWN, extra=[plate])
    assert seen.labels[60, 80] == 2
    assert seen.depth[60, 80] == pytest.approx(0.99)


def test_cameras_where_none_can_be_are_refused():
    world = world_of(Sphere(0.3), at=(0, 0, 1.0))
    with pytest.raises(InputError, match="above the ground"):
        render(world, CAMERA, SE3.from_parts(DOWN.R, [0, 0, -0.1]))
    with pytest.raises(InputError, match="inside it"):
        render(world, CAMERA, SE3.from_parts(DOWN.R, [0, 0, 1.0]))
    with pytest.raises(InputError, match="inside an extra solid"):
        render(world, CAMERA, DOWN, extra=[Sphere(0.1, DOWN.p)])
    with pytest.raises(InputError, match="T_base_camera"):
        render(world, CAMERA, SE3(np.full((4, 4), np.nan)))


def test_looking_straight_down_is_the_end_of_looking_ahead_and_down():
    down = look_at((0, 0, 1), (0, 0, 0))
    nearly = look_at((0, 0, 1), (1e-6, 0, 0))
    assert np.allclose(down.matrix, nearly.matrix, atol=1e-5)


def test_a_camera_cannot_look_at_where_it_is():
    with pytest.raises(InputError, match="where the camera is"):
        look_at((0, 0, 1), (0, 0, 1))


def test_drawn_views_look_at_their_target_from_the_side_of_the_robot(rng):
    target = np.array([1.4, 0.1, 0.1])
    for _ in range(20):
        pose, camera = draw_view(target, rng=rng), draw_intrinsics(rng)
        uv, depth = camera.project(pose.inverse().apply(target))
        assert np.hypot(*(uv - [camera.cx, camera.cy])) < 120
        assert 1.0 < depth < 3.2
        assert pose.p[0] < 1.0
        assert pose.R[2, 0] == pytest.approx(0.0, abs=1e-12)
        assert pose.R[2, 1] < 0.0


@pytest.mark.parametrize("heights", [np.zeros((1, 5)), np.full((3, 3), np.nan)])
def test_ground_that_is_no_grid_is_refused(heights):
    with pytest.raises(InputError, match="ground heights"):
        Ground(heights)


def test_the_picture_of_a_solid_beside_the_eye_is_no_smaller_for_the_search(rng):
    """A part of each stands behind the camera, or beside it."""
    rays = CAMERA.deproject(np.ones((CAMERA.height, CAMERA.width))).reshape(-1, 3)
    seen = 0
    for _ in range(150):
        half = 0.05 + 0.5 * rng.random(3)
        place = rng.uniform([-1.0, -1.0, 1.3], [1.0, 1.0, 2.7])
        turn = so3.exp(rng.standard_normal(3))
        box = Box(half, SE3.from_parts(turn, place))
        if box.signed_distance(DOWN.p) < 0.01:
            continue
        labels = render(world_of(box), CAMERA, DOWN).labels
        hits = first_hits(box.moved(DOWN.inverse()), np.zeros(3), rays)
        expected = hits < 2.0  # the ground
        assert (labels.ravel() == 1).tolist() == expected.tolist()
        seen += bool(expected.any())
    assert seen > 10
