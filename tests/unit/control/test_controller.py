"""Legs as they run: rigid, guarded, giving way; and what the robot is told."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.control import (
    ArmResponse,
    Body,
    Compliance,
    Contact,
    ContactGuard,
    ControllerConfig,
    DeflectionMode,
    LegOutcome,
    LoadModel,
    RefusalCause,
    TarePolicy,
    TaskFrame,
    contact_gain,
    rehearse,
)
from debrisgrasp.control.filters import ZERO_WRENCH
from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.geometry import SE3, so3

from .rigs import CHAIN, KINEMATICS, LIMITS, PERIOD, READY, T_EE_FT, Rig

NOISE = np.repeat([0.05, 0.002], 3)


def driven(rig: Rig, world, n: int, *, state=None, start: int = 1):
    """Run ticks of an arm that follows at once; ``world(T)`` acts in axes of base."""
    rng = np.random.default_rng(1)
    state = state or rig.engaged(in_hand(rig.T_start, world(rig.T_start)))
    q, seen = state.servo.q, []
    for k in range(start, start + n):
        R, p = KINEMATICS.pose(q)
        T = SE3.from_parts(np.reshape(R, (3, 3)), p)
        load = in_hand(T, world(T)) + rng.normal(0, 1, 6) * NOISE
        state, command = rig.controller.step(state, rig.reading(k, q, load))
        q = command.q
        seen.append(command)
    return state, seen


def in_hand(T: SE3, wrench_base) -> np.ndarray:
    wrench_base = np.asarray(wrench_base, dtype=float)
    return np.concatenate([T.R.T @ wrench_base[:3], T.R.T @ wrench_base[3:]])


def nothing(_):
    return np.zeros(6)


def test_a_rigid_leg_ends_at_its_goal_on_a_straight_line():
    rig = Rig(offset=(0.05, -0.02, 0.08))
    _, seen = driven(rig, nothing, 1200)
    assert seen[-1].outcome is LegOutcome.DONE
    assert seen[-1].share == 1.0
    p = CHAIN.fk(np.array([command.q for command in seen])).p - rig.T_start.p
    np.testing.assert_allclose(p[-1], (0.05, -0.02, 0.08), atol=1e-5)
    way = np.array([0.05, -0.02, 0.08]) / np.linalg.norm((0.05, -0.02, 0.08))
    off = p - np.outer(p @ way, way)
    assert np.abs(off).max() < 5e-5
    speed = np.linalg.norm(np.diff(p, axis=0), axis=1) / PERIOD
    assert speed.max() <= 0.03 * 1.02


@pytest.mark.parametrize("mode", list(DeflectionMode))
def test_a_hand_gives_way_along_the_force_at_any_orientation(mode):
    """A steady push moves the hand by compliance times force, along the force."""
    soft = Compliance(np.diag([4e-4] * 3 + [2e-3] * 3), mode=mode)
    rig = Rig(soft, offset=(0, 0, 0))
    push = np.array([20.0, -10.0, 5.0, 0.4, 0.2, -0.3])
    state = rig.engaged()
    _, seen = driven(rig, lambda _: push, 900, state=state)
    T = CHAIN.fk(np.array(seen[-1].q))
    share = 1.0 - 0.6 / np.linalg.norm(push[:3])
    expected = 4e-4 * push[:3] * share
    np.testing.assert_allclose(T.p - rig.T_start.p, expected, atol=3e-5)
    turn = so3.log(T.R @ rig.T_start.R.T)
    dead = 1.0 - 0.02 / np.linalg.norm(push[3:])
    np.testing.assert_allclose(turn, 2e-3 * push[3:] * dead, atol=3e-5)


def test_the_filter_starts_from_zero_at_every_engagement():
    config = ControllerConfig(tare=TarePolicy.MOTION, contact=Contact(stiffness=1e3))
    rig = Rig(Compliance.diagonal(4e-4, 0.0), offset=(0, 0, 0), config=config)
    push = np.array([30.0, 0, 0, 0, 0, 0])
    state, _ = driven(rig, lambda _: push, 400, state=rig.engaged())
    assert np.linalg.norm(state.filtered) > 20.0
    again = rig.controller.engage(
        rig.reading(500, rig.q_start, in_hand(rig.T_start, push))
    ).require()
    assert again.filtered == ZERO_WRENCH
    assert again.deflection == ZERO_WRENCH
    _, seen = driven(rig, lambda _: push, 50, state=again, start=501)
    assert np.linalg.norm(seen[-1].deflection) < 1e-4


def test_the_session_reference_yields_to_a_load_that_was_there_before():
    rig = Rig(Compliance.diagonal(4e-4, 0.0), offset=(0, 0, 0))
    push = np.array([30.0, 0, 0, 0, 0, 0])
    _, seen = driven(rig, lambda _: push, 600)
    assert seen[-1].deflection[0] == pytest.approx(4e-4 * 29.4, abs=2e-4)


def test_a_known_payload_does_not_make_the_hand_sag():
    tool, held = Body(2.1, np.array([0.0, 0.0, 0.08])), Body(5.0, np.array([0, 0, 0.3]))
    loads = LoadModel(T_ee_ft=T_EE_FT, tool=tool)
    for model, sag in ((loads, 0.0196), (loads.with_payload(held), 0.0)):
        rig = Rig(Compliance.diagonal(4e-4, 0.0), offset=(0, 0, 0), loads=model)

        def weight(T):
            f = np.array([0, 0, -9.81 * 5.0])
            lever = T.R @ T_EE_FT.apply(held.com)
            return np.concatenate([f, np.cross(lever, f)])

        _, seen = driven(rig, weight, 600)
        assert -seen[-1].deflection[2] == pytest.approx(sag, abs=5e-4)


def test_deflection_is_clamped_and_never_faster_than_its_rate():
    rig = Rig(
        Compliance.diagonal(2e-3, 0.02),
        offset=(0, 0, 0),
        config=ControllerConfig(
            tau=0.05,
            arm=ArmResponse(frequency=50, damping=0.9, delay=0),
            contact=Contact(stiffness=10.0),
        ),
    )
    push = np.array([80.0, 60.0, 0, 20.0, 10.0, 0])
    ramp = iter(np.minimum(np.arange(3000) / 50.0, 1.0))
    _, seen = driven(rig, lambda _: next(ramp) * push, 900)
    twists = np.array([command.deflection for command in seen])
    gap, turn = (np.linalg.norm(part, axis=1) for part in np.split(twists, 2, axis=1))
    assert gap.max() == pytest.approx(0.10, abs=1e-9)
    assert turn.max() == pytest.approx(0.35, abs=1e-9)
    rate = np.diff(twists, axis=0) / PERIOD
    assert np.linalg.norm(rate[:, :3], axis=1).max() <= 0.05 + 1e-9
    assert np.linalg.norm(rate[:, 3:], axis=1).max() <= 0.25 + 1e-9
    direction = twists[-1, :3] / gap[-1]
    np.testing.assert_allclose(direction, (0.8, 0.6, 0.0), atol=1e-3)


def test_a_support_line_stays_where_it_is_even_at_the_clamp():
    point = Rig().T_start.p + np.array([0.6, 0.1, -0.1])
    frame = TaskFrame.about_line(point, [0, 1, 0])
    rig = Rig(
        Compliance.diagonal(0.0, [0.01, 0.0, 0.0], frame=frame),
        offset=(0, 0, 0),
        config=ControllerConfig(contact=Contact(stiffness=300.0, lever=(0.1, 0, 0))),
    )
    ramp = iter(np.minimum(np.arange(3000) / 200.0, 1.0))
    _, seen = driven(rig, lambda _: next(ramp) * np.array([0, 0, 90.0, 0, 0, 0]), 1500)
    v, w = np.split(np.array(seen[-1].deflection), 2)
    assert np.linalg.norm(v) == pytest.approx(0.10, abs=1e-6)
    np.testing.assert_allclose(v + np.cross(w, point - rig.T_start.p), 0, atol=1e-6)


def test_too_much_compliance_is_refused_with_the_numbers():
    stiff = ControllerConfig(contact=Contact(stiffness=1e5))
    engagement = _engaged(Rig(Compliance.diagonal(1e-3, 0.0), config=stiff))
    assert not engagement.is_engaged
    for number in ("0.001 m/N", "1e+05 N/m", "100", "3.57", "7.68", "3.57e-05"):
        assert number in engagement.refusals[0].words


def test_unknown_contact_and_arm_allow_a_tenth_of_a_millimetre_per_newton():
    config = ControllerConfig()
    assert _engaged(Rig(Compliance.diagonal(1.19e-4, 0.0), config=config)).is_engaged
    assert not _engaged(Rig(Compliance.diagonal(1.2e-4, 0.0), config=config)).is_engaged
    warned = _engaged(Rig(Compliance.diagonal(6.1e-5, 0.0), config=config)).warnings
    assert "over half" in warned[0]
    assert not _engaged(Rig(Compliance.diagonal(5.9e-5, 0.0), config=config)).warnings


def test_a_lever_and_a_held_mass_count():
    soft = Compliance.diagonal(1e-5, 1e-3)
    near = ControllerConfig(contact=Contact(stiffness=3e4))
    far = ControllerConfig(contact=Contact(stiffness=3e4, lever=(0.0, 0.0, 0.5)))
    heavy = ControllerConfig(contact=Contact(stiffness=1e3, mass=40.0))
    assert _engaged(Rig(soft, config=near)).is_engaged
    assert "7.8" in _engaged(Rig(soft, config=far)).refusals[0].words
    swinging = _engaged(Rig(Compliance.diagonal(1e-3, 0.0), config=heavy))
    refused = [refusal.words for refusal in swinging.refusals]
    assert "40 kg" in refused[0]


def test_a_contact_of_unknown_place_may_be_at_the_edge_of_the_hand():
    hinged = Compliance.diagonal(0.0, 0.02)
    refused = _engaged(Rig(hinged, config=ControllerConfig())).refusals[0].words
    assert "0.1 m beside the hand, times stiffness 3e+04 N/m is 6" in refused
    at_origin = Contact(lever=(0.0, 0.0, 0.0))
    assert _engaged(Rig(hinged, config=ControllerConfig(contact=at_origin))).is_engaged


def _engaged(rig: Rig):
    return rig.controller.engage(rig.reading(0, rig.q_start, (0.0,) * 6))


@pytest.mark.parametrize("gains", [(-1.0, None), (1e-9, -1.0)])
def test_a_compliance_below_zero_keeps_no_bound(gains):
    gain, mass_gain = gains
    with pytest.raises(ConfigError, match=r"gain \[m/N\]: got -1,"):
        Rig().controller.bound.verdict(gain, Contact(mass=1.0), mass_gain)


def test_a_compliance_or_a_lever_that_is_no_number_is_refused():
    bound = Rig().controller.bound
    assert bound.verdict(np.nan, Contact()).refusals
    held = bound.verdict(1e-9, Contact(mass=1.0), np.nan)
    assert "held mass" in held.refusals[0]
    for bad in (np.nan, np.inf):
        with pytest.raises(InputError, match="lever"):
            Contact(lever=(bad, 0.0, 0.0))
        with pytest.raises(InputError, match="mass_lever"):
            Contact(mass_lever=(0.0, bad, 0.0))
        with pytest.raises(InputError, match="lever of a contact"):
            contact_gain(np.eye(6), (0.0, 0.0, bad))
        with pytest.raises(InputError, match="compliance at the hand"):
            contact_gain(np.full((6, 6), bad))
    with pytest.raises(ConfigError, match=r"^gain \[m/N\]: got 'a'"):
        bound.verdict("a", Contact())
    with pytest.raises(ConfigError, match=r"mass_gain \[m/N\]: got 'a'"):
        bound.verdict(1e-9, Contact(), "a")
    with pytest.raises(ConfigError, match=r"^contact: got '3e4', expected a Contact"):
        bound.verdict(1e-9, "3e4")
    with pytest.raises(InputError, match=r"shape of compliance.*\(6, 6\)"):
        contact_gain(np.eye(3))
    with pytest.raises(InputError, match="lever of a contact"):
        contact_gain(np.eye(6), "a")
    with pytest.raises(InputError, match="delay"):
        ArmResponse(delay=2.5)


def test_swinging_halves_the_compliance_and_then_stops():
    rig = Rig(Compliance.diagonal(1e-4, 0.0), offset=(0, 0, 0))
    state, q, seen = rig.engaged(), rig.q_start, []
    for k in range(1, 1000):
        swing = 25.0 * np.sin(2 * np.pi * 5.0 * k * PERIOD)
        state, command = rig.controller.step(
            state, rig.reading(k, q, (swing, 0, 30.0, 0, 0, 0))
        )
        q = command.q
        seen.append(float(state.compliance.tensor[0, 0]))
        if command.is_stop:
            break
    assert command.stop.fault.name == "OSCILLATION"
    assert sorted(set(seen)) == [5e-5, 1e-4]
    assert k * PERIOD < 2.0


def test_a_hand_that_gets_stiffer_goes_back_slowly_against_what_pushes():
    rig = Rig(Compliance.diagonal(2e-4, 0.0), offset=(0, 0, 0))
    push = np.array([30.0, 0, 0, 0, 0, 0])
    state, before = driven(rig, lambda _: push, 400)
    halved = state._replace(compliance=state.compliance.scaled(0.5))
    _, after = driven(rig, lambda _: push, 400, state=halved, start=401)
    gone = np.array([command.deflection[0] for command in [before[-1], *after]])
    way = gone[0] - gone[-1]
    assert way == pytest.approx(0.5 * gone[0], rel=0.05)
    rate = LIMITS.deflection.translation_rate
    assert -np.diff(gone).min() <= 0.13 * rate * PERIOD


def test_a_hand_that_is_pushed_the_other_way_gives_way_at_its_full_rate():
    rig = Rig(Compliance.diagonal(4e-4, 0.0), offset=(0, 0, 0))
    state, _ = driven(rig, lambda _: np.array([20.0, 0, 0, 0, 0, 0]), 400)
    pulled = np.array([-20.0, 0, 0, 0, 0, 0])
    _, after = driven(rig, lambda _: pulled, 200, state=state, start=401)
    gone = np.array([command.deflection[0] for command in after])
    rate = LIMITS.deflection.translation_rate
    assert -np.diff(gone).min() >= 0.4 * rate * PERIOD


def test_slow_handling_is_not_taken_for_swinging():
    rig = Rig(Compliance.diagonal(1e-4, 0.0), offset=(0, 0, 0))
    state, q = rig.engaged(), rig.q_start
    for k in range(1, 2000):
        push = 60.0 * np.sin(2 * np.pi * 0.25 * k * PERIOD)
        state, command = rig.controller.step(
            state, rig.reading(k, q, (push, 0, 0.01 * k % 1, 0, 0, 0))
        )
        q = command.q
    assert not command.is_stop
    assert state.swing.strikes == 0


@pytest.mark.parametrize(
    ("stiffness", "reaction_time"), [(1e3, 0.1), (1e4, 0.1), (1e5, 0.06)]
)
def test_a_guarded_approach_stays_below_the_force_limit(stiffness, reaction_time):
    guard = ContactGuard(stiffness=stiffness, reaction_time=reaction_time)
    speed = min(guard.largest_speed(LIMITS), 0.03)
    rig = Rig(guard=guard, offset=(0, 0, -0.1), config=ControllerConfig(speed=speed))
    top = rig.T_start.p[2] - 0.01

    def block(T):
        return np.array([0, 0, max(stiffness * (top - T.p[2]), 0.0), 0, 0, 0])

    run = rehearse(
        rig.controller,
        READY,
        block,
        arm=ArmResponse(frequency=8.0, damping=0.7, delay=2),
        rng=np.random.default_rng(0),
        settle=0.2,
    )
    assert run.last.outcome is LegOutcome.CONTACT
    assert 60.0 <= np.linalg.norm(run.load[:, :3], axis=1).max() < 150.0


@pytest.mark.parametrize("stiffness", [5e3, 3e4, 4e4])
def test_a_leg_that_runs_into_something_slows_down_before_its_limit(stiffness):
    """What the load grows by until the arm stands has room above the limit."""
    limits, lag = LIMITS.scaled(load=0.8), 0.012
    rig = Rig(offset=(0, 0, -0.1), config=ControllerConfig(speed=0.03), limits=limits)
    top, true, felt = rig.T_start.p[2] - 0.02, [], [0.0]

    def block(T):
        true.append(max(stiffness * (top - T.p[2]), 0.0))
        felt[0] += (1.0 - np.exp(-PERIOD / lag)) * (true[-1] - felt[0])
        return np.array([0, 0, felt[0], 0, 0, 0])

    run = rehearse(
        rig.controller,
        READY,
        block,
        arm=ArmResponse(frequency=8.0, damping=0.7, delay=2),
        rng=np.random.default_rng(0),
        settle=0.2,
    )
    assert run.last.is_stop
    assert 0.95 * limits.force < max(true) < LIMITS.force


def test_a_guarded_approach_that_is_too_fast_is_refused():
    with pytest.raises(ConfigError, match=r"0 to 0\.015"):
        Rig(guard=ContactGuard(), config=ControllerConfig(speed=0.02))


def test_a_guarded_approach_that_brakes_too_slowly_is_refused():
    guard = ContactGuard(stiffness=1e4)
    fast = Rig(guard=guard, config=ControllerConfig(speed=0.1))
    (refusal,) = _engaged(fast).refusals
    assert refusal.cause is RefusalCause.BRAKING
    assert "brake" in refusal.words
    patient = ContactGuard(stiffness=1e4, reaction_time=0.2)
    slow = Rig(guard=patient, config=ControllerConfig(speed=0.04))
    assert _engaged(slow).is_engaged


def test_a_touch_by_torque_alone_ends_the_approach():
    rig = Rig(guard=ContactGuard(stiffness=1e4), config=ControllerConfig(speed=0.02))
    ramp = iter(np.arange(1000) / 10.0)
    _, seen = driven(
        rig, lambda _: np.array([0, 0, 0, 0, min(next(ramp), 16.0), 0]), 300
    )
    assert seen[-1].outcome is LegOutcome.CONTACT
    assert seen[-1].q == seen[-20].q


def test_a_leg_out_of_reach_is_blocked_and_says_how_far_it_got():
    rig = Rig(offset=(0.7, 0, 0), config=ControllerConfig(speed=0.2))
    _, seen = driven(rig, nothing, 2800)
    assert seen[-1].outcome is LegOutcome.BLOCKED
    assert 0.3 < seen[-1].share < 0.99
    q = np.array([command.q for command in seen])
    assert LIMITS.violation(q) == ""


def test_a_leg_that_is_blocked_brakes_and_chases_its_goal_no_more():
    config = ControllerConfig(speed=0.2, lag=1e-3, patience=0.02)
    slow = LIMITS.scaled(velocity=0.05)
    rig = Rig(offset=(0.2, 0, 0), config=config, limits=slow)
    _, seen = driven(rig, nothing, 400)
    n = [command.outcome for command in seen].index(LegOutcome.BLOCKED)
    q = np.array([command.q for command in seen])
    steps = np.abs(np.diff(q[n:], axis=0)).max(axis=1)
    assert steps[0] > 1e-5
    assert (np.diff(steps) <= 1e-9).all()
    assert steps[-1] == 0.0


def test_equal_states_and_readings_give_equal_commands():
    rig = Rig(Compliance.diagonal(1e-4, 1e-3))
    state = rig.engaged()
    reading = rig.reading(1, rig.q_start, (5.0, 1, 2, 0.1, 0.2, 0.3))
    first, second = (rig.controller.step(state, reading) for _ in range(2))
    assert first[1] == second[1]
    assert first[0].filtered == second[0].filtered
    assert state.share == 0.0


def test_arrays_and_tuples_are_read_alike():
    rig = Rig(Compliance.diagonal(1e-4, 1e-3))
    state, plain = rig.engaged(), rig.reading(1, rig.q_start, (5.0, 1, 2, 0, 0, 0.3))
    arrays = plain._replace(q=np.array(plain.q), wrench_ft=np.array(plain.wrench_ft))
    assert rig.controller.step(state, plain)[1] == rig.controller.step(state, arrays)[1]
