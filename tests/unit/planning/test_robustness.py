"""Expected quality under errors of the pose: exact moments, and what it prefers."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import SE3
from debrisgrasp.planning import PoseUncertainty


def mean_of(quality, offsets, poses, prototype):
    """Mean quality over errors of each pose (k,)."""
    moved = (poses[:, None] @ offsets.matrix).reshape(-1, 4, 4)
    values = quality(moved, np.repeat(prototype, len(offsets.matrix)))
    return values.reshape(len(poses), -1).mean(axis=1)


@pytest.mark.parametrize("kind", ["offsets", "few_offsets"])
def test_errors_have_the_stated_mean_and_covariance(kind):
    uncertainty = PoseUncertainty(position=0.01, rotation=0.035)
    twists = getattr(uncertainty, kind)().log()
    assert np.abs(twists.mean(axis=0)).max() < 1e-12
    covariance = twists.T @ twists / len(twists)
    expected = np.diag(np.square(np.repeat([0.01, 0.035], 3)))
    assert np.allclose(covariance, expected, atol=1e-12)


@pytest.mark.parametrize("kind", ["offsets", "few_offsets"])
def test_expectation_of_a_quadratic_is_exact(rng, kind):
    """E[c - a x^2] = c - a (x0^2 + sigma^2) for a shift along x."""
    poses = SE3.exp(0.3 * rng.normal(size=(20, 6)))
    uncertainty = PoseUncertainty(position=0.02, rotation=0.0)

    def quality(Ts, _prototype):
        return 1.0 - 3.0 * np.square(Ts[:, :3, 3]).sum(axis=1)

    nominal = quality(poses.matrix, None)
    offsets = getattr(uncertainty, kind)()
    mean = mean_of(quality, offsets, poses.matrix, np.zeros(20, int))
    assert mean == pytest.approx(nominal - 3.0 * 3 * 0.02**2, abs=1e-12)


def test_without_errors_the_expectation_is_the_quality(rng):
    poses = SE3.exp(0.3 * rng.normal(size=(5, 6))).matrix
    exact = PoseUncertainty(position=0.0, rotation=0.0)
    value = mean_of(lambda Ts, _: Ts[:, 0, 0], exact.offsets(), poses, np.zeros(5, int))
    assert value == pytest.approx(poses[:, 0, 0])


def test_a_narrow_peak_is_worth_less_than_a_broad_plateau():
    def quality(Ts, prototype):
        width = np.where(prototype == 0, 0.005, 0.05)
        top = np.where(prototype == 0, 1.0, 0.8)
        return top * np.exp(-0.5 * (Ts[:, 0, 3] / width) ** 2)

    poses = np.tile(np.eye(4), (2, 1, 1))
    offsets = PoseUncertainty().offsets()
    narrow, broad = mean_of(quality, offsets, poses, np.array([0, 1]))
    assert broad > narrow


@pytest.mark.parametrize("field", ["position", "rotation"])
def test_spreads_that_make_no_sense_are_refused(field):
    for value in (-0.01, 3.0, np.nan):
        with pytest.raises(ConfigError, match=field):
            PoseUncertainty(**{field: value})
