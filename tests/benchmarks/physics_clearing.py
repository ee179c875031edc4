"""How much of a pile goes? Grasp after grasp by flying hands, in physics.

Run: python -m tests.benchmarks.physics_clearing [--n 20 --seed0 1000 --json FILE]

What a hand holds at the end of a flight is taken away, and the rest comes to rest. A
body at which two grasps failed is left where it is. Bodies heavier than 8 kg are not to
be lifted; grasps on them count as tries at what stands in the way.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from debrisgrasp.campaign import wilson
from debrisgrasp.cli.tables import columns
from debrisgrasp.errors import DebrisGraspError
from debrisgrasp.pipeline import Pipeline, PlanningResult
from debrisgrasp.sim import TierScene, Verdict, fly, seen_again, settle, tier_scene
from debrisgrasp.trials import capture_of, intended_of
from debrisgrasp.worlds import World

from .report import begin, publish

TARGET = 0.85
LIFTED = 8.0
TRIES = 2


@dataclass
class Cleared:
    """What became of one pile."""

    seed: int
    masses: dict[str, float]
    removed: list[str] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)
    first_tries: int = 0
    peak_force: float = 0.0
    why_ended: str = ""

    @property
    def removable(self) -> float:
        """Mass that hands may lift [kg]."""
        return sum(mass for mass in self.masses.values() if mass <= LIFTED)

    @property
    def gone(self) -> float:
        """Mass that they did [kg]."""
        return sum(
            mass for name in self.removed if (mass := self.masses[name]) <= LIFTED
        )


def next_plan(
    pipeline: Pipeline, scene: TierScene, tries: Counter[str], seed: int
) -> tuple[PlanningResult, str | None] | None:
    """Plan for the first object in the order that has tries left."""
    seen = pipeline.perceive(capture_of(scene))
    planned = pipeline.plan(seen, seed=seed)
    for label in (None, *(candidate.label for candidate in planned.order)):
        if label is not None:
            planned = pipeline.plan(seen, object_label=label, seed=seed)
        if planned.plan.grasps:
            name = intended_of(scene, planned, planned.plan.object_label)
            if tries[name or ""] < TRIES:
                return planned, name
    return None


def clear(pipeline: Pipeline, seed: int) -> Cleared:
    """Take one thing after another from a pile."""
    scene = tier_scene("pile", seed)
    rng = np.random.default_rng([seed, 99])
    bodies = scene.world.bodies
    found = Cleared(seed, {body.name: body.mass for body in bodies})
    tries: Counter[str] = Counter()
    while scene.world.bodies:
        try:
            step = next_plan(pipeline, scene, tries, seed)
        except DebrisGraspError as error:
            found.why_ended = str(error)[:90]
            break
        if step is None:
            found.why_ended = "no grasp with tries left"
            break
        planned, name = step
        grasp = planned.plan.grasps[0]
        hand = pipeline.grippers[grasp.gripper]
        flight = fly(scene.world, hand, grasp, intended=name)
        found.peak_force = max(found.peak_force, flight.peak_force)
        tries[name or ""] += 1
        is_held = flight.verdict is Verdict.HELD and flight.held is not None
        if is_held:
            found.removed.append(str(flight.held))
            found.first_tries += tries[name or ""] == 1
        else:
            found.failures.append(f"{flight.verdict.value}: {name}")
        world = flight.moments[-1].world if flight.moments else scene.world
        left = tuple(b for b in world.bodies if not is_held or b.name != flight.held)
        if left:
            scene = seen_again(scene, settle(World(left, world.ground)), rng=rng)
        else:
            break
    return found


def main() -> None:
    """Clear piles and print what is left of them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--n", type=int, default=20, help="piles")
    parser.add_argument("--seed0", type=int, default=1000)
    parser.add_argument("--json", type=Path, metavar="FILE")
    chosen = parser.parse_args()
    pipeline, done, rows = Pipeline(robot="roman"), [], []
    for seed in range(chosen.seed0, chosen.seed0 + chosen.n):
        one = clear(pipeline, seed)
        done.append(one)
        lifted = [n for n in one.removed if one.masses[n] <= LIFTED]
        count = sum(mass <= LIFTED for mass in one.masses.values())
        kg = f"{one.gone:.1f}/{one.removable:.1f}"
        end = "; ".join([*one.failures, one.why_ended])
        rows.append([str(seed), f"{len(lifted)}/{count}", kg, end])
        print(json.dumps(rows[-1]), flush=True)
    print(columns(["seed", "removed", "kg", "failures"], rows) + "\n")
    total = sum(sum(m <= LIFTED for m in one.masses.values()) for one in done)
    removed = sum(sum(one.masses[n] <= LIFTED for n in one.removed) for one in done)
    low, high = wilson(removed, total)
    mass = sum(one.gone for one in done) / max(sum(o.removable for o in done), 1e-9)
    figures = {
        "piles": len(done),
        "mass_removed": mass,
        "mass_target": TARGET,
        "objects": total,
        "objects_removed": removed / max(total, 1),
        "objects_low": low,
        "objects_high": high,
        "of_first_tries": sum(one.first_tries for one in done),
        "peak_force_max": max(one.peak_force for one in done),
    }
    publish(figures, chosen.json)


if __name__ == "__main__":
    begin(main)
