"""Scenes that no planner likes: an answer and its reason, or a clear error."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from debrisgrasp.errors import ConfigError, DebrisGraspError, InputError
from debrisgrasp.geometry import SE3, Bounds
from debrisgrasp.io import Capture
from debrisgrasp.pipeline import Pipeline, PipelineConfig
from debrisgrasp.planning import PlannerConfig, SceneConfig
from tests.scenes import capture_of, lying_pipe

HAND = "robotiq_3f"
IN_THE_PALM = f"""
name: impossible
gripper: {HAND}
preshape: basic
width: 0.06
opening: 0.10
shape: {{type: cylinder, diameter: 0.06, length: 0.2, ends: open, position: [0, 0, 0]}}
"""
HUGE = f"""
name: huge
gripper: {HAND}
preshape: basic
width: 0.10
opening: 0.14
shape: {{type: bar, width: 0.10, height: 0.3, length: 0.6, position: [0, 0, 0.35]}}
"""


def points_only(points: np.ndarray) -> Capture:
    return Capture(
        points=points, viewpoint=np.array([0.0, 0.0, 1.2]), T_base_camera=SE3.identity()
    )


def spread(dimensions: int, n: int, rng: np.random.Generator) -> np.ndarray:
    """Points of a block (3), a plane (2), a line (1) or a single point (0)."""
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    weights = rng.uniform(-0.2, 0.2, (n, 3))
    weights[:, dimensions:] = 0.0
    return np.array([0.9, 0.0, 0.4]) + weights @ axes.T


@given(
    dimensions=st.integers(0, 3),
    n=st.sampled_from([1, 2, 3, 79, 400, 3000]),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=12, deadline=None)
def test_degenerate_clouds_end_in_grasps_a_reason_or_a_clear_error(
    floating, dimensions, n, seed
):
    points = spread(dimensions, n, np.random.default_rng(seed))
    try:
        plan = floating.plan(points_only(points)).plan
    except DebrisGraspError:
        return
    assert bool(plan.grasps) == (plan.why_empty is None)
    for grasp in plan.grasps:
        numbers = [grasp.S, grasp.C, grasp.expected, grasp.score, grasp.coverage]
        assert np.isfinite(numbers).all()
        assert np.isfinite(grasp.T_base_hand.matrix).all()


@pytest.mark.parametrize("extent", [0.0, 0.3])
def test_points_and_lines_offer_no_grasp(floating, extent):
    line = np.array([0.9, 0.0, 0.4]) + np.linspace(0, extent, 500)[:, None] * [1, 0, 0]
    plan = floating.plan(points_only(line)).plan
    assert not plan.grasps
    assert plan.why_empty


def test_a_region_larger_than_memory_is_refused_with_the_figure(floating, pipe_capture):
    everywhere = Bounds(np.full(3, -20.0), np.full(3, 20.0))
    with pytest.raises(InputError, match=r"region.*40000000 cells.*less room.*coarser"):
        floating.plan(pipe_capture, region=everywhere)


def test_an_object_larger_than_memory_is_passed_over_with_the_figure(dictionary):
    fine = PlannerConfig(
        scene=SceneConfig(spacing=0.005, truncation=0.03, hand_reach=2.0)
    )
    hand = Pipeline(
        robot="none", prototypes=dictionary, config=PipelineConfig(planner=fine)
    )
    plan = hand.plan(capture_of([lying_pipe()])).plan
    assert not plan.grasps
    assert "million cells" in plan.why_empty
    assert "and 2 m around it: lower region_margin or scene.hand" in plan.why_empty


def test_a_prototype_larger_than_the_scene_matches_nothing_and_that_is_said(tmp_path):
    (tmp_path / "huge.yaml").write_text(HUGE)
    hand = Pipeline(robot="none", gripper=HAND, prototypes=tmp_path)
    plan = hand.plan(capture_of([lying_pipe(radius=0.02, length=0.15)])).plan
    assert not plan.grasps
    assert re.search("resembles|candidate poses", plan.why_empty)


@pytest.mark.parametrize("height", [0.0, -0.05])
def test_a_prototype_inside_its_own_hand_is_refused(tmp_path, height):
    text = IN_THE_PALM.replace("[0, 0, 0]", f"[0, 0, {height}]")
    (tmp_path / "impossible.yaml").write_text(text)
    with pytest.raises(ConfigError, match=r"impossible.*mm into its own open hand"):
        Pipeline(robot="none", gripper=HAND, prototypes=tmp_path)


@pytest.mark.parametrize("deadline", [0.0, -1.0, float("nan")])
def test_deadlines_that_mean_nothing_are_refused(floating, pipe_capture, deadline):
    with pytest.raises(ConfigError, match="deadline"):
        floating.plan(pipe_capture, deadline=deadline)


def test_a_deadline_that_has_passed_at_once_still_gives_a_grasp(floating, pipe_capture):
    plan = floating.plan(floating.perceive(pipe_capture), deadline=1e-6).plan
    assert plan.grasps


def test_points_that_are_no_numbers_are_refused():
    points = np.full((100, 3), np.nan)
    with pytest.raises(DebrisGraspError, match=r"NaN|measured|points"):
        points_only(points).cloud()


def test_what_is_far_beyond_the_arms_is_told_without_a_search(dictionary):
    near = capture_of([lying_pipe()])
    far = replace(near, depth=10.0 * near.depth)
    result = Pipeline(prototypes=dictionary).plan(far)
    assert "beyond what the arms span: is the depth in metres" in result.plan.why_empty
    assert "search" not in result.plan.seconds
