"""What is held is put down, and every arm brought to rest, after a fault."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from debrisgrasp.control import GripPhase
from debrisgrasp.executive import recover as recovery
from debrisgrasp.executive.drive import Drive
from debrisgrasp.executive.faults import Action
from debrisgrasp.executive.result import FaultFound
from debrisgrasp.executive.states import State
from debrisgrasp.executive.table import answer_to
from tests.unit.executive.rigs import before_a_brick, gripped_below, holding


def test_a_hand_that_was_stopped_on_its_way_back_gives_way_first(pipeline, monkeypatch):
    _, task = before_a_brick(pipeline)
    context, eased = task.context, []
    context.is_in_pile = "right"
    monkeypatch.setattr(recovery, "relieve", lambda _, arm: eased.append(arm))
    event = task._event(State.RETREAT, FaultFound("plan_collision", ""), Action.RETRY)
    recovery.recover(context, event, answer_to(State.RETREAT, "plan_collision"))
    assert eased == ["right"]


@pytest.mark.parametrize(
    ("backed", "expected"),
    [(0.12, ["lower", "loosen", "back_out"]), (0.0, ["loosen"])],
)
def test_what_hangs_in_an_opened_hand_is_lowered_before_that_opens_wider(
    pipeline, monkeypatch, backed, expected
):
    _, task = before_a_brick(pipeline)
    context, done = task.context, []
    gripped_below(context, "right", backed)

    def hangs(drive, _seconds):
        drive.load = (0.0, 0.0, 50.0, 0.0, 0.0, 0.0)
        return []

    monkeypatch.setattr(Drive, "stand", hangs)
    monkeypatch.setattr(recovery, "free_share", lambda *_: 1.0)
    for name in ("lower", "loosen", "back_out"):
        monkeypatch.setattr(recovery, name, lambda *_, name=name: done.append(name))
    found = recovery._hanging(context, "right")
    assert found.fault == "not_released"
    assert done == expected


@pytest.mark.parametrize("pushed", [20.0, -50.0])
def test_a_hand_goes_off_what_presses_on_it_before_that_counts_as_hanging(
    pipeline, monkeypatch, pushed
):
    _, task = before_a_brick(pipeline)
    context, done, load = task.context, [], [pushed]
    limb = context.limbs["right"]
    down = limb.pose(context.posture(limb)).R.T @ np.array([0.0, 0.0, -1.0])

    def stand(drive, _seconds):
        drive.load = (*(load[0] * down), 0.0, 0.0, 0.0)
        return []

    def relieve(*_):
        load[0] = 0.0

    monkeypatch.setattr(Drive, "stand", stand)
    monkeypatch.setattr(recovery, "relieve", relieve)
    for name in ("lower", "loosen", "back_out"):
        monkeypatch.setattr(recovery, name, lambda *_, name=name: done.append(name))
    assert recovery._hanging(context, "right") is None
    assert not done


def test_an_arm_that_met_something_is_away_before_the_trunk_turns(
    pipeline, monkeypatch
):
    _, task = before_a_brick(pipeline)
    context, order = task.context, []
    context.cycle.motion = SimpleNamespace(arm="left")
    monkeypatch.setattr(recovery, "relieve", lambda *_: None)
    monkeypatch.setattr(recovery, "put_away", lambda _, arm, *__: order.append(arm))
    assert recovery.clear_up(context) is None
    assert order == ["left", "right"]


@pytest.mark.parametrize(
    ("force", "phase", "is_back"),
    [
        (0.0, GripPhase.HOLDING, True),
        (140.0, GripPhase.HOLDING, False),
        (0.0, GripPhase.SLIPPED, False),
    ],
)
def test_a_hand_whose_lift_came_to_nothing_goes_back_before_it_opens(
    pipeline, monkeypatch, force, phase, is_back
):
    """Up there its fingers would be caught in what held it.

    Not under too much load, nor on to what it has lost.
    """
    _, task = before_a_brick(pipeline)
    context, opened = task.context, []
    limb, drive = context.limbs["right"], Drive(context, "right")

    def height():
        return limb.pose(context.posture(limb)).p[2]

    begun = limb.pose(context.posture(limb)).p
    drive.leg([0.0, 0.0, 0.04], speed=0.05)
    assert height() == pytest.approx(begun[2] + 0.04, abs=2e-3)
    context.held, context.is_in_pile = holding(begun=begun), "right"
    context.held.state = context.held.state._replace(phase=phase)
    monkeypatch.setattr(recovery, "let_go", lambda _: opened.append(height()))
    monkeypatch.setattr(recovery, "back_out", lambda *_: None)
    monkeypatch.setattr(recovery, "put_away", lambda *_: None)
    load = np.array([0.0, 0.0, force, 0.0, 0.0, 0.0])
    monkeypatch.setattr(recovery, "standing_load", lambda *_: load)
    assert recovery.clear_up(context) is None
    height = begun[2] + 0.04 * (not is_back)
    assert opened == [pytest.approx(height, abs=2e-3)]


@pytest.mark.parametrize(
    ("borne", "expected"), [(0.0, ["let_go"]), (50.0, ["taken_back", "put_down"])]
)
def test_a_hand_that_lost_what_it_carried_is_not_lowered_on_to_it(
    pipeline, monkeypatch, borne, expected
):
    """What one side of it still bears is put down; let go, it would fall."""
    _, task = before_a_brick(pipeline)
    context, done = task.context, []
    context.held, context.is_in_pile = holding(is_lifted=True), "right"
    context.held.state = context.held.state._replace(
        phase=GripPhase.SLIPPED, most_carried=60.0
    )
    monkeypatch.setattr(Drive, "carried", lambda *_: borne)
    monkeypatch.setattr(recovery, "relieve", lambda *_: None)
    for name in ("let_go", "put_down", "back_out", "put_away"):
        monkeypatch.setattr(recovery, name, lambda *_, name=name: done.append(name))
    monkeypatch.setattr(recovery, "taken_back", lambda _: done.append("taken_back"))
    monkeypatch.setattr(recovery, "_hanging", lambda *_: None)
    assert recovery.clear_up(context) is None
    assert done == [*expected, "back_out", "put_away", "put_away"]


def test_a_hand_that_goes_back_presses_on_nothing(pipeline, monkeypatch):
    _, task = before_a_brick(pipeline)
    context, ends = task.context, []
    limb = context.limbs["right"]
    T = limb.pose(context.posture(limb))
    context.held = holding(begun=T.p - [0.0, 0.0, 0.05])
    monkeypatch.setattr(Drive, "leg", lambda *_, until, **__: ends.append(until))
    assert recovery._gone_back(context, context.held) is None
    for push, is_met in ((60.0, True), (30.0, False), (-60.0, False)):
        load = (*(T.R.T @ [0.0, 0.0, push]), 0.0, 0.0, 0.0)
        assert ends[0](load) is is_met
