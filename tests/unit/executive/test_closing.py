"""A hand whose fingers of one side met nothing moves until they do."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from debrisgrasp.control import (
    FingerReading,
    GripConfig,
    GripController,
    GripPhase,
)
from debrisgrasp.executive import closing
from debrisgrasp.executive.drive import Drive
from debrisgrasp.executive.result import Done, FaultFound
from debrisgrasp.geometry import SE3
from tests.unit.executive.rigs import before_a_brick, holding

ENOUGH = 10.0
"""At which a finger stops [N]."""


@pytest.fixture
def shifted(monkeypatch):
    """Shift a hand whose pair met something, and return where it went, and until."""
    found = []
    monkeypatch.setattr(closing, "_nudged", lambda *a, until: found.append((a, until)))
    config = GripConfig(
        opening=0.13,
        width=0.09,
        resistance=ENOUGH,
        squeeze=50.0,
        max_force=60.0,
        sides=(-1, 1, 1),
    )
    grip = GripController(config)
    ended = grip.preshape()._replace(
        phase=GripPhase.EMPTY, is_stopped=(False, True, True)
    )
    held = SimpleNamespace(grip=grip, state=ended)
    forces = [0.0, 0.0, 0.0]
    drive = SimpleNamespace(
        limb=SimpleNamespace(pose=lambda _: SE3.identity()),
        fingers=lambda: SimpleNamespace(openings=(0.006, 0.066, 0.060), forces=forces),
    )
    context = SimpleNamespace(posture=lambda _: None)
    assert closing._shifted(context, held, drive, 1) is None
    ((_, _, way), until) = found[0]
    return held, way, until, forces


def test_it_moves_towards_what_was_met_and_closes_anew(shifted):
    held, way, _, _ = shifted
    np.testing.assert_allclose(way, [0.033, 0.0, 0.0])
    assert held.state.phase is GripPhase.CLOSING
    assert held.state.targets == (0.006, 0.066, 0.060)
    assert not any(held.state.is_stopped)


@pytest.mark.parametrize(
    ("thumb", "pair", "load", "is_met"),
    [
        (0.0, 4.0, 0.0, False),
        (7.6, 4.0, -16.0, False),  # the thumb would not stop yet
        (7.6, 12.0, -16.0, False),
        (10.5, 12.0, -16.0, True),
        (0.0, 12.0, -31.0, True),  # whatever that is, it is no finger
        (0.0, 12.0, 31.0, False),
    ],
)
def test_it_stops_once_the_fingers_of_both_sides_would(
    shifted, thumb, pair, load, is_met
):
    _, _, until, forces = shifted
    forces[:] = [thumb, pair / 2, pair / 2]
    assert until([load, 0.0, 0.0, 0.0, 0.0, 0.0]) is is_met


@pytest.mark.parametrize(
    ("closed", "force", "rests_at"),
    [
        ((0.0,), 50.0, 0.09),
        ((0.008, 0.0), 50.0, 0.082),  # it curled around something
        ((0.008,) * 4, 50.0, None),  # it goes on: what was there is pushed out
        ((0.0,), 0.5, None),
    ],
)
def test_a_grip_whose_fingers_come_to_rest_on_something_holds(
    pipeline, monkeypatch, closed, force, rests_at
):
    _, task = before_a_brick(pipeline)
    held = task.context.held = holding()
    openings, steps = np.full(3, 0.09), list(closed)

    def stand(*_, **__):
        openings[:] -= steps.pop(0)
        return []

    def fingers(_):
        return FingerReading(tuple(openings.tolist()), (force,) * 3)

    monkeypatch.setattr(Drive, "stand", stand)
    monkeypatch.setattr(Drive, "fingers", fingers)
    monkeypatch.setattr(closing, "object_in_hand", lambda *_: np.zeros((0, 3)))
    monkeypatch.setattr(
        closing, "motion_of", lambda _: SimpleNamespace(grasp=SimpleNamespace(width=0))
    )
    result = closing.verify_grasp(task.context)
    assert not steps
    if rests_at is None:
        assert isinstance(result, FaultFound)
        assert result.fault == "empty_grip"
    else:
        assert isinstance(result, Done)
        assert held.state.held_openings == pytest.approx((rests_at,) * 3)
