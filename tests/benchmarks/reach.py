"""Reachability: in the search or after it, collision of postures, maps, placements.

``python -m tests.benchmarks.reach [--json FILE]``. Times are CPU times of one thread,
the least of several repeats. The arms of example-robot-data are measured if it is
installed.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import numpy as np
import pinocchio as pin

import debrisgrasp
from debrisgrasp.cli.tables import columns
from debrisgrasp.geometry import SE3, Bounds
from debrisgrasp.kinematics import (
    ArmCollision,
    ArmReach,
    ReachMap,
    RobotModel,
    base_placements,
    grid_places,
    load_reach_map,
    palm_poses,
    save_reach_map,
    survey_reach,
)
from debrisgrasp.kinematics.body import RobotBody
from debrisgrasp.kinematics.survey import APPROACHES
from debrisgrasp.pipeline import PipelineConfig
from debrisgrasp.planning import Grasp, PlannerConfig
from tests.benchmarks.plan import captures
from tests.benchmarks.report import arguments, publish
from tests.unit.kinematics.example_robots import PANDA, UR10, load
from tests.unit.kinematics.robots import ROMAN_URDF

N_POSTURES = 100_000
N_TIMED = 8192
TARGETS = {
    "collision_misses_roman": "0",
    "executable_share_search": "1",
    "seconds_search_over_after": "1 or less",
    "map_mb": "10 or less",
}


def cpu(call: Callable[[], object], repeats: int = 3) -> float:
    """Least CPU seconds of several runs."""
    spent = []
    for _ in range(repeats):
        start = time.thread_time()
        call()
        spent.append(time.thread_time() - start)
    return min(spent)


def pinocchio_hits(collision: ArmCollision, q: np.ndarray) -> np.ndarray:
    """Self-collision of RoMan by pinocchio, over every pair that the robot has."""
    robot = RobotModel.load("roman")
    every = RobotBody.fit(robot, "right", collision.body.chain)
    links = {
        frozenset((every.parts[i].link, every.parts[j].link)) for i, j in every.pairs
    }
    model = pin.buildModelFromUrdf(str(ROMAN_URDF))
    geometry = pin.buildGeomFromUrdf(model, str(ROMAN_URDF), pin.GeometryType.COLLISION)
    objects = geometry.geometryObjects
    names = [model.frames[o.parentFrame].name for o in objects]
    for i in range(len(objects)):
        for j in range(i):
            if frozenset((names[i], names[j])) in links:
                geometry.addCollisionPair(pin.CollisionPair(j, i))
    where = [
        model.joints[model.getJointId(n)].idx_q
        for n in collision.body.chain.joint_names
    ]
    configuration = pin.neutral(model)
    for name, value in robot.joint_values().items():
        if model.existJointName(name):
            configuration[model.joints[model.getJointId(name)].idx_q] = value
    data, geometry_data = model.createData(), geometry.createData()
    hits = np.zeros(len(q), dtype=bool)
    for i, row in enumerate(q):
        configuration[where] = row
        hits[i] = pin.computeCollisions(
            model,
            data,
            geometry,
            geometry_data,
            configuration,
            True,  # noqa: FBT003
        )
    return hits


def collision_figures() -> dict[str, float]:
    robots = [("roman", "right", RobotModel.load("roman"))]
    with tempfile.TemporaryDirectory() as folder:
        for name, arm in (("panda", PANDA), ("ur10", UR10)):
            robot = load(arm, Path(folder))
            robots += [(name, "arm", robot)] if robot is not None else []
    figures = {}
    rng = np.random.default_rng(7)
    for name, arm_name, robot in robots:
        collision = ArmCollision.fit(robot, arm_name)
        q = collision.body.chain.sampled(N_POSTURES, rng=rng)
        may, hits = collision.may_hit_itself(q), collision.hits_itself(q)
        if name == "roman":
            exact = pinocchio_hits(collision, q)
            figures["collision_misses_roman"] = float((exact & ~may).sum())
            figures["collision_disagreements_roman"] = float((exact != hits).sum())
        figures |= {
            f"collision_missed_by_spheres_{name}": float((hits & ~may).sum()),
            f"collision_share_{name}": float(hits.mean()),
            f"false_alarms_of_free_{name}": float((may & ~hits).sum() / (~hits).sum()),
        }
        tests = {
            "spheres": collision.may_hit_itself,
            "is_free": collision.is_free,
            "clearance": collision.clearance,
        }
        for kind, test in tests.items():
            seconds = cpu(partial(test, q[:N_TIMED]))
            figures[f"us_{kind}_{name}"] = 1e6 * seconds / N_TIMED
    return figures


def map_figures() -> dict[str, float]:
    arm = ArmReach(RobotModel.load("roman"), "right")
    built = ReachMap.build(arm.chain)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.npz"
        save_reach_map(built, path)
        megabytes = path.stat().st_size / 1e6
        load_ms = 1e3 * cpu(lambda: load_reach_map(path, arm.chain))
    return {
        "map_build_s": cpu(lambda: ReachMap.build(arm.chain)),
        "map_load_ms": load_ms,
        "map_mb": megabytes,
    }


def survey_figures() -> dict[str, float]:
    robot = RobotModel.load("roman")
    arms = [ArmReach(robot, name) for name in robot.arms]
    places = grid_places(
        Bounds(np.array([0.7, -0.4, 0]), np.array([1.2, 0.4, 0.7])), 0.1
    )
    rng = np.random.default_rng(1)
    survey_reach(arms[0], places[:4], rng=rng)
    spent = cpu(lambda: survey_reach(arms[0], places, rng=rng), 1)
    directions = np.concatenate([a.directions for a in APPROACHES])
    T = palm_poses(places[::6] + np.array([1.2, 0.4, 0.0]), directions, 0.06).matrix
    poses = SE3(T.reshape(-1, 4, 4))
    found = base_placements(arms, poses, rng=rng)
    here = next(p.share for p in found if p.travel == 0.0)
    return {
        "survey_us_per_direction": 1e6 * spent / (len(places) * len(directions)),
        "placements_s": cpu(lambda: base_placements(arms, poses, rng=rng), 1),
        "placement_best_share": found[0].share,
        "placement_share_here": here,
    }


def strategy_figures() -> dict[str, float]:
    """Reachability in the search against the two steps of the paper."""
    figures, rows, loaded = {}, [], list(captures())
    for strategy in ("search", "after"):
        planner = PlannerConfig(reach=strategy)
        pipeline = debrisgrasp.Pipeline(config=PipelineConfig(planner=planner))
        pipeline.plan(loaded[0])
        plans = [pipeline.plan(capture).plan for capture in loaded]
        spent = [cpu(partial(pipeline.plan, capture), 3) for capture in loaded]
        grasps = [grasp for plan in plans for grasp in plan.grasps]
        refused = sum(
            n
            for plan in plans
            for reason, n in plan.rejections.items()
            if " arm: " in reason
        )
        found = {
            "executable_share": float(np.mean([executable(g) for g in grasps])),
            "modes_executable_share": len(grasps) / (len(grasps) + refused),
            "grasps": len(grasps) / len(plans),
            "seconds": float(np.median(spent)),
            "best_Q": float(
                np.mean([plan.grasps[0].Q for plan in plans if plan.grasps])
            ),
        }
        figures |= {f"{name}_{strategy}": value for name, value in found.items()}
        rows.append([strategy, *(f"{value:.3f}" for value in found.values())])
    header = ["reach in", "executable", "of all modes", "grasps", "CPU s", "best Q"]
    print(columns(header, rows) + "\n")
    ratio = figures["seconds_search"] / figures["seconds_after"]
    return {**figures, "seconds_search_over_after": ratio}


@cache
def arm_named(name: str) -> ArmReach:
    """Return an arm of RoMan, fitted once."""
    return ArmReach(RobotModel.load("roman"), name)


def executable(grasp: Grasp) -> bool:
    """Whether the joints of a grasp lead to its pose and keep the robot off itself."""
    if grasp.arm is None or grasp.joints is None:
        return False
    arm = arm_named(grasp.arm)
    q = arm.chain.vector(grasp.joints)
    gap = np.abs(arm.chain.fk(q).matrix - grasp.T_base_hand.matrix).max()
    is_within = bool(((q >= arm.chain.lower) & (q <= arm.chain.upper)).all())
    return gap < 2e-3 and is_within and not len(arm.collision.self_contacts(q))


def main() -> None:
    options = arguments(__doc__ or "")
    figures = strategy_figures()
    figures |= collision_figures() | map_figures() | survey_figures()
    targets = [[k, t, f"{figures[k]:.4g}"] for k, t in TARGETS.items()]
    print(columns(["target", "wanted", "measured"], targets) + "\n")
    publish(figures, options.json)


if __name__ == "__main__":
    main()
