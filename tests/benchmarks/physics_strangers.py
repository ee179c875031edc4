"""Does the first grasp hold of things that nothing was made for? (`strangers`)

Run: python -m tests.benchmarks.physics_strangers [--n 100 --seed0 5000 --json FILE]
                                                  [--learnt] [--ranks 0] [--records F]

One thing of a kind kept aside, and three to eight of them, in settled scenes that are
seen and flown as those of the tiers. Kinds of ``--learnt`` are for fitting and mending.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

from debrisgrasp.campaign import grouped, save_flight
from debrisgrasp.cli.campaign_text import flights_text
from debrisgrasp.trials import TrialRecord, TrialSpec, trials

from .physics import kept, planner, shares
from .report import begin, publish
from .strangers import LEARNT, UNKNOWN, stranger_scene

SIZES = {"one": (1, 1), "several": (3, 8)}


def tried(
    job: tuple[str, int],
    *,
    is_learnt: bool,
    ranks: tuple[int, ...],
    folder: Path | None,
) -> list[TrialRecord]:
    """Fly grasps of one plan; draw the first if it fails and a folder is given."""
    size, seed = job
    kinds = LEARNT if is_learnt else UNKNOWN
    scene = stranger_scene(seed, kinds, SIZES[size], size)
    spec = TrialSpec(tier=size, seed=seed)
    done = trials(spec, planner(spec.robot, spec.order), ranks=ranks, scene=scene)
    first = done[0]
    if folder is not None and not first.record.is_success:
        kind, outcome = first.record.kind, first.record.outcome
        save_flight(folder / f"{size}_{seed}_{kind}_{outcome}.png", first)
    return [one.record for one in done]


def main() -> None:
    """Run the trials and print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--n", type=int, default=20, help="scenes of each size")
    parser.add_argument("--seed0", type=int, default=1000)
    parser.add_argument("--learnt", action="store_true", help="the other kinds")
    parser.add_argument("--ranks", type=int, nargs="+", default=[0])
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--failures", type=Path, metavar="DIR", help="pictures")
    parser.add_argument("--records", type=Path, metavar="FILE", help="JSON lines")
    parser.add_argument("--json", type=Path, metavar="FILE")
    chosen = parser.parse_args()
    if chosen.failures is not None:
        chosen.failures.mkdir(parents=True, exist_ok=True)
    seeds = range(chosen.seed0, chosen.seed0 + chosen.n)
    jobs = [(size, seed) for size in SIZES for seed in seeds]
    run = partial(
        tried,
        is_learnt=chosen.learnt,
        ranks=tuple(chosen.ranks),
        folder=chosen.failures,
    )
    with ProcessPoolExecutor(chosen.workers) as pool:
        records = kept(pool.map(run, jobs), chosen.records)
    print(flights_text(grouped(records)) + "\n")
    publish(shares([r for r in records if r.rank == 0]), chosen.json)


if __name__ == "__main__":
    begin(main)
