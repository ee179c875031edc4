"""How the chain searches: how long, on how many threads, on what was seen before."""

from __future__ import annotations

import gc
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace
from weakref import ref

import numpy as np
import pytest

from debrisgrasp.io.plan_json import plan_to_json
from debrisgrasp.pipeline import Pipeline, PipelineConfig
from debrisgrasp.planning import PlannerConfig, SceneConfig
from debrisgrasp.planning.config import SETTLED
from debrisgrasp.planning.exploration import explore
from tests.scenes import capture_of, lying_pipe

SWEEPS = PlannerConfig().schedule.sweeps


def test_a_doubtful_search_sets_out_once_more_with_more_walkers(
    floating, pipe_capture, monkeypatch
):
    set_out = []

    def counted(*args, **kwargs):
        set_out.append(args[4].walkers)
        return explore(*args, **kwargs)

    monkeypatch.setattr("debrisgrasp.planning.scene_search.explore", counted)
    scores = [
        floating.plan(pipe_capture, mass=mass).plan.grasps[0].score
        for mass in (1.0, 12.0)
    ]
    n, share = floating.config.planner.walkers, floating.config.planner.doubtful_share
    assert scores[0] > SETTLED > scores[1]
    assert set_out == [n, n, share * n]


def test_progress_of_a_search_never_goes_back(floating, pipe_capture):
    told = []
    floating.plan(
        pipe_capture, mass=12.0, progress=lambda *step: told.append(step)
    )  # it is doubtful, and explores once more
    for name in ("search", "wider search"):
        first = told.index((name, 0.0))
        shares = [share for stage, share in told[first:] if stage == name]
        assert len(shares) == SWEEPS + 2  # begun, after every sweep, done
        assert shares == sorted(shares)
        assert shares[-1] == 1.0
    assert told.index(("search", 1.0)) < told.index(("wider search", 0.0))


def test_what_is_hopeless_is_not_searched_on(floating, pipe_capture, monkeypatch):
    monkeypatch.setattr("debrisgrasp.pipeline.second_look._HOPELESS", 1.0)
    stages = set()
    floating.plan(pipe_capture, mass=12.0, progress=lambda stage, _: stages.add(stage))
    assert "search" in stages
    assert "wider search" not in stages


class FakeTime:
    """A clock on which one sweep of the search takes a second, and nothing else any."""

    def __init__(self) -> None:
        self.now = 0.0
        self.sweeps = 0

    def monotonic(self) -> float:
        return self.now

    def progress(self, stage: str, share: float) -> None:
        if stage == "search" and 0.0 < share <= 1.0:
            self.now += 1.0
            self.sweeps += 1


@pytest.fixture
def fake_time(monkeypatch):
    clock = FakeTime()
    monkeypatch.setattr(
        "debrisgrasp._stopwatch.time", SimpleNamespace(monotonic=clock.monotonic)
    )
    return clock


def test_without_a_deadline_every_sweep_is_made(floating, pipe_capture, fake_time):
    floating.plan(pipe_capture, progress=fake_time.progress)
    assert fake_time.sweeps == SWEEPS + 1  # the end of the stage is told too


def test_a_deadline_ends_the_search_and_offers_what_was_found(
    floating, pipe_capture, fake_time
):
    result = floating.plan(pipe_capture, deadline=4.5, progress=fake_time.progress)
    assert fake_time.sweeps == 5 + 1
    assert result.plan.grasps


def test_a_deadline_that_passes_after_the_search_cut_nothing_short(
    floating, pipe_capture, fake_time
):
    told = [
        floating.plan(
            pipe_capture, deadline=fake_time.now + most, progress=fake_time.progress
        ).plan.notes
        for most in (SWEEPS - 0.5, SWEEPS + 0.5)
    ]
    assert ["cut the search short" in " ".join(notes) for notes in told] == [
        True,
        False,
    ]
    assert fake_time.sweeps == 2 * (SWEEPS + 1)


def test_after_the_deadline_objects_are_tried_until_one_offers_a_grasp(
    dictionary, block_capture, fake_time
):
    config = PipelineConfig(doubtful=1.0)
    hands = Pipeline(robot="none", prototypes=dictionary, config=config)
    plan = hands.plan(block_capture, deadline=0.5, progress=fake_time.progress).plan
    assert plan.grasps
    assert plan.object_label == 2
    tried = [passed.label for passed in plan.passed_over]
    assert 1 in tried
    # The shortest search of each, and nothing further once there is a grasp.
    assert fake_time.sweeps == (len(tried) + 1) * (1 + 1)


def test_one_worker_makes_the_plan_of_two(
    floating, dictionary, block_capture, monkeypatch
):
    monkeypatch.setattr("debrisgrasp._workers.cores", lambda: 2)
    config = PipelineConfig(workers=1)
    alone = Pipeline(robot="none", prototypes=dictionary, config=config)
    one, two = (p.plan(block_capture).plan for p in (alone, floating))
    assert one.grasps
    assert plan_to_json(replace(one, seconds={})) == plan_to_json(
        replace(two, seconds={})
    )


def test_threads_that_share_a_pipeline_get_the_plans_of_one(
    floating, pipe_capture, block_capture
):
    captures = [pipe_capture, block_capture, pipe_capture]
    alone = [floating.plan(capture).plan for capture in captures]
    with ThreadPoolExecutor(3) as pool:
        together = [r.plan for r in pool.map(floating.plan, captures)]
    for one, other in zip(alone, together, strict=True):
        assert [g.score for g in one.grasps] == [g.score for g in other.grasps]
        poses = [[g.T_base_hand.matrix for g in p.grasps] for p in (one, other)]
        assert np.array_equal(*poses)


@pytest.mark.parametrize("mass", [1.0, 12.0])
def test_what_was_seen_is_let_go_with_its_perception(floating, pipe_capture, mass):
    """At once, also after a search that could go on: its maps are large."""
    gc.collect()
    gc.disable()
    try:
        seen = floating.perceive(pipe_capture)
        floating.plan(seen, mass=mass)
        scene = ref(next(iter(seen._scenes.values())))
        del seen
        assert scene() is None
    finally:
        gc.enable()


def test_plans_on_one_perception_equal_plans_on_the_capture(floating):
    capture = capture_of([lying_pipe()])
    seen = floating.perceive(capture)
    for seed in (0, 1):
        alone = floating.plan(capture, seed=seed).plan
        shared = floating.plan(seen, seed=seed).plan
        assert [g.score for g in shared.grasps] == [g.score for g in alone.grasps]
        assert len(shared.grasps) > 0
    assert seen.order(floating.policy) is seen.order(floating.policy)


def test_what_another_pipeline_saw_gets_scenes_by_the_settings_of_this_one(
    floating, dictionary
):
    capture = capture_of([lying_pipe()])
    planner = PlannerConfig(scene=SceneConfig(spacing=0.015))
    config = PipelineConfig(planner=planner)
    coarse = Pipeline(robot="none", prototypes=dictionary, config=config)
    seen = floating.perceive(capture)
    plans = [coarse.plan(what).plan for what in (capture, seen)]
    poses = [[g.T_base_hand.matrix for g in plan.grasps] for plan in plans]
    assert poses[0]
    assert np.array_equal(*poses)
