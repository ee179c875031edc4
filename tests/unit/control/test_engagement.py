"""Where a leg may begin, and from which load its changes count."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.control import (
    CartesianLeg,
    Contact,
    ContactGuard,
    ControllerConfig,
    Fault,
    LegOutcome,
    LoadModel,
    RefusalCause,
    SafetyConfig,
    TarePolicy,
)
from debrisgrasp.geometry import SE3, so3

from .rigs import SOFT, T_EE_FT, Rig, pushed, wrench

GUARD = ContactGuard(force=60.0, stiffness=1e4, reaction_time=0.2)
HELD = wrench(0, 0, -70)


@pytest.mark.parametrize("angle", [0.02, 1.0, np.pi - 1e-9, np.pi])
@pytest.mark.parametrize("axis", np.eye(3), ids=str)
def test_a_hand_that_is_turned_does_not_engage(axis, angle):
    rig = Rig()
    turned = SE3.from_parts(rig.T_start.R @ so3.exp(angle * axis), rig.T_start.p)
    rig.controller.leg = CartesianLeg.along(turned, [0.0, 0.0, 0.1])
    found = rig.controller.engage(rig.reading(0, rig.q_start, np.zeros(6)))
    assert not found.is_engaged
    assert found.refusals[0].cause is RefusalCause.ELSEWHERE
    assert f"{angle:.3f} rad from the start" in found.refusals[0].words


@pytest.mark.parametrize("tare", TarePolicy)
def test_a_touch_is_a_change_since_the_leg_began(tare):
    config = ControllerConfig(tare=tare)
    rig = Rig(guard=GUARD, config=config)
    state, seen = pushed(rig, [HELD] * 20, state=rig.engaged(HELD))
    assert seen[-1].outcome is LegOutcome.RUNNING
    loads = [HELD + wrench(0, 3.0 * k, 0) for k in range(22)]
    _, seen = pushed(rig, loads, state=state, start=21)
    assert seen[-1].outcome is LegOutcome.CONTACT
    assert np.linalg.norm(seen[-1].load - HELD) == pytest.approx(60.0, abs=6.0)


@pytest.mark.parametrize("tare", TarePolicy)
def test_a_limit_of_one_motion_is_a_change_since_it_began(tare):
    safety = SafetyConfig(motion_force=30.0)
    rig = Rig(config=ControllerConfig(tare=tare, safety=safety))
    state, seen = pushed(rig, [HELD] * 20, state=rig.engaged(HELD))
    assert seen[-1].stop is None
    _, seen = pushed(
        rig, [HELD + wrench(0, 2.0 * k, 0) for k in range(20)], state=state, start=21
    )
    assert seen[-1].stop.fault is Fault.MOTION_OVERLOAD


@pytest.mark.parametrize(
    ("tare", "reference"), [(TarePolicy.SESSION, 0.0), (TarePolicy.MOTION, -70.0)]
)
def test_the_load_at_engagement_is_apart_from_what_the_hand_gives_way_to(
    tare, reference
):
    config = ControllerConfig(tare=tare, contact=Contact(stiffness=1e3))
    state = Rig(SOFT, config=config).engaged(HELD)
    np.testing.assert_allclose(state.initial, HELD, atol=1e-9)
    np.testing.assert_allclose(state.reference[2], reference, atol=1e-9)


def test_a_sensor_at_the_end_of_its_range_does_not_engage():
    loads = LoadModel(T_ee_ft=T_EE_FT, sensor_range=(50.0, 60.0))
    rig = Rig(loads=loads)
    found = rig.controller.engage(rig.reading(0, rig.q_start, wrench(0, 0, -70)))
    assert not found.is_engaged
    assert found.refusals[0].cause is RefusalCause.SATURATED
    assert "end of its range" in found.refusals[0].words
    assert "of 50 N" in found.refusals[0].words


def test_a_sensor_that_ends_below_the_limit_stops_the_arm_at_its_end():
    loads = LoadModel(T_ee_ft=T_EE_FT, sensor_range=(100.0, 60.0))
    rig = Rig(loads=loads)
    state, q = rig.engaged(), rig.q_start
    for k in range(1, 400):
        reading = rig.reading(k, q, wrench(0, 0, -0.5 * k))
        raw = np.clip(reading.wrench_ft, -100.0, 100.0)
        state, command = rig.controller.step(state, reading._replace(wrench_ft=raw))
        q = command.q
        if command.is_stop:
            break
    assert command.stop.fault is Fault.WRENCH_SATURATED
    assert 0.5 * k < 150.0
