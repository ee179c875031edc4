"""Inverse kinematics: time per pose, share solved, map.

``python -m tests.benchmarks.ik [--json FILE]`` on RoMan's right arm (seven joints; with
the torso, ``_torso``, eight) and on a Panda arm (``_panda``). Times are wall times;
poses are those of random postures, which the seeds have nothing to do with.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import (
    ArmReach,
    IkStatus,
    KinematicChain,
    ReachMap,
    RobotModel,
    solve,
)
from tests.benchmarks.report import arguments, publish
from tests.unit.kinematics.robots import JointText, written

TURN = 0.5 * np.pi
PANDA = (
    JointText(xyz=(0, 0, 0.333), lower=-2.8973, upper=2.8973),
    JointText(xyz=(0, 0, 0), rpy=(-TURN, 0, 0), lower=-1.7628, upper=1.7628),
    JointText(xyz=(0, -0.316, 0), rpy=(TURN, 0, 0), lower=-2.8973, upper=2.8973),
    JointText(xyz=(0.0825, 0, 0), rpy=(TURN, 0, 0), lower=-3.0718, upper=-0.0698),
    JointText(xyz=(-0.0825, 0.384, 0), rpy=(-TURN, 0, 0), lower=-2.8973, upper=2.8973),
    JointText(xyz=(0, 0, 0), rpy=(TURN, 0, 0), lower=-0.0175, upper=3.7525),
    JointText(xyz=(0.088, 0, 0), rpy=(TURN, 0, 0), lower=-2.8973, upper=2.8973),
    JointText("fixed", xyz=(0, 0, 0.107)),
)


def chains() -> dict[str, KinematicChain]:
    """Arms to measure, by the suffix of their figures; the first has none."""
    robot = RobotModel.load("roman")
    with tempfile.TemporaryDirectory() as folder:
        path = written(Path(folder), PANDA)
        panda = KinematicChain.from_urdf(path, "link0", f"link{len(PANDA)}")
    return {
        "": robot.chain("right", {"torso_joint": 0.0}),
        "_torso": robot.chain("right"),
        "_panda": panda,
    }


def timed(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def measured(chain: KinematicChain, *, seed: int) -> dict[str, float]:
    """Figures of one arm."""
    rng = np.random.default_rng(seed)
    build = timed(lambda: ReachMap.build(chain))
    reach_map = ReachMap.build(chain)
    figures = {"map_build_s": build, "map_mb": reach_map.seeds.nbytes / 1e6}
    for n, repeats in ((10_000, 5), (1_000, 10), (100, 30), (1, 300)):
        seconds, solved = [], []
        for _ in range(repeats):
            T = chain.fk(chain.sampled(n, rng=rng))
            start = time.perf_counter()
            found = solve(chain, T, reach_map=reach_map, rng=rng)
            seconds.append(time.perf_counter() - start)
            solved.append(found.is_solved.mean())
        figures[f"solved_{n}"] = float(np.mean(solved))
        if n == 1:
            figures["ms_single_median"] = 1e3 * float(np.median(seconds))
            figures["ms_single_p95"] = 1e3 * float(np.quantile(seconds, 0.95))
        else:
            figures[f"us_{n}"] = 1e6 * float(np.median(seconds)) / n
    figures |= _unreachable(chain, reach_map, rng)
    return figures


def _unreachable(
    chain: KinematicChain, reach_map: ReachMap, rng: np.random.Generator
) -> dict[str, float]:
    """Time for poses that the map rules out, and how many it rules out wrongly."""
    R = chain.fk(chain.sampled(20_000, rng=rng)).R
    poses = SE3.from_parts(R, rng.uniform(-1.5, 1.5, (20_000, 3)))
    found = solve(chain, poses, reach_map=reach_map, rng=rng)
    poses = poses[found.status == IkStatus.UNREACHABLE]
    seconds = timed(lambda: solve(chain, poses, reach_map=reach_map, rng=rng))
    wrong = sum(
        np.count_nonzero(solve_status(chain, reach_map, rng) == IkStatus.UNREACHABLE)
        for _ in range(10)
    )
    return {
        "us_unreachable": 1e6 * seconds / len(poses.matrix),
        "false_unreachable_of_100000": float(wrong),
    }


def solve_status(
    chain: KinematicChain, reach_map: ReachMap, rng: np.random.Generator
) -> np.ndarray:
    """Status of ten thousand poses that are reachable."""
    T = chain.fk(chain.sampled(10_000, rng=rng))
    return solve(chain, T, reach_map=reach_map, rng=rng).status


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


def main() -> None:
    options = arguments(__doc__ or "")
    figures = {
        f"{name}{suffix}": value
        for suffix, chain in chains().items()
        for name, value in measured(chain, seed=7).items()
    }
    figures["reach_200_poses_s"] = reach_seconds(7)
    publish(figures, options.json)


if __name__ == "__main__":
    main()
