"""Where closing fingers meet what is round: straight faces, whose lean is known."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from debrisgrasp.planning.finger_faces import FingerFaces
from debrisgrasp.prototypes import PrototypeLibrary

REACH = 0.12
CLAW = PrototypeLibrary.load().select(names=["claw_bar_2x4_flat"])


class Hand:
    """Straight fingers."""

    def __init__(self, lean):
        self._slope = np.tan(lean)

    def preshape(self, _name):
        return SimpleNamespace(narrowest=0.0, widest=0.2)

    def fingertip_reach(self, _name, _opening):
        return REACH

    def inner_faces(self, _name, opening, heights):
        half = opening / 2 + (REACH - heights) * self._slope
        return np.tile(np.where(heights <= REACH, half, np.inf), (2, 1))


class Library(list):
    """Prototypes and their hands."""

    def __init__(self, prototypes, grippers):
        super().__init__(prototypes)
        self.grippers = grippers


def library(lean: float) -> Library:
    """One prototype of a hand whose straight fingers lean inwards [rad]."""

    prototype = SimpleNamespace(gripper="hand", preshape="any", opening=0.2)
    return Library([prototype], {"hand": Hand(lean)})


def lean_of(faces: FingerFaces, middle: float, radius: float) -> float:
    found = faces.lean(np.zeros(1, dtype=int), np.array([middle]), np.array([radius]))
    return float(found[0])


@pytest.mark.parametrize("lean", [0.0, 0.2, 0.4])
@pytest.mark.parametrize(("middle", "radius"), [(0.085, 0.02), (0.075, 0.03)])
def test_straight_faces_meet_a_cylinder_as_they_lean(lean, middle, radius):
    faces = FingerFaces.of(library(lean))
    assert lean_of(faces, middle, radius) == pytest.approx(lean, abs=0.09)


def test_what_lies_on_the_palm_is_held_there():
    faces = FingerFaces.of(library(0.4))
    assert lean_of(faces, 0.03, 0.03) == 0.0


def test_what_is_met_nowhere_has_no_lean():
    faces = FingerFaces.of(library(0.4))
    assert lean_of(faces, 0.3, 0.02) == 0.0
    assert lean_of(faces, 0.04, 0.01) == 0.0  # narrower than closed fingers leave there


def test_gaps_are_no_wider_than_the_opening_and_go_on_past_the_tips():
    gaps = FingerFaces.of(library(0.4)).gaps[0]
    assert gaps.max() <= np.float32(0.2)
    assert gaps[-1] == pytest.approx(gaps[11])
    assert gaps[3] == pytest.approx(2 * (REACH - 0.035) * np.tan(0.4), abs=1e-6)


def test_a_claw_closes_over_a_bar_near_its_palm_and_on_one_at_its_tips():
    faces = FingerFaces.of(CLAW)
    assert lean_of(faces, 0.058, 0.015) > 0.6
    assert lean_of(faces, 0.080, 0.015) < 0.1
