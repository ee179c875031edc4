from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import SE3, PointCloud, so3
from debrisgrasp.pipeline import ground_notes
from debrisgrasp.segmentation import (
    GroundConfig,
    LccpConfig,
    PointKind,
    SegmentationConfig,
    SurroundingsConfig,
    segment_cloud,
)
from debrisgrasp.segmentation.ground import find_ground
from debrisgrasp.segmentation.surroundings import _is_amid, find_surroundings

from .clouds import STACK, TWO_BOXES, box_at, scene_cloud, truth_of

LCCP = SegmentationConfig(method=LccpConfig())
WALL = box_at(1.6, 0.0, 0.75, (0.05, 4.0, 1.5))
BIN = (
    box_at(1.0, 0.33, 0.13, (0.7, 0.02, 0.26)),
    box_at(1.0, -0.33, 0.13, (0.7, 0.02, 0.26)),
    box_at(1.34, 0.0, 0.13, (0.02, 0.64, 0.26)),
    box_at(1.0, 0.0, 0.005, (0.7, 0.64, 0.01)),
)
CONTENT = box_at(0.95, 0.05, 0.06, (0.15, 0.2, 0.1), yaw=0.4)


def judged(cloud, config=None):
    found = find_ground(cloud, GroundConfig())
    return find_surroundings(cloud, *found, config or SurroundingsConfig())[1]


def raised_scene(solids, height):
    """Cloud of solids without a floor, moved up."""
    cloud = scene_cloud(solids, has_floor=False)
    return cloud.in_frame(SE3.from_parts(np.eye(3), [0, 0, height]), "base")


def test_a_wall_behind_the_scene_is_no_object():
    solids = (*TWO_BOXES, WALL)
    cloud = scene_cloud(solids)
    truth = truth_of(cloud, solids)
    report = judged(cloud)
    front = (truth == 3) & (np.abs(cloud.normals[:, 0]) > 0.9)
    assert np.mean(report.kinds[front] == PointKind.WALL) > 0.95
    assert not (report.kinds[np.isin(truth, (1, 2))] == PointKind.WALL).any()
    assert report.counts["wall"] == np.count_nonzero(report.kinds == PointKind.WALL)
    assert "nothing seen behind" in report.surroundings[-1].reason


@pytest.mark.parametrize("solids", [TWO_BOXES, STACK], ids=["apart", "stacked"])
def test_boxes_on_the_floor_are_no_surroundings(solids):
    report = judged(scene_cloud(solids))
    assert report.surroundings == ()
    assert set(report.counts) == {"ground"}


def test_a_board_on_edge_with_ground_behind_it_is_no_wall():
    board = box_at(1.0, 0.0, 0.2, (0.03, 0.9, 0.42))
    config = SurroundingsConfig(min_wall=(0.5, 0.3))
    assert "wall" not in judged(scene_cloud((board,)), config).counts


def test_sides_and_floor_of_a_bin_that_holds_the_scene_are_no_objects():
    solids = (*BIN, CONTENT)
    cloud = raised_scene(solids, 0.3)
    truth = truth_of(scene_cloud(solids, has_floor=False), solids)
    result = segment_cloud(cloud, LCCP)
    assert result.ground.status == "skipped"
    assert "above the expected ground" in result.ground.pose_doubt
    kinds = result.ground.kinds
    in_bin = np.isin(truth, (1, 2, 3, 4)) & (cloud.points[:, 2] < 0.5)
    assert np.mean(kinds[in_bin] != PointKind.STANDING) > 0.9
    assert np.mean(result.labels[truth == 5] == 1) > 0.9
    assert result.ground.counts["container"] > 1000


def test_a_bin_on_the_ground_is_an_object():
    assert "container" not in judged(scene_cloud((*BIN, CONTENT))).counts


def test_what_lies_below_the_ground_is_reported():
    cloud = scene_cloud(TWO_BOXES)
    points = cloud.points.copy()
    corner = (points[:, 0] < 0.8) & (points[:, 1] > 0.3) & (points[:, 2] < 0.01)
    points[corner, 2] -= 0.4
    report = judged(replace(cloud, points=points))
    assert report.counts["below"] == corner.sum() > 100


@pytest.mark.parametrize("depth", [0.15, 0.6])
def test_a_pit_in_the_ground_is_told_from_what_lies_around_a_table(depth):
    cloud = scene_cloud(TWO_BOXES)
    points = cloud.points.copy()
    low = points[:, 2] < 0.01
    dug = low & (points[:, 0] > 0.7) & (np.abs(points[:, 1]) < 0.25)
    points[dug, 2] -= depth
    report = judged(replace(cloud, points=points))
    assert report.counts["pit"] == dug.sum() > 1000
    (note,) = ground_notes(report)
    assert f"{dug.sum()} points lie more than 10 cm below the ground" in note
    table = cloud.points.copy()
    table[low & ~dug, 2] -= 1.0
    report = judged(replace(cloud, points=table))
    assert "below" in report.counts
    assert "pit" not in report.counts


def test_what_lies_below_two_scan_lines_of_ground_is_in_a_pit(rng):
    x = np.linspace(0.4, 2.0, 14_000)
    lines = np.stack([x, np.resize([-0.1, 0.1], len(x)), np.zeros(len(x))], axis=1)
    box, deep = rng.uniform([0.9, -0.05, 0.15], [1.1, 0.05, 0.15], (2, 600, 3))
    deep[:, 2] = -0.3
    points = np.concatenate([lines, box, deep])
    report = judged(
        PointCloud(
            points=points,
            normals=np.tile([0.0, 0.0, 1.0], (len(points), 1)),
            viewpoint=np.array([0.0, 0.0, 1.5]),
            frame="base",
        )
    )
    assert report.status == "removed"
    assert report.counts["pit"] == 600


def test_nothing_lies_amid_what_is_along_a_line():
    line = np.linspace([0.0, 0.0, 0.0], [1.0, 0.5, 0.0], 9)
    for others in (line, line[:1], line[:0]):
        points = np.concatenate([others, [[0.5, 0.3, -0.3]]])
        is_last = np.arange(len(points)) == len(others)
        assert not _is_amid(points, is_last, ~is_last)


def test_counts_and_labels_agree_and_follow_the_order_of_points(rng):
    cloud = scene_cloud((*TWO_BOXES, WALL))
    order = rng.permutation(len(cloud))
    result = segment_cloud(cloud, LCCP)
    shuffled = segment_cloud(cloud.selected(order), LCCP)
    np.testing.assert_array_equal(shuffled.ground.kinds, result.ground.kinds[order])
    assert (result.labels[result.ground.kinds != PointKind.STANDING] == 0).all()
    for name, count in result.ground.counts.items():
        kind = PointKind[name.upper()]
        assert count == np.count_nonzero(result.ground.kinds == kind)


@pytest.mark.parametrize(
    ("turn", "words"),
    [
        ([np.pi, 0.0, 0.0], "upside down"),
        ([0.0, 0.4, 0.0], "gravity disagrees"),
        ([0.0, np.pi / 2, 0.0], "wall"),
    ],
    ids=["upside down", "tilted", "on its side"],
)
def test_a_pose_that_gravity_contradicts_is_doubted(turn, words):
    move = SE3.from_parts(so3.from_rpy(np.array(turn)), [0.0, 0.0, 3.0])
    cloud = scene_cloud(TWO_BOXES).in_frame(move, "base")
    report = judged(cloud)
    assert report.status == "skipped"
    assert words in report.pose_doubt
    assert "T_base_camera" in report.pose_doubt


def test_a_camera_below_the_ground_is_doubted():
    move = SE3.from_parts(np.eye(3), [0.0, 0.0, -2.0])
    report = judged(scene_cloud(TWO_BOXES).in_frame(move, "base"))
    assert "below the ground" in report.pose_doubt


def test_a_good_pose_is_not_doubted():
    assert judged(scene_cloud(TWO_BOXES)).pose_doubt == ""


@pytest.mark.parametrize(
    "settings",
    [
        {"min_wall": (0.0, 1.0)},
        {"min_side": (0.1, np.inf)},
        {"max_wall_lean": 0.0},
        {"max_side_lean": 2.0},
        {"max_behind": -0.1},
        {"min_held": 1.5},
    ],
)
def test_settings_out_of_range_are_refused(settings):
    with pytest.raises(ConfigError):
        SurroundingsConfig(**settings)
