"""Jumps put prototypes on an object, its ends and rims as well as its long sides."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from debrisgrasp.geometry import PointCloud
from debrisgrasp.planning.proposals import Anchors, GlobalMove
from debrisgrasp.prototypes import PrototypeLibrary

LIBRARY = PrototypeLibrary.load().select(names=["rim_bucket", "bar_4x4", "edge_030"])
ANCHORS = Anchors.of(LIBRARY.packed())
END, SIDE = np.array([-1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


def beam(n_end: int = 10, n_side: int = 990) -> SimpleNamespace:
    """What jumps read of a beam along x of which an end and the upper side are seen."""
    rng = np.random.default_rng(0)
    end = np.column_stack([np.zeros(n_end), rng.uniform(-0.05, 0.05, (n_end, 2))])
    side = rng.uniform((0.0, -0.05, 0.05), (1.0, 0.05, 0.05), (n_side, 3))
    cloud = PointCloud(
        np.concatenate([end, side]),
        np.concatenate([np.tile(END, (n_end, 1)), np.tile(SIDE, (n_side, 1))]),
        np.array([-1.0, 0.0, 1.0]),
    )
    along = np.tile([1.0, 0.0, 0.0], (len(cloud), 1))
    return SimpleNamespace(cloud=cloud, target=np.arange(len(cloud)), tangents=along)


def at_end(rng: np.random.Generator, even_share: float, n: int = 4000) -> float:
    """Share of jumps that put a point of the prototype on the end, normals aligned."""
    scene, which = beam(), np.full(n, 1)
    Ts = GlobalMove(scene, ANCHORS, even_share=even_share, tries=1).sample(which, rng)
    p = LIBRARY.packed()
    mask = p.mask[1]
    points = p.points[1, mask] @ np.swapaxes(Ts[:, :3, :3], 1, 2) + Ts[:, None, :3, 3]
    normals = p.normals[1, mask] @ np.swapaxes(Ts[:, :3, :3], 1, 2)
    end = scene.cloud.points[:10]
    distance = np.linalg.norm(points[:, :, None] - end, axis=-1).min(axis=2)
    found = (distance < 1e-9) & (normals @ END > 1.0 - 1e-9)
    return float(found.any(axis=1).mean())


@pytest.mark.parametrize("row", range(len(LIBRARY)))
def test_only_points_of_the_prototype_are_drawn_from(row):
    assert LIBRARY.packed().mask[row, ANCHORS.even[row]].all()


def test_the_faces_of_a_box_are_drawn_alike_often():
    row = [prototype.name for prototype in LIBRARY].index("bar_4x4")
    drawn = LIBRARY.packed().normals[row, ANCHORS.even[row]].round(6)
    faces, counts = np.unique(drawn, axis=0, return_counts=True)
    assert 4 <= len(faces) <= 6
    assert np.ptp(counts) <= 1


def test_an_end_of_few_points_is_found_as_often_as_the_side(rng):
    assert at_end(rng, 0.0) < 0.03
    assert 0.4 < at_end(rng, 1.0) < 0.6
    assert 0.2 < at_end(rng, 0.5) < 0.3


def test_the_same_generator_gives_the_same_poses():
    def drawn() -> np.ndarray:
        rng = np.random.default_rng(7)
        return GlobalMove(beam(), ANCHORS).sample(np.array([0, 1, 2] * 20), rng)

    np.testing.assert_array_equal(drawn(), drawn())
    R = drawn()[:, :3, :3]
    np.testing.assert_allclose(np.swapaxes(R, 1, 2) @ R, [np.eye(3)] * 60, atol=1e-9)
