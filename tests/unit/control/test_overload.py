"""Loads that reach their limit, or would before the arm stands."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from debrisgrasp.control import Fault, FaultClass

from .rigs import SOFT, Rig, pushed, wrench


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
