"""The whole robot in physics: is it true, how fast, and what does the task do there?

``python -m tests.benchmarks.arm_physics [--tier pile] [--n 10] [--seed0 200000]
[--records FILE] [--json FILE]`` with RoMan. Times are CPU times of the thread. Each run
is told when it ends; the table comes last. With ``--n 0`` no pile is cleared.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from pathlib import Path

import numpy as np

from debrisgrasp.campaign import RunRecord, RunSpec, run_arm
from debrisgrasp.campaign.specs import MARKED
from debrisgrasp.robot import CHECKS, MOVING_CHECKS, FakeConfig, check_robot
from debrisgrasp.sim import TIERS, tier_scene
from debrisgrasp.sim_robot import SimRobot, sim_robot
from debrisgrasp.worlds import World
from tests.benchmarks.report import begin, publish
from tests.unit.robot.rigs import FAR, GRIPPERS, PERIOD, ROMAN

TARGETS = {
    "conformance_problems": "0",
    "removed_mass_share": "0.85 or more, within 2 attempts per object",
    "exceedances": "0: wrenches above the limits of a hand",
    "through_runs": "0: a hand more than 2 mm inside a body",
}
ATTEMPTS_PER_BODY = 2
SWING = np.array([0.3, -0.4, 0.3, 0.5, -0.4, 0.3, 0.5, 0.6])


def made(world: World) -> SimRobot:
    """RoMan before a world, its arms free."""
    config = FakeConfig(start={"left": "ready", "right": "ready"})
    return sim_robot(
        ROMAN, world, rng=np.random.default_rng(0), config=config, grippers=GRIPPERS
    )


def devices() -> dict[str, float]:
    """Conformance, how well joints follow, and what an idle wrist reads."""
    robot = made(World((FAR,)))
    found = check_robot(robot.robot, motion=True)
    figures = {
        "conformance_checks": float(len(CHECKS) + len(MOVING_CHECKS)),
        "conformance_problems": float(len(found.findings)),
    }
    robot = made(World((FAR,)))
    arm, clock = robot.robot.limbs["left"].arm, robot.robot.clock
    arm.engage()
    clock.wait_until(0.2)
    start, errors = np.array(arm.read().q), []
    for k in range(1, 626):
        u = k / 625
        goal = start + u**3 * (10 - 15 * u + 6 * u * u) * SWING
        arm.command(goal.tolist())
        clock.wait_until(clock.now() + PERIOD)
        errors.append(float(np.abs(np.array(arm.read().q) - goal).max()))
    figures["tracking_mrad_rms"] = 1e3 * float(np.sqrt(np.mean(np.square(errors))))
    figures["tracking_mrad_max"] = 1e3 * max(errors)
    loads = [
        np.linalg.norm(limb.loads.load_ee(
            np.mean([_raw(robot, name) for _ in range(250)], axis=0),
            robot.arms[name].pose()[0],
        )[:3])
        for name, limb in robot.robot.limbs.items()
    ]  # fmt: skip
    return figures | {"idle_load_N": float(max(loads))}


def _raw(robot: SimRobot, name: str) -> np.ndarray:
    robot.robot.clock.wait_until(robot.robot.clock.now() + PERIOD)
    return np.asarray(robot.robot.limbs[name].sensor.read().wrench_ft)


def speed() -> dict[str, float]:
    """Simulated over computing time, standing before nothing and before a pile."""
    figures = {}
    for name, world in (
        ("alone", World((FAR,))),
        ("pile", tier_scene("pile", 3).world),
    ):
        clock = made(world).robot.clock
        clock.wait_until(0.2)
        begun = time.thread_time()
        clock.wait_until(2.2)
        figures[f"real_time_factor_{name}"] = 2.0 / (time.thread_time() - begun)
    return figures


def runs(tier: str, n: int, seed0: int) -> list[RunRecord]:
    """Clear the scenes of a tier, one after another."""
    records = []
    for seed in range(seed0, seed0 + n):
        n_bodies = len(tier_scene(tier, seed).world.bodies)
        spec = RunSpec(
            name=f"{tier}_{seed}",
            seed=seed,
            world="mujoco",
            level="arm",
            tier=tier,
            max_attempts=ATTEMPTS_PER_BODY * n_bodies,
        )
        record = run_arm(spec)
        records.append(record)
        facts = record.details
        print(
            f"{record.name}: {record.end}, {facts['removed_kg']:.1f} of "
            f"{facts['removable_kg']:.1f} kg, {facts['robot_seconds']:.0f} s in "
            f"{record.seconds:.0f} s, peak {max(facts['peak_force'].values()):.0f} N, "
            f"faults {', '.join(record.faults) or 'none'}",
            flush=True,
        )
    return records


def figures_of(records: list[RunRecord]) -> dict[str, float]:
    """What came of all runs."""
    facts = [record.details for record in records]
    mass = sum(fact["removable_kg"] for fact in facts)
    checks = Counter[str]()
    for record in records:
        checks.update(record.checks)
    deepest = [max(fact["deepest_mm"].values()) for fact in facts]
    return {
        "runs": len(records),
        "removed_mass_share": sum(f["removed_kg"] for f in facts) / max(mass, 1e-9),
        "removed": sum(record.n_removed for record in records),
        "objects": sum(record.n_objects for record in records),
        "exceedances": checks["wrenches_above_limits"],
        "peak_force_N": max(max(f["peak_force"].values()) for f in facts),
        "commands_outside_limits": checks["commands_outside_limits"],
        "false_cleared": checks["false_cleared"],
        "uncaught": checks["uncaught"],
        "through_runs": sum(depth > 2.0 for depth in deepest),
        "deepest_mm": max(deepest),
        "computing_s_median": float(np.median([r.seconds for r in records])),
        "robot_s_median": float(np.median([f["robot_seconds"] for f in facts])),
    }


def main() -> None:
    """Print the figures beside their targets."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--tier", choices=sorted(set(TIERS) - set(MARKED)), default="pile"
    )
    parser.add_argument("--n", type=int, default=10, help="scenes (default: 10)")
    parser.add_argument("--seed0", type=int, default=200_000)
    parser.add_argument("--records", type=Path, help="every run, as JSON lines")
    parser.add_argument("--json", type=Path, help="figures for machines")
    arguments = parser.parse_args()
    figures = devices() | speed()
    records = runs(arguments.tier, arguments.n, arguments.seed0)
    if records:
        figures |= figures_of(records)
        faults = Counter(
            (fault["state"], fault["fault"])
            for record in records
            for fault in record.details["faults"]
        )
        for (state, fault), count in faults.most_common():
            print(f"{count:4d}  {fault} in {state}")
    if arguments.records is not None:
        lines = [json.dumps(json.loads(record.to_json())) for record in records]
        arguments.records.write_text("".join(line + "\n" for line in lines))
    for name, target in TARGETS.items():
        if name in figures:
            print(f"{name}: {figures[name]:.3g} (target {target})")
    publish(figures, arguments.json)


if __name__ == "__main__":
    begin(main)
