"""Thinning a cloud by voxels."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from debrisgrasp.errors import InputError, ShapeError
from debrisgrasp.geometry import voxel_cells, voxel_count, voxel_downsample
from debrisgrasp.geometry.neighbors import by_place


def test_one_point_stays_in_each_occupied_cell_and_it_is_the_most_central(rng):
    points, size = rng.uniform(-1, 1, (3000, 3)), 0.3
    kept = voxel_downsample(points, size)
    cells: dict[tuple[int, ...], list[int]] = {}
    for index, point in enumerate(points):
        cells.setdefault(tuple(np.floor(point / size).astype(int)), []).append(index)
    expected = []
    for members in cells.values():
        offset = points[members] - points[members].mean(axis=0)
        expected.append(members[np.argmin(np.linalg.norm(offset, axis=1))])
    assert_array_equal(kept, sorted(expected))


@pytest.mark.parametrize("extent", [1.0, 1000.0])  # in a table, and by sorting
def test_occupied_cells_are_counted(rng, extent):
    points = rng.uniform(-extent, extent, (3000, 3))
    n_cells = len(np.unique(np.floor(points / 0.3), axis=0))
    assert voxel_count(points, 0.3) == n_cells == len(voxel_downsample(points, 0.3))
    assert voxel_count(np.empty((0, 3)), 0.3) == 0


def test_the_order_of_points_does_not_matter(rng):
    points = rng.uniform(0, 1, (500, 3))
    order = rng.permutation(500)
    # Cells of many points: two points are equally far from their mean.
    kept, shuffled = voxel_downsample(points, 0.5), voxel_downsample(points[order], 0.5)
    assert_array_equal(kept, np.sort(order[shuffled]))


def test_no_points_stay_no_points():
    assert voxel_downsample(np.empty((0, 3)), 0.1).shape == (0,)


@pytest.mark.parametrize("size", [0.0, -0.1, np.nan])
def test_voxels_without_size_are_refused(size):
    with pytest.raises(InputError, match="voxel size"):
        voxel_downsample(np.zeros((3, 3)), size)


def test_more_cells_than_keys_can_number_are_refused():
    with pytest.raises(InputError, match="larger voxels"):
        voxel_downsample(np.array([[0.0, 0, 0], [1e6, 0, 0]]), 1e-3)


def test_points_that_are_not_finite_are_refused():
    with pytest.raises(InputError, match="points"):
        voxel_downsample(np.array([[0.0, 0, np.nan]]), 0.1)


def test_points_are_ordered_by_place_and_know_the_first_in_theirs(rng):
    points = rng.integers(0, 5, (300, 3)).astype(float)
    order, first = by_place(points)
    index = np.arange(300)
    plain = np.lexsort((index, points[:, 2], points[:, 1], points[:, 0]))
    np.testing.assert_array_equal(order, plain)
    is_same = (points[:, None] == points).all(axis=2)
    np.testing.assert_array_equal(first, is_same.argmax(axis=1))


def test_points_that_repeat_none_are_their_own_first(rng):
    points = rng.normal(size=(50, 3))
    order, first = by_place(points)
    np.testing.assert_array_equal(order, np.argsort(points[:, 0]))
    np.testing.assert_array_equal(first, np.arange(50))
    assert [part.shape for part in by_place(points[:0])] == [(0,), (0,)]


@pytest.mark.parametrize("kind", [np.float32, ">f8", list])
def test_points_of_any_kind_of_number_share_the_same_cells(rng, kind):
    points = rng.uniform(0.0, 1.0, (4000, 3)).astype(np.float32)
    given = points.tolist() if kind is list else points.astype(kind)
    plain = points.astype(np.float64)
    assert voxel_count(given, 0.01) == voxel_count(plain, 0.01)
    for divide in (voxel_cells, voxel_downsample):
        np.testing.assert_array_equal(
            np.hstack(divide(given, 0.01)), np.hstack(divide(plain, 0.01))
        )


@pytest.mark.parametrize(
    "thin",
    [
        by_place,
        lambda points: voxel_cells(points, 0.1),
        lambda points: voxel_count(points, 0.1),
        lambda points: voxel_downsample(points, 0.1),
    ],
)
def test_points_in_the_order_of_an_image_are_refused(thin, rng):
    with pytest.raises(ShapeError, match=r"\(4, 5, 3\), expected \(n, 3\).*reshape"):
        thin(rng.random((4, 5, 3)))
