"""Clouds and boxes: selection, frames, refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from debrisgrasp.errors import FrameMismatchError, InputError, ShapeError
from debrisgrasp.geometry import SE3, Bounds, PointCloud, so3


@pytest.fixture
def cloud(rng):
    normals = rng.normal(size=(50, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return PointCloud(
        rng.uniform(-1, 1, (50, 3)),
        normals,
        np.array([0.0, 0.0, 2.0]),
        frame="camera",
        pixels=np.arange(50),
        image_shape=(5, 10),
    )


def test_cropping_keeps_exactly_the_points_inside(cloud):
    bounds = Bounds(np.array([-0.5, -0.5, -1.0]), np.array([0.5, 1.0, 1.0]))
    cropped = cloud.cropped(bounds)
    inside = ((cloud.points >= bounds.lower) & (cloud.points <= bounds.upper)).all(1)
    assert 0 < len(cropped) < len(cloud)
    assert_array_equal(cropped.pixels, np.flatnonzero(inside))
    assert_array_equal(cropped.normals, cloud.normals[inside])


@pytest.mark.parametrize("is_organised", [True, False])
def test_a_mask_and_its_row_numbers_select_the_same_points(cloud, is_organised):
    if not is_organised:
        cloud = replace(cloud, pixels=None, image_shape=None)
    mask = cloud.points[:, 0] > 0
    for index in (mask, np.flatnonzero(mask)):
        chosen = cloud.selected(index)
        assert_array_equal(chosen.points, cloud.points[mask])
        assert_array_equal(chosen.normals, cloud.normals[mask])
        assert (chosen.pixels is None) != is_organised
    with pytest.raises(IndexError):
        cloud.selected(mask[:-1])


def test_pixels_are_the_clouds_own(cloud):
    pixels = np.arange(50)
    own = replace(cloud, pixels=pixels)
    pixels[:] = 0
    assert_array_equal(own.pixels, np.arange(50))
    assert not own.pixels.flags.writeable
    assert not own.cropped(Bounds.around(own.points)).pixels.flags.writeable
    assert_array_equal(replace(cloud, pixels=list(range(50))).pixels, np.arange(50))


def test_the_shape_of_an_image_may_be_a_list(cloud):
    assert replace(cloud, image_shape=[5, 10]).image_shape == (5, 10)


def test_pixels_are_integers(cloud):
    with pytest.raises(InputError, match=r"pixels.*float64.*integers"):
        replace(cloud, pixels=np.arange(50.0))


def test_a_change_of_frame_moves_points_and_turns_normals(cloud, rng):
    T_base_camera = SE3.from_parts(so3.exp(rng.normal(size=3)), rng.normal(size=3))
    moved = cloud.in_frame(T_base_camera, "base")
    back = moved.in_frame(T_base_camera.inverse(), "camera")
    assert moved.frame == "base"
    assert_allclose(back.points, cloud.points, atol=1e-12)
    assert_allclose(back.normals, cloud.normals, atol=1e-12)
    assert_allclose(moved.viewpoint, T_base_camera.apply(cloud.viewpoint))


def test_a_cloud_in_another_frame_is_refused_with_the_mend(cloud):
    with pytest.raises(FrameMismatchError, match="T_base_camera"):
        cloud.require_frame("base")


def test_arrays_are_copied_and_read_only(rng):
    points = rng.normal(size=(4, 3))
    cloud = PointCloud(points, np.full_like(points, np.nan), np.zeros(3))
    points[0] = 99.0
    assert cloud.points.max() < 99.0
    with pytest.raises(ValueError, match="read-only"):
        cloud.points[0] = 0.0


def test_points_and_normals_of_different_number_are_refused():
    with pytest.raises(ShapeError, match="points and normals"):
        PointCloud(np.zeros((4, 3)), np.zeros((5, 3)), np.zeros(3))


@pytest.mark.parametrize(
    ("lower", "upper", "message"),
    [
        ([0, 0, 0], [1, 0, 1], "lower < upper"),
        ([0, 0, 2], [1, 1, 1], "lower < upper"),
        ([0, 0, np.nan], [1, 1, 1], "finite"),
        ([0, 0, 0], [1, 1, np.inf], "finite"),
    ],
)
def test_boxes_without_volume_are_refused(lower, upper, message):
    with pytest.raises(InputError, match=message):
        Bounds(np.array(lower, float), np.array(upper, float))


def test_a_box_around_points_contains_them(rng):
    points = rng.normal(size=(20, 3))
    bounds = Bounds.around(points, margin=0.1)
    assert bounds.contains(points).all()
    assert_allclose(bounds.grown(0.2).size, bounds.size + 0.4)
    with pytest.raises(InputError, match="at least one"):
        Bounds.around(np.empty((0, 3)))


def test_a_box_is_one_box_around_rows_of_points(rng):
    image = rng.normal(size=(4, 5, 3))
    with pytest.raises(ShapeError, match=r"lower corner: got \(4, 3\)"):
        Bounds(image[:, 0] - 9.0, image[:, 0])
    with pytest.raises(ShapeError, match=r"points to bound.*reshape\(-1, 3\)"):
        Bounds.around(image)
    with pytest.raises(InputError, match="margin"):
        Bounds.around(image[0], margin=-0.1)
    with pytest.raises(ShapeError, match="points"):
        Bounds.around(image[0]).contains([[0.0, 0.0, 0.0], [1.0]])


def test_the_rim_is_where_the_measured_part_of_an_image_ends():
    measured = np.ones((96, 160), dtype=bool)
    measured[:, :6] = False  # as a stereo camera leaves it
    measured[40:60, 70:90] = False  # a hole is not the end
    pixels = np.flatnonzero(measured)
    points = np.zeros((len(pixels), 3))
    cloud = PointCloud(
        points,
        points + np.nan,
        np.zeros(3),
        pixels=pixels,
        image_shape=measured.shape,
    )
    at_rim = np.zeros(measured.shape, dtype=bool)
    at_rim.ravel()[pixels] = cloud.at_rim(np.arange(len(pixels)))
    expected = measured.copy()
    expected[2:-2, 8:-2] = False
    assert (at_rim == expected).all()
    assert_array_equal(cloud.at_rim(np.array([0, 5000])), [True, False])


def test_a_cloud_without_an_image_has_no_rim():
    cloud = PointCloud(np.zeros((3, 3)), np.full((3, 3), np.nan), np.zeros(3))
    assert not cloud.at_rim(np.arange(3)).any()


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("points", np.array([[0.0, np.nan, 1.0]]), r"points.*1 of 3 values NaN"),
        ("normals", np.zeros((1, 3)), r"normals.*1 of 1.*length.*of 0\b.*NaN where"),
        ("normals", np.array([[0.0, 0.0, 1.5]]), r"first of 1\.5.*Divide"),
        ("viewpoint", np.array([0.0, np.inf, 0.0]), r"viewpoint.*finite"),
        ("pixels", np.arange(2), r"pixels.*\(2,\).*\(1,\)"),
    ],
)
def test_clouds_that_cannot_be_are_refused(field, value, message):
    good = {
        "points": np.zeros((1, 3)),
        "normals": np.full((1, 3), np.nan),
        "viewpoint": np.ones(3),
    }
    PointCloud(**good)
    with pytest.raises(InputError, match=f"(?s){message}"):
        PointCloud(**{**good, field: value})


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"viewpoint": np.zeros((2, 3))}, r"viewpoint: got \(2, 3\), expected \(3,\)"),
        ({"pixels": np.arange(50) + 1}, "pixels: got 1 to 50, expected 0 to 49"),
        ({"pixels": np.arange(50) - 1}, "pixels: got -1 to 48"),
        ({"pixels": None}, r"pixels: got \(0,\), expected \(50,\)"),
        ({"image_shape": None}, r"image_shape: got None, expected \(height, width\)"),
        ({"image_shape": (5, 10, 3)}, r"image_shape: got \(5, 10, 3\)"),
        ({"image_shape": (5.0, 10.0)}, r"image_shape: got \(5\.0, 10\.0\)"),
    ],
    ids=["viewpoints", "beyond", "before", "no", "of none", "colours", "floats"],
)
def test_a_cloud_has_one_viewpoint_and_pixels_of_its_image(cloud, wrong, words):
    with pytest.raises(InputError, match=words):
        replace(cloud, **wrong)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda cloud: cloud.cropped((0, 1)), r"bounds: got tuple.*Bounds\("),
        (lambda cloud: cloud.in_frame(np.eye(4), "base"), r"T_frame_own.*from_matrix"),
        (
            lambda cloud: cloud.in_frame("base", SE3.identity()),
            "T_frame_own: got",
        ),
    ],
)
def test_no_box_and_no_pose_is_refused_in_words(cloud, call, words):
    with pytest.raises(InputError, match=words):
        call(cloud)
