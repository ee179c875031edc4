"""Which of the objects tried is gripped, and what is said of the others."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from debrisgrasp.geometry import Bounds
from debrisgrasp.pipeline import PipelineConfig, Target
from debrisgrasp.pipeline.reasons import unfit, why_empty
from debrisgrasp.pipeline.second_look import BestSoFar
from debrisgrasp.planning import PassedOver, SearchResult
from debrisgrasp.segmentation import GroundReport

BOX = Bounds(np.zeros(3), np.ones(3))


def target(label: int, cost: float = 0.0) -> Target:
    return Target(label, BOX, np.ones(1, dtype=bool), cost)


def found(score: float, **kwargs) -> SearchResult:
    return SearchResult((SimpleNamespace(score=score),), **kwargs)


def promising(promise: float, *later: SearchResult, told=None) -> SearchResult:
    """A search without a grasp that goes on to other results, one after the other."""

    def further(beyond: float) -> SearchResult:
        if told is not None:
            told.append(beyond)
        return later[0]

    return SearchResult((), promise=promise, further=further)


def test_a_sure_first_grasp_ends_the_search():
    best = BestSoFar(0.25, 2)
    best.take(found(0.3), target(1))
    assert best.has_looked
    assert (best.target.label, best.passed_over) == (1, [])


def test_a_doubtful_one_gives_way_to_a_better_one_and_says_so():
    best = BestSoFar(0.25, 2)
    best.take(found(0.1), target(1))
    assert best.is_found
    assert not best.has_looked
    best.take(found(0.3), target(2, 0.1))
    assert best.has_looked
    assert best.target.label == 2
    (passed,) = best.passed_over
    assert passed.label == 1
    assert "doubtful (score 0.10); object 2 has a better one (0.30)" in passed.reason


def test_a_doubtful_one_stays_where_nothing_is_better():
    best = BestSoFar(0.25, 1)
    best.take(found(0.2), target(1))
    best.take(found(0.15), target(2))
    assert best.has_looked
    assert best.target.label == 1
    (passed,) = best.passed_over
    assert passed.label == 2
    assert "no better (score 0.15)" in passed.reason


def test_what_a_further_object_has_to_beat_grows_with_its_cost():
    best = BestSoFar(0.7, 2)
    assert best.worth_beating(target(1)) == 0.0
    best.take(found(0.6), target(1, 0.2))
    assert best.worth_beating(target(2, 0.2)) == pytest.approx(0.6)
    needed = best.worth_beating(target(2, 0.3))
    best.take(found(needed - 1e-6), target(2, 0.3))
    assert best.target.label == 1
    best.take(found(needed + 1e-6), target(3, 0.3))
    assert best.target.label == 3


def test_a_further_object_where_nothing_is_better_says_so_too():
    best = BestSoFar(0.7, 1)
    best.take(found(0.6), target(1))
    best.take(SearchResult((), {"no arm gets there": 3}), target(2))
    assert best.has_looked
    (passed,) = best.passed_over
    assert "object 1 is doubtful, but no better" in passed.reason


def test_an_object_that_likely_carries_something_is_left_alone():
    best = BestSoFar(0.7, 2)
    assert best.is_worth_a_look(target(5, 3.0))
    best.take(found(0.6), target(1, 0.2))
    assert best.is_worth_a_look(target(2, 0.4))
    assert not best.is_worth_a_look(target(3, 0.8))
    # It comes later although it costs less: something surely lies on it.
    assert not best.is_worth_a_look(target(4, 0.1))


def test_a_little_better_is_not_worth_a_costlier_object():
    best = BestSoFar(0.25, 2)
    best.take(found(0.20), target(1, 0.0))
    best.take(found(0.22), target(2, 0.25))
    assert best.target.label == 1


def test_objects_without_any_grasp_are_counted_as_tries_only_after_the_first():
    best = BestSoFar(0.25, 1)
    best.take(SearchResult(()), target(1))
    best.take(SearchResult(()), target(2))
    assert not best.is_found
    assert best.target.label == 1
    best.take(found(0.1), target(3))
    assert best.target.label == 3
    best.take(SearchResult(()), target(4))
    assert best.has_looked
    assert [passed.label for passed in best.passed_over] == [1, 2, 4]


def test_a_poor_grasp_is_no_reason_to_look_no_further():
    best = BestSoFar(0.9, 1)
    best.take(found(0.12), target(1))
    best.take(found(0.1), target(2))
    assert not best.has_looked
    best.take(promising(0.3, found(0.2)), target(3))
    assert not best.has_looked
    best.take(promising(0.5, found(0.2)), target(4))
    assert best.has_looked
    best.search_on()  # it came to less than it promised
    assert not best.has_looked
    best.take(found(0.5), target(5))
    assert best.has_looked
    assert best.target.label == 5


def test_a_first_look_at_others_comes_before_a_longer_search():
    best = BestSoFar(0.9, 2)
    best.take(promising(0.3, found(0.5)), target(1))
    assert not best.is_found
    assert not best.has_looked
    best.take(found(0.92), target(2, 0.01))
    assert best.has_looked
    assert not best.promises_more  # the second one needs no help
    assert best.target.label == 2
    (passed,) = best.passed_over
    assert passed.label == 1


def test_the_search_goes_on_where_it_promises_most():
    told = []
    best = BestSoFar(0.9, 2)
    best.take(promising(0.3, found(0.5), told=told), target(1))
    best.take(promising(0.4, SearchResult(()), told=told), target(2))
    best.take(promising(0.4, found(0.7)), target(3, 0.5))  # it costs more
    assert best.has_looked
    assert not best.is_found
    assert best.promises_more
    best.search_on()
    assert not best.is_found  # the second object came to nothing
    assert best.promises_more
    best.search_on()
    assert (best.target.label, best.result.grasps[0].score) == (1, 0.5)
    assert told == [0.0, 0.0]
    assert not best.promises_more  # what the third promises is less than that
    assert {passed.label for passed in best.passed_over} == {2, 3}


def test_where_there_is_no_hope_the_search_goes_on_only_for_want_of_anything_else():
    best = BestSoFar(0.25, 2)
    best.take(promising(0.001, found(0.2)), target(1))
    best.take(promising(0.1, SearchResult(())), target(2))
    best.search_on()
    assert not best.promises_more
    assert not best.is_found
    best.hope_for_anything()
    assert best.promises_more
    best.search_on()
    assert (best.target.label, best.is_found) == (1, True)
    assert not best.promises_more


def test_a_doubtful_grasp_is_searched_on_before_it_is_offered():
    told = []

    def further(beyond: float) -> SearchResult:
        told.append(beyond)
        return found(0.85)

    best = BestSoFar(0.9, 1)
    best.take(found(0.6, promise=0.6, further=further), target(1))
    best.take(found(0.5), target(2))
    assert best.promises_more
    best.search_on()
    assert told == [0.0]
    assert (best.target.label, best.result.grasps[0].score) == (1, 0.85)
    assert not best.promises_more


def test_another_object_is_searched_on_for_what_is_better_than_the_best():
    told = []

    def further(beyond: float) -> SearchResult:
        told.append(beyond)
        return SearchResult(())

    best = BestSoFar(0.9, 1)
    best.take(found(0.5), target(1))
    best.take(found(0.4, promise=0.7, further=further), target(2, 0.1))
    assert best.promises_more
    best.search_on()
    assert told == [pytest.approx(0.5 * np.exp(0.1))]
    assert best.target.label == 1
    assert not best.promises_more


def test_what_carries_something_waits_until_the_others_came_to_nothing():
    best = BestSoFar(0.9, 2)
    best.take(promising(0.3, SearchResult(())), target(1, 0.5))
    assert not best.is_worth_a_look(target(2, 0.1))
    assert best.promises_more
    best.search_on()
    assert best.is_worth_a_look(target(2, 0.1))


@given(st.lists(st.floats(0.01, 1.0), min_size=1, max_size=6))
def test_at_equal_cost_the_best_score_wins_and_everybody_else_is_named(scores):
    best = BestSoFar(2.0, 10)
    for label, score in enumerate(scores, start=1):
        best.take(found(score), target(label))
    assert best.result.grasps[0].score == pytest.approx(max(scores))
    labels = {passed.label for passed in best.passed_over}
    assert labels == set(range(1, len(scores) + 1)) - {best.target.label}


def test_crumbs_of_a_sparse_cloud_share_one_reason():
    scene = SimpleNamespace(segments=(1, 2, 3))
    report, config = GroundReport.skipped(""), PipelineConfig()
    crumbs = [
        unfit(label, config.planner.scene.spacing * cells, BOX, report, config, [])
        for label, n_cells in ((3, 47), (1, 60), (2, 1))
        for cells in [2.0 * np.arange(3 * n_cells).reshape(-1, 3)]
    ]
    told = why_empty(scene, [*crumbs, PassedOver(4, "too small: 9 cells")], 80, [])
    assert told.endswith(
        "objects 3, 1, 2: too small: 1 to 60 cells of surface seen, 80 are needed; "
        "object 4: too small: 9 cells"
    )


def test_a_hand_whose_palm_frame_is_turned_is_named_where_nothing_is_found():
    scene = SimpleNamespace(segments=(1,))
    left = [PassedOver(1, "3 because the palm would hit something")]
    turned = SimpleNamespace(palm_doubt="the palm reaches 90 mm in front of its frame")
    sound = SimpleNamespace(palm_doubt="")
    told = why_empty(scene, left, 80, [turned, sound])
    assert told.endswith("hit something. The palm reaches 90 mm in front of its frame")
    assert why_empty(scene, left, 80, [sound]).endswith("hit something")
