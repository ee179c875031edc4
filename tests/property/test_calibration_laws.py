"""Laws of calibration: exact without noise, equivariant, error linear in the noise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from debrisgrasp.calibration import (
    CalibrationConfig,
    Observations,
    WorkspaceError,
    calibrate,
    predicted_error,
)
from debrisgrasp.calibration.uncertainty import lever_arm
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3, Bounds, sampling
from tests.strategies import poses
from tests.unit.calibration.looks import PLACES

CAMERA_SIDE = np.array([0.0, 0.0, 2.5])
"""Added to random places so that the camera has them before it [m]."""
seeds = st.integers(0, 2**32 - 1)


def seen_anywhere(seed: int, n: int) -> np.ndarray:
    """Random places before the camera, camera frame."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.6, 0.6, (n, 3)) + CAMERA_SIDE
    assume(lever_arm(points) > 0.15)
    return points


def upright(pose: SE3) -> SE3:
    """Keep the place and the pan, so that the camera is not taken for swapped."""
    pan = np.arctan2(pose.R[1, 0], pose.R[0, 0])
    c, s = np.cos(pan), np.sin(pan)
    d = np.sqrt(0.5)
    level = np.array([[0.0, -d, d], [-1.0, 0.0, 0.0], [0.0, -d, -d]])
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return SE3.from_parts(turn @ level, pose.p)


@given(poses, seeds, st.integers(3, 12))
def test_what_is_measured_without_noise_is_recovered(pose, seed, n):
    points, T = seen_anywhere(seed, n), upright(pose)
    found = calibrate(Observations(T.apply(points), points))
    assert found.T_base_camera.matrix == pytest.approx(T.matrix, abs=1e-9)
    assert found.rmse < 1e-9
    assert not found.is_outlier.any()


@given(poses, seeds)
def test_a_moved_base_moves_the_answer_and_nothing_else(pose, seed):
    rng = np.random.default_rng(seed)
    points = seen_anywhere(seed, 8)
    T = upright(SE3.identity())
    noisy = points + rng.normal(0.0, 0.002, points.shape)
    moved = upright(pose) @ T.inverse()
    first = calibrate(Observations(T.apply(points), noisy))
    other = calibrate(Observations(moved.apply(T.apply(points)), noisy))
    assert other.T_base_camera.matrix == pytest.approx(
        (moved @ first.T_base_camera).matrix, abs=1e-8
    )
    assert other.kept.chi_square == pytest.approx(first.kept.chi_square, rel=1e-6)
    assert other.held_out == pytest.approx(first.held_out, abs=1e-8)
    at = T.apply(points)
    assert predicted_error(other.covariance, moved.apply(at)) == pytest.approx(
        predicted_error(first.covariance, at), rel=1e-6
    )


@given(seeds)
def test_the_order_of_observations_is_irrelevant(seed):
    rng = np.random.default_rng(seed)
    points, T = seen_anywhere(seed, 7), upright(SE3.identity())
    noisy = points + rng.normal(0.0, 0.002, points.shape)
    order = rng.permutation(7)
    first = calibrate(Observations(T.apply(points), noisy))
    other = calibrate(Observations(T.apply(points)[order], noisy[order]))
    assert other.T_base_camera.matrix == pytest.approx(
        first.T_base_camera.matrix, abs=1e-9
    )
    assert other.is_outlier.tolist() == first.is_outlier[order].tolist()


@given(seeds, st.floats(0.1, 0.9))
def test_error_and_residual_grow_linearly_with_noise(seed, factor):
    rng = np.random.default_rng(seed)
    T = upright(SE3.identity())
    points = T.inverse().apply(PLACES)
    noise = rng.normal(0.0, 1e-4, points.shape)

    def fit(scale: float) -> tuple[np.ndarray, float]:
        found = calibrate(Observations(PLACES, points + scale * noise))
        return (found.T_base_camera @ T.inverse()).log(), found.rmse

    (whole, rmse), (part, less) = fit(1.0), fit(factor)
    size = np.linalg.norm(whole)
    assert np.linalg.norm(part - factor * whole) < 2e-3 * size
    assert less == pytest.approx(factor * rmse, rel=2e-3)


@given(st.floats(1e-3, 2e-2))
def test_predicted_error_grows_with_the_stated_noise(sigma):
    T = upright(SE3.identity())
    seen = T.inverse().apply(PLACES)

    def rms(value: float) -> float:
        given = Observations(PLACES, seen, value, kinematic_sigma=1e-9)
        return calibrate(given).error.rms

    assert rms(sigma) == pytest.approx(sigma / 1e-3 * rms(1e-3), rel=1e-6)


@given(seeds)
def test_the_worst_point_of_the_workspace_is_a_corner(seed):
    root = np.random.default_rng(seed).normal(size=(6, 6))
    bounds = Bounds(np.array([0.6, -0.5, 0.0]), np.array([1.3, 0.6, 0.9]))
    error = WorkspaceError.of(root @ root.T, bounds)
    at_low = np.isclose(error.worst_at, bounds.lower)
    corner = at_low | np.isclose(error.worst_at, bounds.upper)
    assert corner.all()
    assert error.rms <= error.worst


@given(seeds, st.integers(3, 9))
def test_points_on_a_line_are_always_refused(seed, n):
    rng = np.random.default_rng(seed)
    way = rng.normal(size=3)
    way *= rng.uniform(0.05, 0.5) / np.linalg.norm(way)
    line = CAMERA_SIDE + np.linspace(-1, 1, n)[:, None] * way
    T = upright(SE3.identity())
    with pytest.raises(InputError, match="rotation"):
        calibrate(Observations(T.apply(line), line))


@given(seeds, st.sampled_from(range(3)))
def test_a_mirrored_axis_is_always_refused(seed, axis):
    points = seen_anywhere(seed, 8)
    assume(np.linalg.svd(points - points.mean(axis=0))[1][2] > 0.3)
    signs = np.ones(3)
    signs[axis] = -1.0
    rng = np.random.default_rng(seed)
    R = sampling.random_rotations(1, rng=rng)[0]
    mirrored = points * signs
    mirrored[:, 2] += 2.0 * max(0.0, 0.1 - mirrored[:, 2].min())
    with pytest.raises(InputError, match="left-handed"):
        calibrate(Observations(points @ R.T, mirrored), config=CalibrationConfig())
