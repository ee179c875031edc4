"""Is what was seen of an object a part of something larger? Stubs and whole things."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from debrisgrasp.geometry import Bounds, PointCloud
from debrisgrasp.planning.borders import is_behind, missing

GROUND = np.array([0.0, 0.0, 1.0, 0.0])


def sheet(x: tuple[float, float], y: tuple[float, float], z: float) -> np.ndarray:
    """Points 1 cm apart on a level rectangle [m]."""
    columns, rows = (np.arange(low, high + 1e-9, 0.01) for low, high in (x, y))
    grid = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    return np.column_stack([grid, np.full(len(grid), z)])


def scene_of(target: np.ndarray, *others: np.ndarray) -> SimpleNamespace:
    """What is asked of a scene that a camera 1 m above its middle looks down at."""
    points = np.concatenate([target, *others])
    is_target = np.arange(len(points)) < len(target)
    cloud = PointCloud(points, np.tile(GROUND[:3], (len(points), 1)), [0.0, 0.0, 1.0])
    region = Bounds(target.min(axis=0) - 0.05, target.max(axis=0) + 0.05)
    return SimpleNamespace(
        cloud=cloud, is_target=is_target, region=region, ground_plane=GROUND
    )


STUB = sheet((0.0, 0.12), (0.0, 0.06), 0.10)
FLOOR = sheet((-0.3, 0.3), (-0.3, 0.3), 0.0)
BOARD_OVER_IT = sheet((0.105, 0.3), (-0.2, 0.2), 0.18)


def test_a_small_thing_that_stands_alone_is_whole():
    assert missing(scene_of(STUB)) == 0.0
    assert missing(scene_of(STUB, FLOOR)) == 0.0


def test_a_stub_that_vanishes_under_a_board_is_a_part():
    found = missing(scene_of(STUB, FLOOR, BOARD_OVER_IT))
    assert found == pytest.approx(0.3 - np.hypot(0.12, 0.06), abs=0.01)


def test_a_piece_that_goes_over_into_another_is_a_part():
    rest = sheet((0.13, 0.5), (0.0, 0.06), 0.10)
    assert 0.0 < missing(scene_of(STUB, FLOOR, rest)) <= 0.2


def test_what_is_as_large_as_debris_is_whole_wherever_it_lies():
    bar = sheet((-0.2, 0.12), (0.0, 0.06), 0.10)
    assert missing(scene_of(bar, FLOOR, BOARD_OVER_IT)) == 0.0


def test_what_a_region_cuts_out_of_an_object_is_not_called_a_part():
    scene = scene_of(STUB, FLOOR, BOARD_OVER_IT)
    scene.region = Bounds(STUB.min(axis=0) - 0.001, STUB.max(axis=0) + 0.05)
    assert missing(scene) == 0.0


def test_only_what_is_nearer_hides():
    below = BOARD_OVER_IT - [0.0, 0.0, 0.12]
    for other, hides in ((BOARD_OVER_IT, True), (below, False)):
        scene = scene_of(STUB, other)
        hidden = is_behind(scene, scene.is_target)
        assert hidden.any() == hides
        assert STUB[hidden, 0].min(initial=1.0) > 0.08
    alone = scene_of(STUB)
    assert not is_behind(alone, alone.is_target).any()
