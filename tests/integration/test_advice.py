"""Advice is checked by doing what it says and planning again."""

from __future__ import annotations

import inspect
from dataclasses import replace

import numpy as np
import pytest

import debrisgrasp
import debrisgrasp.planning
from debrisgrasp.cli.tables import plan_summary
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import SE3, Box
from debrisgrasp.pipeline import Pipeline, PipelineConfig
from debrisgrasp.planning import PlannerConfig
from debrisgrasp.planning.success import SuccessModel
from tests.scenes import capture_of, lying_pipe

PIPE = capture_of([lying_pipe()])
FAR = capture_of([lying_pipe(length=0.5, position=(1.75, 0.0, 0.3))])


@pytest.fixture(scope="module")
def roman(dictionary):
    return Pipeline(robot="roman", prototypes=dictionary)


@pytest.fixture(scope="module")
def heavy(floating):
    return floating.plan(capture_of([lying_pipe()]), mass=400.0).plan


def test_an_object_out_of_reach_is_reached_from_where_the_advice_sends_the_base(roman):
    plan = roman.plan(FAR).plan
    assert not plan.grasps
    advice = plan.advice[0]
    assert advice.kind == "base"
    assert advice.change["x"] > 0
    assert 0 < advice.freed <= advice.of
    placed = SE3.from_parts(p=[advice.change["x"], advice.change["y"], 0.0])
    moved = replace(FAR, T_base_camera=placed.inverse() @ FAR.T_base_camera)
    assert roman.plan(moved).plan.grasps


def test_a_base_that_stands_fast_is_sent_nowhere(roman, dictionary):
    fast = Pipeline(robot=replace(roman.robot, drives=False), prototypes=dictionary)
    plan = fast.plan(FAR, advise=True).plan
    assert not plan.grasps
    assert not [advice for advice in plan.advice if advice.kind == "base"]


def test_there_is_no_advice_once_the_deadline_has_passed(roman):
    plan = roman.plan(FAR, deadline=1e-3, advise=True).plan
    assert not plan.advice
    assert "advice" not in plan.seconds
    assert "deadline" in plan.notes[0]


def test_who_plans_in_one_call_may_ask_for_advice_too(dictionary):
    doubting = PipelineConfig(planner=PlannerConfig(minimum_evidence=1.0))
    settings = {"robot": "none", "prototypes": dictionary, "config": doubting}
    found = debrisgrasp.plan(PIPE, **settings, advise=True).plan
    assert found.advice
    texts = [advice.text for advice in found.advice]
    again = Pipeline(**settings).plan(PIPE, advise=True).plan
    assert texts == [advice.text for advice in again.advice]


def test_the_one_call_takes_what_pipeline_and_plan_take():
    takes, *parts = (
        set(inspect.signature(call).parameters) - {"self"}
        for call in (debrisgrasp.plan, Pipeline.__init__, Pipeline.plan)
    )
    assert takes == set.union(*parts)


def test_an_idle_arm_is_named_if_it_gets_there(dictionary):
    left = capture_of([lying_pipe(length=0.5, position=(0.85, 0.75, 0.3))])
    right = Pipeline(robot="roman", arm="right", prototypes=dictionary)
    plan = right.plan(left, advise=True).plan
    advice = [a for a in plan.advice if a.kind == "arm"]
    assert advice
    assert "left arm" in advice[0].text
    assert 0 < advice[0].freed <= advice[0].of


def test_what_is_too_heavy_says_what_could_be_lifted(heavy, floating):
    assert not heavy.grasps
    assert "too heavy" in heavy.why_empty
    (advice,) = (a for a in heavy.advice if a.kind == "mass")
    lighter = 0.99 * advice.change["mass"]
    found = floating.plan(capture_of([lying_pipe()]), mass=lighter).plan
    assert found.grasps
    assert all(grasp.load.margins[1] >= 1.0 for grasp in found.grasps)


def test_where_a_far_side_is_doubted_the_settings_that_trust_it_are_named():
    """What is written as Python is Python."""
    doubting = PipelineConfig(planner=PlannerConfig(minimum_evidence=1.0))
    plan = Pipeline(robot="none", config=doubting).plan(PIPE, advise=True).plan
    (advice,) = (a for a in plan.advice if a.kind == "view")
    words = advice.text.partition("in Python, plan with ")[2]
    trusting = eval(words, vars(debrisgrasp.planning))
    assert (trusting.minimum_evidence, trusting.clearance.unknown_cost) == (0, 0)
    config = PipelineConfig(planner=trusting)
    assert Pipeline(robot="none", config=config).plan(PIPE).plan.grasps


def test_the_table_says_how_many_grasps_it_leaves_out(floating):
    plan = floating.plan(capture_of([lying_pipe()])).plan
    n = len(plan.grasps)
    assert n > 3
    assert f"and {n - 3} more" in plan_summary(plan, limit=3)
    assert "more" not in plan_summary(plan, limit=n)


def test_what_would_hardly_hold_is_no_grasp(dictionary):
    shipped = SuccessModel.load()
    gloomy = replace(shipped, intercept=shipped.intercept - 4.5)
    config = PipelineConfig(planner=PlannerConfig(success=gloomy))
    floating = Pipeline(robot="none", prototypes=dictionary, config=config)
    plan = floating.plan(capture_of([lying_pipe()])).plan
    assert plan.rejections["it would hardly hold"]
    assert all(grasp.success_probability >= 0.1 for grasp in plan.grasps)


def test_a_plan_with_grasps_has_advice_only_on_wish(roman):
    aside = capture_of([lying_pipe(length=0.5, position=(0.9, 0.9, 0.3))])
    plan = roman.plan(aside).plan
    assert plan.grasps
    assert plan.advice == ()
    asked = roman.plan(aside, advise=True).plan
    assert "what would help:" in plan_summary(asked)
    assert [a.score for a in asked.grasps] == [b.score for b in plan.grasps]


def test_the_command_proposes_to_ask_where_no_grasp_is_likely_to_hold(
    run, dictionary, tmp_path, monkeypatch
):
    words = "none is likely to hold; --advice"
    capture = tmp_path / "pipe.npz"
    capture_of([lying_pipe()]).save(capture)
    command = ("plan", capture, "--robot", "none", "--prototypes", dictionary)
    assert words not in run(*command).out
    shipped = SuccessModel.load()
    gloomy = replace(shipped, intercept=shipped.intercept - 4.5)
    monkeypatch.setattr(SuccessModel, "load", lambda: gloomy)
    found = run(*command)
    assert found.status == 0
    assert words in found.out
    assert words not in run(*command, "--advice").out


def test_neighbours_named_are_other_objects_and_the_counts_agree(floating):
    pipe = lying_pipe()
    walls = [
        Box([0.01, 0.35, 0.12], SE3.from_parts(None, [x, 0.0, 0.12]))
        for x in (0.82, 0.98)
    ]
    seen = floating.perceive(capture_of([pipe, *walls]))
    on_pipe = int(
        np.argmin([abs(s.centroid[2] - 0.2) for s in seen.segmentation.segments])
    )
    label = seen.segmentation.segments[on_pipe].label
    plan = floating.plan(seen, object_label=label, advise=True).plan
    neighbours = {a.change["object"] for a in plan.advice if a.kind == "neighbour"}
    labels = {s.label for s in seen.segmentation.segments} - {label}
    assert neighbours <= labels
    assert sum(plan.ruled_out.counts().values()) == len(plan.ruled_out)
    assert plan.rejections == plan.ruled_out.counts()


def test_the_same_seed_gives_the_same_advice(roman):
    one, other = (roman.plan(FAR, seed=4).plan.advice for _ in "ab")
    assert [a.text for a in one] == [a.text for a in other]


@pytest.mark.parametrize("mass", [0.0, -2.0, np.nan, np.inf])
def test_a_mass_that_is_none_is_refused(floating, mass):
    with pytest.raises(ConfigError, match="mass"):
        floating.plan(FAR, mass=mass)


def test_the_command_takes_a_mass_and_gives_advice(run, dictionary, tmp_path):
    capture = tmp_path / "pipe.npz"
    capture_of([lying_pipe()]).save(capture)
    words = ("plan", capture, "--robot", "none", "--prototypes", dictionary)
    found = run(*words, "--mass", 2, "--advice", "--json").json
    assert found["grasps"][0]["load"]["mass"] == [2.0, 2.0]
    assert len(found["grasps"][0]["retreat"]["direction"]) == 3
    assert all(a["freed"] <= a["of"] for a in found["advice"])
    ended = run(*words, "--mass", 900)
    assert ended.status == 1
    assert "too heavy for the grip" in ended.out
    assert "hold an object of" in ended.out
    assert run(*words, "--mass", -1).status == 2
