"""An open hand that is caught on its way out."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from debrisgrasp.control import LegOutcome
from debrisgrasp.errors import DriverError
from debrisgrasp.executive import TaskSettings, folding, moves, releasing
from debrisgrasp.executive.context import Context
from debrisgrasp.executive.result import Done, LegEnd
from debrisgrasp.executive.states import State
from tests.unit.executive.rigs import POINTS, before_a_brick, holding

AXIS = np.array([0.0, 0.0, -1.0])


class Caught:
    """A hand that is stopped after 5 mm, so many times, by a push."""

    def __init__(self, times, push):
        self.times, self._push, self.ways = times, np.asarray(push, float), []
        self.context = SimpleNamespace(
            settings=TaskSettings(), posture=lambda _: np.zeros(6)
        )
        self.limb = None

    def leg(self, way, **_):
        way = np.asarray(way)
        is_back = abs(way @ AXIS) > 0.99 * np.linalg.norm(way)
        is_stopped = is_back and self.times > 0
        self.times -= is_back
        length = float(np.linalg.norm(way))
        share = 0.005 / length if is_stopped else 1.0
        self.ways.append(share * way)
        outcome = LegOutcome.CONTACT if is_stopped else LegOutcome.DONE
        return LegEnd(outcome, share, length)

    def push(self, _=None):
        return self._push

    def against(self, *_):
        return lambda _: False

    def weighed(self):
        return (*self._push, 0.0, 0.0, 0.0)


@pytest.fixture(autouse=True)
def unfolded(monkeypatch):
    monkeypatch.setattr(folding, "free_share", lambda *_: 1.0)


@pytest.mark.parametrize("times", [0, 1, 3])
def test_a_hand_caught_by_its_side_goes_aside_and_comes_out(times):
    drive = Caught(times, [40.0, 10.0, 5.0])
    end = releasing._drawn_out(drive, AXIS)
    assert end.outcome is LegOutcome.DONE
    out = np.sum(drive.ways, axis=0)
    assert -out @ AXIS == pytest.approx(0.04)
    assert np.allclose(out[:2], times * 0.006 * np.array([4.0, 1.0]) / np.sqrt(17.0))


@pytest.mark.parametrize(
    ("times", "push"), [(9, [40.0, 0.0, 0.0]), (1, [1.0, 0.0, -40.0])]
)
def test_a_hand_that_is_caught_for_good_is_told(times, push):
    drive = Caught(times, push)
    assert releasing._drawn_out(drive, AXIS).outcome is LegOutcome.CONTACT
    assert len(drive.ways) <= 11


def test_an_arm_that_would_fold_onto_the_robot_is_not_drawn_out_farther(monkeypatch):
    monkeypatch.setattr(folding, "free_share", lambda *_: 0.25)
    drive = Caught(0, [0.0, 0.0, 0.0])
    assert releasing._drawn_out(drive, AXIS).outcome is LegOutcome.DONE
    assert np.linalg.norm(drive.ways[0]) == pytest.approx(0.25 * 0.04)
    monkeypatch.setattr(folding, "free_share", lambda *_: 0.0)
    assert releasing._drawn_out(drive, AXIS).outcome is LegOutcome.BLOCKED
    assert len(drive.ways) == 1


def test_a_gripper_that_does_not_answer_has_let_nothing_go(monkeypatch):
    def refuses(*_):
        raise DriverError("gripper right", "no answer")

    context = SimpleNamespace(held=SimpleNamespace(arm="right"))
    context.fingers_as_they_are = lambda: Context.fingers_as_they_are(context)
    held = context.held
    monkeypatch.setattr(moves, "Drive", lambda *_: None)
    monkeypatch.setattr(moves, "loosen", refuses)
    with pytest.raises(DriverError):
        moves.let_go(context, 0.1)
    assert context.held is held


def test_what_is_let_go_twice_lies_in_one_place(pipeline, monkeypatch):
    _, task = before_a_brick(pipeline)
    context = task.context
    context.state = State.RELEASE
    monkeypatch.setattr(releasing, "_shaken_open", lambda _: None)
    monkeypatch.setattr(releasing, "put_down", lambda *_: None)
    context.held = held = holding(points_hand=POINTS)
    for _ in range(2):
        context.cycle.reached.append(State.RELEASE)
        assert isinstance(releasing.release(context), Done)
        context.held = held  # it still hangs in the hand
    assert len(context.memory.dropped) == 1


def test_what_was_let_go_at_the_drop_off_is_taken_back_nowhere(pipeline, monkeypatch):
    _, task = before_a_brick(pipeline)
    context = task.context
    context.held = holding(arm="right", points_hand=POINTS, is_lifted=True)
    context.cycle.hung = context.posture(context.limbs["right"])
    context.cycle.reached.append(context.state)
    monkeypatch.setattr(releasing, "put_down", lambda *_: None)
    assert isinstance(releasing.release(context), Done)
    assert context.cycle.hung is None
    (body,) = context.memory.dropped
    np.testing.assert_allclose(context.cycle.place, body.mean(axis=0))
