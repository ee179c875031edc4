"""What a plan says of how it came about."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from debrisgrasp.geometry import Bounds
from debrisgrasp.pipeline import Target
from debrisgrasp.pipeline.notes import deadline_notes, mask_notes, mass_notes
from debrisgrasp.pipeline.second_look import BestSoFar
from debrisgrasp.planning import SearchResult

BOX = Bounds(np.zeros(3), np.ones(3))
GRASPS = SearchResult((SimpleNamespace(score=0.95),))


def tried(*results: tuple[int, SearchResult]) -> BestSoFar:
    best = BestSoFar(0.9, 2)
    for label, result in results:
        best.take(result, Target(label, BOX, np.ones(1, dtype=bool)))
    return best


def test_a_deadline_is_told_of_where_it_cut_something_short():
    assert deadline_notes(None, is_late=False) == ()
    assert deadline_notes(0.5, is_late=False) == ()
    (note,) = deadline_notes(0.5, is_late=True)
    assert "0.5 s" in note


def test_a_mass_that_was_meant_for_another_object_is_told_of():
    one, other = tried((4, GRASPS)), tried((4, SearchResult(())), (7, GRASPS))
    assert mass_notes(400.0, one) == ()
    assert mass_notes(None, other) == ()
    (note,) = mass_notes(400.0, other)
    assert "400 kg given were taken for object 4" in note
    assert "object 7" in note
    (note,) = mass_notes(400.0, tried((4, SearchResult(()))))
    assert "object 4" in note
    assert mass_notes(400.0, tried()) == ()


def test_a_mass_that_no_arm_lifts_is_told_of():
    assert mass_notes(12.0, tried((4, GRASPS)), liftable=15.0) == ()
    first, _ = mass_notes(3000.0, tried((4, SearchResult(()))), liftable=15.0)
    assert "no arm in use lifts the 3000 kg given" in first
    assert "15 kg" in first


def test_a_mask_over_one_object_says_nothing():
    labels = np.repeat([0, 1, 2], [10, 50, 40])
    assert mask_notes(None, labels) == ()
    assert mask_notes(labels == 1, labels) == ()
    grazed = labels == 1
    grazed[[0, 1, 60, 61]] = True
    assert mask_notes(grazed, labels) == ()
    assert mask_notes(np.zeros(100, dtype=bool), labels) == ()


def test_a_mask_over_several_objects_or_the_ground_is_told_of():
    labels = np.repeat([0, 1, 2], [40, 30, 30])
    (note,) = mask_notes(labels > 0, labels)
    assert "2 objects, 1 (50%), 2 (50%) of it" in note
    (note,) = mask_notes(labels == 0, labels)
    assert "100% of the mask" in note


def test_a_mask_over_a_whole_pile_names_every_object_but_no_crumbs():
    labels = np.repeat([0, 1, 2, 3, 4, 5, 6, 7], [50, 160, 160, 160, 160, 160, 160, 9])
    (note,) = mask_notes(labels > 0, labels)
    assert "covers 6 objects" in note
    assert "6 (17%)" in note
    assert "7 (" not in note
