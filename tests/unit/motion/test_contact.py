"""Spheres, grids and solids against brute force."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.errors import InputError, ShapeError
from debrisgrasp.geometry import SE3, DepthSight, Intrinsics, PointCloud
from debrisgrasp.kinematics import ArmCollision, ArmReach, RobotModel
from debrisgrasp.motion import MotionSpace, UnknownSpace
from debrisgrasp.motion.spheres import ArmSpheres, SphereTest
from tests.unit.kinematics.robots import JointText, row_robot

from .conftest import GROUND


@pytest.fixture(scope="module")
def clutter() -> MotionSpace:
    """Crumbs all over the workspace."""
    rng = np.random.default_rng(5)
    points = rng.uniform([0.7, -1.1, 0.02], [1.4, 0.2, 0.8], (40, 3))
    return MotionSpace.from_points(points, ground_plane=GROUND)


@pytest.fixture(scope="module")
def postures(arm) -> np.ndarray:
    rng = np.random.default_rng(6)
    q = arm.q_present + rng.normal(0.0, 0.5, (120, 8))
    return np.clip(q, arm.chain.lower, arm.chain.upper)


def by_brute_force(arm, space: MotionSpace, q: np.ndarray, margin: float) -> bool:
    """Every solid that moves, placed by the robot model, against every point."""
    moved = dict(zip(arm.joint_names, q, strict=True))
    moving = {p.link for p in arm.collision.body.parts if p.segment > 0}
    for link, solid in arm.robot.links_solids(moved):
        if link not in moving:
            continue
        if (solid.signed_distance(space.measured_points) < margin).any():
            return False
        if solid.mesh()[0][:, 2].min() < margin:
            return False
    return True


def test_balls_cover_all_that_moves_and_the_idle_arm_with_the_trunk(
    arm, planner, postures
):
    moving = {p.link for p in arm.collision.body.parts if p.segment > 0}
    assert "left_arm_link4" in moving
    rng = np.random.default_rng(7)
    for q in postures[:10]:
        balls = planner.balls_at(q, 0.0)
        posed = arm.robot.links_solids(dict(zip(arm.joint_names, q, strict=True)))
        for solid in (solid for link, solid in posed if link in moving):
            low, high = solid.bounds.lower, solid.bounds.upper
            points = rng.uniform(low, high, (300, 3))
            points = points[solid.signed_distance(points) < 0.0]
            away = np.linalg.norm(points[:, None] - balls[:, :3], axis=2) - balls[:, 3]
            assert (away.min(axis=1) < 1e-6).all()


def test_exact_contact_equals_brute_force(arm, planner, clutter, postures):
    test = planner.exact_test(clutter)
    oracle = [by_brute_force(arm, clutter, q, test.margin) for q in postures]
    body = ArmCollision(body=test.arm.body, self_margin=test.self_margin)
    oracle = np.array(oracle) & ~body.hits_itself(postures)
    np.testing.assert_array_equal(test.is_free(postures), oracle)
    assert 10 < oracle.sum() < 110


def test_contacts_name_the_links_and_what_they_touch(arm, planner):
    palm = arm.chain.fk(arm.q_present).p
    space = MotionSpace.from_points(palm[None], ground_plane=GROUND)
    found = planner.exact_test(space).contacts(arm.q_present)
    assert found
    assert all("robotiq" in contact.link for contact in found)
    assert {contact.what for contact in found} == {"a measured surface"}
    assert not planner.exact_test(space, with_hand=False).contacts(arm.q_present)


def test_spheres_that_are_sure_are_right(arm, planner, clutter, postures):
    exact = planner.exact_test(clutter)
    spheres = SphereTest(
        arm=ArmSpheres(arm.collision.body),
        space=clutter,
        margin=exact.margin,
        self_margin=exact.self_margin,
        is_strict=True,
    )
    sure, right = spheres(postures), exact.is_free(postures)
    assert right[sure].all()
    assert sure.sum() > 0.5 * right.sum()


def test_an_endless_first_joint_may_have_turned_often(tmp_path):
    beam = '<collision><origin xyz="0.2 0 0"/><geometry><box size="0.4 0.1 0.05"/>'
    beam += "</geometry></collision>"
    endless = JointText(kind="continuous")
    arm = ArmReach(RobotModel.load(row_robot(tmp_path, beam, joint=endless)), "one")
    wall = np.mgrid[-0.4:-0.3:0.01, -0.1:0.1:0.01, 0.1:0.3:0.01].reshape(3, -1).T
    test = SphereTest(
        arm=ArmSpheres(arm.collision.body),
        space=MotionSpace.from_points(wall),
        margin=0.005,
        self_margin=0.0,
    )
    q = np.zeros((3, 6))
    q[:, 0] = 0.0, 1.5, 3.0
    assert test(q).tolist() == [True, True, False]
    turn = np.eye(6)[0] * 2.0 * np.pi
    for turns in (-3, -1, 1, 4):
        assert (test(q + turns * turn) == test(q)).all()


def test_spheres_see_near_points_as_brute_force_does(rng, clutter):
    centers = rng.uniform([0.2, -1.1, -0.1], [1.5, 0.8, 1.0], (3000, 3))
    radii = rng.uniform(0.01, 0.08, 3000)
    away = np.linalg.norm(centers[:, None] - clutter.measured_points, axis=-1).min(1)
    near = (away < radii + 0.01) | (centers[:, 2] < radii + 0.01)
    assert 300 < near.sum() < 2700
    each = {
        is_strict: np.array(
            [
                clutter.hits(
                    c[:, None, None].astype(np.float32),
                    np.full((1, 1), r, np.float32),
                    0.01,
                    is_strict=is_strict,
                )[0]
                for c, r in zip(centers, radii, strict=True)
            ]
        )
        for is_strict in (False, True)
    }
    np.testing.assert_array_equal(each[True], near)
    # The grid keeps one point a cell, so that it misses a few.
    assert not (each[False] & ~near).any()
    assert np.count_nonzero(each[False] != near) < 30


def looking_down() -> tuple[PointCloud, DepthSight]:
    """A camera 1 m above a table 0.3 m wide that hides the ground below it."""
    camera = Intrinsics(fx=100.0, fy=100.0, cx=49.5, cy=49.5, width=100, height=100)
    T = SE3.from_parts(np.diag([1.0, -1.0, -1.0]), np.array([1.0, 0.0, 1.0]))
    v, u = np.mgrid[0:100, 0:100]
    is_table = (np.abs(u - 49.5) < 25) & (np.abs(v - 49.5) < 25)
    depth = np.where(is_table, 0.6, 1.0).astype(np.float32)
    rays = np.stack([(u - 49.5) / 100.0, (v - 49.5) / 100.0, np.ones(u.shape)], axis=-1)
    points = T.apply((rays * depth[..., None]).reshape(-1, 3))
    cloud = PointCloud(points, np.full(points.shape, np.nan), T.p)
    return cloud, DepthSight(depth, camera, T)


@pytest.mark.parametrize(
    ("unknown", "below", "beside"),
    [
        (UnknownSpace.IGNORED, False, False),
        (UnknownSpace.HIDDEN, True, False),
        (UnknownSpace.ALL, True, True),
    ],
)
def test_what_counts_as_unknown_is_the_policys_choice(unknown, below, beside):
    cloud, sight = looking_down()
    space = MotionSpace.build(cloud, sight, GROUND, unknown=unknown)
    radius = np.full((1, 1), 0.03, np.float32)

    def hits(x, y, z):
        return bool(space.hits(np.float32([x, y, z]).reshape(3, 1, 1), radius, 0.0)[0])

    assert hits(1.0, 0.0, 0.4)  # the table
    assert not hits(1.0, 0.0, 0.6)  # above it
    assert hits(1.0, 0.0, 0.2) is below
    assert hits(1.45, 0.45, 0.3) is beside  # outside the camera's view


@pytest.mark.parametrize(
    ("points", "error", "words"),
    [
        (np.zeros(3), ShapeError, r"expected \(n, 3\)"),
        (np.array([[1.0, 0.0, np.nan]]), InputError, "NaN or infinite"),
        (
            np.array([[900.0, 0.0, 300.0], [1100.0, 0.0, 0.0]]),
            InputError,
            "millimetres",
        ),
    ],
)
def test_points_that_are_no_obstacles_are_refused(points, error, words):
    with pytest.raises(error, match=words):
        MotionSpace.from_points(points)


def test_points_far_away_are_no_obstacles():
    points = np.array([[1.0, 0.0, 0.3], [50.0, 0.0, 0.0]])
    assert MotionSpace.from_points(points).measured_points == pytest.approx(points[:1])


@pytest.mark.parametrize(
    ("plane", "error", "words"),
    [
        ([0.0, 0.0, np.nan, 0.0], InputError, "1 of 4 values NaN"),
        ([0.0, 0.0, 2.0, 0.0], InputError, "normal: got 2, expected 1"),
        ([0.0, 0.0, 0.0, 0.0], InputError, "normal: got 0"),
        ([0.0, 0.0, 1.0, 1000.0], InputError, "millimetres"),
        ([0.0, 0.0, 1.0], ShapeError, r"got \(3,\)"),
        ([[0.0, 0.0, 1.0, 0.0]], ShapeError, r"got \(1, 4\)"),
    ],
)
def test_a_ground_that_would_be_none_is_refused(plane, error, words):
    with pytest.raises(error, match=words):
        MotionSpace.from_points(np.zeros((0, 3)), ground_plane=plane)


def test_a_ground_may_be_a_list_and_is_kept_from_changes():
    given = np.array([0, 0, 1, 0])
    space = MotionSpace.from_points(np.zeros((0, 3)), ground_plane=given)
    given[:] = 7
    np.testing.assert_array_equal(space.ground_plane, [0.0, 0.0, 1.0, 0.0])
    assert MotionSpace.from_points([[0, 0, 1]], ground_plane=[0, 0, 1, 0]).coarse


@pytest.mark.parametrize("given", [np.nan, np.inf])
def test_a_posture_that_is_none_is_not_free(planner, arm, empty, given):
    q = np.where(np.arange(len(arm.q_present)) == 2, given, arm.q_present)
    test = planner.exact_test(empty)
    for ask, posture in ((test.is_free, q[None]), (test.contacts, q)):
        with pytest.raises(InputError, match=r"posture.* got 1 of 8 values NaN"):
            ask(posture)


def test_postures_of_another_shape_are_refused(planner, arm, empty):
    test, q = planner.exact_test(empty), arm.q_present
    for ask, posture in ((test.is_free, q), (test.contacts, q[None])):
        with pytest.raises(ShapeError, match="shape of posture"):
            ask(posture)
