from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from debrisgrasp.motion.ramps import Ramps

SPEED = np.array([1.0])
speeds = st.floats(-1.0, 1.0)


def ramp(way: float, v0: float, v1: float, total: float) -> Ramps:
    states = (np.array([[x]]) for x in (0.0, v0, way, v1))
    return Ramps.between(*states, np.array([total]), SPEED)


@given(st.floats(-2.0, 2.0), speeds, speeds, st.floats(0.05, 5.0))
def test_ramps_join_the_two_states_and_keep_the_speed(way, v0, v1, total):
    found = ramp(way, v0, v1, total)
    q, v = found.at(found.total)
    if not found.fits[0]:
        # Only too far or too fast a motion has no ramp of its own.
        assert abs(way) > 0.4 * total
        return
    np.testing.assert_allclose([q[0, 0], v[0, 0]], [way, v1], atol=1e-7)
    t = np.linspace(0.0, total, 200)[:, None]
    assert np.abs(found.at(t)[1]).max() <= 1.0 + 1e-9


def test_from_rest_to_rest_is_the_known_triangle():
    found = ramp(0.25, 0.0, 0.0, 1.0)
    np.testing.assert_allclose(found.a, 1.0)
    np.testing.assert_allclose(found.at(np.array([[0.5]]))[1], 0.5)


def test_a_peak_that_is_too_fast_becomes_a_plateau():
    found = ramp(1.5, 0.0, 0.0, 2.0)
    # At full speed for T - d, half of it for 2 d: 2 - d = 1.5.
    np.testing.assert_allclose([found.t_hold[0, 0], found.t_end[0, 0]], [0.5, 1.5])
    np.testing.assert_allclose(found.a, 2.0)


def test_acceleration_is_constant_between_knots():
    found = ramp(0.3, 0.4, -0.2, 1.3)[0,]
    knots = np.concatenate([[0.0], found.knots()])
    for begin, end in pairwise(knots):
        t = np.linspace(begin, end, 7)[:, None]
        second = np.diff(found.at(t)[0][:, 0], 2)
        np.testing.assert_allclose(second, second[0], atol=1e-12)
