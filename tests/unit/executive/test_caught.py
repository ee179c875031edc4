"""A hand that does not come out straight."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.control import LegOutcome
from debrisgrasp.executive import caught, folding, relief
from debrisgrasp.executive import recover as recovery
from debrisgrasp.executive.drive import Drive
from debrisgrasp.executive.result import FaultFound, LegEnd
from debrisgrasp.executive.states import State
from debrisgrasp.robot import HandReading
from debrisgrasp.robot.fake_hand import FakeGripper
from tests.unit.executive.rigs import before_a_brick, gripped_below


class Bars:
    """Something that stops a hand on its way back, unless it went far enough aside."""

    def __init__(self, R, needed):
        self.back, self.R, self.needed = -R[:, 2], R, np.asarray(needed, float)
        self.place, self.loads, self.pulled = np.zeros(3), [0.0], []

    def leg(self, _drive, way, *, until, **_):
        way = np.asarray(way, float)
        length, aside = float(np.linalg.norm(way)), self.place @ self.R
        far = float(np.linalg.norm(self.needed))
        is_free = far == 0.0 or aside @ self.needed > 0.9 * far * far
        is_stopped = way @ self.back > 0.9 * length and not is_free
        share = 1e-3 / length if is_stopped else 1.0
        self.place = self.place + share * way
        if is_stopped:
            force = next(f for f in range(200) if until((float(f), 0.0, 0.0)))
            self.pulled.append(force)
            return LegEnd(LegOutcome.CONTACT, share, length)
        return LegEnd(LegOutcome.DONE, share, length)


@pytest.fixture
def caught_by(pipeline, monkeypatch):
    def go(needed):
        _, task = before_a_brick(pipeline)
        context = task.context
        limb = context.limbs["right"]
        bars = Bars(limb.pose(context.posture(limb)).R, needed)
        monkeypatch.setattr(Drive, "leg", lambda *a, **k: bars.leg(*a, **k))
        monkeypatch.setattr(folding, "free_share", lambda *_: 1.0)
        monkeypatch.setattr(caught, "relieve", lambda *_: None)
        return context, bars

    return go


@pytest.mark.parametrize(
    "needed", [(0, 0, 0), (0, 0.03, 0), (0, -0.03, 0), (0.03, 0, 0), (-0.03, 0, 0)]
)
def test_a_hand_goes_aside_until_nothing_is_in_its_way_out(caught_by, needed):
    context, bars = caught_by(needed)
    assert caught.felt_out(context, "right") is None
    assert bars.place @ bars.back == pytest.approx(0.12, abs=0.02)
    assert all(force <= 41 for force in bars.pulled)


def test_a_hand_that_no_side_frees_is_told_and_not_pulled_harder(caught_by):
    context, bars = caught_by((1.0, 1.0, 0.0))
    found = caught.felt_out(context, "right")
    assert isinstance(found, FaultFound)
    assert found.fault == "not_released"
    assert len(bars.pulled) == 10  # straight and to four sides, and so drawn in
    assert all(force <= 41 for force in bars.pulled)


def test_fingers_that_opened_behind_something_are_drawn_in(caught_by, monkeypatch):
    context, bars = caught_by((1.0, 1.0, 0.0))
    draw_in, drawn = caught.draw_in, []

    def frees(drive):
        drawn.append(drive.fingers().openings)
        fault = draw_in(drive)
        drawn.append(drive.fingers().openings)
        bars.needed = np.zeros(3)
        return fault

    monkeypatch.setattr(caught, "draw_in", frees)
    assert caught.felt_out(context, "right") is None
    wide, narrow = np.array(drawn)
    np.testing.assert_allclose(narrow, 0.5 * wide, atol=2e-3)
    assert bars.place @ bars.back == pytest.approx(0.12, abs=0.02)


def test_fingers_are_drawn_in_where_the_arm_gets_no_farther_back(
    caught_by, monkeypatch
):
    context, bars = caught_by((0, 0, 0))
    monkeypatch.setattr(folding, "free_share", lambda *_: 0.0)
    gripper = context.limbs["right"].limb.gripper
    wide = np.array(gripper.read().openings)
    assert caught.felt_out(context, "right") is None
    np.testing.assert_allclose(gripper.read().openings, 0.5 * wide, atol=2e-3)
    assert not bars.place.any()


@pytest.mark.parametrize("forces", [(60.0, 50.0, 50.0), (0.0, np.nan, 0.0)])
def test_fingers_that_bear_more_than_the_hand_may_are_believed_and_nothing_moves(
    caught_by, monkeypatch, forces
):
    """The wrist may lie by just as much as the hand is pushed."""
    context, bars = caught_by((0, 0, 0))
    read = HandReading(0.0, (0.1,) * 3, forces)
    monkeypatch.setattr(FakeGripper, "read", lambda _: read)
    found = caught.felt_out(context, "right")
    assert isinstance(found, FaultFound)
    assert found.fault == "ratchet"
    assert "the fingers of an open hand bear" in found.message
    assert not bars.place.any()


def test_a_wrist_that_tells_what_the_fingers_add_up_to_is_believed(
    caught_by, monkeypatch
):
    context, bars = caught_by((0, 0, 0))
    forces = (140.0, 5.0, 5.0)
    read = HandReading(0.0, (0.1,) * 3, forces)
    monkeypatch.setattr(FakeGripper, "read", lambda _: read)
    fingers = context.limbs["right"].hand.fingers
    aside = sum(f.side * force for f, force in zip(fingers, forces, strict=True))
    load = (aside, 10.0, 0.0, 0.0, 0.0, 0.0)
    monkeypatch.setattr(Drive, "weighed", lambda _: load)
    assert caught.felt_out(context, "right") is None
    assert bars.place @ bars.back == pytest.approx(0.12, abs=0.02)


@pytest.mark.parametrize("speed", [1.0, 0.25])
def test_a_hand_that_touched_something_on_its_way_to_rest_feels_its_way_out(
    pipeline, monkeypatch, speed
):
    _, task = before_a_brick(pipeline)
    context, felt = task.context, []
    context.is_in_pile, context.cycle.speed = "right", speed
    monkeypatch.setattr(recovery, "back_out", lambda *_: None)
    monkeypatch.setattr(recovery, "felt_out", lambda _, arm: felt.append(arm))
    assert recovery.clear_up(context) is None
    assert felt == ([] if speed == 1.0 else ["right"])


@pytest.mark.parametrize("fault", ["too_heavy", "ratchet"])
def test_only_a_hand_that_is_stopped_by_a_load_on_its_way_out_feels_for_another(
    pipeline, monkeypatch, fault
):
    _, task = before_a_brick(pipeline)
    context, felt = task.context, []
    context.is_in_pile = "right"
    stopped = FaultFound(fault, "as asked", "right")
    monkeypatch.setattr(recovery, "back_out", lambda *_: stopped)
    monkeypatch.setattr(recovery, "felt_out", lambda _, arm: felt.append(arm))
    found = recovery.clear_up(context)
    assert felt == (["right"] if fault == "too_heavy" else [])
    assert found is (None if felt else stopped)


@pytest.mark.parametrize(
    ("push", "is_stopped"),
    [((0, 0, 60), False), ((0, 0, -60), True), ((60, 0, 0), True), ((0, 0, 30), False)],
)
def test_what_pushes_a_hand_on_its_way_does_not_stop_it(
    pipeline, monkeypatch, push, is_stopped
):
    _, task = before_a_brick(pipeline)
    drive = Drive(task.context, "right")
    R = drive.limb.pose(task.context.posture(drive.limb)).R
    load = (*(R.T @ np.array(push, float)).tolist(), 0.0, 0.0, 0.0)

    def leg(*_, until, **__):
        return until(load)

    monkeypatch.setattr(Drive, "leg", leg)
    assert caught.pushed_to(drive, np.array([0.0, 0.0, 0.04]), 40.0) is is_stopped


@pytest.mark.parametrize(("weight", "expected"), [(60.0, "lower"), (110.0, None)])
def test_a_weight_that_nothing_has_is_not_given_way_to(
    pipeline, monkeypatch, weight, expected
):
    """A sensor that lies by a constant would have the hand press the other way."""
    _, task = before_a_brick(pipeline)
    context, done = task.context, []
    T = gripped_below(context, "right", 0.1)

    def lies(drive, _seconds):
        up = T.R.T @ np.array([0.0, 0.0, -weight])
        drive.load = (*up, 0.0, 0.0, 0.0)
        return []

    monkeypatch.setattr(Drive, "stand", lies)
    for name in ("lower", "loosen", "back_out"):
        monkeypatch.setattr(recovery, name, lambda *_, name=name: done.append(name))
    found = recovery._hanging(context, "right")
    assert done[:1] == [expected] * (expected is not None)
    assert found.fault == ("not_released" if expected else "ratchet")
    assert f"{weight:.0f} N" in found.message


@pytest.mark.parametrize(
    ("weight", "is_empty", "expected"),
    [(112.0, True, "ratchet"), (112.0, False, None), (80.0, True, None)],
)
def test_an_empty_hand_gives_way_to_no_weight_that_nothing_has(
    pipeline, monkeypatch, weight, is_empty, expected
):
    _, task = before_a_brick(pipeline)
    context, legs = task.context, []
    limb = context.limbs["right"]
    down = limb.pose(context.posture(limb)).R.T @ np.array([0.0, 0.0, -weight])
    context.held = None if is_empty else object()
    monkeypatch.setattr(
        relief, "standing_load", lambda *_: np.array([*down, 0.0, 0.0, 0.0])
    )

    def leg(*_, **__):
        legs.append(1)
        return FaultFound("wrench_frozen", "as asked")

    monkeypatch.setattr(Drive, "leg", leg)
    found = relief.relieve(context, "right", tight=0.3)
    assert found.fault == (expected or "wrench_frozen")
    assert bool(legs) is (expected is None)


def hooked(up):
    """Weight of what a hand holds by a spring, so far over where it was [m]."""
    return 112.0 + 1e4 * up


def lies(up):
    """Reading of a hand whose sensor is wrong, and that stands on something."""
    return 112.0 + 1e4 * min(up, 0.0)


@pytest.mark.parametrize(
    ("reached", "weighs", "expected"),
    [
        ([State.APPROACH, State.CLOSE, State.LIFT], hooked, None),
        ([State.APPROACH, State.CLOSE, State.LIFT], lies, "ratchet"),
        ([State.APPROACH, State.CLOSE, State.LIFT], lambda _: 112.0, "ratchet"),
        ([State.APPROACH], hooked, "ratchet"),
        ([State.CLOSE, State.LIFT, State.TRANSPORT], hooked, "ratchet"),
    ],
)
def test_a_weight_that_falls_on_the_way_back_and_grows_on_the_way_on_is_no_lie(
    pipeline, monkeypatch, reached, weighs, expected
):
    """What the hand hooked on its way up presses less where it came from."""
    _, task = before_a_brick(pipeline)
    context, limb = task.context, task.context.limbs["right"]
    gripped_below(context, "right", 0.1)
    context.cycle.reached[:] = reached
    T, up, ways = limb.pose(context.posture(limb)), [0.0], []

    def leg(_, way, **__):
        ways.append(np.asarray(way))
        up[0] += way[2]

    monkeypatch.setattr(
        relief,
        "standing_load",
        lambda *_: np.array([*(T.R.T @ [0.0, 0.0, -weighs(up[0])]), 0.0, 0.0, 0.0]),
    )
    monkeypatch.setattr(Drive, "leg", leg)
    found = relief.relieve(context, "right", tight=0.3)
    assert (found and found.fault) == expected
    if reached[-1] is not State.LIFT:
        assert not ways  # it never was there, or came another way
        return
    assert ways[0][2] == pytest.approx(-2e-3)  # to where it gripped
    # Only what is hooked is eased; else no step leads farther than that.
    lowest = np.cumsum([way[2] for way in ways]).min()
    assert (lowest < -2.5e-3) == (expected is None)


def slides(gone):
    """Load of a hand that pushed something on, which slid until it stood [N]."""
    return max(112.0 - 1e4 * gone, 0.0)


@pytest.mark.parametrize(
    ("weighs", "expected", "n"), [(slides, None, 7), (lambda _: 112.0, "ratchet", 1)]
)
def test_a_hand_that_pushed_something_is_believed_if_the_load_falls_on_the_way_back(
    pipeline, monkeypatch, weighs, expected, n
):
    """What slid before it grows no more on the way on, but nothing was behind it."""
    _, task = before_a_brick(pipeline)
    limb = task.context.limbs["right"]
    T, ways = limb.pose(task.context.posture(limb)), []

    def load(*_):
        gone = -sum(way[1] for way in ways)
        return np.array([*(T.R.T @ [0.0, 0.0, -weighs(gone)]), 0.0, 0.0, 0.0])

    monkeypatch.setattr(relief, "standing_load", load)
    monkeypatch.setattr(Drive, "leg", lambda _, way, **__: ways.append(np.array(way)))
    back = np.array([0.0, -0.06, 0.0])
    found = relief.relieve(task.context, "right", tight=0.3, back=back)
    assert (found and found.fault) == expected
    assert len(ways) == n
    np.testing.assert_allclose(ways, n * [[0.0, -2e-3, 0.0]], atol=1e-9)


def test_a_load_that_is_gone_after_the_step_back_and_on_needs_no_more_belief(
    pipeline, monkeypatch
):
    """What the hand hooked has slid off: a sensor that lies would tell it still."""
    _, task = before_a_brick(pipeline)
    context, limb = task.context, task.context.limbs["right"]
    gripped_below(context, "right", 0.1)
    context.cycle.reached[:] = [State.APPROACH, State.CLOSE, State.LIFT]
    T, ways = limb.pose(context.posture(limb)), []

    def load(*_):
        weight = 20.0 if ways else 112.0
        return np.array([*(T.R.T @ [0.0, 0.0, -weight]), 0.0, 0.0, 0.0])

    monkeypatch.setattr(relief, "standing_load", load)
    monkeypatch.setattr(Drive, "leg", lambda _, way, **__: ways.append(np.array(way)))
    assert relief.relieve(context, "right", tight=0.3) is None
    np.testing.assert_allclose(np.sum(ways, axis=0), [0.0, 0.0, 2e-3], atol=1e-9)
