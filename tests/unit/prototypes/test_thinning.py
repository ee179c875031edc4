"""Thinned surfaces: float noise and the form of a file don't change what is kept."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from debrisgrasp.prototypes import (
    GripperModel,
    SurfaceShape,
    propose_hand_poses,
    surface_from_mesh,
)

HAND = GripperModel.load("robotiq_3f")
SIDE = np.linspace(0.0005, 0.0995, 100)
PLATE = np.stack(np.meshgrid(SIDE, SIDE), axis=-1).reshape(-1, 2)


def facing_up(points):
    return np.tile([0.0, 0.0, 1.0], (len(points), 1))


def at_height(height):
    return np.column_stack([PLATE, np.broadcast_to(height, len(PLATE))])


@pytest.mark.parametrize("height", [0.0, 0.01, 0.0125, -0.03])
@pytest.mark.parametrize("noise", [0.0, 1e-9, 1e-4])
def test_a_face_has_a_point_in_each_square_wherever_it_lies(height, noise, rng):
    points = at_height(height + noise * rng.normal(size=len(PLATE)))
    thinned = SurfaceShape.thinned(points, facing_up(points))
    assert len(thinned.points) == 20 * 20


def test_faces_above_each_other_keep_their_own_points():
    both = np.vstack([at_height(0.0), at_height(0.005), at_height(0.0312)])
    thinned = SurfaceShape.thinned(both, facing_up(both))
    _, counts = np.unique(thinned.points[:, 2], return_counts=True)
    assert counts.tolist() == [400, 400, 400]


def test_a_slope_is_one_layer():
    slope = np.column_stack([PLATE, PLATE[:, 0]])
    normals = np.tile(np.array([-1.0, 0.0, 1.0001]), (len(slope), 1))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert len(SurfaceShape.thinned(slope, normals).points) == 20 * 20


def test_of_two_points_as_near_the_first_is_kept_whatever_the_noise(rng):
    corners = np.array(list(product(np.arange(20), np.arange(20)))) * 0.005
    pairs = np.concatenate([corners + 0.001, corners + 0.004])
    points = np.column_stack([pairs, np.zeros(len(pairs))])
    for _ in range(5):
        noisy = points + 1e-9 * rng.normal(size=points.shape)
        thinned = SurfaceShape.thinned(noisy, facing_up(noisy))
        assert np.allclose(thinned.points, points[: len(corners)], atol=1e-7)


trimesh = pytest.importorskip("trimesh")


def same_boxes(size, folder):
    """Surfaces of one box, from files that differ in the last digits."""
    exact, other = trimesh.creation.box(size), trimesh.creation.box(size)
    in_millimetres = trimesh.creation.box(1e3 * np.asarray(size))
    other.apply_scale(1.0 + 1e-9)
    for mesh, name, scale in (
        (exact, "box.stl", 1.0),
        (exact, "box.obj", 1.0),
        (in_millimetres, "millimetres.stl", 1e-3),
        (other, "other.obj", 1.0),
    ):
        mesh.export(folder / name)
        yield surface_from_mesh(folder / name, scale=scale)


def principal_axes(shape):
    offset = shape.points - shape.points.mean(axis=0)
    return np.linalg.eigh(offset.T @ offset)[1]


def turn_between(a, b):
    """Largest angle between axes of two frames (3, 3), without their signs [rad]."""
    return np.arccos(np.clip(np.abs((a * b).sum(axis=0)), 0.0, 1.0)).max()


def test_a_box_is_taken_in_the_same_way_from_every_file(tmp_path):
    first, *others = [
        propose_hand_poses(shape, HAND, preshape="basic", limit=1)[0]
        for shape in same_boxes((0.05, 0.2, 0.06), tmp_path)
    ]
    assert np.abs(first.T_surface_hand.R).max(axis=0).min() > np.cos(np.deg2rad(1.0))
    for pose in others:
        assert pose.way == first.way
        assert pose.width == pytest.approx(first.width, abs=1e-3)
        turn = turn_between(pose.T_surface_hand.R, first.T_surface_hand.R)
        assert turn < np.deg2rad(1.0)


def test_boxes_have_the_same_axes_and_even_faces_in_every_file(tmp_path, rng):
    for _ in range(12):
        size = 0.005 * rng.integers(4, 41, 3)
        shapes = list(same_boxes(size, tmp_path))
        axes = [principal_axes(shape) for shape in shapes]
        # Also of a square bar, whose axes the least unevenness turns.
        assert max(turn_between(axes[0], other) for other in axes) < np.deg2rad(1.0)
        for shape in shapes:
            middle = shape.points.mean(axis=0)
            assert np.abs(middle).max() < 0.01 * size.max()
            index = np.rint(shape.normals).astype(int)
            _, counts = np.unique(index, axis=0, return_counts=True)
            assert counts == pytest.approx(counts[::-1], rel=0.02)  # opposite faces
