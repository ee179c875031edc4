"""What contacts are measured with, against the plain way of doing the same."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from debrisgrasp.geometry import PointCloud
from debrisgrasp.segmentation.contacts import find_contacts
from debrisgrasp.segmentation.corridor import freest_corridor
from debrisgrasp.segmentation.occlusion import occluded_shares
from debrisgrasp.segmentation.surface import LabelledSurface, inside_box, quantiles
from debrisgrasp.segmentation.touching import touching_cells


def thinned(points, labels, size=0.01):
    up = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
    cloud = PointCloud(points=points, normals=up, viewpoint=np.array([0.0, 0.0, 1.5]))
    return LabelledSurface.of(cloud, labels, None, size=size, noise=0.0009)


def test_points_inside_a_box_are_found_in_order(rng):
    points = rng.normal(size=(500, 3))
    low, high = np.array([-1.0, -0.5, 0.0]), np.array([0.5, 1.0, 2.0])
    inside = ((points > low) & (points < high)).all(axis=1)
    np.testing.assert_array_equal(inside_box(points, low, high), np.flatnonzero(inside))


@pytest.mark.parametrize("n", [1, 2, 3, 50])
def test_quantiles_are_those_of_numpy(rng, n):
    values = rng.normal(size=(4, n))
    expected = np.quantile(values, (0.0, 0.1, 0.5, 1.0), axis=-1).T
    np.testing.assert_allclose(quantiles(values, (0.0, 0.1, 0.5, 1.0)), expected)


def test_each_cell_holds_its_own_points(rng):
    points, labels = rng.uniform(0.0, 0.05, (400, 3)), rng.integers(0, 4, 400)
    surface = thinned(points, labels)
    assert (np.diff(surface.labels) >= 0).all()
    for cell, (mean, label) in enumerate(
        zip(surface.points, surface.labels, strict=True)
    ):
        same = (np.floor(points / 0.01) == np.floor(mean / 0.01)).all(axis=1)
        own = points[same & (labels == label)]
        np.testing.assert_array_equal(surface.points_in(np.array([cell])), own)
        np.testing.assert_allclose(own.mean(axis=0), mean)
    every = surface.points_in(np.arange(len(surface.labels)))
    np.testing.assert_array_equal(every, surface.measured)


def test_cells_touch_those_of_others_within_reach_and_noise(rng):
    points, labels = rng.uniform(0.0, 0.15, (800, 3)), rng.integers(1, 5, 800)
    points[:, 2] += 3.0
    surface = thinned(points, labels)
    gap = cdist(surface.points, surface.points)
    limit = 0.02 + surface.noise[:, None] + surface.noise
    near = (gap < limit) & (surface.labels[:, None] < surface.labels)
    pairs = touching_cells(surface, 0.02)
    assert len(pairs) > 100
    assert {tuple(pair) for pair in pairs} == {
        tuple(pair) for pair in np.argwhere(near)
    }
    ends = surface.labels[pairs]
    contacts = find_contacts(surface, 0.02)
    for k, (a, b) in enumerate(contacts.labels):
        own = pairs[(ends == [a, b]).all(axis=1)]
        assert contacts.n_pairs[k] == len(own)
        for side, label in enumerate((a, b)):
            touching = len(set(own[:, side])) / (surface.labels == label).sum()
            assert contacts.share[k, side] == pytest.approx(touching)
        between = surface.points[own[:, 0]] - surface.points[own[:, 1]]
        over = np.linalg.norm(between[:, :2], axis=1) < 0.012
        assert contacts.n_over[k] == over.sum()
        assert contacts.drop[k] == pytest.approx(np.median(between[over, 2]))


def test_of_many_small_objects_within_reach_only_the_nearest_touch(rng):
    n = 200
    surface = thinned(rng.uniform(0.0, 0.08, (n, 3)), np.arange(1, n + 1))
    gap = cdist(surface.points, surface.points) + np.where(np.eye(n), np.inf, 0.0)
    rank = gap.argsort(axis=1).argsort(axis=1)
    limit = 0.035 + surface.noise[:, None] + surface.noise
    is_near = (gap < limit) & ((rank < 12) | (rank.T < 12))
    assert (gap < limit).sum() > 2 * is_near.sum()
    expected = surface.labels[np.argwhere(np.triu(is_near))]
    contacts = find_contacts(surface, 0.035)
    np.testing.assert_array_equal(contacts.labels, expected)


def test_what_a_large_object_touches_is_not_limited(rng):
    x = np.linspace(0.0, 1.0, 30)
    small = np.column_stack([x, np.full(30, 0.01), np.zeros(30)])
    board = rng.uniform([0.0, -0.1, -0.001], [1.0, 0.0, 0.0], (20_000, 3))
    points, own = np.concatenate([board, small]), np.arange(2, 32)
    labels = np.concatenate([np.ones(len(board), dtype=np.int64), own])
    contacts = find_contacts(thinned(points, labels), 0.02)
    np.testing.assert_array_equal(contacts.labels, [[1, k] for k in own])


def test_a_contact_runs_along_the_edge_at_which_two_meet(rng):
    flat = rng.uniform([-0.2, -0.1, 0.0], [0.2, 0.1, 0.001], (8000, 3))
    labels = np.where(flat[:, 1] < 0.0, 1, 2)
    turn = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    contacts = find_contacts(thinned(flat @ turn.T, labels), 0.015)
    assert abs(contacts.axis[0] @ turn[:, 0]) > 0.99


def test_the_length_of_a_contact_counts_steps_in_which_points_touch(rng):
    flat = rng.uniform([0.0, 0.0, 0.0], [0.3, 0.2, 0.001], (6000, 3))
    labels = np.where(flat[:, 0] < 0.15, 1, 2)
    surface = thinned(flat, labels)
    contacts = find_contacts(surface, 0.015)
    assert contacts.labels.tolist() == [[1, 2]]
    # Of all cells close to the border the noise and the spacing are about the same.
    reach = float(np.median(surface.noise) + 2.0 * np.median(surface.spacing))
    gap = cdist(flat[labels == 1], flat[labels == 2])
    touching = (flat[labels == 1][gap.min(axis=1) < reach],)
    touching += (flat[labels == 2][gap.min(axis=0) < reach],)
    n_steps = [len(np.unique(np.floor(side / 0.02), axis=0)) for side in touching]
    assert contacts.length[0] == pytest.approx(0.009 * sum(n_steps) / 2, rel=0.15)


def test_what_is_occluded_is_counted_pixel_by_pixel(rng):
    shape, bridge = (24, 30), 4
    image = np.kron(rng.integers(0, 4, (6, 6)), np.ones((4, 5), dtype=np.int64))
    depth = 1.0 + 0.3 * np.kron(rng.random((6, 6)), np.ones((4, 5)))
    points = np.zeros((image.size, 3))
    points[:, 2] = depth.ravel()
    cloud = PointCloud(
        points=points,
        normals=np.full_like(points, np.nan),
        viewpoint=np.zeros(3),
        pixels=np.arange(image.size),
        image_shape=shape,
    )
    outline, hidden = np.zeros(4), np.zeros(4)
    for row, column in np.argwhere(image > 0):
        own = image[row, column]
        for step in ((bridge, 0), (-bridge, 0), (0, bridge), (0, -bridge)):
            there = row + step[0], column + step[1]
            if min(there) < 0:
                continue  # left of the image or above it
            in_image = there[0] < shape[0] and there[1] < shape[1]
            other = image[there] if in_image else 0
            outline[own] += other != own
            if other not in (0, own):
                hidden[own] += depth[there] < depth[row, column] - 0.02
    shares = occluded_shares(cloud, image.ravel(), 3)
    np.testing.assert_allclose(shares, hidden[1:] / outline[1:])
    assert shares.max() > 0.1


@pytest.mark.parametrize(("depth", "blocked"), [(0.2, 0.0), (0.6, 0.5)])
def test_a_roof_blocks_the_way_out_unless_one_can_pull_from_under_it(depth, blocked):
    x, y = np.arange(0.5, 0.7, 0.005), np.arange(0.0, 0.2, 0.005)
    half_roof = np.arange(0.7 - depth, 0.7, 0.005), y[: len(y) // 2], [0.4]
    parts = (x, y, [0.1]), half_roof, (x, y + 0.5, [0.4])
    points = [np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3) for axes in parts]
    labels = np.repeat([1, 2, 3], [len(part) for part in points])
    way = freest_corridor(thinned(np.concatenate(points), labels), 1)
    assert way.blocked == pytest.approx(blocked, abs=0.1)
    assert way.blockers.tolist() == ([2] if blocked else [])
