"""Inverse kinematics: time per pose, share solved, map, and other solvers.

``python -m tests.benchmarks.ik [--json FILE]`` on RoMan's right arm (seven joints; with
the torso, ``_torso``, eight), a Panda and whatever else example-robot-data has. Times
are CPU times of one thread, medians; poses are those of random postures, which the
seeds have nothing to do with, and tolerances 1e-4 m and 1e-3 rad. The other solvers
come with the extra ``bench`` and run in the same process.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np

from debrisgrasp.cli.tables import columns
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import (
    ArmReach,
    IkStatus,
    KinematicChain,
    ReachMap,
    RobotModel,
    solve,
)
from debrisgrasp.kinematics.descent import Goals
from debrisgrasp.kinematics.formulas import AxisGoals
from tests.benchmarks.ik_peers import measured_peers
from tests.benchmarks.ik_robots import ARMS
from tests.benchmarks.report import arguments, publish

TARGETS = {
    "us_10000": "6 or less",
    "us_1000": "15 or less",
    "us_100": "50 or less",
    "ms_single_median": "0.2 or less",
    "ms_single_p95": "0.6 or less",
    "solved_10000": "0.999 or more",
    "us_unreachable": "10 or less",
    "false_unreachable_of_1000000": "0",
    "map_build_s": "0.5 or less",
    "map_mb": "10 or less",
    "map_query_us": "0.2 or less",
    "speedup_best_peer": "20 or more",
}
PEERS_ON = ("", "_panda", "_ur10")


def timed(call: Callable[[], object]) -> float:
    start = time.thread_time()
    call()
    return time.thread_time() - start


def measured(chain: KinematicChain, *, seed: int) -> dict[str, float]:
    """Figures of one arm."""
    rng = np.random.default_rng(seed)
    build = min(timed(lambda: ReachMap.build(chain)) for _ in range(3))
    reach_map = ReachMap.build(chain)
    arrays = (reach_map.seeds, reach_map.seed_cell, reach_map.azimuths, reach_map.turns)
    figures = {}
    for n, repeats in ((10_000, 7), (1_000, 21), (100, 51), (1, 1001)):
        seconds, solved = [], []
        for _ in range(repeats):
            T = chain.fk(chain.sampled(n, rng=rng))
            start = time.thread_time()
            found = solve(chain, T, reach_map=reach_map, rng=rng)
            seconds.append(time.thread_time() - start)
            solved.append(found.is_solved.mean())
        # What is compiled when it is first called is no time per pose.
        seconds = seconds[1:]
        figures[f"solved_{n}"] = float(np.mean(solved))
        if n == 1:
            figures["ms_single_median"] = 1e3 * float(np.median(seconds))
            figures["ms_single_p95"] = 1e3 * float(np.quantile(seconds, 0.95))
        else:
            figures[f"us_{n}"] = 1e6 * float(np.median(seconds)) / n
    figures["map_build_s"] = build
    figures["map_mb"] = sum(array.nbytes for array in arrays) / 1e6
    return figures | _unreachable(chain, reach_map, rng)


def _unreachable(
    chain: KinematicChain, reach_map: ReachMap, rng: np.random.Generator
) -> dict[str, float]:
    """Time for poses that the map rules out, and how many it rules out wrongly."""
    R = chain.fk(chain.sampled(20_000, rng=rng)).R
    poses = SE3.from_parts(R, rng.uniform(-1.5, 1.5, (20_000, 3)))
    found = solve(chain, poses, reach_map=reach_map, rng=rng)
    poses = poses[found.status == IkStatus.UNREACHABLE]
    seconds = timed(lambda: solve(chain, poses, reach_map=reach_map, rng=rng))
    wrong, query = 0, []
    for _ in range(20):
        T = chain.fk(chain.sampled(50_000, rng=rng)).matrix
        goals = AxisGoals.from_columns(Goals.from_matrices(chain.form, T).columns)
        query.append(timed(partial(reach_map.admits, goals)))
        wrong += np.count_nonzero(~reach_map.admits(goals))
    return {
        "us_unreachable": 1e6 * seconds / len(poses.matrix),
        "false_unreachable_of_1000000": float(wrong),
        "map_query_us": 1e6 * min(query) / 50_000,
    }


def reach_seconds(seed: int) -> float:
    """Seconds for 200 palm poses with collision tests, half of them reachable."""
    reach = ArmReach(RobotModel.load("roman"), "right")
    rng = np.random.default_rng(seed)
    q = reach.chain.sampled(100, rng=rng)
    T = reach.chain.fk(q).matrix
    far = T.copy()
    far[:, :3, 3] += rng.normal(0, 0.5, (100, 3))
    poses = SE3(np.concatenate([T, far]))

    def above_ground(points: np.ndarray) -> np.ndarray:
        return np.minimum(points[..., 2], 0.1)

    reach.reach(poses, above_ground, rng=rng)
    return min(timed(lambda: reach.reach(poses, above_ground, rng=rng)) for _ in "abc")


def against_peers(figures: dict[str, float], seed: int) -> dict[str, float]:
    """Run the peers, print them beside ours, and return the speed-ups."""
    speedups = {}
    rows = []
    for arm in ARMS:
        if arm.suffix not in PEERS_ON or f"us_10000{arm.suffix}" not in figures:
            continue
        ours = figures[f"us_10000{arm.suffix}"]
        name = arm.suffix.strip("_") or "roman"
        solved = figures[f"solved_10000{arm.suffix}"]
        rows.append([name, "debrisgrasp, 10 000", f"{ours:.1f}", f"{solved:.4f}", "1"])
        best = np.inf
        for peer in measured_peers(arm, arm.chain(), seed=seed):
            ratio = peer.microseconds / ours
            rows.append(
                [
                    name,
                    peer.name,
                    f"{peer.microseconds:.1f}",
                    f"{peer.solved:.4f}",
                    f"{ratio:.0f}",
                ]
            )
            best = np.fmin(best, peer.microseconds)
        if np.isfinite(best):
            speedups[f"speedup_best_peer{arm.suffix}"] = float(best / ours)
    print(columns(["arm", "solver", "us a pose", "solved", "times ours"], rows))
    return speedups


def table(figures: dict[str, float], suffixes: list[str]) -> str:
    """Figures of all arms beside their targets."""
    names = [suffix.strip("_") or "roman" for suffix in suffixes]
    shown = [name for name in figures if f"{name}{suffixes[-1]}" in figures]
    shown += [name for name in TARGETS if name not in shown]
    rows = [
        [
            name,
            TARGETS.get(name, ""),
            *(f"{figures.get(name + suffix, np.nan):.4g}" for suffix in suffixes),
        ]
        for name in dict.fromkeys(shown)
    ]
    return columns(["figure", "target", *names], rows)


def main() -> None:
    options = arguments(__doc__ or "")
    figures: dict[str, float] = {}
    suffixes = []
    for arm in ARMS:
        if arm.path is None:
            print(f"{arm.suffix}: skipped, example-robot-data is not installed")
            continue
        print(f"measuring {arm.suffix.strip('_') or 'roman'} ...", flush=True)
        found = measured(arm.chain(), seed=7)
        figures |= {f"{name}{arm.suffix}": value for name, value in found.items()}
        suffixes.append(arm.suffix)
    figures |= against_peers(figures, seed=7)
    figures["reach_200_poses_s"] = reach_seconds(7)
    print(table(figures, suffixes), end="\n\n")
    publish(figures, options.json)


if __name__ == "__main__":
    main()
