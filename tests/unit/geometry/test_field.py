"""The grid agrees with a KD-tree, and knows free from unknown."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from debrisgrasp.errors import InputError
from debrisgrasp.geometry import (
    SE3,
    Bounds,
    DepthSight,
    DistanceField,
    Intrinsics,
    PanoramicSight,
    PointCloud,
    Space,
)

UNIT = Bounds(np.zeros(3), np.ones(3))


def cloud_of(points: np.ndarray, viewpoint: tuple[float, float, float]) -> PointCloud:
    normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    return PointCloud(points, normals, np.array(viewpoint))


def built(points: np.ndarray, **settings: float) -> DistanceField:
    cloud = cloud_of(points, (0.5, 0.5, 3.0))
    return DistanceField.build(
        cloud, UNIT, PanoramicSight.from_cloud(cloud), **settings
    )


def test_distance_agrees_with_a_kd_tree_up_to_a_cell(rng):
    points = rng.uniform(0.1, 0.9, (400, 3))
    field = built(points, spacing=0.02, truncation=0.1)
    queries = rng.uniform(0.1, 0.9, (20000, 3))
    exact = np.minimum(cKDTree(points).query(queries)[0], 0.1)
    error = field.distance(queries) - exact
    assert error.min() > -1e-5
    assert error.max() < 0.02 * np.sqrt(3)
    assert np.abs(error).mean() < 0.002


def test_distance_is_exact_at_the_measured_points(rng):
    points = rng.uniform(0.1, 0.9, (200, 3))
    keep = np.unique(np.floor(points / 0.02), axis=0, return_index=True)[1]
    field = built(points[keep], spacing=0.01)
    assert field.distance(points[keep]).max() < 1e-5


def test_nearest_index_names_the_point_that_is_near(rng):
    points = rng.uniform(0.2, 0.8, (50, 3))
    field = built(points)
    near = points + rng.normal(0, 0.002, points.shape)
    found = field.nearest_index(near)
    gap = np.linalg.norm(points[found] - near, axis=1)
    assert gap.max() < 0.02


def test_outside_the_grid_everything_is_far_and_unknown():
    field = built(np.full((1, 3), 0.5))
    outside = np.array([[5.0, 0.5, 0.5], [-5.0, -5.0, -5.0], [0.5, 0.5, 1e9]])
    assert (field.distance(outside) == np.float32(field.truncation)).all()
    assert (field.space_at(outside) == Space.UNKNOWN).all()


def test_space_before_a_wall_is_free_and_behind_it_unknown():
    camera = Intrinsics(fx=100, fy=100, cx=49.5, cy=49.5, width=100, height=100)
    # Looks along +x from the origin at a wall 0.5 m away.
    T_base_camera = SE3.from_parts([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], [0.0, 0.5, 0.5])
    depth = np.full((100, 100), 0.5)
    points = T_base_camera.apply(camera.deproject(depth)).reshape(-1, 3)
    cloud = PointCloud(points, np.tile([-1.0, 0, 0], (len(points), 1)), T_base_camera.p)
    sight = DepthSight(depth.astype(np.float32), camera, T_base_camera)
    field = DistanceField.build(cloud, UNIT, sight)
    along = np.array([[x, 0.5, 0.5] for x in (0.1, 0.4, 0.5, 0.6, 0.9)])
    expected = [Space.FREE, Space.FREE, Space.MEASURED, Space.UNKNOWN, Space.UNKNOWN]
    assert field.space_at(along).tolist() == expected
    beside_the_view = np.array([[0.1, 0.95, 0.5]])
    assert field.space_at(beside_the_view)[0] == Space.UNKNOWN


def test_missing_depth_leaves_space_unknown():
    camera = Intrinsics(fx=100, fy=100, cx=49.5, cy=49.5, width=100, height=100)
    sight = DepthSight(np.full((100, 100), np.nan, np.float32), camera, SE3.identity())
    assert np.isnan(sight.clearance(*np.array([[0.0], [0.0], [0.5]]))).all()


def test_panoramic_sight_sees_as_far_as_the_first_surface():
    points = np.array([[2.0, 0.0, 0.0], [4.0, 0.001, 0.0]])
    sight = PanoramicSight.from_cloud(cloud_of(points, (0.0, 0.0, 0.0)))
    ahead = np.array([[1.0, 0.0, 0.0], [3.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    clearance = sight.clearance(*ahead.T)
    assert clearance[0] == pytest.approx(1.0, abs=1e-5)
    assert clearance[1] == pytest.approx(-1.0, abs=1e-5)
    assert np.isnan(clearance[2])


def test_a_region_too_large_for_memory_is_refused_with_the_figure():
    cloud = cloud_of(np.full((1, 3), 0.5), (0, 0, 3))
    huge = Bounds(np.zeros(3), np.full(3, 50.0))
    with pytest.raises(InputError, match="cells"):
        DistanceField.build(cloud, huge, PanoramicSight.from_cloud(cloud))


@pytest.mark.parametrize("truncation", [0.0, 0.5])
def test_a_truncation_that_does_not_fit_the_cells_is_refused(truncation):
    with pytest.raises(InputError, match="truncation"):
        built(np.full((1, 3), 0.5), truncation=truncation)
