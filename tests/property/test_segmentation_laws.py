"""What must not change the division of a cloud, and how scores behave."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from debrisgrasp.geometry import SE3, so3
from debrisgrasp.segmentation import (
    Binning,
    LccpConfig,
    SegmentationConfig,
    SupervoxelConfig,
    segment_cloud,
    segmentation_of_labels,
    support_graph,
)
from tests.benchmarks.segmentation_scores import scores
from tests.unit.segmentation.clouds import STACK, TWO_BOXES, same_partition, scene_cloud

METHODS = {
    "default": SegmentationConfig(),
    "lccp": SegmentationConfig(method=LccpConfig()),
    "lccp_single_camera": SegmentationConfig(
        method=LccpConfig(supervoxels=SupervoxelConfig(binning=Binning.SINGLE_CAMERA))
    ),
}


@pytest.mark.parametrize("method", METHODS)
@given(seed=st.integers(0, 1000))
@settings(max_examples=3)
def test_order_of_points_does_not_matter(method, seed):
    cloud = scene_cloud(STACK)
    order = np.random.default_rng(seed).permutation(len(cloud))
    labels = segment_cloud(cloud, METHODS[method]).labels
    shuffled = segment_cloud(cloud.selected(order), METHODS[method]).labels
    assert same_partition(labels[order], shuffled)


@given(seed=st.integers(0, 1000))
@settings(max_examples=3)
def test_order_of_points_does_not_matter_to_ground_and_support(seed):
    cloud = replace(scene_cloud(STACK), pixels=None, image_shape=None)
    rng = np.random.default_rng(seed)
    # Rough ground: which of its points stand for all is seen in the heights.
    rough = cloud.points + rng.normal(0.0, 0.004, cloud.points.shape)
    cloud, order = replace(cloud, points=rough), rng.permutation(len(cloud))
    found = segment_cloud(cloud)
    given_labels = segmentation_of_labels(cloud, found.labels)
    shuffled = segmentation_of_labels(cloud.selected(order), found.labels[order])
    np.testing.assert_allclose(
        shuffled.ground.plane, given_labels.ground.plane, rtol=0.0, atol=1e-12
    )
    graph = support_graph(given_labels, cloud)
    other = support_graph(shuffled, cloud.selected(order))
    for name in ("encumbrance", "load", "extents"):
        np.testing.assert_allclose(
            getattr(other, name), getattr(graph, name), rtol=1e-9, atol=1e-9
        )


@pytest.mark.parametrize("method", METHODS)
@given(
    yaw=st.floats(-3.0, 3.0),
    x=st.floats(-2.0, 2.0),
    y=st.floats(-2.0, 2.0),
)
@settings(max_examples=3)
def test_scene_and_camera_moved_together_over_the_floor_change_nothing(
    method, yaw, x, y
):
    cloud = scene_cloud(TWO_BOXES)
    move = SE3.from_parts(so3.from_rpy(np.array([0.0, 0.0, yaw])), [x, y, 0.0])
    labels = segment_cloud(cloud, METHODS[method]).labels
    moved = segment_cloud(cloud.in_frame(move, "base"), METHODS[method]).labels
    np.testing.assert_array_equal(moved, labels)


@pytest.mark.parametrize("method", METHODS)
def test_equal_input_gives_equal_output(method):
    cloud = scene_cloud(STACK)
    first, second = (segment_cloud(cloud, METHODS[method]) for _ in range(2))
    np.testing.assert_array_equal(first.labels, second.labels)
    np.testing.assert_array_equal(first.patches, second.patches)


@given(
    st.lists(st.integers(0, 4), min_size=5, max_size=60), st.permutations(range(1, 5))
)
def test_scores_do_not_depend_on_names_and_the_truth_is_perfect(truth, names):
    truth = np.array([*truth, 1, 1])
    renamed = np.array([0, *names])[truth]
    perfect = scores(renamed, truth)
    assert perfect.wov == perfect.found == 1.0
    assert perfect.fos == perfect.fus == 0.0
    assert perfect.ari == pytest.approx(1.0)


def test_one_segment_over_two_equal_objects_scores_half():
    truth = np.array([0, 0, 1, 1, 2, 2])
    result = scores(np.array([0, 0, 7, 7, 7, 7]), truth)
    assert result.wov == pytest.approx(0.5)
    assert result.fos == 0.0
    assert result.fus == result.fusc == pytest.approx(1.0)
    assert result.ari == pytest.approx(0.0)
