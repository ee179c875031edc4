"""What each part of the planner is worth, in physics, on the same scenes.

Run: python -m tests.benchmarks.physics_ablation [--variant NAME --tier pile --n 20
     --seed0 1000 --json FILE]

Every variant flies the first grasp of its own plan; a scene counts as gained or lost
where its outcome differs from that of the planner as shipped. What a lift that gives
way is worth, `tests.benchmarks.physics_lift` tells.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from debrisgrasp._arrays import Float32Array
from debrisgrasp._stopwatch import Stopwatch
from debrisgrasp.campaign import wilson
from debrisgrasp.cli.tables import columns
from debrisgrasp.io import Capture
from debrisgrasp.pipeline import Perception, Pipeline, PipelineConfig
from debrisgrasp.planning import ClearanceConfig, PlannerConfig
from debrisgrasp.segmentation import DEFAULT_POINT, PriorityPoint
from debrisgrasp.sim import TIERS, SceneConfig
from debrisgrasp.trials import TrialRecord, TrialSpec, run_trial

from .report import begin, publish

ROUGH = SceneConfig(calibration_shift=0.01, calibration_turn=float(np.radians(3.0)))


class NothingSeen:
    """Lines of sight that tell nothing: all space is unknown."""

    def clearance(
        self, x: Float32Array, y: Float32Array, z: Float32Array
    ) -> Float32Array:
        """NaN for every point."""
        return np.full(np.broadcast_shapes(x.shape, y.shape, z.shape), np.nan, "f4")


class PointsOnly(Pipeline):
    """A planner that forgets through what the camera saw."""

    def _perceive(self, capture: Capture, watch: Stopwatch) -> Perception:
        return replace(super()._perceive(capture, watch), sight=NothingSeen())


def shipped() -> Pipeline:
    return Pipeline()


def by_distance() -> Pipeline:
    return Pipeline(policy=PriorityPoint(np.array(DEFAULT_POINT)))


def arms_after() -> Pipeline:
    return Pipeline(config=PipelineConfig(planner=PlannerConfig(reach="after")))


def points_only() -> Pipeline:
    planner = PlannerConfig(
        clearance=ClearanceConfig(unknown_cost=0.0), minimum_evidence=0.0
    )
    return PointsOnly(config=PipelineConfig(planner=planner))


def any_object() -> Pipeline:
    return Pipeline(config=PipelineConfig(doubtful=0.0))


@dataclass(frozen=True)
class Variant:
    """What is changed, and in which words."""

    said: str
    pipeline: Callable[[], Pipeline] = shipped
    scene: SceneConfig = SceneConfig()


VARIANTS = {
    "shipped": Variant("as shipped"),
    "order": Variant("order by distance (Eq. 1)", by_distance),
    "reach": Variant("R after the search", arms_after),
    "sight": Variant("no seen-through evidence", points_only),
    "object": Variant("the first object, however doubtful", any_object),
    "calibration": Variant("calibration off by 1 cm and 3 degrees", scene=ROUGH),
}


@lru_cache(maxsize=1)
def loaded(name: str) -> Pipeline:
    return VARIANTS[name].pipeline()


def flown(name: str, tier: str, seeds: range) -> list[TrialRecord]:
    """First grasps of a variant."""
    variant = VARIANTS[name]
    specs = [TrialSpec(tier=tier, seed=seed, scene=variant.scene) for seed in seeds]
    return [run_trial(spec, loaded(name)) for spec in specs]


def compared(base: list[TrialRecord], other: list[TrialRecord]) -> list[str]:
    """Share that was held, and what differs scene by scene."""
    pairs = [(a.is_held, b.is_held) for a, b in zip(base, other, strict=True)]
    good, n = sum(b for _, b in pairs), len(pairs)
    low, high = wilson(good, n)
    gained = sum(b and not a for a, b in pairs)
    lost = sum(a and not b for a, b in pairs)
    return [f"{good}/{n}", f"{low:.0%} to {high:.0%}", str(gained), str(lost)]


def main() -> None:
    """Fly the variants and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--variant", action="append", choices=list(VARIANTS)[1:])
    parser.add_argument("--tier", action="append", choices=list(TIERS))
    parser.add_argument("--n", type=int, default=20)
    parser.add_argument("--seed0", type=int, default=1000)
    parser.add_argument("--json", type=Path, metavar="FILE")
    chosen = parser.parse_args()
    seeds = range(chosen.seed0, chosen.seed0 + chosen.n)
    base: dict[str, list[TrialRecord]] = {}
    rows, figures = [], {}
    for name in ["shipped", *(chosen.variant or list(VARIANTS)[1:])]:
        for tier in chosen.tier or ("pile", "encumbered"):
            if tier not in base:
                base[tier] = flown("shipped", tier, seeds)
            records = base[tier] if name == "shipped" else flown(name, tier, seeds)
            cells = compared(base[tier], records)
            rows.append([VARIANTS[name].said, tier, *cells])
            good = sum(record.is_held for record in records)
            figures[f"{name}_{tier}"] = good / len(records)
            print(rows[-1], flush=True)
    header = ["variant", "tier", "held", "95 %", "gained", "lost"]
    print("\n" + columns(header, rows) + "\n")
    publish(figures, chosen.json)


if __name__ == "__main__":
    begin(main)
