from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import PointCloud, so3
from debrisgrasp.segmentation import LccpConfig, SupervoxelConfig
from debrisgrasp.segmentation.lccp import judged_borders, lccp, merged_small
from debrisgrasp.segmentation.supervoxels import supervoxels

from .clouds import STACK, TWO_BOXES, cloud_of, plate, scene_cloud, truth_of

UP = np.array([0.0, 0.0, 1.0])


def objects_of(cloud, config=None):
    graph = lccp(cloud, config or LccpConfig())
    return graph.patch_object[graph.point_patch], graph


@pytest.mark.parametrize("solids", [TWO_BOXES, STACK], ids=["apart", "stacked"])
def test_boxes_come_apart(solids):
    cloud = scene_cloud(solids)
    truth = truth_of(cloud, solids)
    objects, _ = objects_of(cloud.selected(truth > 0))
    truth = truth[truth > 0]
    majority = [np.bincount(objects[truth == k]).argmax() for k in (1, 2)]
    assert majority[0] != majority[1]
    for k, label in zip((1, 2), majority, strict=True):
        assert np.mean(objects[truth == k] == label) > 0.95
        assert np.mean(truth[objects == label] == k) > 0.95


def test_a_box_without_tolerance_for_convexity_is_whole():
    cloud = scene_cloud(TWO_BOXES[:1])
    cloud = cloud.selected(truth_of(cloud, TWO_BOXES[:1]) > 0)
    objects, _ = objects_of(cloud)
    assert np.bincount(objects).max() / len(objects) > 0.98
    # Patches that meet diagonally across an edge of the box fail for sanity alone.
    _, graph = objects_of(cloud, LccpConfig(sanity=False))
    assert graph.is_convex.mean() > 0.9


@pytest.mark.parametrize(("smoothness", "joins"), [(0.1, False), (None, True)])
def test_a_step_divides_unless_steps_are_allowed(smoothness, joins):
    grid = plate((0.5, 0.7), (0.0, 0.2))
    patches = supervoxels(cloud_of(grid, UP), SupervoxelConfig())
    raised = patches.centers + [0.0, 0.0, 0.01] * (patches.centers[:, 1:2] > 0.1)
    stair = replace(patches, centers=raised)
    convex, _ = judged_borders(stair, LccpConfig(smoothness=smoothness, sanity=False))
    over_step = np.ptp(raised[patches.edges][..., 2], axis=1) > 0.005
    assert convex[over_step].all() == joins
    assert convex[~over_step].all()


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_floor_is_convex_and_parts_from_a_wall_whatever_the_noise(noise, rng):
    floor = plate((0.0, 0.4), (0.0, 0.4))
    wall = floor[:, [2, 0, 1]] + [0.4, 0.0, 0.004]
    points = np.concatenate([floor, wall])
    normals = np.repeat([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]], len(floor), axis=0)
    normals = normals + noise * rng.normal(size=normals.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    cloud = PointCloud(points, normals, np.array([-0.5, 0.2, 1.5]))
    objects, graph = objects_of(cloud)
    assert len(np.unique(objects)) == 2
    is_even = np.ptp(graph.patch_object[graph.edges], axis=1) == 0
    assert graph.is_convex[is_even].mean() > 0.95


def test_contact_length_of_a_stack_is_about_the_visible_border():
    cloud = scene_cloud(STACK)
    truth = truth_of(cloud, STACK)
    cloud, truth = cloud.selected(truth > 0), truth[truth > 0]
    graph = lccp(cloud, LccpConfig())
    side = np.array(
        [
            np.bincount(truth[graph.point_patch == p]).argmax()
            for p in range(len(graph.patch_object))
        ]
    )
    crossing = side[graph.edges[:, 0]] != side[graph.edges[:, 1]]
    # Two faces of the upper box, 14 cm wide, stand on the lower one.
    assert 0.15 < graph.contact_length[crossing].sum() < 0.6


def test_small_objects_go_to_their_largest_neighbour():
    joined = np.array([0, 0, 0, 1, 2, 2, 2, 2])
    edges = np.array([[0, 1], [1, 2], [2, 3], [3, 4], [4, 5], [5, 6], [6, 7]])
    merged = merged_small(joined, edges, 1)
    assert merged[3] == merged[4]
    assert merged[0] != merged[4]


def test_isolated_small_objects_stay():
    merged = merged_small(np.array([0, 0, 1]), np.array([[0, 1]]), 5)
    assert len(np.unique(merged)) == 2


def test_chains_of_small_objects_end_up_together():
    edges = np.array([[0, 1], [1, 2], [2, 3]])
    assert len(np.unique(merged_small(np.arange(4), edges, 3))) == 1


@pytest.mark.parametrize(
    "settings",
    [
        {"concavity_tolerance": -0.1},
        {"concavity_tolerance": 10.0},
        {"smoothness": -1.0},
        {"extended_convexity": -1},
        {"min_segment_size": -1},
    ],
)
def test_settings_out_of_range_are_refused(settings):
    with pytest.raises(ConfigError):
        LccpConfig(**settings)


def test_flags_follow_from_the_patches_alone():
    # The same patches, moved as a whole, carry the same flags.
    cloud = scene_cloud(STACK)
    patches = supervoxels(
        cloud.selected(truth_of(cloud, STACK) > 0), SupervoxelConfig()
    )
    turn = so3.from_rpy(np.array([0.3, -0.2, 1.0]))
    moved = replace(
        patches,
        centers=patches.centers @ turn.T + [1.0, 2.0, 3.0],
        normals=patches.normals @ turn.T,
    )
    config = LccpConfig(extended_convexity=1)
    for here, there in zip(
        judged_borders(patches, config), judged_borders(moved, config), strict=True
    ):
        assert np.mean(here != there) < 1e-3
