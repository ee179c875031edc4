"""Rotation vectors in plain numbers, by scipy's, also where logarithms are hard."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from debrisgrasp.control._rigid import exp3, rotation_error, times
from debrisgrasp.geometry import so3
from tests.strategies import unit_vectors

from .rigs import rpy

AXES = [*np.eye(3), *-np.eye(3), [1, 1, 0], [1, -1, 0], [0, 1, -1], [1, -2, 3]]
ANGLES = [0.0, 1e-300, 1e-12, 1e-7, 9.9e-5, 1.1e-4, 0.5, 3.0, 3.1]
NEAR_PI = [np.pi - gap for gap in (1e-3, 2e-4, 9e-5, 1e-6, 1e-9, 1e-13)]
BEYOND = [np.pi, np.pi + 1e-13]


def plain(R: np.ndarray) -> tuple[float, ...]:
    return tuple(np.asarray(R).ravel().tolist())


def require_same_turn(found, expected) -> None:
    """By pi it counts as well about the opposite axis."""
    expected = np.asarray(expected)
    if np.linalg.norm(expected) > np.pi - 1e-10 and found @ expected < 0.0:
        expected = -expected
    np.testing.assert_allclose(found, expected, atol=1e-11)


@pytest.mark.parametrize("angle", [*ANGLES, *NEAR_PI, *BEYOND])
@pytest.mark.parametrize("axis", AXES, ids=str)
def test_the_turn_that_is_left_is_scipys(axis, angle):
    rotvec = angle * np.array(axis, dtype=float) / np.linalg.norm(axis)
    turn = Rotation.from_rotvec(rotvec)
    expected, R = turn.as_rotvec(), rpy(0.3, -1.0, 2.0)
    left = rotation_error(plain(R), plain(turn.as_matrix() @ R))
    require_same_turn(np.array(left), expected)


@given(axis=unit_vectors, gap=st.floats(0.0, 1e-3))
def test_a_turn_by_nearly_pi_is_undone_by_its_own_vector(axis, gap):
    R = so3.exp((np.pi - gap) * axis)
    found = rotation_error(plain(np.eye(3)), plain(R))
    assert np.linalg.norm(found) == pytest.approx(np.pi - gap, abs=1e-11)
    np.testing.assert_allclose(np.reshape(exp3(found), (3, 3)), R, atol=1e-10)
    half = exp3(tuple(0.5 * x for x in found))
    np.testing.assert_allclose(times(half, half), plain(R), atol=1e-10)
