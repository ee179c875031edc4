"""A clock that goes wrong is a fault, and makes no wait longer."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from debrisgrasp.executive.result import FaultRaised
from debrisgrasp.executive.steady import SteadyClock


class Told:
    """A clock that is right but for some of what it tells."""

    def __init__(self, wrong):
        self.time, self.n, self.wrong = 100.0, 0, wrong

    def now(self):
        self.n += 1
        return self.time + self.wrong.get(self.n, 0.0)

    def wait_until(self, time):
        self.time = max(self.time, time)


def waited(told, times, seconds):
    clock = SteadyClock(told)
    for _ in range(times):
        clock.wait_until(clock.now() + seconds)


@settings(max_examples=200, deadline=None)
@given(st.integers(1, 40), st.floats(-1e4, 1e4) | st.just(np.nan), st.floats(0.0, 2.0))
def test_one_wrong_time_makes_no_wait_longer(n, wrong, seconds):
    told = Told({n: wrong})
    with suppress(FaultRaised):
        waited(told, 3, seconds)
    # A second, for no robot is that punctual.
    assert told.time <= 100.0 + 3.0 * seconds + 1.0


@pytest.mark.parametrize(
    ("n", "wrong"),
    [(1, 600.0), *((n, wrong) for n in (2, 3) for wrong in (600.0, -600.0, np.nan))],
)
def test_a_time_that_can_not_be_is_a_fault(n, wrong):
    with pytest.raises(FaultRaised) as raised:
        waited(Told({n: wrong}), 3, 0.5)
    assert raised.value.found.fault == "clock_disorder"


def test_a_time_that_never_comes_is_not_waited_for():
    clock = SteadyClock(Told({}))
    for time in (np.nan, np.inf):
        with pytest.raises(FaultRaised):
            clock.wait_until(time)


def test_waits_end_when_they_should():
    told = Told({})
    clock = SteadyClock(told)
    for seconds in (0.0, 0.004, 0.1, 0.35, 7.0):
        until = clock.now() + seconds
        clock.wait_until(until)
        assert told.time == until
