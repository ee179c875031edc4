"""Normals of depth images, against known planes, with and without sensor noise."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.errors import ShapeError
from debrisgrasp.geometry import Intrinsics, depth_normals

CAMERA = Intrinsics(fx=610.0, fy=608.0, cx=321.0, cy=237.0, width=640, height=480)


def rays() -> np.ndarray:
    return CAMERA.deproject(np.ones((480, 640)))


def plane_depth(normal: np.ndarray, distance: float) -> np.ndarray:
    """Depth of the plane ``normal . x == -distance``, whose normal faces the camera."""
    return -distance / (rays() @ normal)


def unit(*vector: float) -> np.ndarray:
    return np.array(vector) / np.linalg.norm(vector)


def stereo_noise(depth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Noise of a stereo camera: 1.8 mm / m^2, over 2 pixels, disparity in 1/32."""
    coarse = rng.normal(0.0, 0.0018, (241, 321))
    smooth = np.kron(coarse, np.ones((2, 2)))[:480, :640]
    baseline_times_focal = 0.05 * CAMERA.fx
    disparity = baseline_times_focal * (1 / depth + smooth)
    return baseline_times_focal / (np.round(disparity * 32) / 32)


def angles_deg(normals: np.ndarray, truth: np.ndarray) -> np.ndarray:
    return np.degrees(np.arccos(np.clip((normals * truth).sum(-1), -1, 1)))


NORMALS = [unit(0, 0, -1), unit(0.3, -0.8, -0.6), unit(-0.7, 0.2, -0.5)]


@pytest.mark.parametrize("normal", NORMALS)
def test_normals_of_an_exact_plane_are_exact(normal):
    normals = depth_normals(plane_depth(normal, 1.0), CAMERA)
    assert np.isfinite(normals).all()
    assert angles_deg(normals, normal).max() < 0.1


@pytest.mark.parametrize("normal", NORMALS)
def test_normals_of_a_noisy_plane_are_good_to_a_few_degrees(normal, rng):
    depth = plane_depth(normal, 1.5 * abs(normal[2]))  # 1.5 m at the centre
    normals = depth_normals(stereo_noise(depth, rng), CAMERA)
    errors = angles_deg(normals, normal)[np.isfinite(normals[..., 0])]
    assert errors.size > 0.99 * depth.size
    assert np.median(errors) < 4.0
    assert np.percentile(errors, 95) < 10.0


def test_normals_are_unit_vectors_towards_the_camera(rng):
    depth = stereo_noise(plane_depth(NORMALS[1], 1.0), rng)
    depth[:, 300:] += 0.4
    normals = depth_normals(depth, CAMERA)
    known = np.isfinite(normals[..., 0])
    np.testing.assert_allclose(np.linalg.norm(normals[known], axis=-1), 1.0)
    assert ((normals * rays()).sum(-1)[known] < 0).all()


def test_a_jump_in_depth_is_not_smoothed(rng):
    near, far = plane_depth(NORMALS[1], 0.8), plane_depth(NORMALS[2], 1.6)
    is_near = np.arange(640) < 301
    depth = stereo_noise(np.where(is_near, near, far), rng)
    normals = depth_normals(depth, CAMERA)
    truth = np.where(is_near[None, :, None], NORMALS[1], NORMALS[2])
    errors = angles_deg(normals, truth)
    beside = errors[20:-20, 296:306]
    assert np.isfinite(beside).mean() > 0.85
    assert np.nanpercentile(beside, 90) < 20.0


def test_a_crease_is_not_rounded():
    left, right = unit(0.8, 0.0, -0.6), unit(-0.8, 0.0, -0.6)
    depth = np.minimum(plane_depth(left, 0.6), plane_depth(right, 0.6))
    normals = depth_normals(depth, CAMERA)
    crease = 321
    assert angles_deg(normals[:, : crease - 3], left).max() < 1.0
    assert angles_deg(normals[:, crease + 4 :], right).max() < 1.0


def test_pixels_without_depth_and_lone_pixels_have_no_normal():
    depth = np.full((480, 640), np.nan)
    depth[100:200, 100:200] = 1.0
    depth[300, 300] = 1.0
    normals = depth_normals(depth, CAMERA)
    assert np.isnan(normals[np.isnan(depth)]).all()
    assert np.isnan(normals[300, 300]).all()
    assert np.isfinite(normals[102:198, 102:198]).all()


def test_a_stray_pixel_between_two_surfaces_has_no_normal():
    depth = np.full((480, 640), 1.5)
    depth[240, 320] = 1.2
    normals = depth_normals(depth, CAMERA)
    assert np.isnan(normals[240, 320]).all()
    assert angles_deg(normals[238, 318], unit(0, 0, -1)) < 0.1


def test_speckles_without_data_do_not_disturb_a_plane(rng):
    depth = plane_depth(NORMALS[1], 1.0)
    depth[rng.random(depth.shape) < 0.2] = np.nan
    normals = depth_normals(depth, CAMERA)
    known = np.isfinite(normals[..., 0])
    assert known.sum() > 0.99 * np.isfinite(depth).sum()
    assert np.percentile(angles_deg(normals, NORMALS[1])[known], 99) < 2.0


def test_images_of_odd_and_small_sizes_work():
    small = Intrinsics(fx=500.0, fy=500.0, cx=250.0, cy=20.0, width=499, height=41)
    normals = depth_normals(np.full((41, 499), 0.9), small)
    assert normals.shape == (41, 499, 3)
    np.testing.assert_allclose(normals, np.broadcast_to([0, 0, -1], normals.shape))


def test_an_image_without_depth_has_no_normals():
    assert np.isnan(depth_normals(np.full((480, 640), np.nan), CAMERA)).all()


def test_an_image_of_another_size_is_refused():
    with pytest.raises(ShapeError, match="depth"):
        depth_normals(np.ones((480, 320)), CAMERA)


@pytest.mark.parametrize("pile", ["pile_01", "pile_03"])
def test_noise_hardly_turns_the_normals_of_a_pile(pile, shared_data):
    normals = []
    for kind in ("clean", "noisy"):
        with np.load(shared_data / "piles" / f"{pile}_{kind}.npz") as arrays:
            depth = np.where(arrays["depth"] > 0, arrays["depth"], np.nan)
            camera = Intrinsics.from_matrix(arrays["K"], depth.shape)
        normals.append(depth_normals(depth, camera))
    errors = angles_deg(*normals)
    errors = errors[np.isfinite(errors)]
    assert np.median(errors) < 5.0
    assert np.percentile(errors, 90) < 12.0
