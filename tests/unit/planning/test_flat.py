"""Which objects lie flat and too wide for any hand."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp._stopwatch import Stopwatch
from debrisgrasp.geometry import Bounds, PanoramicSight, PointCloud
from debrisgrasp.planning import GraspPlanner, GraspScene, PlannerConfig, SceneConfig
from debrisgrasp.planning.flat import lies_flat
from debrisgrasp.prototypes import PrototypeLibrary

WIDEST = 0.18
LEVEL = np.array([0.0, 0.0, 1.0, 0.0])
ASIDE = np.array([[0.0, -0.15, 0.0], [0.0, 0.15, 0.0]])


def sheet(width: float, length: float, height: float) -> np.ndarray:
    """Top of a board that lies on the ground, turned by 0.4 rad."""
    x, y = (np.arange(-s / 2, s / 2, 0.008) for s in (length, width))
    grid = np.stack(np.meshgrid(x, y, [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    c, s = np.cos(0.4), np.sin(0.4)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return grid @ turn.T + [1.0, 0.1, height]


def scene_of(points: np.ndarray, plane: np.ndarray | None = LEVEL) -> GraspScene:
    up = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    cloud = PointCloud(points, up, np.array([0.4, 0.0, 0.9]))
    return GraspScene.build(
        cloud,
        np.ones(len(points), dtype=bool),
        Bounds.around(points, 0.05),
        PanoramicSight.from_cloud(cloud),
        SceneConfig(),
        ground_plane=plane,
    )


def test_a_board_that_no_hand_reaches_across_is_told():
    told = lies_flat(scene_of(sheet(0.30, 0.60, 0.02)), WIDEST)
    assert told is not None
    assert "across where the hands open 18 cm" in told
    width = float(told.split("ground, ")[1].split(" cm")[0])
    assert width == pytest.approx(30, abs=1.5)


@pytest.mark.parametrize(
    "points",
    [
        sheet(0.14, 0.60, 0.02),
        sheet(0.30, 0.60, 0.10),
        np.concatenate([sheet(0.03, 0.6, 0.02) + shift for shift in ASIDE]),
        sheet(0.01, 0.60, 0.02)[:40],
    ],
    ids=["narrow", "raised", "two rods", "a line"],
)
def test_what_may_be_gripped_is_not(points):
    assert lies_flat(scene_of(points), WIDEST) is None


def test_without_ground_nothing_lies_on_it():
    assert lies_flat(scene_of(sheet(0.30, 0.60, 0.02), None), WIDEST) is None


def test_a_search_that_finds_nothing_says_so_first(rng):
    library = PrototypeLibrary.load().select(names=["bar_1x4_flat_tip"])
    result = GraspPlanner(library, PlannerConfig()).plan(
        scene_of(sheet(0.30, 0.60, 0.02)),
        (),
        lambda points: np.full(points.shape[:-1], np.inf),
        rng=rng,
        watch=Stopwatch(None, None),
    )
    assert not result.grasps
    assert (result.why_empty() or "").startswith("it lies flat on the ground, ")
