"""Intervals against published figures and against the distributions themselves."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from debrisgrasp.campaign import newcombe, wilson
from debrisgrasp.errors import InputError


@pytest.mark.parametrize(
    ("count", "total", "interval"),
    [
        (19, 43, (0.304333098392, 0.588923855472)),
        (19, 26, (0.539169596208, 0.862955516780)),
        (95, 99, (0.900679787497, 0.984177361006)),
    ],
)
def test_wilson_gives_the_worked_examples(count, total, interval):
    assert wilson(count, total) == pytest.approx(interval, abs=1e-9)


def test_newcombe_gives_the_published_example():
    # Newcombe 1998, Table II (a): 56/70 against 48/80, method 10.
    assert newcombe((48, 80), (56, 70)) == pytest.approx((0.0524, 0.3339), abs=5e-5)


counts = st.integers(1, 400).flatmap(
    lambda total: st.tuples(st.integers(0, total), st.just(total))
)


@given(counts)
def test_wilson_agrees_with_the_score_test_of_scipy(pair):
    interval = stats.binomtest(*pair).proportion_ci(0.95, method="wilson")
    assert wilson(*pair) == pytest.approx((interval.low, interval.high), abs=1e-9)


@given(counts)
def test_an_interval_holds_its_share_and_stays_within_0_and_1(pair):
    low, high = wilson(*pair)
    assert 0.0 <= low <= pair[0] / pair[1] <= high <= 1.0


@given(counts, counts)
def test_exchanging_two_campaigns_turns_the_sign(old, new):
    low, high = newcombe(old, new)
    back_low, back_high = newcombe(new, old)
    assert (low, high) == pytest.approx((-back_high, -back_low), abs=1e-12)
    assert -1.0 <= low <= new[0] / new[1] - old[0] / old[1] <= high <= 1.0


def test_no_runs_say_nothing():
    assert wilson(0, 0) == (0.0, 1.0)
    assert newcombe((0, 0), (3, 4)) == (-1.0, 1.0)


@pytest.mark.parametrize("pair", [(-1, 3), (4, 3), (0, -1)])
def test_impossible_counts_are_refused(pair):
    with pytest.raises(InputError, match="expected 0 to the total"):
        wilson(*pair)


@pytest.mark.parametrize("confidence", [0.0, 1.0, 95.0, float("nan")])
def test_a_confidence_that_is_none_is_refused(confidence):
    with pytest.raises(InputError, match="confidence"):
        wilson(3, 4, confidence=confidence)
