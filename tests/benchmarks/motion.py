"""Pre-grasp motions: time, share solved, and what the exact recheck finds.

``python -m tests.benchmarks.motion [--json FILE]`` plans grasps in the shared piles
(beside the checkout; else in the bundled one), and then a motion of RoMan's arm from
its present posture to the pre-grasp of each, 100 in all. Times are CPU times of one
thread, of the whole call: postures of the goal, path, time, final check. The recheck is
made afterwards, by the links' solids alone, at 0.01 rad, and for contact of the robot
with itself by the collision tests of the kinematics. The same motions are planned with
OMPL's search in the place of ours if the extra ``motion`` is installed.
"""

from __future__ import annotations

import importlib.util
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from debrisgrasp.cli.tables import columns
from debrisgrasp.geometry import SE3
from debrisgrasp.io import Capture, data_path
from debrisgrasp.kinematics import ArmCollision
from debrisgrasp.motion import (
    MotionConfig,
    MotionPlan,
    MotionPlanner,
    MotionSpace,
    MotionStatus,
    connect,
    connect_by_ompl,
    samples_of,
)
from debrisgrasp.pipeline import Pipeline, motion_space
from tests.benchmarks.report import arguments, publish

TARGETS = {
    "solved": "1: solved, or infeasible for a reason",
    "ms_median": "40 or less",
    "ms_p95": "150 or less",
    "recheck_failures": "0",
}
N_QUERIES = 100


@dataclass(frozen=True)
class Query:
    arm: str
    q_start: np.ndarray
    goal: SE3
    space: MotionSpace


def queries(pipeline: Pipeline) -> list[Query]:
    """Pre-grasps of the best grasps in every pile, the same number from each."""
    folder = Path(__file__).parents[3] / "shared" / "data" / "piles"
    paths = sorted(folder.glob("*.npz")) or [data_path("captures", "pile.npz")]
    per_pile = []
    arms = {arm.name: arm for arm in pipeline.arms}
    for path in paths:
        result = pipeline.plan(Capture.load(path))
        space = motion_space(result.capture, result.cloud, result.segmentation)
        per_pile.append(
            [
                Query(g.arm, arms[g.arm].q_present, g.T_base_pregrasp, space)
                for g in result.plan.grasps
                if g.arm is not None
            ]
        )
    found: list[Query] = []
    for rank in range(max(map(len, per_pile))):
        found += [of_pile[rank] for of_pile in per_pile if rank < len(of_pile)]
    return found[:N_QUERIES]


def fails_recheck(planner: MotionPlanner, query: Query, plan: MotionPlan) -> bool:
    """Whether the solids touch anything, or a limit is broken."""
    assert plan.trajectory is not None
    q = samples_of(plan.trajectory, 0.01)
    test = planner.exact_test(query.space)
    body = ArmCollision(body=test.arm.body)
    return bool(
        not test.is_free(q).all()
        or body.hits_itself(q).any()
        or plan.trajectory.violation(planner.limits, period=0.001)
    )


def measured(
    pipeline: Pipeline, asked: Sequence[Query], config: MotionConfig
) -> tuple[dict[str, float], Counter[str]]:
    """Figures of one engine, and how the motions ended."""
    planners = {
        arm.name: MotionPlanner.of_arm(arm, config=config) for arm in pipeline.arms
    }
    for query in asked[:4] + asked[-4:]:
        # Grids, trees and compiled formulas are made when first used.
        planners[query.arm].plan(
            query.q_start, query.goal, query.space, rng=np.random.default_rng(0)
        )
    seconds, seconds_path, failures, ends = [], [], 0, Counter[str]()
    searched, duration = [], []
    for i, query in enumerate(asked):
        planner, rng = planners[query.arm], np.random.default_rng(i)
        start = time.thread_time()
        plan = planner.plan(query.q_start, query.goal, query.space, rng=rng)
        spent = time.thread_time() - start
        seconds.append(spent)
        ends[plan.status.name] += 1
        if plan.is_solved:
            seconds_path.append(spent)
            failures += fails_recheck(planner, query, plan)
            duration.append(plan.trajectory.duration if plan.trajectory else 0.0)
            if plan.counts.rounds:
                searched.append(spent)
    return {
        "solved": 1.0 - ends[MotionStatus.BUDGET.name] / len(asked),
        "ms_median": 1e3 * float(np.median(seconds)),
        "ms_p95": 1e3 * float(np.quantile(seconds, 0.95)),
        "recheck_failures": float(failures),
        "found": float(len(seconds_path)),
        "searched": float(len(searched)),
        "ms_median_searched": 1e3 * float(np.median(searched)) if searched else 0.0,
        "motion_s_mean": float(np.mean(duration)),
    }, ends


def main() -> None:
    options = arguments(__doc__ or "")
    pipeline = Pipeline()
    asked = queries(pipeline)
    engines = {"ours": connect}
    if importlib.util.find_spec("ompl") is not None:
        engines["ompl"] = connect_by_ompl
    columns_of, figures = {}, {}
    for name, engine in engines.items():
        found, ends = measured(pipeline, asked, MotionConfig(engine=engine))
        columns_of[name] = found
        print(f"{name}: " + ", ".join(f"{n} {end}" for end, n in ends.items()))
        suffix = "" if name == "ours" else f"_{name}"
        figures |= {f"{key}{suffix}": value for key, value in found.items()}
    figures["queries"] = float(len(asked))
    rows = [
        [key, TARGETS.get(key, ""), *(f"{c[key]:.4g}" for c in columns_of.values())]
        for key in columns_of["ours"]
    ]
    print(columns(["figure", "target", *columns_of], rows), end="\n\n")
    publish(figures, options.json)


if __name__ == "__main__":
    main()
