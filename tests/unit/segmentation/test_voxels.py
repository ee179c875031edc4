import numpy as np

from debrisgrasp.segmentation.voxels import Binning, cell_ids, voxelise

from .clouds import cloud_of, plate


def test_cells_are_numbered_by_coordinates_not_by_order_of_points(rng):
    keys = rng.integers(-5, 5, (3, 200))
    ids, cells = cell_ids(keys)
    order = rng.permutation(200)
    np.testing.assert_array_equal(cell_ids(keys[:, order])[0], ids[order])
    np.testing.assert_array_equal(cells[:, ids], keys)


def test_sorted_cells_equal_tabled_cells(rng):
    keys = rng.integers(0, 20, (3, 500))
    far = np.concatenate([keys, [[10**6], [10**6], [10**6]]], axis=1)
    ids, cells = cell_ids(keys)
    ids_far, cells_far = cell_ids(far)
    np.testing.assert_array_equal(ids_far[:-1], ids)
    np.testing.assert_array_equal(cells_far[:, :-1], cells)


def test_neighbours_equal_those_of_a_comparison_of_all_pairs(rng):
    cloud = cloud_of(rng.uniform(0.2, 0.4, (150, 3)))
    grid = voxelise(cloud, 0.03)
    axes_free = {tuple(pair) for pair in zip(grid.sources, grid.targets, strict=True)}
    far = cloud_of(np.concatenate([cloud.points, [[300.0, 300.0, 300.0]]]))
    assert len(voxelise(far, 0.03)) > 1
    assert all((b, a) in axes_free for a, b in axes_free)
    distance = np.abs(grid.centers[:, None] - grid.centers).max(axis=2)
    touching = np.zeros_like(distance, dtype=bool)
    touching[grid.sources, grid.targets] = True
    # Means of 26-neighbours are less than two cells apart along each grid axis.
    assert (distance[touching] < 2 * 0.03 * np.sqrt(2)).all()
    assert not np.diag(touching).any()


def test_sorted_neighbours_equal_tabled_neighbours(rng):
    points = rng.uniform(0.2, 0.5, (400, 3))
    near = voxelise(cloud_of(points), 0.02)
    # One distant point makes the table of all cells too large; it also turns the grid,
    # so a mirror point keeps the direction to the centroid.
    spread = np.array([[900.0, 900.0, 900.0], [-900.0, -900.0, -900.0]])
    center = points.mean(axis=0)
    far = voxelise(cloud_of(np.concatenate([points, center + spread])), 0.02)
    assert len(far) == len(near) + 2
    assert len(far.sources) == len(near.sources)


def test_voxel_means_are_means_of_their_points():
    cloud = cloud_of(plate((0.5, 0.6), (0.0, 0.1)), np.array([0.0, 0.0, 1.0]))
    grid = voxelise(cloud, 0.02)
    for voxel in range(0, len(grid), 7):
        own = cloud.points[grid.point_voxel == voxel]
        np.testing.assert_allclose(grid.centers[voxel], own.mean(axis=0))
    np.testing.assert_allclose(grid.normals, [[0.0, 0.0, 1.0]] * len(grid))


def test_single_camera_cells_grow_with_distance():
    cloud = cloud_of(plate((0.5, 3.0), (0.0, 0.1), spacing=0.01))
    grid = voxelise(cloud, 0.01, Binning.SINGLE_CAMERA)
    reach = np.linalg.norm(grid.centers - cloud.viewpoint, axis=1)
    assert np.corrcoef(reach, grid.sizes)[0, 1] > 0.9


def test_points_all_round_the_sensor_can_be_binned():
    angle = np.linspace(0, 2 * np.pi, 500, endpoint=False)
    ring = np.column_stack([2 * np.cos(angle), 2 * np.sin(angle), np.full(500, 0.3)])
    grid = voxelise(cloud_of(ring), 0.02, Binning.SINGLE_CAMERA)
    assert np.isfinite(grid.centers).all()
    assert (grid.sizes > 0).all()


def test_cells_without_normal_take_those_of_their_neighbours():
    points = plate((0.5, 0.6), (0.0, 0.1))
    normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    normals[points[:, 0] > 0.585] = np.nan
    grid = voxelise(cloud_of(points, normals), 0.01)
    assert np.isfinite(grid.normals).all()


def test_fitted_normals_weigh_two_rings_like_an_explicit_multiset(rng):
    cloud = cloud_of(rng.uniform([0.2, 0.2, 0.3], [0.5, 0.5, 0.32], (300, 3)))
    grid = voxelise(cloud, 0.03)
    neighbours = [[v] for v in range(len(grid))]
    for source, target in zip(grid.sources, grid.targets, strict=True):
        neighbours[target].append(source)
    for voxel in range(0, len(grid), 9):
        members = [voxel, *neighbours[voxel]]
        members += [far for near in neighbours[voxel] for far in neighbours[near]]
        away = grid.centers[members] - grid.centers[members].mean(axis=0)
        expected = np.linalg.eigh(away.T @ away)[1][:, 0]
        assert abs(expected @ grid.normals[voxel]) > 1 - 1e-9
        assert (cloud.viewpoint - grid.centers[voxel]) @ grid.normals[voxel] > 0
