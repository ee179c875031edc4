"""Loads and orders of removal on graphs whose answer is known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from debrisgrasp.segmentation.loads import (
    carried_loads,
    removal_sequence,
    support_shares,
)

# Labels 1 and 2 stand on the ground, 3 lies across both, 4 on 3.
RELATIONS = np.array([[3, 1], [3, 2], [4, 3], [1, 0], [2, 0]])
SURE = np.full(5, 0.95)


def shares_of(relations=RELATIONS, confidence=SURE, middle_y=0.0, reach=0.0):
    places = np.array([[0, -0.5, 0], [0, 0.5, 0], [0, 0, 0], [0, -0.5, 0], [0, 0.5, 0]])
    middles = np.zeros((5, 3))
    middles[3, 1] = middle_y
    return support_shares(relations, confidence, places, middles, np.full(5, reach))


def test_two_supports_share_by_the_lever_rule():
    shares = shares_of(middle_y=0.25)
    np.testing.assert_allclose(shares[:2], [[0.25, 0.25], [0.75, 0.75]])
    np.testing.assert_allclose(shares[2:], 1.0)
    shares = shares_of(middle_y=0.25, reach=0.1)
    np.testing.assert_allclose(shares[:2], [[0.15, 0.35], [0.65, 0.85]])


def test_a_doubtful_support_may_carry_all_or_nothing():
    shares = shares_of(confidence=np.array([0.95, 0.5, 0.95, 0.95, 0.95]))
    np.testing.assert_allclose(shares[:2], [[0, 1], [0, 1]])


def test_loads_pass_down_to_the_ground():
    order, _ = removal_sequence(RELATIONS, SURE, np.zeros(4))
    weights = np.tile([[10.0, 20.0]], (4, 1))
    loads = carried_loads(RELATIONS, shares_of(), weights, order)
    np.testing.assert_allclose(loads[4], 0.0)
    np.testing.assert_allclose(loads[3], [10, 20])
    np.testing.assert_allclose(loads[1:3], [[10, 20], [10, 20]])
    np.testing.assert_allclose(loads[0], [40, 80])


def test_removal_starts_at_the_top():
    order, certain = removal_sequence(RELATIONS, SURE, np.array([0.2, 0.1, 0.0, 0.0]))
    assert order.tolist() == [4, 3, 2, 1]
    np.testing.assert_allclose(certain, 1.0)


def test_in_a_ring_the_least_certain_relation_gives_way():
    ring = np.array([[1, 2], [2, 3], [3, 1]])
    order, certain = removal_sequence(ring, np.array([0.9, 0.3, 0.8]), np.zeros(3))
    assert order.tolist() == [3, 1, 2]
    assert certain.tolist() == pytest.approx([0.7, 1.0, 1.0])
    shares = np.ones((3, 2))
    loads = carried_loads(ring, shares, np.ones((3, 2)), order)
    assert np.isfinite(loads).all()


@st.composite
def piles(draw):
    """Relations in which labels rest only on smaller ones, so without rings."""
    n = draw(st.integers(1, 7))
    pairs = [(a, b) for a in range(1, n + 1) for b in range(a)]
    chosen = draw(st.lists(st.sampled_from(pairs), unique=True, max_size=12))
    relations = np.array(chosen, dtype=np.int64).reshape(-1, 2)
    share = st.floats(0.01, 1.0)
    shares = np.array([sorted(draw(st.tuples(share, share))) for _ in chosen])
    return n, relations, shares.reshape(-1, 2)


@given(piles(), st.floats(0.1, 100.0), st.data())
def test_another_object_on_top_never_lightens_a_load(pile, weight, data):
    n, relations, shares = pile
    sure = np.full(len(relations), 0.9)
    weights = np.tile([[1.0, 2.0]], (n, 1))
    order, _ = removal_sequence(relations, sure, np.zeros(n))
    before = carried_loads(relations, shares, weights, order)
    below = data.draw(st.integers(0, n))
    more = np.append(relations, [[n + 1, below]], axis=0)
    order, _ = removal_sequence(more, np.append(sure, 0.9), np.zeros(n + 1))
    after = carried_loads(
        more,
        np.append(shares, [[1.0, 1.0]], axis=0),
        np.append(weights, [[weight, weight]], axis=0),
        order,
    )
    assert (after[: n + 1] >= before - 1e-9).all()
    assert after[below, 0] >= before[below, 0] + weight - 1e-9


def test_what_may_come_down_two_ways_is_counted_once():
    """Each of two doubtful supports may carry all, what is below both not twice."""
    diamond = np.array([[4, 3], [4, 2], [3, 1], [2, 1], [1, 0]])
    weights = np.tile([[1.0, 2.0]], (4, 1))
    shares = np.tile([0.0, 1.0], (5, 1))
    loads = carried_loads(diamond, shares, weights, [4, 3, 2, 1])
    np.testing.assert_allclose(loads[:, 1], [8.0, 6.0, 2.0, 2.0, 0.0])
    assert not loads[:, 0].any()


@given(piles())
def test_no_load_is_more_than_all_that_others_weigh(pile):
    n, relations, shares = pile
    weights = np.column_stack([np.arange(1.0, n + 1), np.arange(2.0, n + 2)])
    order, _ = removal_sequence(relations, np.full(len(relations), 0.9), np.zeros(n))
    loads = carried_loads(relations, shares, weights, order)
    assert (loads >= 0.0).all()
    assert (loads[:, 0] <= loads[:, 1] + 1e-9).all()
    assert (loads[0] <= weights.sum(axis=0) + 1e-9).all()
    assert (loads[1:] <= weights.sum(axis=0) - weights + 1e-9).all()


@given(piles())
def test_nothing_is_taken_before_what_rests_on_it(pile):
    n, relations, _ = pile
    order, certain = removal_sequence(
        relations, np.full(len(relations), 0.9), np.zeros(n)
    )
    turn = np.zeros(n + 1)
    turn[order] = np.arange(1, n + 1)
    on_objects = relations[relations[:, 1] > 0]
    assert (turn[on_objects[:, 0]] < turn[on_objects[:, 1]]).all()
    np.testing.assert_allclose(certain, 1.0)
