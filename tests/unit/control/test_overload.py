"""Loads that reach their limit, or would before the arm stands."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from debrisgrasp.control import Contact, ControllerConfig, Fault, FaultClass, Reading

from .rigs import SOFT, Rig, pushed, wrench

FAST = 0.001
"""Period of a fast loop [s]."""


def test_overload_stops_within_two_samples_however_slow_the_filter():
    rig = Rig(SOFT)
    ramp = [wrench(0, 0, -4.0 * k) for k in range(33)]
    _, seen = pushed(rig, [*[wrench(0, 0, 0)] * 20, *ramp, *[wrench(0, 0, -160)] * 2])
    assert not seen[52].is_stop
    assert seen[54].is_stop
    assert seen[54].stop.fault is Fault.OVERLOAD
    assert seen[54].stop.fault.fault_class is FaultClass.SAFETY


@settings(max_examples=20, deadline=None)
@given(growth=st.floats(2.0, 45.0))
def test_a_load_that_grows_stops_the_arm_before_it_reaches_its_limit(growth):
    rig = Rig(SOFT)
    _, seen = pushed(rig, [wrench(0, 0, -growth * k) for k in range(90)])
    first = next(k for k, command in enumerate(seen) if command.is_stop)
    assert seen[first].stop.fault is Fault.OVERLOAD
    assert growth * first < 148.0


def test_a_load_that_falls_stops_nothing():
    rig = Rig(SOFT)
    rise, fall = [-3.0 * k for k in range(31)], [-90.0 + 45.0 * k for k in range(1, 3)]
    _, seen = pushed(rig, [wrench(0, 0, z) for z in [*rise, *fall, 0.0, 0.0, 0.0]])
    assert not any(command.is_stop for command in seen)


def fast_loop(rig: Rig, loads: np.ndarray) -> list[bool]:
    """Whether the arm has stopped after each load (n, 6) in a loop at 1 kHz."""
    state, q, seen = rig.engaged(loads[0]), rig.q_start, []
    for k, load in enumerate(loads[1:], 1):
        now = k * FAST
        reading = Reading(now, q, rig.raw(q, load), now)
        state, command = rig.controller.step(state, reading)
        q = command.q
        seen.append(command.is_stop)
    return seen


def fast_rig() -> Rig:
    return Rig(
        SOFT, config=ControllerConfig(period=FAST, contact=Contact(stiffness=1e3))
    )


def test_noise_is_no_growth_to_a_fast_loop(rng):
    noise = rng.normal(0.0, 1.0, (4000, 6)) * np.repeat([1.0, 0.1], 3)
    assert not any(fast_loop(fast_rig(), wrench(0, 0, -125) + noise))


@pytest.mark.parametrize("growth", [1.0, 3.0, 8.0])
def test_a_load_that_grows_stops_a_fast_loop_as_early(growth):
    loads = np.array([wrench(0, 0, -growth * k) for k in range(200)])
    first = fast_loop(fast_rig(), loads).index(True)
    # 12 ms until the arm stands, less the median and what passes between judgements.
    assert growth * (first + 1 + 7) < 148.0
