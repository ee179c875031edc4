"""Which of what was seen is in the way."""

from __future__ import annotations

from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest

from debrisgrasp.executive import choose, choose_grasp
from debrisgrasp.executive.choose import _not_in_the_way, _triage
from debrisgrasp.executive.context import Context
from debrisgrasp.executive.marks import Marks
from debrisgrasp.executive.result import Done, FaultFound
from debrisgrasp.executive.states import State
from debrisgrasp.executive.triage import Triage, Way
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.pipeline import PlanningResult
from debrisgrasp.planning import GraspPlan
from tests.unit.executive.rigs import before_a_brick, look


@pytest.mark.parametrize(
    ("share", "unsure", "is_in_way"),
    [(0.45, 0.0, True), (0.15, 0.0, False), (0.15, 2.0, True)],
)
def test_what_lies_across_the_border_of_the_workspace_is_in_the_way(
    pipeline, monkeypatch, share, unsure, is_in_way
):
    """As is what may do, for all that was seen of it."""
    _, task = before_a_brick(pipeline)
    context = task.context
    look(context)
    seen = context.cycle.seen
    segment = seen.segmentation.segment(1)
    points = seen.cloud.points[seen.segmentation.points_of(1)]
    border = float(np.quantile(points[:, 0], share))
    assert segment.centroid[0] > border
    monkeypatch.setattr(choose, "_UNSURE", unsure)
    monkeypatch.setattr(
        Context, "is_in_way", lambda _, p, more=0.0: p[..., 0] < border + more
    )
    triage = _triage(context, seen, segment)
    reason = _not_in_the_way(context, seen, points, triage)
    assert (reason != "outside the workspace") is is_in_way


def before_a_chosen_brick(pipeline):
    """What a task knows that has chosen the one object before it."""
    _, task = before_a_brick(pipeline)
    context = task.context
    look(context)
    segment = context.cycle.seen.segmentation.segment(1)
    triage = Triage(Way.PINCH, "", ("right", "left"))
    assert isinstance(choose._chosen(context, segment, triage, ""), Done)
    return context


def grasp(rank):
    """One as far as it is asked here."""
    return SimpleNamespace(
        rank=rank, score=rank, success=None, arm="right", prototype="bar",
        width=0.05, opening=0.1,
        gripper="robotiq_3f", preshape="basic", T_base_hand=SE3.identity(),
    )  # fmt: skip


@pytest.mark.parametrize(("rank", "is_put_off"), [(0.2, True), (0.8, False)])
def test_what_hardly_holds_is_put_off_once_until_something_changes(
    pipeline, monkeypatch, rank, is_put_off
):
    context = before_a_chosen_brick(pipeline)
    plan = blank(GraspPlan, grasps=(grasp(rank),))
    found = blank(PlanningResult, plan=plan)
    monkeypatch.setattr(type(context.pipeline), "plan", lambda *_, **__: found)
    for n_before in range(4):
        if n_before == 2:
            context.n_removed += 1
        done = choose_grasp.plan_grasp(context)
        is_first = n_before % 2 == 0
        assert done.next is (State.SELECT if is_put_off and is_first else None)


def blank(kind, **values):
    """One of a kind that holds these values, and nothing else."""
    names = [field.name for field in fields(kind) if field.init]
    return kind(**(dict.fromkeys(names) | values))


def test_what_was_put_off_comes_last_and_the_likeliest_of_it_first():
    marks, places = Marks(), np.eye(4, 3) * 2.0
    marks.put_off(places[0], 0.2, n_changes=0)
    marks.put_off(places[1], 0.4, n_changes=0)
    marks.add(places[2], FaultFound("empty_grip", "nothing there"), n_changes=0)

    def order(n_changes):
        turns = [marks.turn(place, n_changes) for place in places]
        return sorted(range(4), key=turns.__getitem__)

    assert order(0) == [3, 2, 1, 0]
    assert order(1) == [0, 1, 3, 2]
    assert not marks.why_left(places[0], 0, tries=1)


@pytest.mark.parametrize(
    ("fault", "is_search", "values"),
    [("slip", False, {}), ("no_grasp", True, {"candidates": 0.0})],
)
def test_what_is_put_off_keeps_its_try_after_a_removal(fault, is_search, values):
    marks, place = Marks(), np.zeros(3)
    found = FaultFound(fault, "in vain", None, values)
    marks.add(place, found, n_changes=0, is_search=is_search)
    assert marks.why_left(place, 0, tries=1)
    assert not marks.why_left(place, 1, tries=1)
    marks.put_off(place, 0.3, n_changes=1)
    assert not marks.why_left(place, 1, tries=1)
    assert marks.promise(place, 1) == 0.3
    assert marks.promise(place, 2) is None


def test_an_object_that_is_the_only_one_sought_is_never_put_off(pipeline, monkeypatch):
    context = before_a_chosen_brick(pipeline)
    monkeypatch.setattr(context.cycle, "seen", SimpleNamespace(is_marked=np.ones(1)))
    assert not choose_grasp._is_put_off(context, [grasp(0.01)])


def test_what_was_found_on_an_object_that_was_put_off_is_kept_for_its_turn(
    pipeline, monkeypatch
):
    context = before_a_chosen_brick(pipeline)
    slip = FaultFound("slip", "it slipped")
    context.marks.add(context.cycle.centroid, slip, 0).mass = 3.0
    turned = SE3.from_parts(so3.exp(np.array([0.0, 0.0, 1.0])))
    searches = iter([(0.3, 0.0), (0.4, 0.2), (0.2, 0.4), (0.1, 0.6), (0.05, 0.8)])

    def plan(*_, mass, **__):
        assert mass == 3.0
        rank, x = next(searches)
        found = grasp(rank)
        found.T_base_hand = SE3.from_parts(p=[x, 0.0, 0.0]) @ turned
        return blank(PlanningResult, plan=blank(GraspPlan, grasps=(found,)))

    monkeypatch.setattr(type(context.pipeline), "plan", plan)
    assert choose_grasp.plan_grasp(context).next is State.SELECT  # two searches
    assert choose_grasp.plan_grasp(context).next is None  # one more
    kept = [g.rank for g in context.cycle.plan.plan.grasps]
    assert kept == [0.4, 0.3, 0.2]
    context.cycle.seen = replace(context.cycle.seen)  # another look
    choose_grasp.plan_grasp(context)
    assert [g.rank for g in context.cycle.plan.plan.grasps] == [0.1, 0.05]
