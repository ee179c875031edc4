from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.errors import (
    ConfigError,
    FrameMismatchError,
    InputError,
    ShapeError,
)
from debrisgrasp.geometry import SE3, image_normals, so3
from debrisgrasp.io import Capture
from debrisgrasp.segmentation import (
    LccpConfig,
    SegmentationConfig,
    SupportAware,
    segment_cloud,
    segmentation_of_labels,
    with_mark,
)
from debrisgrasp.segmentation.segmentation import measured_segments
from tests.benchmarks.segmentation_scores import scores
from tests.scenes import capture_of

from .clouds import TWO_BOXES, cloud_of, plate, scene_cloud, truth_of

UP = np.array([0.0, 0.0, 1.0])
LCCP = SegmentationConfig(method=LccpConfig())


@pytest.mark.parametrize("config", [None, LCCP], ids=["default", "lccp"])
def test_segments_describe_their_points(config):
    cloud = scene_cloud(TWO_BOXES)
    result = segment_cloud(cloud, config)
    assert result.labels.dtype == np.int32
    sizes = [segment.n_points for segment in result.segments]
    assert sizes == sorted(sizes, reverse=True)
    assert [s.label for s in result.segments] == list(range(1, len(sizes) + 1))
    assert sum(sizes) == np.count_nonzero(result.labels)
    for segment in result.segments:
        own = cloud.points[result.points_of(segment.label)]
        assert len(own) == segment.n_points
        np.testing.assert_allclose(segment.centroid, own.mean(axis=0))
        assert segment.bounds.contains(own).all()
        np.testing.assert_allclose(segment.axes @ segment.axes.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(segment.axes) == pytest.approx(1.0)
        along = (own - segment.centroid) @ segment.axes.T
        few = len(along) // 200
        inner = np.sort(along, axis=0)[few : len(along) - few]
        np.testing.assert_allclose(segment.extents, np.ptp(inner, axis=0), atol=1e-9)


@pytest.mark.parametrize("config", [None, LCCP], ids=["default", "lccp"])
def test_patches_nest_in_segments_and_spare_the_ground(config):
    result = segment_cloud(scene_cloud(TWO_BOXES), config)
    pairs = np.unique(np.stack([result.patches, result.labels], axis=1), axis=0)
    assert len(pairs) == len(np.unique(result.patches))
    assert (result.labels[result.patches == 0] == 0).all()


def test_parts_of_a_result_show_themselves_in_a_line():
    result = segment_cloud(scene_cloud(TWO_BOXES))
    ground, edges, segment = result.ground, result.edges, result.segments[0]
    assert repr(ground) == f"<GroundReport removed: {ground.reason}>"
    assert type(ground.inlier_share) is float
    assert repr(edges) == "<SegmentEdges between none>"
    touching = replace(edges, labels=np.array([[1, 2], [1, 3]]))
    assert repr(touching) == "<SegmentEdges between 1-2, 1-3>"
    size = " x ".join(f"{100 * extent:.0f}" for extent in segment.extents)
    told = f"<Segment 1: {segment.n_points} points, {size} cm, middle at ("
    assert repr(segment).startswith(told)


def test_arrays_of_a_result_are_read_only():
    result = segment_cloud(scene_cloud(TWO_BOXES))
    with pytest.raises(ValueError, match="read-only"):
        result.labels[0] = 5


@pytest.mark.parametrize("n", [1, 3])
def test_a_handful_of_points_is_a_speck(n):
    cloud = cloud_of([[0.5, 0.01 * k, 0.3] for k in range(n)])
    result = segment_cloud(cloud)
    assert result.segments == ()
    assert result.ground.status == "skipped"
    assert result.labels.tolist() == [0] * n


def test_a_handful_of_points_is_an_object_if_specks_are_wanted():
    cloud = cloud_of([[0.5, 0.0, 0.3]])
    result = segment_cloud(cloud, SegmentationConfig(min_points=0))
    assert len(result.segments) == 1


def test_one_plane_in_the_air_is_one_object():
    result = segment_cloud(cloud_of(plate((0.5, 0.8), (0.0, 0.3)), UP))
    assert len(result.segments) == 1


def test_all_ground_is_not_guessed_away():
    floor = plate((0.5, 1.5), (-0.5, 0.5), z=0.0, spacing=0.01)
    result = segment_cloud(cloud_of(floor, UP))
    assert result.ground.status == "skipped"
    assert len(result.segments) == 1


def test_objects_without_any_ground_are_found():
    cloud = scene_cloud(TWO_BOXES, has_floor=False)
    result = segment_cloud(cloud)
    assert result.ground.status == "skipped"
    assert len(result.segments) == 2


def test_duplicates_share_the_label_of_their_twin():
    points = np.concatenate(
        [plate((0.5, 0.6), (0, 0.1)), plate((0.5, 0.6), (0.3, 0.4))]
    )
    result = segment_cloud(cloud_of(np.concatenate([points, points]), UP))
    half = len(points)
    np.testing.assert_array_equal(result.labels[:half], result.labels[half:])
    assert len(result.segments) == 2


def test_scans_that_are_merged_are_divided_like_one_of_them(rng):
    points = scene_cloud(TWO_BOXES, has_floor=False).points
    once = rng.choice(points, 3000, replace=False)
    again = rng.permutation(np.tile(np.arange(len(once)), 4)[: 10 * len(once) // 3])
    own, merged = segment_cloud(cloud_of(once)), segment_cloud(cloud_of(once[again]))
    assert len(own.segments) > 1
    np.testing.assert_array_equal(merged.labels, own.labels[again])
    np.testing.assert_array_equal(merged.patches, own.patches[again])
    np.testing.assert_array_equal(merged.ground.kinds, own.ground.kinds[again])
    counts = [[s.n_points for s in found.segments] for found in (own, merged)]
    assert counts[0] == counts[1]


def test_a_mark_on_one_of_two_points_in_a_place_marks_both():
    points = plate((0.5, 0.6), (0, 0.1))
    is_marked = np.repeat([False, True], len(points))
    cloud = cloud_of(np.concatenate([points, points]), UP)
    assert segment_cloud(cloud, of_interest=is_marked).marked_shares.tolist() == [1.0]


def test_clouds_without_any_normal_still_divide_by_distance():
    near, far = plate((0.5, 0.6), (0, 0.1)), plate((0.5, 0.6), (0.3, 0.4))
    cloud = cloud_of(np.concatenate([near, far]))
    labels = segment_cloud(cloud, SegmentationConfig(min_points=1)).labels
    assert not set(labels[: len(near)]) & set(labels[len(near) :])


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_points_that_are_not_finite_are_refused(bad):
    with pytest.raises(InputError, match="NaN or infinite"):
        segment_cloud(cloud_of([[0.5, 0.0, 0.3], [bad, 0.0, 0.3]]))


def test_a_few_strays_make_no_object_longer(rng):
    box = rng.uniform(-0.5, 0.5, (2000, 3)) * [0.6, 0.1, 0.05]
    strays = box[:8] + np.array([1.5, 0.0, 0.0])
    points = np.concatenate([box, strays])
    (segment,) = measured_segments(points, np.ones(len(points), int), np.ones(2))
    np.testing.assert_allclose(segment.extents, [0.6, 0.1, 0.05], rtol=0.15)
    assert segment.bounds.upper[0] > 1.1


def test_empty_clouds_are_refused():
    with pytest.raises(InputError, match="no points"):
        segment_cloud(cloud_of(np.empty((0, 3))))


@pytest.mark.parametrize("has_image", [True, False])
def test_a_noisy_scene_moved_with_its_camera_is_divided_the_same(has_image, rng):
    cloud = scene_cloud(TWO_BOXES)
    away = cloud.points - cloud.viewpoint
    noise = 1.0 + rng.normal(0.0, 0.003, (len(cloud), 1))
    cloud = replace(cloud, points=cloud.viewpoint + noise * away)
    if not has_image:
        cloud = replace(cloud, pixels=None, image_shape=None)
    expected = segment_cloud(cloud)
    for yaw, x, y in ((0.0, 0.01, 0.0), (0.7, 0.3, -0.2), (-2.0, 1.0, 1.0)):
        move = SE3.from_parts(so3.from_rpy(np.array([0.0, 0.0, yaw])), [x, y, 0.0])
        found = segment_cloud(cloud.in_frame(move, "base"))
        np.testing.assert_array_equal(found.labels, expected.labels)
        np.testing.assert_array_equal(found.ground.kinds, expected.ground.kinds)
        plane = found.ground.plane @ move.matrix
        np.testing.assert_allclose(plane, expected.ground.plane, atol=1e-9)


@pytest.mark.parametrize("far", [1e5, 1e9, 1e25])
def test_points_too_far_apart_to_be_binned_are_refused(far, rng):
    points = rng.normal(size=(500, 3))
    points[:2] = [[-far, -far, far], [far, far, -far]]
    with pytest.raises(InputError, match="extent of the cloud"):
        segment_cloud(cloud_of(points))


def test_clouds_in_another_frame_are_refused():
    cloud = cloud_of([[0.5, 0.0, 0.3]]).in_frame(SE3.from_parts(), "camera")
    with pytest.raises(FrameMismatchError):
        segment_cloud(cloud)


def test_colours_need_one_row_per_point():
    with pytest.raises(InputError, match="colors"):
        segment_cloud(cloud_of([[0.5, 0.0, 0.3]]), colors=np.zeros((2, 3)))


@pytest.mark.parametrize("value", [255.0, -0.1, np.nan])
def test_colours_outside_of_their_range_are_refused(value):
    cloud = cloud_of([[0.5, 0.0, 0.3], [0.5, 0.1, 0.3]])
    with pytest.raises(InputError, match="by 255"):
        segment_cloud(cloud, colors=np.array([[0.5, 0.5, value], [0.0, 0.0, 0.0]]))


@pytest.mark.parametrize("marked", [[0, 1], np.array([1.0, 0.0]), [True]])
def test_marks_are_true_or_false_for_each_point(marked):
    cloud = cloud_of([[0.5, 0.0, 0.3], [0.5, 0.1, 0.3]])
    with pytest.raises(ShapeError, match="of_interest"):
        segment_cloud(cloud, of_interest=marked)
    with pytest.raises(ShapeError, match="of_interest"):
        with_mark(segment_cloud(cloud), marked)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"cloud": np.eye(3)}, r"cloud: got ndarray.*Capture\.cloud\(\)"),
        ({"config": LccpConfig()}, "config: got LccpConfig"),
        ({"region": (0, 1)}, "region: got tuple.*Bounds"),
    ],
    ids=["cloud", "config", "region"],
)
def test_what_is_no_cloud_is_not_divided(wrong, words):
    right = {"cloud": cloud_of([[0.5, 0.0, 0.3]])}
    with pytest.raises(InputError, match=words):
        segment_cloud(**{**right, **wrong})


def test_one_object_is_not_several():
    result = segmentation_of_labels(cloud_of([[0.5, 0.0, 0.3]]), [1])
    assert repr(result) == "<Segmentation of 1 point: 1 object, ground skipped>"


def test_colours_and_marks_may_be_lists():
    cloud = cloud_of([[0.5, 0.0, 0.3], [0.5, 0.1, 0.3]])
    found = segment_cloud(
        cloud, colors=[[0, 0, 0], [1, 1, 1]], of_interest=[True, True]
    )
    assert found.labels.shape == (2,)


def test_negative_smallest_size_is_refused():
    with pytest.raises(ConfigError):
        SegmentationConfig(min_points=-1)


def test_millions_of_points_take_bounded_memory(rng):
    points = rng.uniform([0.5, -1, 0.0], [2.5, 1, 0.02], (1_000_000, 3))
    result = segment_cloud(cloud_of(points, UP), is_cropped=True)
    assert len(result.labels) == 1_000_000


@pytest.mark.parametrize(
    ("kind", "least"), [("clean", 0.85), ("noisy", 0.8)], ids=["clean", "noisy"]
)
def test_simulated_piles_are_divided_well(shared_data, kind, least):
    overlap = []
    for path in sorted((shared_data / "piles").glob(f"*_{kind}.npz")):
        capture = Capture.load(path)
        cloud = capture.cloud()
        labels = segment_cloud(cloud).labels
        overlap.append(scores(labels, capture.labels.ravel()[cloud.pixels]).wov)
    assert np.mean(overlap) > least


def test_an_unorganised_scan_is_divided(shared_data):
    path = shared_data / "real" / "drc_cinderblocks_close.npz"
    cloud = Capture.load(path, camera_pose="level").cloud()
    result = segment_cloud(cloud)
    assert result.method == "lccp"
    # Most of what the scan shows is blocks; the little ground lies where it should.
    assert result.ground.status == "removed"
    assert result.ground.inlier_share < 0.25
    assert len(result.segments) > 10
    for candidate in SupportAware().order(result, cloud)[:5]:
        assert result.segment(candidate.label).bounds.upper[2] > 0.1


def test_labels_do_not_depend_on_how_the_image_is_cut_into_strips(monkeypatch):
    capture = capture_of(TWO_BOXES)
    expected = segment_cloud(capture.cloud()).labels
    for rows in (5, 64, 10_000):
        monkeypatch.setattr(image_normals, "_CHUNK_ROWS", rows)
        again = Capture(
            depth=capture.depth,
            intrinsics=capture.intrinsics,
            T_base_camera=capture.T_base_camera,
        )
        np.testing.assert_array_equal(segment_cloud(again.cloud()).labels, expected)


@pytest.mark.parametrize("config", [None, LCCP], ids=["default", "lccp"])
def test_holes_in_the_depth_divide_nothing(config, rng):
    capture = capture_of(TWO_BOXES)
    depth = capture.depth.copy()
    depth[rng.random(depth.shape) < 0.1] = np.nan
    for row, column in rng.integers(20, 220, (12, 2)):
        depth[row : row + 5, column : column + 5] = np.nan
    cloud = replace(capture, depth=depth).cloud()
    result = segment_cloud(cloud, config)
    assert len(result.labels) == np.isfinite(depth).sum()
    assert scores(result.labels, truth_of(cloud, TWO_BOXES)).wov > 0.85
