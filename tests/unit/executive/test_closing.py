"""A hand whose fingers of one side met nothing moves until they do."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from debrisgrasp.control import GripConfig, GripController, GripPhase
from debrisgrasp.executive import closing
from debrisgrasp.geometry import SE3

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
