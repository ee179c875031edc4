"""What a plan says of how it came about."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import debrisgrasp
from debrisgrasp._files import data_path
from debrisgrasp.geometry import Bounds
from debrisgrasp.io import Capture, measured
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.pipeline import Target
from debrisgrasp.pipeline.notes import (
    deadline_notes,
    mask_notes,
    mass_notes,
    pipeline_notes,
    warning_notes,
)
from debrisgrasp.pipeline.second_look import BestSoFar
from debrisgrasp.planning import (
    PlannerConfig,
    SearchResult,
    SimilarityConfig,
    SuccessModel,
)
from debrisgrasp.segmentation import Candidate

BOX = Bounds(np.zeros(3), np.ones(3))
GRASPS = SearchResult((SimpleNamespace(score=0.95),))


def tried(*results: tuple[int, SearchResult]) -> BestSoFar:
    best = BestSoFar(0.9, 2)
    for label, result in results:
        best.take(result, Target(label, BOX, np.ones(1, dtype=bool)))
    return best


def test_a_deadline_is_told_of_where_it_cut_something_short():
    assert deadline_notes(None, is_cut=False) == ()
    assert deadline_notes(0.5, is_cut=False) == ()
    (note,) = deadline_notes(0.5, is_cut=True)
    assert "0.5 s" in note


def test_an_arm_whose_hand_no_prototype_is_for_is_told_of():
    chain = RobotModel.load("roman").chain("left")
    arms = [
        SimpleNamespace(name=n, gripper=h, chain=chain)
        for n, h in (("left", "a"), ("arm", "b"))
    ]
    of_a, of_b = (SimpleNamespace(gripper=hand) for hand in "ab")
    assert pipeline_notes(arms, [of_a, of_b], PlannerConfig()) == ()
    (note,) = pipeline_notes(arms, [of_a], PlannerConfig())
    assert "for the arm:" in note
    assert note.endswith("for its hand, b")
    assert len(pipeline_notes(arms, [], PlannerConfig())) == 2


def test_an_arm_that_moves_its_palm_in_some_ways_only_is_told_of():
    wrist = [f"right_arm_joint{i}" for i in range(1, 4)]
    chain = RobotModel.load("roman").chain("right", dict.fromkeys(wrist, 0.0))
    arm = SimpleNamespace(name="right", gripper="a", chain=chain)
    (note,) = pipeline_notes([arm], [SimpleNamespace(gripper="a")], PlannerConfig())
    assert "for the right arm: it moves its palm in 5 of six ways" in note


def test_a_plan_tells_of_coefficients_other_than_the_shipped_ones():
    own = replace(SuccessModel.load(), date="2027-01-31", campaign="90 flights")
    (note,) = pipeline_notes([], [], PlannerConfig(success=own))
    assert note.endswith("that were given: 2027-01-31, 90 flights")
    nameless = replace(own, date="", campaign="")
    (note,) = pipeline_notes([], [], PlannerConfig(success=nameless))
    assert "don't say" in note


def test_what_lies_on_the_object_chosen_is_warned_of():
    order = (Candidate(4, 0.1, "why"), Candidate(7, 1.2, "why", "object 4 may fall"))
    assert warning_notes(order, tried((4, GRASPS))) == ()
    assert warning_notes(order, tried((7, SearchResult(())))) == ()
    assert warning_notes(order, tried((7, GRASPS))) == ("object 4 may fall",)


def test_a_plan_on_what_carries_another_object_says_so():
    capture = Capture.load(data_path("captures", "pile.npz"))
    pipeline = debrisgrasp.Pipeline(robot="none")
    seen = pipeline.perceive(capture)
    order = pipeline.plan(seen).order
    warned = [c for c in order if c.warning]
    assert warned
    for candidate in (order[0], warned[0]):
        notes = pipeline.plan(seen, object_label=candidate.label).plan.notes
        assert (candidate.warning in notes) == bool(candidate.warning)


def test_a_mass_that_was_meant_for_another_object_is_told_of():
    one, other = tried((4, GRASPS)), tried((4, SearchResult(())), (7, GRASPS))
    assert mass_notes(400.0, one) == ()
    assert mass_notes(None, other) == ()
    (note,) = mass_notes(400.0, other)
    assert "400 kg given were taken for object 4" in note
    assert "object 7" in note
    (note,) = mass_notes(400.0, tried((4, SearchResult(())), (7, SearchResult(()))))
    assert "object 4" in note
    assert mass_notes(400.0, tried()) == ()


def test_a_mass_of_the_only_thing_tried_is_not_said_to_be_of_the_first():
    for label in (0, 4):
        assert mass_notes(400.0, tried((label, SearchResult(())))) == ()


def test_a_mass_that_no_arm_lifts_is_told_of():
    assert mass_notes(12.0, tried((4, GRASPS)), liftable=15.0) == ()
    (note,) = mass_notes(3000.0, tried((4, SearchResult(()))), liftable=15.0)
    assert "no arm in use lifts the 3000 kg given" in note
    assert "15 kg" in note


def test_a_mass_too_small_for_debris_is_told_of():
    assert mass_notes(0.3, tried((4, GRASPS)), liftable=15.0) == ()
    (note,) = mass_notes(0.008, tried((4, GRASPS)), liftable=15.0)
    assert "8 g" in note
    assert "kilograms" in note


@pytest.fixture(scope="module")
def pile():
    """Return the example capture, its segmentation and the label of each pixel."""
    capture = Capture.load(data_path("captures", "pile.npz"))
    found = debrisgrasp.segment(capture)
    labels = np.zeros(capture.depth.shape, dtype=int)
    labels[measured(capture)] = found.labels
    return capture, labels


def told(capture, mask):
    found = debrisgrasp.segment(replace(capture, mask=mask))
    return mask_notes(mask[measured(capture)], found)


@pytest.mark.parametrize("label", range(1, 9))
def test_a_mask_over_one_object_says_nothing(pile, label):
    capture, labels = pile
    assert told(capture, labels == label) == ()


def test_without_a_mask_or_with_nothing_in_it_there_is_nothing_to_say(pile):
    capture, labels = pile
    assert mask_notes(None, debrisgrasp.segment(capture)) == ()
    assert told(capture, np.zeros_like(labels, dtype=bool)) == ()


@pytest.mark.parametrize("covered", [(3, 4), (1, 2, 3, 4, 5), (1, 2, 3, 4, 5, 6, 8)])
def test_a_mask_over_objects_that_touch_tells_their_number(pile, covered):
    capture, labels = pile
    (note,) = told(capture, np.isin(labels, covered))
    assert f"covers {len(covered)} objects" in note
    assert note.count("%") == len(covered)


def test_a_mask_over_the_ground_is_told_of(pile):
    capture, labels = pile
    (note,) = told(capture, labels == 0)
    assert "100% of the mask" in note


def test_scores_by_the_distance_of_the_paper_are_told_to_be_no_probabilities():
    by_distance = PlannerConfig(similarity=SimilarityConfig(measure="distance"))
    (note,) = pipeline_notes([], [], by_distance)
    assert "no probabilities" in note
