"""Swings are told whichever components of the load they show in."""

from __future__ import annotations

import pytest

from debrisgrasp.control import OscillationGuard, OscillationState

GUARD = OscillationGuard(crossover=2.0, force=5.0, torque=1.0)
SIZES = (20.0, 20.0, 20.0, 5.0, 5.0, 5.0)
HALF = 0.1
"""Between two reversals [s]."""


def first_strike(load_in_half):
    """When the guard strikes, by the load in each half swing [s]; None: never."""
    state = OscillationState()
    for k in range(int(5.0 / 0.004)):
        time = 0.004 * k
        state, is_struck = GUARD.step(
            state, time, 0.004, load_in_half(int(time / HALF))
        )
        if is_struck:
            return time
    return None


def alone(i):
    return lambda half: tuple(
        SIZES[j] * (1 if half % 2 else -1) if j == i else 0.0 for j in range(6)
    )


@pytest.mark.parametrize("i", range(6))
def test_a_swing_of_one_component_strikes(i):
    assert first_strike(alone(i)) == pytest.approx(4 * HALF, abs=0.01)


@pytest.mark.parametrize("i", range(6))
def test_others_that_turn_in_the_same_tick_hide_no_swing(i):
    """Each reversal comes with one of another component, each time of the next."""
    others = [j for j in range(6) if j != i]

    def load(half):
        values = list(alone(i)(half))
        for k, j in enumerate(others):
            values[j] = SIZES[j] * (1 if (half + 4 - k) // 5 % 2 else -1)
        return tuple(values)

    assert first_strike(load) == pytest.approx(4 * HALF, abs=0.01)
