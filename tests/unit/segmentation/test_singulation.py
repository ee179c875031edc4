from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import SE3, Cylinder, PointCloud, so3
from debrisgrasp.segmentation import (
    SegmentationConfig,
    SingulationConfig,
    segment_cloud,
)
from debrisgrasp.segmentation.singulation import method, singulate
from debrisgrasp.segmentation.singulation.camera import inverse_depth_image
from tests.scenes import CAMERA, LOOKING_DOWN_AND_AHEAD, capture_of

from .clouds import STACK, TWO_BOXES, box_at, same_partition, scene_cloud, truth_of


def best_overlap(labels, truth, k):
    """IoU of solid k with the segment that covers most of it."""
    label = np.bincount(labels[(truth == k) & (labels > 0)]).argmax()
    both = np.sum((labels == label) & (truth == k))
    return both / np.sum((labels == label) | (truth == k))


@pytest.mark.parametrize("solids", [TWO_BOXES, STACK], ids=["apart", "stacked"])
def test_boxes_come_apart(solids):
    cloud = scene_cloud(solids)
    result = segment_cloud(cloud)
    truth = truth_of(cloud, solids)
    assert result.method == "singulation"
    assert [best_overlap(result.labels, truth, k) > 0.9 for k in (1, 2)] == [True] * 2


@pytest.mark.parametrize(("length", "hidden"), [(0.7, 0.09), (0.9, 0.4)])
def test_a_bar_behind_another_is_one_object(length, hidden):
    R = so3.from_rpy(np.array([np.pi / 2, 0, 0]))
    across = Cylinder(0.03, length, SE3.from_parts(R, [1, 0, 0.1]))
    front = box_at(0.9, 0.0, 0.3, (0.09, hidden, 0.6))
    solids = (across, front)
    cloud = scene_cloud(solids)
    labels = segment_cloud(cloud).labels
    truth = truth_of(cloud, solids)
    left = labels[(truth == 1) & (cloud.points[:, 1] > hidden / 2)]
    right = labels[(truth == 1) & (cloud.points[:, 1] < -hidden / 2)]
    assert np.bincount(left).argmax() == np.bincount(right).argmax() > 0
    assert best_overlap(labels, truth, 2) > 0.9


def test_two_bars_with_a_visible_gap_are_two_objects():
    R = so3.from_rpy(np.array([np.pi / 2, 0, 0]))
    solids = tuple(
        Cylinder(0.03, 0.25, SE3.from_parts(R, [1, y, 0.1])) for y in (-0.25, 0.25)
    )
    cloud = scene_cloud(solids)
    labels = segment_cloud(cloud).labels
    truth = truth_of(cloud, solids)
    first, second = (np.bincount(labels[truth == k]).argmax() for k in (1, 2))
    assert first != second


def test_a_truss_of_thin_bars_is_one_object():
    along = so3.from_rpy(np.array([np.pi / 2, 0.0, 0.0]))
    lean = SE3.from_parts(so3.from_rpy(np.array([0, 0, 0.3])), [0.8, 0.0, 0.35])
    slant = 0.5
    brace = so3.from_rpy(np.array([0.0, np.pi / 2, slant]))
    bars = tuple(
        Cylinder(0.022, 0.7, lean @ SE3.from_parts(along, [x, 0, 0]))
        for x in (-0.1, 0.1)
    ) + tuple(
        Cylinder(0.012, 0.2 / np.cos(slant), lean @ SE3.from_parts(brace, [0, y, 0]))
        for y in (-0.2, 0.0, 0.2)
    )
    cloud = scene_cloud(bars)
    labels = segment_cloud(cloud).labels
    on_truss = truth_of(cloud, bars) > 0
    assert np.bincount(labels[on_truss]).max() / on_truss.sum() > 0.95


def test_the_upper_one_of_a_stack_is_known():
    cloud = scene_cloud(STACK)
    result = segment_cloud(cloud)
    truth = truth_of(cloud, STACK)
    lower, upper = (np.bincount(result.labels[truth == k]).argmax() for k in (1, 2))
    pair = [min(lower, upper), max(lower, upper)]
    row = result.edges.labels.tolist().index(pair)
    assert result.edges.upper[row] == upper
    assert result.edges.convexity[row] < 0.5
    assert 0.1 < result.edges.contact_length[row] < 0.6


def test_a_sliver_is_part_of_what_it_touches_where_larger_things_stay_apart(
    monkeypatch,
):
    knob = box_at(1.0, 0.0, 0.515, (0.035, 0.035, 0.03))
    solids = (box_at(1.0, 0.0, 0.25, (0.3, 0.3, 0.5)), knob)
    wide = (solids[0], box_at(1.0, 0.0, 0.55, (0.2, 0.2, 0.1)))
    evidence = SimpleNamespace(probability=lambda f: np.full(len(f), 0.65))
    monkeypatch.setattr(method, "fitted_evidence", lambda: evidence)

    def n_objects(solids):
        cloud = scene_cloud(solids)
        labels, truth = segment_cloud(cloud).labels, truth_of(cloud, solids)
        tops = [labels[(truth == k) & (cloud.normals[:, 2] > 0.9)] for k in (1, 2)]
        return len({np.bincount(top).argmax() for top in tops})

    assert (n_objects(solids), n_objects(wide)) == (1, 2)


def test_scores_tell_joined_from_kept_apart():
    config = SingulationConfig()
    for solids in (TWO_BOXES, STACK):
        result = segment_cloud(scene_cloud(solids))
        assert ((result.edges.score >= 0) & (result.edges.score <= 1)).all()
        assert (result.edges.score <= config.min_score).all()
        for segment in result.segments:
            assert config.min_score <= segment.certainty <= 1


def test_certainty_falls_with_the_score_that_joins():
    cloud = scene_cloud(STACK)
    everything = segment_cloud(
        cloud, SegmentationConfig(method=SingulationConfig(min_score=0.0))
    )
    usual = segment_cloud(cloud)
    assert len(everything.segments) == 1
    assert everything.segments[0].certainty < min(s.certainty for s in usual.segments)


def test_a_marked_part_becomes_an_object_of_its_own():
    cloud = scene_cloud(TWO_BOXES)
    truth = truth_of(cloud, TWO_BOXES)
    right = cloud.points[:, 1] < np.median(cloud.points[truth == 1, 1])
    marked = (truth == 1) & right
    graph = singulate(cloud, truth > 0, SingulationConfig(), of_interest=marked)
    own = np.append(graph.patch_object, -1)[graph.point_patch]
    inside = marked[truth > 0]
    label = np.bincount(own[inside]).argmax()
    overlap = np.sum((own == label) & inside) / np.sum((own == label) | inside)
    assert overlap > 0.95


def test_colours_weaken_a_join_but_do_not_decide_alone():
    cloud = scene_cloud(STACK)
    truth = truth_of(cloud, STACK)
    painted = np.where((truth == 1)[:, None], [0.8, 0.1, 0.1], [0.1, 0.1, 0.8])
    graphs = [
        singulate(cloud, truth > 0, SingulationConfig(), colors=colors)
        for colors in (None, painted, np.full_like(painted, 0.5))
    ]
    object_of = [g.patch_object for g in graphs]
    assert same_partition(object_of[0] + 1, object_of[2] + 1)
    crossing = (
        object_of[1][graphs[1].edges[:, 0]] != object_of[1][graphs[1].edges[:, 1]]
    )
    assert (graphs[1].score[crossing] <= graphs[0].score[crossing] + 1e-9).all()


@pytest.mark.filterwarnings("error")
def test_colours_may_decide_all_but_alone():
    cloud = scene_cloud(STACK)
    truth = truth_of(cloud, STACK)
    painted = np.where((truth == 1)[:, None], [0.8, 0.1, 0.1], [0.1, 0.1, 0.8])
    paint = SingulationConfig(color_weight=1e6)
    graph = singulate(cloud, truth > 0, paint, colors=painted)
    assert np.isfinite(graph.score).all()
    assert len(np.unique(graph.patch_object)) >= 2


def test_the_order_of_points_changes_nothing(rng):
    cloud = scene_cloud(STACK)
    order = rng.permutation(len(cloud))
    expected = segment_cloud(cloud).labels[order]
    np.testing.assert_array_equal(segment_cloud(cloud.selected(order)).labels, expected)


@given(st.floats(-3.1, 3.1), st.floats(-0.4, 0.4), st.floats(-0.4, 0.4))
@settings(max_examples=6)
def test_moving_base_and_camera_together_changes_nothing(yaw, x, y):
    cloud = scene_cloud(STACK)
    move = SE3.from_parts(so3.from_rpy(np.array([0.0, 0.0, yaw])), [x, y, 0.0])
    standing = truth_of(cloud, STACK) > 0
    config = SingulationConfig()
    graph = singulate(cloud, standing, config)
    moved = singulate(cloud.in_frame(move, "base"), standing, config)
    np.testing.assert_array_equal(moved.patch_object, graph.patch_object)
    np.testing.assert_array_equal(moved.point_patch, graph.point_patch)
    np.testing.assert_allclose(moved.rise, graph.rise, atol=1e-6)


def test_the_camera_is_found_from_the_cloud():
    capture = capture_of(TWO_BOXES)
    move = SE3.exp(np.array([0.3, -0.2, 0.5, 0.2, -0.4, 1.0]))
    cloud = capture.cloud().in_frame(move, "elsewhere")
    image = inverse_depth_image(cloud)
    expected = (move @ LOOKING_DOWN_AND_AHEAD).R
    np.testing.assert_allclose(image.R_base_camera, expected, atol=1e-9)
    assert image.focal == pytest.approx(CAMERA.fx)
    known = image.values > 0
    np.testing.assert_allclose(1 / image.values[known], capture.depth[known], rtol=1e-6)


def test_pixels_that_no_pinhole_camera_made_go_to_the_fallback(rng):
    cloud = scene_cloud(TWO_BOXES)
    shuffled = PointCloud(
        points=cloud.points,
        normals=cloud.normals,
        viewpoint=cloud.viewpoint,
        pixels=rng.permutation(cloud.pixels),
        image_shape=cloud.image_shape,
    )
    assert inverse_depth_image(shuffled) is None
    assert segment_cloud(shuffled).method == "lccp"


@pytest.mark.parametrize(
    "out_of_range",
    [
        {"max_gap": 0.0},
        {"max_increase": np.nan},
        {"sweeps": -1},
        {"min_patch": 1001},
        {"min_score": 1.5},
        {"color_weight": -0.1},
        {"color_weight": np.inf},
    ],
)
def test_settings_out_of_range_are_refused(out_of_range):
    with pytest.raises(ConfigError):
        SingulationConfig(**out_of_range)
