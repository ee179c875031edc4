"""What can't be true of two readings in a row: laws, and the motions that it ends."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from debrisgrasp.executive.plausible import Felt

OWN = (False, True, True)
REST = (0.1, 0.2, 0.3)
HAND = (3.0, -4.0, 30.0, 1.0, 2.0, 0.5)
small = st.floats(-1.0, 1.0)


@given(st.tuples(*[small] * 6), st.tuples(small, small))
def test_all_values_negated_are_the_sensor_whatever_the_noise(noise, away):
    turned = -np.array(HAND) + [0.7, 0.7, 0.7, 0.2, 0.2, 0.2] * np.array(noise)
    q = (REST[0], *np.array(REST[1:]) + 0.02 * np.array(away))
    once = Felt(REST, HAND).followed_by(q, turned.tolist(), OWN)
    assert not once.fault
    assert not once.followed_by(q, turned.tolist(), OWN).fault  # no second measurement
    again = (turned + 0.01).tolist()
    assert once.followed_by(q, again, OWN).fault == "wrench_sign"


@given(st.floats(5e3, 2e5), st.floats(0.0, 1.0))
def test_a_light_hand_may_touch_something_stiff(stiffness, phase):
    """It presses as hard as it weighed, for one reading, and then harder."""
    felt, way = Felt(REST, (0.0, 0.0, -12.0, 0.0, 0.0, 0.0)), 0.05 * 0.004
    for tick in range(10):
        load = -12.0 + min(stiffness * way * (tick + phase), 200.0)
        noise = 0.1 * (-1) ** tick
        felt = felt.followed_by(REST, (noise, 0.0, load, 0.0, 0.0, 0.0), OWN)
        assert not felt.fault


@given(st.lists(st.floats(-200.0, 200.0), min_size=6, max_size=6), st.floats(0.2, 1.0))
def test_a_load_that_grows_ends_or_comes_from_elsewhere_is_believed(load, least):
    """Of what is carried any share may be let go, and more may come on top."""
    more = np.array(HAND) * least
    assert not Felt(REST, HAND).followed_by(REST, more.tolist(), OWN).fault
    turned = np.array(load)
    if np.linalg.norm(turned[:3] + HAND[:3]) > 0.2 * 31.0 + 2.0:
        assert not Felt(REST, HAND).followed_by(REST, load, OWN).fault


@pytest.mark.parametrize(("away", "fault"), [(0.1, ""), (0.3, "encoder_jump")])
def test_an_arm_that_is_not_heard_for_a_while_still_brakes(away, fault):
    felt = Felt(REST, HAND, is_moving=True)
    for _ in range(5):
        felt = felt.followed_by((np.nan,) * 3, HAND, OWN)
        assert not felt.fault
    later = np.array(REST)
    later[1] += away
    assert felt.followed_by(later.tolist(), HAND, OWN).fault == fault


@pytest.mark.parametrize(
    ("joint", "gone", "is_moving", "fault"),
    [
        (1, 0.05, False, "encoder_jump"),
        (1, 0.05, True, ""),
        (2, -0.3, True, "encoder_jump"),
        (2, 0.01, False, ""),
        (0, 0.5, False, ""),  # the other arm moved it
    ],
)
def test_joints_get_no_farther_than_they_brake(joint, gone, is_moving, fault):
    q = np.array(REST)
    q[joint] += gone
    found = Felt(REST, HAND, is_moving).followed_by(q.tolist(), HAND, OWN)
    assert found.fault == fault
    assert ("rad or m" in found.message) == bool(fault)
    assert found.is_moving is (joint != 0)


def test_numbers_that_are_none_raise_no_doubt_here():
    nothing = (np.nan,) * 6
    assert not Felt(REST, HAND).followed_by(REST, nothing, OWN).fault
    assert not Felt(REST, nothing).followed_by(REST, HAND, OWN).fault
    assert not Felt(REST, HAND).followed_by((), HAND, OWN).fault


@pytest.mark.parametrize("q", [(), (np.nan, 0.2, 0.3), (0.1, np.nan, np.nan)])
def test_a_reading_that_is_none_hides_no_jump(q):
    felt = Felt(REST, HAND).followed_by(q, (np.nan,) * 6, OWN)
    assert felt.followed_by((0.1, 0.2, 1.3), HAND, OWN).fault == "encoder_jump"
    turned = [-value for value in HAND]
    felt = felt.followed_by(REST, turned, OWN)
    assert felt.followed_by(REST, [*turned[:5], 0.0], OWN).fault == "wrench_sign"
