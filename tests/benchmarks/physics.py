"""Does the first grasp of a plan hold? Flying hands in scenes settled by physics.

Run: python -m tests.benchmarks.physics [--tier pile --n 40 --seed0 1000 --json FILE]

Success is the object's centre of mass 15 cm up after 2 s, or the object pulled clear
(`..._held` counts the former alone). The scenes of a tier are fixed by their seeds;
figures are only worth something on seeds nobody tuned on.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from functools import lru_cache
from pathlib import Path

import numpy as np

from debrisgrasp.campaign import grouped, save_flight, wilson
from debrisgrasp.cli.campaign_text import flights_text
from debrisgrasp.pipeline import Pipeline
from debrisgrasp.sim import TIERS
from debrisgrasp.trials import TrialRecord, TrialSpec, pipeline_of, trials

from .report import begin, publish

TARGETS = {
    "pile": 0.90, "stacked": 0.95, "isolated": 0.95, "handle": 0.98, "encumbered": 0.85,
}  # fmt: skip


@lru_cache(maxsize=2)
def planner(robot: str, order: str) -> Pipeline:
    """One planner for each process."""
    return pipeline_of(TrialSpec(tier="pile", seed=0, robot=robot, order=order))


Job = tuple[TrialSpec, tuple[int, ...], Path | None]


def tried(job: Job) -> list[TrialRecord]:
    """Fly grasps of one plan; draw those that fail if a folder is given."""
    spec, ranks, folder = job
    done = trials(spec, planner(spec.robot, spec.order), ranks=ranks)
    for one in done:
        if folder is not None and not one.record.is_success:
            rank = f"_{one.record.rank}" if one.record.rank else ""
            name = f"{spec.tier}_{spec.seed}{rank}_{one.record.outcome}.png"
            save_flight(folder / name, one)
    return [one.record for one in done]


def kept(records: Iterable[list[TrialRecord]], path: Path | None) -> list[TrialRecord]:
    """Collect records, and write each to a file as it comes."""
    found = []
    with ExitStack() as stack:
        file = None if path is None else stack.enter_context(path.open("w"))
        for some in records:
            found += some
            if file is not None:
                file.writelines(json.dumps(r.as_dict()) + "\n" for r in some)
                file.flush()
    return found


def shares(records: list[TrialRecord]) -> dict[str, float]:
    """Share of successes in each tier, with its interval, and what it is to be."""
    figures: dict[str, float] = {}
    for tier in dict.fromkeys(record.tier for record in records):
        group = [record for record in records if record.tier == tier]
        good = sum(record.is_success for record in group)
        figures[tier] = good / len(group)
        figures[f"{tier}_n"] = len(group)
        figures[f"{tier}_held"] = sum(record.is_held for record in group) / len(group)
        figures[f"{tier}_low"], figures[f"{tier}_high"] = wilson(good, len(group))
        if tier in TARGETS:
            figures[f"{tier}_target"] = TARGETS[tier]
    return figures


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--tier", action="append", choices=list(TIERS))
    parser.add_argument("--n", type=int, default=20, help="scenes of each tier")
    parser.add_argument("--seed0", type=int, default=1000)
    parser.add_argument("--robot", default="roman")
    parser.add_argument("--order", default="support_aware")
    parser.add_argument("--reactive", action="store_true", help="yielding lift")
    parser.add_argument(
        "--ranks", type=int, nargs="+", default=[0], help="which grasps of each plan"
    )
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--failures", type=Path, metavar="DIR", help="pictures")
    parser.add_argument("--records", type=Path, metavar="FILE", help="JSON lines")
    parser.add_argument("--json", type=Path, metavar="FILE")
    return parser.parse_args()


def main() -> None:
    """Run the trials and print the tables."""
    chosen = options()
    jobs = [
        (
            TrialSpec(
                tier=tier,
                seed=seed,
                robot=chosen.robot,
                order=chosen.order,
                is_lift_reactive=chosen.reactive,
            ),
            tuple(chosen.ranks),
            chosen.failures,
        )
        for tier in chosen.tier or list(TARGETS)
        for seed in range(chosen.seed0, chosen.seed0 + chosen.n)
    ]
    if chosen.failures is not None:
        chosen.failures.mkdir(parents=True, exist_ok=True)
    if chosen.workers > 1:
        with ProcessPoolExecutor(chosen.workers) as pool:
            records = kept(pool.map(tried, jobs), chosen.records)
    else:
        records = kept(map(tried, jobs), chosen.records)
    print(flights_text(grouped(records)) + "\n")
    figures = shares(records)
    flown = [record for record in records if record.prototype]
    if flown:
        figures["flight_seconds_mean"] = np.mean([r.flight_seconds for r in flown])
        figures["through"] = sum(r.is_through for r in flown)
        figures["as_intended"] = np.mean([r.is_as_intended for r in flown])
        figures["peak_force_max"] = max(r.peak_force for r in flown)
    figures["plan_seconds_mean"] = np.mean([r.plan_seconds for r in records])
    publish(figures, chosen.json)


if __name__ == "__main__":
    begin(main)
