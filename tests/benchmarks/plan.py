"""Planning from loaded arrays to ranked grasps: time, memory, and what comes out.

Run: python -m tests.benchmarks.plan [--json FILE]

Each time is the median of three runs. Beside it stands the CPU time of the thread: on a
machine that has other work the first says little.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TypeVar

import numpy as np

import debrisgrasp
from debrisgrasp.cli.tables import columns
from debrisgrasp.geometry import SE3, DepthSight
from debrisgrasp.io import data_path
from debrisgrasp.planning import (
    GraspScene,
    PlannerConfig,
    SceneConfig,
    SimilarityConfig,
)
from debrisgrasp.planning.clearance import ClearanceConfig, HandClearance
from debrisgrasp.planning.hands import PackedHands
from debrisgrasp.planning.proposals import Anchors, GlobalMove
from debrisgrasp.planning.similarity import ShapeSimilarity
from debrisgrasp.planning.surfaces import VisibleSurfaces
from debrisgrasp.prototypes import PrototypeLibrary
from debrisgrasp.segmentation import region_of_interest

from .report import arguments, publish

T = TypeVar("T")

PILES = Path(__file__).parents[3] / "shared" / "data" / "piles"
REAL = PILES.with_name("real")
LOOKING_DOWN = SE3.from_parts([[0, -1, 0], [-1, 0, 0], [0, 0, -1]], [1.0, 0.0, 0.9])
AHEAD = 0.95
"""Where the middle of what a real camera saw is put before the robot [m]."""
DEADLINE = 0.1
TARGETS = {
    "seconds_median": "0.5 or less",
    "seconds_warm": "0.15 or less",
    "deadline_without_grasp": "0",
    "poses_per_second_S": "500000 or more",
    "poses_per_second_SC": "200000 or more",
    "executable_share": "1",
    "peak_mb": "500 or less",
}


def files() -> list[Path]:
    return sorted(PILES.glob("*.npz")) or [data_path("captures", "pile.npz")]


def captures() -> Iterator[debrisgrasp.Capture]:
    """One after another: a user has one at a time in memory."""
    for path in files():
        yield debrisgrasp.Capture.load(path)


def real_captures() -> Iterator[debrisgrasp.Capture]:
    """Those of real cameras, moved in the plane so that they lie before the robot."""
    for path in sorted(REAL.glob("*.npz")):
        capture = debrisgrasp.Capture.load(path)
        T = capture.T_base_camera or capture.T_level_camera or LOOKING_DOWN
        middle = np.median(capture.posed(T).cloud().points, axis=0)
        shift = SE3.from_parts(p=[AHEAD - middle[0], -middle[1], 0.0])
        yield capture.posed(shift @ T)


def timed(work: Callable[[], T]) -> tuple[T, float, float]:
    """Result of some work, and medians of three runs: time, CPU time of the thread."""
    times, done = [], None
    for _ in range(3):
        done = None  # nobody holds two results
        begin, spent = time.perf_counter(), time.thread_time()
        done = work()
        times.append((time.perf_counter() - begin, time.thread_time() - spent))
    seconds, cpu = np.median(times, axis=0).tolist()
    assert done is not None
    return done, seconds, cpu


def start_seconds(work: str) -> float:
    """Least CPU seconds that a fresh interpreter takes for some work."""
    code = f"import time, debrisgrasp; {work}; print(time.process_time())"
    runs = [
        float(subprocess.run([sys.executable, "-c", code], capture_output=True).stdout)
        for _ in range(5)
    ]
    return min(runs)


def evaluations_per_second(capture: debrisgrasp.Capture) -> tuple[float, float]:
    """Poses a second in S alone, and in S and C, on proposals of the search."""
    cloud, segmentation = capture.cloud(), debrisgrasp.segment(capture)
    label = debrisgrasp.select(capture, segmentation)[0].label
    library = PrototypeLibrary.load().select(kind="generic")
    packed = library.packed()
    assert capture.depth is not None
    assert capture.intrinsics is not None
    assert capture.T_base_camera is not None
    depth = capture.depth.astype(np.float32)
    scene = GraspScene.build(
        cloud,
        segmentation.labels == label,
        region_of_interest(cloud.points[segmentation.labels == label]),
        DepthSight(depth, capture.intrinsics, capture.T_base_camera),
        SceneConfig(),
    )
    surfaces = VisibleSurfaces.pack(packed, PlannerConfig().search_points)
    similarity = ShapeSimilarity(scene, surfaces, SimilarityConfig())
    hands = PackedHands.pack(library, approach=0.12, tolerance=0.004)
    clearance = HandClearance(scene, hands, ClearanceConfig())
    which = np.repeat(np.arange(len(library)), 40)
    Ts = GlobalMove(scene, Anchors.of(packed)).sample(which, np.random.default_rng(0))
    rates = []
    for with_clearance in (False, True):
        begin = time.perf_counter()
        for _ in range(10):
            similarity(Ts, which)
            if with_clearance:
                clearance(Ts, which, np.zeros(len(Ts)))
        rates.append(10 * len(Ts) / (time.perf_counter() - begin))
    return rates[0], rates[1]


def main() -> None:
    options = arguments(__doc__ or "")
    pipeline = debrisgrasp.Pipeline(robot="roman")
    n_piles, first = len(files()), next(captures())
    pipeline.plan(first)  # builds the arms' maps, once per process
    rows, seconds, again, offered, executable = [], [], [], 0, 0
    cpu_first, cpu_again, hurried, hurried_share = [], [], [], []
    for capture in chain(captures(), real_captures()):
        result, *first_time = timed(lambda c=capture: pipeline.plan(replace(c)))
        plan = result.plan
        del result  # with all that it was made from
        seconds.append(first_time[0])
        cpu_first.append(first_time[1])
        seen = pipeline.perceive(capture)
        pipeline.plan(seen)
        _, *second_time = timed(lambda s=seen: pipeline.plan(s, seed=1))
        again.append(second_time[0])
        cpu_again.append(second_time[1])
        quick, *hurry = timed(lambda s=seen: pipeline.plan(s, deadline=DEADLINE))
        hurried.append(hurry[0])
        scores = [p.grasps[0].score if p.grasps else 0.0 for p in (quick.plan, plan)]
        if plan.grasps:
            hurried_share.append(scores[0] / max(scores[1], 1e-9))
        offered += len(plan.grasps)
        executable += sum(g.joints is not None for g in plan.grasps)
        tried = len(plan.passed_over) + bool(plan.grasps)
        best = plan.grasps[0] if plan.grasps else None
        rows.append(
            [
                capture.name,
                str(tried),
                str(len(plan.grasps)),
                f"{best.Q:.2f}" if best else "-",
                best.prototype if best else "-",
                f"{seconds[-1]:.2f}",
            ]
        )
        del capture, seen, quick, plan, best
    print(columns(["capture", "tried", "grasps", "best Q", "prototype", "s"], rows))
    print()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    in_S, in_SC = evaluations_per_second(first)
    figures = {
        "seconds_median": float(np.median(seconds)),
        "cpu_seconds_median": float(np.median(cpu_first)),
        "seconds_max": float(np.max(seconds)),
        "seconds_warm": float(np.median(again)),
        "cpu_seconds_warm": float(np.median(cpu_again)),
        "seconds_deadline": float(np.median(hurried)),
        "deadline_best_share": float(np.median(hurried_share)),
        "deadline_without_grasp": float(hurried_share.count(0.0)),
        "seconds_median_piles": float(np.median(seconds[:n_piles])),
        "seconds_warm_piles": float(np.median(again[:n_piles])),
        "poses_per_second_S": in_S,
        "poses_per_second_SC": in_SC,
        "executable_share": executable / max(offered, 1),
        "grasps_min": float(min(int(row[2]) for row in rows)),
        "import_cpu_seconds": start_seconds("debrisgrasp.Pipeline"),
        "start_cpu_seconds": start_seconds("debrisgrasp.Pipeline()"),
        "peak_mb": peak,
    }
    targets = [[k, t, f"{figures[k]:.4g}"] for k, t in TARGETS.items()]
    print(columns(["target", "wanted", "measured"], targets) + "\n")
    publish(figures, options.json)


if __name__ == "__main__":
    main()
