"""Fingers: preshape, resistance, squeeze, nothing, slip."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.control import (
    FingerReading,
    GripConfig,
    GripController,
    GripPhase,
)
from debrisgrasp.errors import ConfigError

SIDES = (-1, 1, 1)
CONFIG = GripConfig(opening=0.12, width=0.08, sides=SIDES)


class Hand:
    """Three fingers that go where they are sent, and an object between them."""

    def __init__(self, object_width: float | tuple[float, ...] = 0.08) -> None:
        self.widths = np.broadcast_to(object_width, (3,))
        self.openings = np.full(3, 0.15)

    def follow(self, command) -> FingerReading:
        wanted = np.array(command.openings)
        step = np.clip(wanted - self.openings, -0.0008, 0.0008)
        moved = np.maximum(self.openings + step, self.widths)
        touching = (self.openings + step) < self.widths - 1e-12
        self.openings = moved
        shares = command.force * np.array([1.0, 0.5, 0.5])
        forces = np.where(touching, shares, 1.0)
        return FingerReading(tuple(moved.tolist()), tuple(forces.tolist()))


def run(hand: Hand, *, until: tuple[GripPhase, ...], most: int = 3000, state=None):
    grip = GripController(CONFIG)
    reading = FingerReading(tuple(hand.openings), (1.0,) * 3)
    state = state or grip.preshape()
    for _ in range(most):
        state, command = grip.step(state, reading)
        if state.phase is GripPhase.READY:
            state = grip.close(state)
        if state.phase in until:
            return state, command
        reading = hand.follow(command)
    raise AssertionError(state.phase)


def test_fingers_close_until_resistance_and_squeeze_from_then_on():
    hand = Hand((0.08, 0.074, 0.077))
    state, command = run(hand, until=(GripPhase.HOLDING,))
    np.testing.assert_allclose(hand.openings, (0.08, 0.074, 0.077), atol=1e-9)
    assert state.is_stopped == (True,) * 3
    assert command.force == CONFIG.squeeze
    assert max(command.openings) < 0.074


def test_nothing_between_the_fingers_is_noticed():
    state, command = run(Hand(0.02), until=(GripPhase.EMPTY, GripPhase.HOLDING))
    assert state.phase is GripPhase.EMPTY
    assert min(command.openings) > CONFIG.width - CONFIG.empty_margin - 0.002


def test_a_flat_object_that_may_be_as_thin_as_nothing():
    config = GripConfig(opening=0.05, width=0.01)
    grip = GripController(config)
    state = grip.preshape()
    state, _ = grip.step(state, FingerReading((0.05,) * 2, (0.0,) * 2))
    state = grip.close(state)
    state, _ = grip.step(state, FingerReading((0.0,) * 2, (0.0,) * 2))
    assert state.phase is GripPhase.EMPTY


def test_a_jammed_finger_is_noticed():
    grip = GripController(CONFIG)
    reading = FingerReading((0.15, 0.12, 0.12), (1.0,) * 3)
    state = grip.preshape()
    for _ in range(1100):
        state, _ = grip.step(state, reading)
    assert state.phase is GripPhase.JAMMED


def holding():
    hand = Hand()
    return hand, run(hand, until=(GripPhase.HOLDING,))[0]


@pytest.mark.parametrize(
    ("felt", "step", "travel"),
    [(8.0, 1e-4, 0.005), (20.0, 4e-5, 0.064), (20.0, 2e-4, 0.0054)],
)
def test_fingers_that_close_while_holding_have_lost_their_object(felt, step, travel):
    hand, state = holding()
    grip = GripController(CONFIG)
    steps = round(travel / step)
    for k in range(2 * steps):
        openings = tuple((hand.openings - step * k).tolist())
        reading = FingerReading(openings, (felt, 0.5 * felt, 0.5 * felt))
        state, command = grip.step(state, reading)
        if state.phase is GripPhase.SLIPPED:
            break
    assert state.phase is GripPhase.SLIPPED
    assert steps <= k <= steps + 15
    assert command.force == CONFIG.squeeze


def test_fingers_that_have_met_each_other_hold_nothing_though_they_press():
    _, state = holding()
    grip = GripController(CONFIG)
    state = state.held_from((0.01,) * 3)
    for opening, phase in ((0.004, GripPhase.HOLDING), (0.0, GripPhase.SLIPPED)):
        reading = FingerReading((opening,) * 3, (40.0, 20.0, 20.0))
        for _ in range(100):
            state, _ = grip.step(state, reading)
        assert state.phase is phase


@pytest.mark.parametrize(
    ("shut", "felt", "phase"),
    [
        (0.0, 0.0, GripPhase.SLIPPED),
        (0.0, 20.0, GripPhase.HOLDING),
        (0.05, 0.0, GripPhase.HOLDING),
    ],
)
def test_fingers_that_have_shut_on_nothing_have_lost_what_the_others_hook(
    shut, felt, phase
):
    grip = GripController(CONFIG)
    state, _ = run(Hand(), until=(GripPhase.HOLDING,))
    openings = (0.15, shut, shut)  # pushed open, as if nothing had closed
    for _ in range(30):
        reading = FingerReading(openings, (110.0, felt, felt), 60.0)
        state, _ = grip.step(state, reading)
    assert state.phase is phase


def test_a_load_that_falls_by_a_third_means_slip_and_noise_does_not():
    hand, state = holding()
    grip = GripController(CONFIG)
    rng = np.random.default_rng(0)
    openings = tuple(hand.openings.tolist())
    for k in range(400):
        carried = 60.0 if k < 200 else 40.0
        reading = FingerReading(openings, (40.0,) * 3, carried + rng.normal(0, 0.3))
        state, _ = grip.step(state, reading)
        if state.phase is GripPhase.SLIPPED:
            break
    assert 205 < k < 220


def test_one_spike_of_the_carried_weight_is_nothing_that_can_be_lost():
    grip = GripController(CONFIG)
    state, _ = run(Hand(), until=(GripPhase.HOLDING,))
    squeezed = FingerReading(tuple(state.held_openings), (40.0, 20.0, 20.0))
    for carried in [20.0] * 20 + [200.0] + [20.0] * 30:
        state, _ = grip.step(state, squeezed._replace(carried=carried))
        assert state.phase is GripPhase.HOLDING
    assert state.most_carried == 20.0
    for carried in [12.0] * 20:
        state, _ = grip.step(state, squeezed._replace(carried=carried))
    assert state.phase is GripPhase.SLIPPED


def test_a_brief_dip_is_no_slip():
    hand, state = holding()
    grip = GripController(CONFIG)
    openings = tuple(hand.openings.tolist())
    for k in range(300):
        carried = 20.0 if k % 50 == 0 else 60.0
        state, _ = grip.step(state, FingerReading(openings, (40.0,) * 3, carried))
    assert state.phase is GripPhase.HOLDING


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_a_lost_reading_goes_on_squeezing(bad):
    hand, state = holding()
    openings = (bad, *hand.openings[1:])
    state, command = GripController(CONFIG).step(
        state, FingerReading(openings, (40.0,) * 3)
    )
    assert state.phase is GripPhase.LOST
    assert command.force == CONFIG.squeeze
    assert np.isfinite(command.openings).all()
    state, _ = GripController(CONFIG).step(state, FingerReading((), ()))
    assert state.phase is GripPhase.LOST


@pytest.mark.parametrize("carried", ["none", (), np.nan])
def test_a_weight_that_is_no_number_is_not_known(carried):
    hand, state = holding()
    felt = FingerReading(tuple(hand.openings), (40.0, 20.0, 20.0))
    state, _ = GripController(CONFIG).step(state, felt._replace(carried=carried))
    assert state.phase is GripPhase.HOLDING
    assert (state.carried, state.most_carried) == (0.0, 0.0)


def test_fingers_that_pass_each_other_have_lost_what_they_held():
    _, state = holding()
    grip, crossed = GripController(CONFIG), FingerReading((-0.007,) * 3, (0.0,) * 3)
    for _ in range(100):
        state, command = grip.step(state, crossed)
    assert state.phase is GripPhase.SLIPPED
    assert min(command.openings) >= 0.0


def test_closing_needs_the_preshape():
    grip = GripController(CONFIG)
    state = grip.preshape()
    with pytest.raises(ConfigError, match="preshape"):
        grip.close(state)


@pytest.mark.parametrize(
    "wrong",
    [
        {"resistance": 50.0, "squeeze": 40.0},
        {"squeeze": 70.0},
        {"width": 0.13},
        {"width": -0.01},
        {"opening": -1.0},
        {"opening": 120.0, "width": 80.0},
        {"speed": float("nan")},
    ],
)
def test_settings_that_make_no_sense_are_refused(wrong):
    with pytest.raises(ConfigError):
        GripConfig(**{"opening": 0.12, "width": 0.08} | wrong)


@pytest.mark.parametrize("bad", [-1.0, -0.021, 80.0, float("nan")])
@pytest.mark.parametrize("phase", [GripPhase.PRESHAPING, GripPhase.CLOSING])
def test_an_opening_that_no_hand_has_is_a_lost_reading(bad, phase):
    grip = GripController(CONFIG)
    ready = FingerReading((0.12,) * 3, (1.0,) * 3)
    state = grip.preshape()
    if phase is GripPhase.CLOSING:
        state = grip.close(grip.step(state, ready)[0])
    for forces in ((1.0,) * 3, (30.0,) * 3):
        reading = FingerReading((bad, 0.12, 0.12), forces)
        found, command = grip.step(state, reading)
        assert found.phase is GripPhase.LOST
        assert command.openings == (CONFIG.opening,) * 3


def test_no_pad_is_sent_beyond_zero_or_the_preshape():
    """Encoders are off by a little; commands are not."""
    config = GripConfig(opening=0.05, width=0.0)
    grip = GripController(config)
    rng = np.random.default_rng(0)
    for _ in range(300):
        state = grip.preshape()
        state, _ = grip.step(state, FingerReading((0.05,) * 2, (0.0,) * 2))
        state = grip.close(state)
        for _ in range(4):
            openings = rng.choice([-0.002, 0.0, 0.03, 0.052, 0.9], 2).tolist()
            forces = rng.choice([0.0, 30.0], 2).tolist()
            state, command = grip.step(state, FingerReading(openings, forces))
            assert 0.0 <= min(command.openings) <= max(command.openings) <= 0.05


def test_a_share_of_the_load_above_one_would_never_be_lost_and_is_refused():
    with pytest.raises(ConfigError, match="slip_load"):
        GripConfig(opening=0.12, width=0.08, slip_load=1.5)


@pytest.mark.parametrize("n", [0, 2, 4])
def test_a_hand_of_other_fingers_is_no_usable_one(n):
    grip = GripController(CONFIG)
    reading = FingerReading((0.12,) * n, (0.0,) * n)
    state, command = grip.step(grip.preshape(), reading)
    assert state.phase is GripPhase.LOST
    assert command.openings == (CONFIG.opening,) * 3


@pytest.mark.parametrize("forces", [(None,) * 3, [None] * 3, None, ("a", "b", "c")])
def test_a_hand_that_tells_no_forces_is_no_usable_one(forces):
    grip = GripController(CONFIG)
    state, command = grip.step(grip.preshape(), FingerReading((0.12,) * 3, forces))
    assert state.phase is GripPhase.LOST
    assert command.openings == (CONFIG.opening,) * 3


def test_fingers_of_a_side_stop_at_their_share_of_the_resistance():
    grip = GripController(CONFIG)
    state = grip.preshape()
    state, _ = grip.step(state, FingerReading((0.12,) * 3, (0.0,) * 3))
    # What pushes an object along, or rubs in its joints, feels less than it exerts.
    enough = 0.8 * 0.5 * CONFIG.resistance
    reading = FingerReading((0.1,) * 3, (enough + 1.0, enough + 1.0, enough - 1.0))
    state, _ = grip.step(grip.close(state), reading)
    assert state.is_stopped == (False, True, False)


NOISY = GripConfig(
    opening=0.12, width=0.08, empty_margin=0.12, sides=SIDES, tau=0.05, resistance=10.0
)


@pytest.mark.parametrize(("period", "sigma"), [(0.004, 6.0), (0.01, 3.0)])
def test_fingers_that_are_smoothed_stop_at_no_spike_and_no_noise_before_they_touch(
    rng, period, sigma
):
    grip = GripController(replace(NOISY, period=period))
    state = closing(grip)
    for k in range(round(2.0 / period)):
        forces = rng.normal(0.0, sigma, 3)
        forces[k % 3] += 500.0 * (k % 10 == 0)
        state, _ = grip.step(state, FingerReading((0.1,) * 3, tuple(forces)))
        assert state.is_stopped == (False,) * 3
    for _ in range(round(0.3 / period)):
        forces = np.array([10.0, 5.0, 5.0]) + rng.normal(0.0, sigma, 3)
        state, _ = grip.step(state, FingerReading((0.08,) * 3, tuple(forces)))
    assert state.phase is GripPhase.HOLDING


@pytest.mark.parametrize("period", [0.001, 0.004, 0.01])
def test_a_finger_that_is_smoothed_stops_as_soon_at_any_rate(period):
    grip = GripController(replace(NOISY, period=period))
    state, n = closing(grip), 0
    while not state.is_stopped[0]:
        reading = FingerReading((0.08, 0.1, 0.1), (10.0, 0.0, 0.0))
        state, _ = grip.step(state, reading)
        n += 1
    assert n * period == pytest.approx(1.6 * NOISY.tau, abs=1.5 * period)


SIDED = GripConfig(
    opening=0.12, width=0.08, empty_margin=0.12, tolerance=0.006, sides=(1, -1, -1)
)


def closing(grip: GripController):
    state = grip.preshape()
    state, _ = grip.step(state, FingerReading((0.12,) * 3, (0.0,) * 3))
    return grip.close(state)


def test_a_side_holds_with_one_of_its_fingers():
    grip = GripController(SIDED)
    reading = FingerReading((0.05, 0.0, 0.05), (40.0, -5.0, 30.0))
    state, _ = grip.step(closing(grip), reading)
    assert state.phase is GripPhase.HOLDING
    assert grip.weakest(reading.forces) == 30.0
    assert grip.weakest((40.0, 15.0, 20.0)) == 35.0


def test_a_side_that_meets_nothing_means_empty_once_the_other_has_ended():
    grip = GripController(SIDED)
    reading = FingerReading((0.09, 0.0, 0.0), (0.0, 0.0, 0.0))
    state, _ = grip.step(closing(grip), reading)
    assert state.phase is GripPhase.CLOSING
    state, _ = grip.step(state, FingerReading((0.09, 0.0, 0.0), (40.0, 0.0, 0.0)))
    assert state.phase is GripPhase.EMPTY
    assert state.is_stopped == (True, False, False)


def test_an_object_that_moves_between_the_fingers_is_no_slip():
    grip = GripController(SIDED)
    before = (0.05, 0.05, 0.05)
    assert grip.travel(before, (0.04, 0.06, 0.06)) == pytest.approx(0.0)
    assert grip.travel(before, (0.05, 0.05, 0.04)) == pytest.approx(0.0025)
    assert grip.travel(before, (0.04, 0.04, 0.04)) == pytest.approx(0.01)


def test_a_finger_that_finds_a_better_hold_has_not_lost_what_the_wrist_still_bears():
    hand, state = holding()
    grip = GripController(CONFIG)
    for carried, phase in ((60.0, GripPhase.HOLDING), (None, GripPhase.SLIPPED)):
        after = state._replace(most_carried=60.0)
        openings = tuple((hand.openings - 0.008).tolist())
        for _ in range(100):
            after, _ = grip.step(after, FingerReading(openings, (8.0,) * 3, carried))
        assert after.phase is phase
    for _ in range(100):
        openings = tuple((hand.openings - 0.066).tolist())
        state, _ = grip.step(state, FingerReading(openings, (8.0,) * 3, 60.0))
    assert state.phase is GripPhase.SLIPPED


@pytest.mark.parametrize(
    "sides", [(), 1, (1,), (1, 1), (0, 1), "ab", (1, np.nan), ([1], [-1]), (1, -1, 3)]
)
def test_fingers_are_on_two_sides(sides):
    with pytest.raises(ConfigError, match="sides"):
        GripConfig(opening=0.12, width=0.08, sides=sides)


@pytest.mark.parametrize("name", ["speed", "period", "timeout"])
def test_a_grip_that_never_goes_on_is_refused(name):
    with pytest.raises(ConfigError, match=name):
        GripConfig(opening=0.12, width=0.08, **{name: 0.0})
