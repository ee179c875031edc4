"""How good the search is: against a long run, and over seeds.

``python -m tests.benchmarks.plan_quality [--json FILE]``

- the best score of a usual search against that of one with twenty times the work, and
  its spread over seeds, on the piles of `plan` (scores as the list is sorted by);
- how the time grows with points, prototypes and hands, as an exponent: 1 is linear;
- the same poses scored by nearest neighbours from a KD-tree.

Times are CPU times of one thread.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

import debrisgrasp
from debrisgrasp._stopwatch import Stopwatch
from debrisgrasp.cli.tables import columns
from debrisgrasp.pipeline import Perception, PipelineConfig, choose_targets
from debrisgrasp.planning import (
    GraspPlanner,
    GraspScene,
    PlannerConfig,
    SceneConfig,
    Schedule,
)
from debrisgrasp.planning.proposals import Anchors, GlobalMove
from debrisgrasp.planning.similarity import ShapeSimilarity
from debrisgrasp.planning.surfaces import VisibleSurfaces
from debrisgrasp.prototypes import PrototypeLibrary

from .plan import captures
from .report import arguments, publish

SEEDS = 20
LONG_SEEDS = 2
LONG = PlannerConfig(
    starts=960,
    walkers=160,
    schedule=Schedule(sweeps=48),
    max_refined=960,
    exchanged=240,
    refined=(400, 40),
    refinement_sweeps=24,
    refinement_steps=640,
    max_ranked=400,
)
"""Twenty times the moves."""
TARGETS = {
    "best_of_long_worst": "0.98 or more",
    "spread_worst": "0.03 or less",
    "exponent_points": "1 or less",
    "exponent_prototypes": "1 or less",
}
DEFAULT = PlannerConfig()


@dataclass(frozen=True)
class Task:
    """One object of one capture, ready to be searched."""

    name: str
    seen: Perception
    scene: GraspScene


def tasks(pipeline: debrisgrasp.Pipeline) -> list[Task]:
    """The object that the pipeline plans on, of every capture."""
    found = []
    for capture in captures():
        seen = pipeline.perceive(capture)
        label = pipeline.plan(seen).plan.object_label
        targets = choose_targets(
            seen.cloud,
            seen.segmentation,
            seen.order(pipeline.policy),
            region=None,
            object_label=label or None,
            is_marked=None,
            margin=pipeline.config.region_margin,
        )
        scene = seen.scene(next(iter(targets)))
        found.append(Task(capture.name, seen, scene))
    return found


def planner_of(pipeline: debrisgrasp.Pipeline, config: PlannerConfig) -> GraspPlanner:
    return GraspPlanner(pipeline.library.select(kind="generic"), config)


def searched(
    planner: GraspPlanner, pipeline: debrisgrasp.Pipeline, task: Task, seed: int
) -> tuple[float, float]:
    """Best score of a search, and its CPU seconds."""
    start = time.thread_time()
    found = planner.plan(
        task.scene,
        pipeline.arms,
        task.seen.obstacles,
        rng=np.random.default_rng(seed),
        watch=Stopwatch(None, lambda _stage, _share: None),
    )
    spent = time.thread_time() - start
    return max((grasp.score for grasp in found.grasps), default=0.0), spent


def search_figures(
    pipeline: debrisgrasp.Pipeline, found: list[Task], seeds: int = SEEDS
) -> dict[str, float]:
    """Usual searches against long ones, and over seeds."""
    usual, long = planner_of(pipeline, DEFAULT), planner_of(pipeline, LONG)
    rows, of_long, spreads, seconds = [], [], [], []
    for task in found:
        runs = np.array([searched(usual, pipeline, task, s) for s in range(seeds)])
        best = max(
            searched(long, pipeline, task, 100 + s)[0] for s in range(LONG_SEEDS)
        )
        best = max(best, runs[:, 0].max())
        mean = runs[:, 0].mean()
        of_long.append(mean / max(best, 1e-9))
        spreads.append(runs[:, 0].std() / max(mean, 1e-9))
        seconds.append(float(np.median(runs[:, 1])))
        rows.append(
            [
                task.name,
                f"{mean:.3f}",
                f"{best:.3f}",
                f"{of_long[-1]:.3f}",
                f"{spreads[-1]:.3f}",
                f"{seconds[-1]:.2f}",
            ]
        )
    header = ["capture", "mean best", "long run", "share", "spread", "CPU s"]
    print(columns(header, rows) + "\n")
    return {
        "best_of_long": float(np.median(of_long)),
        "best_of_long_worst": min(of_long),
        "spread": float(np.median(spreads)),
        "spread_worst": max(spreads),
        "search_cpu_s": float(np.median(seconds)),
    }


def growth(sizes: list[float], seconds: list[float]) -> float:
    """Exponent with which the time grows."""
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])


def scaling_figures(
    pipeline: debrisgrasp.Pipeline, found: list[Task]
) -> dict[str, float]:
    """Search time against prototypes, hands and points."""
    task, library = found[0], pipeline.library.select(kind="generic")
    names = [prototype.name for prototype in library]
    order = np.random.default_rng(0).permutation(len(names))

    def seconds(planner: GraspPlanner, task: Task) -> float:
        return min(searched(planner, pipeline, task, s)[1] for s in range(3))

    counts = [len(names) // 4, len(names) // 2, len(names)]
    by_count = [
        seconds(
            GraspPlanner(library.select(names=[names[i] for i in order[:n]]), DEFAULT),
            task,
        )
        for n in counts
    ]
    hands = sorted({prototype.gripper for prototype in library})
    by_hand = [seconds(GraspPlanner(library.select(gripper=hands[0]), DEFAULT), task)]
    by_hand.append(by_count[-1])
    n_hand = len(library.select(gripper=hands[0]))
    sizes, by_points = [], []
    for spacing in (0.016, 0.0125, 0.01, 0.008):
        scene_config = SceneConfig(spacing=spacing)
        rough = replace(DEFAULT, scene=scene_config)
        seen = debrisgrasp.Pipeline(config=PipelineConfig(planner=rough))
        again = seen.perceive(task.seen.capture)
        targets = choose_targets(
            again.cloud,
            again.segmentation,
            again.order(pipeline.policy),
            region=task.scene.region,
            object_label=None,
            is_marked=None,
            margin=0.0,
        )
        scene = again.scene(next(iter(targets)))
        sizes.append(len(scene.cloud))
        by_points.append(
            seconds(planner_of(pipeline, rough), Task("", again, scene)),
        )
    rows = [
        *(
            [f"{n} prototypes", f"{s:.3f}"]
            for n, s in zip(counts, by_count, strict=True)
        ),
        [f"1 hand, {n_hand} prototypes", f"{by_hand[0]:.3f}"],
        [f"{len(hands)} hands, {len(names)} prototypes", f"{by_hand[1]:.3f}"],
        *([f"{n} points", f"{s:.3f}"] for n, s in zip(sizes, by_points, strict=True)),
    ]
    print(columns(["size", "CPU s"], rows) + "\n")
    return {
        "exponent_prototypes": growth(counts, by_count),
        "exponent_hands": growth([n_hand, len(names)], by_hand),
        "exponent_points": growth(sizes, by_points),
    }


def tree_figures(task: Task, n_poses: int = 4000) -> dict[str, float]:
    """S by the look-up field, and by a KD-tree of the same points."""
    library = PrototypeLibrary.load().select(kind="generic")
    packed = library.packed()
    surfaces = VisibleSurfaces.pack(packed, DEFAULT.search_points)
    similarity = ShapeSimilarity(task.scene, surfaces, DEFAULT.similarity)
    rng = np.random.default_rng(0)
    which = rng.integers(len(library), size=n_poses)
    Ts = GlobalMove(task.scene, Anchors.of(packed)).sample(which, rng)
    cloud, config = task.scene.cloud, DEFAULT.similarity
    tree = cKDTree(cloud.points)

    def by_tree() -> np.ndarray:
        R, t = Ts[:, :3, :3].astype(np.float32), Ts[:, :3, 3].astype(np.float32)
        row = surfaces.rows(R, t, which, cloud.viewpoint)
        shape = surfaces.surface[row]
        points = (R @ shape[:, :3] + t[..., None]).swapaxes(1, 2)
        normals = (R @ shape[:, 3:6]).swapaxes(1, 2)
        distance, index = tree.query(points, distance_upper_bound=0.05)
        index = np.minimum(index, len(cloud) - 1)
        distance = np.minimum(distance, 0.05)
        cosine = (normals * cloud.normals[index]).sum(axis=-1)
        exponent = -0.5 * (distance / config.sigma) ** 2
        exponent -= (1.0 - cosine) / config.normal_sigma**2
        value = np.exp(exponent) * task.scene.is_target[index]
        return (value * surfaces.is_used[row]).sum(axis=1)

    spent = {}
    for name, call in (("field", lambda: similarity(Ts, which)), ("tree", by_tree)):
        call()
        times = []
        for _ in range(5):
            start = time.thread_time()
            call()
            times.append(time.thread_time() - start)
        spent[name] = 1e6 * min(times) / n_poses
    print(
        columns(["S of the same poses by", "us a pose"], list(map(list, _shown(spent))))
        + "\n"
    )
    return {
        "us_pose_field": spent["field"],
        "us_pose_tree": spent["tree"],
        "tree_over_field": spent["tree"] / spent["field"],
    }


def _shown(spent: dict[str, float]) -> list[tuple[str, str]]:
    return [(name, f"{value:.2f}") for name, value in spent.items()]


def main() -> None:
    options = arguments((__doc__ or "").splitlines()[0])
    pipeline = debrisgrasp.Pipeline(robot="roman")
    found = tasks(pipeline)
    figures = search_figures(pipeline, found)
    figures |= scaling_figures(pipeline, found)
    figures |= tree_figures(found[0])
    targets = [[k, t, f"{figures[k]:.4g}"] for k, t in TARGETS.items()]
    print(columns(["target", "wanted", "measured"], targets) + "\n")
    publish(figures, options.json)


if __name__ == "__main__":
    main()
