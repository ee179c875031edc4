"""A dictionary learned from trials in physics beside the one made by hand.

``python -m tests.benchmarks.learn [--tier pile] [--n 30] [--held-back 20]
[--records DIR] [--json FILE]``. Trials of one range of seeds are recorded, a dictionary
is learned from them, and both dictionaries are tried on seeds that were held back. No
targets but that the learned one be smaller and no worse.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

from debrisgrasp.errors import InputError
from debrisgrasp.pipeline import Pipeline
from debrisgrasp.trials import TrialSpec, run_trial, trial
from debrisgrasp.workbench import (
    GraspRecord,
    LearnConfig,
    learn,
    recorded,
    save_records,
)

from .report import publish


def experience(tier: str, seeds: range, pipeline: Pipeline) -> list[GraspRecord]:
    """Records of the first grasps of trials."""
    records = []
    for seed in seeds:
        found = trial(TrialSpec(tier=tier, seed=seed), pipeline)
        if found.grasp is None:
            continue
        planned = found.planned
        is_object = planned.segmentation.labels == found.grasp.object_label
        try:
            records.append(
                recorded(
                    planned.cloud,
                    is_object,
                    found.grasp,
                    pipeline.grippers[found.grasp.gripper],
                    held=found.record.is_held,
                    source=f"{tier}_{seed}",
                )
            )
        except InputError:
            continue  # hardly anything of the object was seen where it was gripped
    return records


def held(tier: str, seeds: range, pipeline: Pipeline) -> tuple[int, int]:
    """How many trials held, and how many had a grasp."""
    outcomes = [run_trial(TrialSpec(tier=tier, seed=s), pipeline) for s in seeds]
    return sum(r.is_held for r in outcomes), sum(bool(r.n_grasps) for r in outcomes)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tier", default="pile")
    parser.add_argument("--n", type=int, default=30)
    parser.add_argument("--held-back", type=int, default=20)
    parser.add_argument("--seed0", type=int, default=500_000)
    parser.add_argument("--radius", type=float, default=LearnConfig().radius)
    parser.add_argument("--records", type=Path)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    by_hand = Pipeline()
    train = range(arguments.seed0, arguments.seed0 + arguments.n)
    rest = range(train.stop, train.stop + arguments.held_back)
    records = experience(arguments.tier, train, by_hand)
    if arguments.records:
        save_records(records, arguments.records)
    config = LearnConfig(radius=arguments.radius)
    try:
        learned = learn(records, by_hand.grippers, config)
    except InputError as error:
        parser.exit(1, f"{error} Take a larger --n.\n")
    with TemporaryDirectory() as folder:
        learned.library.save(folder)
        ours = held(arguments.tier, rest, Pipeline(prototypes=folder))
    theirs = held(arguments.tier, rest, by_hand)
    figures = {
        "recorded": float(len(records)),
        "recorded_held": float(sum(r.held for r in records)),
        "prototypes_by_hand": float(len(by_hand.library.select(kind="generic"))),
        "prototypes_learned": float(len(learned.library)),
        "covered": learned.covered,
        "held_back": float(len(rest)),
        "held_by_hand": theirs[0] / len(rest),
        "held_learned": ours[0] / len(rest),
        "planned_by_hand": theirs[1] / len(rest),
        "planned_learned": ours[1] / len(rest),
    }
    publish(figures, arguments.json)


if __name__ == "__main__":
    main()
