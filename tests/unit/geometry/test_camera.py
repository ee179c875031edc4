"""Pixels to points and back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from debrisgrasp.errors import CaptureError, InputError, ShapeError
from debrisgrasp.geometry import Intrinsics

K = np.array([[610.0, 0.0, 322.5], [0.0, 605.0, 238.0], [0.0, 0.0, 1.0]])
CAMERA = Intrinsics.from_matrix(K, (480, 640))


def test_projection_undoes_deprojection(rng):
    depth = rng.uniform(0.3, 4.0, (480, 640))
    uv, z = CAMERA.project(CAMERA.deproject(depth))
    v, u = np.mgrid[:480, :640]
    assert_allclose(uv[..., 0], u, atol=1e-9)
    assert_allclose(uv[..., 1], v, atol=1e-9)
    assert_allclose(z, depth)


def test_the_principal_point_looks_straight_ahead():
    uv, z = CAMERA.project(np.array([0.0, 0.0, 2.0]))
    assert_allclose(uv, [322.5, 238.0])
    assert z == 2.0


def test_points_right_and_below_have_larger_pixel_coordinates():
    uv, _ = CAMERA.project(np.array([[0.1, 0.0, 1.0], [0.0, 0.1, 1.0]]))
    assert_allclose(uv, [[383.5, 238.0], [322.5, 298.5]])


def test_points_at_and_behind_the_camera_have_no_pixel():
    uv, z = CAMERA.project(np.array([[0.1, 0.2, -1.0], [0.1, 0.2, 0.0]]))
    assert np.isnan(uv).all()
    assert_allclose(z, [-1.0, 0.0])


def test_pixels_without_depth_have_no_point():
    depth = np.full((480, 640), np.nan)
    depth[10, 20] = 1.0
    points = CAMERA.deproject(depth)
    assert np.isfinite(points[10, 20]).all()
    assert np.isnan(points).all(axis=-1).sum() == 480 * 640 - 1


def test_a_depth_image_of_another_size_is_refused():
    with pytest.raises(ShapeError, match="depth"):
        CAMERA.deproject(np.ones((240, 320)))
    with pytest.raises(ShapeError, match=r"depth: got \(2, 480, 640\).*one image"):
        CAMERA.deproject(np.ones((2, 480, 640)))


def test_nine_numbers_row_by_row_are_a_matrix():
    flat = Intrinsics.from_matrix(K.ravel().tolist(), (480, 640))
    assert flat == Intrinsics.from_matrix(K, (480, 640))
    for odd in ([600.0, 600.0, 319.5, 239.5], [K, K], K[:2]):
        with pytest.raises(CaptureError, match=r"shape .*expected \[\[fx.* 9 numbers"):
            Intrinsics.from_matrix(odd, (480, 640))


@pytest.mark.parametrize(
    "matrix",
    [
        K * [[0.25], [0.25], [1.0]],
        K * [[4.0], [4.0], [1.0]],
        K * [[-1.0], [1.0], [1.0]],
        K * [[1e-3], [1e-3], [1.0]],
        K.T,
        np.full((3, 3), np.nan),
        np.zeros((3, 3)),
        np.eye(4),
    ],
    ids=["small", "large", "mirrored", "metres", "transposed", "nan", "zero", "4x4"],
)
def test_a_matrix_that_does_not_fit_the_image_is_refused(matrix):
    with pytest.raises(InputError, match="K"):
        Intrinsics.from_matrix(matrix, (480, 640))


def test_a_mirrored_matrix_is_not_told_to_have_skew():
    with pytest.raises(InputError, match=r"fx, fy > 0\. Give it row by row"):
        Intrinsics.from_matrix(K * [[-1.0], [1.0], [1.0]], (480, 640))


@pytest.mark.parametrize(
    ("field", "value"),
    [("fx", 0.0), ("fy", np.nan), ("fx", np.inf), ("cx", np.nan), ("height", 0)],
)
def test_cameras_that_cannot_be_are_refused(field, value):
    with pytest.raises(InputError, match=r"focal|finite|image"):
        replace(CAMERA, **{field: value})


@pytest.mark.parametrize("shape", [(480, 640, 3), (480,), 480, "here", None])
def test_an_image_has_rows_and_columns(shape):
    with pytest.raises(CaptureError, match=r"shape of the image: .*shape\[:2\]"):
        Intrinsics.from_matrix(K, shape)
