"""Campaigns: an attack with random faults, the paper's two re-enacted, and scaling.

``python -m tests.benchmarks.campaign [--json FILE] [--n RUNS] [--seed S] [--out DIR]``

The attack injects one or two random faults at any state into each run; one run in ten
clears two objects of a small pile, the others one that lies alone. The paper's
campaigns are re-enacted with the rates of ``data/campaigns/paper_*.yaml``: what is
known of them are the runs, those that got to a grasp, and those that succeeded (19 of
26 of 43, and 95 of 99 of 147); how the rest falls on the classes is not, and is spread
evenly. Each is run without and with recovery, beside a campaign without faults that
says what the scene itself costs.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

from debrisgrasp._arrays import Rng
from debrisgrasp._files import data_path
from debrisgrasp.campaign import (
    CHECKS,
    UNCLASSIFIED,
    Campaign,
    FaultRates,
    LocalWorkers,
    Progress,
    RunRecord,
    Share,
    compare,
    draw_specs,
    random_faults,
    run_fake,
    tabulate,
)
from debrisgrasp.cli.campaign_text import comparison_text, tables_text
from debrisgrasp.cli.tables import columns
from debrisgrasp.executive import FAULTS
from debrisgrasp.robot import Injection
from tests.benchmarks.report import publish

SEED = 20220
PILES = 10
"""One run in so many of the attack is one of piles."""
TARGETS = {
    "uncaught": "0",
    "commands_outside_limits": "0",
    "wrenches_above_limits": "0",
    "false_cleared": "0",
    "stops_not_latched": "0",
    "unclassified": "0",
    "one_class_share": "1",
    "stops_latched_share": "1",
    "scaling_1_to_2": "1.7 or more",
    "scaling_by_cpu": "1.7 or more",
    "paper_piles_all_in_interval": "1",
    "paper_piles_grasps_in_interval": "1",
    "paper_handle_all_in_interval": "1",
    "paper_handle_grasps_in_interval": "1",
}
PAPER = {
    "paper_piles": ("single", 19, 26, 43),
    "paper_handle": ("handle", 95, 99, 147),
}
"""Scene, successes, runs that got to a grasp, runs."""
Source = Callable[[Rng], tuple[Injection, ...]] | None


class Bench:
    """Runs campaigns into folders, so that an interrupted benchmark goes on."""

    def __init__(self, out: Path, workers: int, seed: int = SEED) -> None:
        self.out, self.workers, self.seed = out, workers, seed

    def run(
        self,
        name: str,
        n: int,
        faults: Source = None,
        *,
        tier: str = "single",
        recovery: bool = True,
        removals: int = 1,
        workers: int | None = None,
    ) -> tuple[RunRecord, ...]:
        specs = draw_specs(
            n,
            seed=self.seed,
            tier=tier,
            faults=faults,
            recovery=recovery,
            max_removals=removals,
            max_attempts=4 * removals,
        )
        campaign = Campaign(specs=specs, run_one=run_fake, folder=self.out / name)

        def show(progress: Progress) -> None:
            if progress.done % 10 == 0:
                print(f"  {name}: {progress.done} of {progress.total}", flush=True)

        return campaign.run(
            LocalWorkers(workers or self.workers, time_limit=900.0), on_progress=show
        )


def attack(bench: Bench, n: int) -> dict[str, float]:
    """Random single and paired faults at any state, on single objects and on piles."""
    print(f"attack: {n} runs with one or two random faults at any state")
    n_piles = n // PILES
    parts = {"attack": bench.run("attack", n - n_piles, random_faults)}
    if n_piles:
        # Other draws, which a larger n leaves as they were.
        other = Bench(bench.out, bench.workers, bench.seed + 1)
        parts["attack_piles"] = other.run(
            "attack_piles", n_piles, random_faults, tier="few", removals=2
        )
    for name, part in parts.items():
        print(f"{name}: {len(part)} runs\n{tables_text(tabulate(part))}", end="\n\n")
        print_broken(name, part)
    records = [record for part in parts.values() for record in part]
    tables = tabulate(records)
    print(by_fault(records), end="\n\n")
    figures = {name: float(count) for name, count in tables.checks}
    figures["unclassified"] = float(sum(r.outcome == UNCLASSIFIED for r in records))
    print(runs_violating(records), end="\n\n")
    figures["one_class_share"] = 1.0 - figures["unclassified"] / n
    stopped = [r for r in records if r.end in ("stopped", "interrupted")]
    latched = sum(not r.checks.get("stops_not_latched") for r in stopped)
    figures["stops_latched_share"] = latched / max(len(stopped), 1)
    figures["stops"] = float(len(stopped))
    figures["attack_runs"] = float(n)
    figures["attack_piles"] = float(n_piles)
    figures["attack_struck"] = float(sum(bool(r.injected) for r in records))
    figures["cpu_seconds_per_run"] = sum(r.seconds for r in records) / n
    return figures


def print_broken(name: str, records: Sequence[RunRecord]) -> None:
    """Name the runs in which something happened that never must."""
    for record in records:
        broken = {k: v for k, v in record.checks.items() if v}
        if broken or record.error:
            faults = [f"{i['fault']}@{i['state']}" for i in record.spec["faults"]]
            told = f"run {name}/{record.name} ({', '.join(faults)}): {broken}"
            print(told, *record.error.strip().splitlines()[-1:])


def runs_violating(records: Sequence[RunRecord]) -> str:
    """Say in how many runs each thing happened that never must, with intervals."""
    counts = {name: sum(bool(r.checks.get(name)) for r in records) for name in CHECKS}
    counts["unclassified"] = sum(r.outcome == UNCLASSIFIED for r in records)
    rows = []
    for name, count in counts.items():
        low, high = Share(count, len(records)).interval
        shown = f"{100 * low:.1f} to {100 * high:.1f}"
        rows.append([name, f"{count} of {len(records)}", shown])
    return columns(["never", "runs", "95 % interval, %"], rows)


def by_fault(records: Sequence[RunRecord]) -> str:
    """Say of each single fault that struck what the runs ended in, and its class."""
    ends: dict[str, Counter[str]] = {}
    for record in records:
        if len(set(record.injected)) == 1:
            ends.setdefault(record.injected[0], Counter())[record.outcome] += 1
    rows = []
    for name in sorted(ends):
        found = ", ".join(f"{end} {count}" for end, count in ends[name].most_common())
        rows.append([name, FAULTS[name].fault_class.value, found])
    return columns(["only fault that struck", "its class", "runs ended in"], rows)


def reenacted(bench: Bench, name: str, n: int) -> dict[str, float]:
    """Inject the rates of one of the paper's campaigns, without and with recovery."""
    tier, successes, grasps, runs = PAPER[name]
    rates = FaultRates.load(data_path("campaigns", f"{name}.yaml"))
    clean = tabulate(bench.run(f"{name}_clean", n, tier=tier))
    off = tabulate(bench.run(f"{name}_off", n, rates.drawn, tier=tier, recovery=False))
    on = tabulate(bench.run(f"{name}_on", n, rates.drawn, tier=tier))
    rows, figures = [], {}
    for words, key, paper, ours in (
        ("success of all runs", "all", Share(successes, runs), off.success),
        ("success of grasps", "grasps", Share(successes, grasps), off.grasp_success),
        (
            "got to a grasp",
            "reached",
            Share(grasps, runs),
            Share(off.grasp_success.total, off.success.total),
        ),
    ):
        low, high = ours.interval
        is_inside = low <= paper.value <= high
        figures[f"{name}_{key}_in_interval"] = float(is_inside)
        shown = f"{ours.count} of {ours.total}: {100 * ours.value:.1f}"
        shown += f" ({100 * low:.0f} to {100 * high:.0f})"
        told = f"{paper.count} of {paper.total}: {100 * paper.value:.1f}"
        rows.append([words, told, shown, "yes" if is_inside else "no"])
    print(columns([f"{name}, recovery off", "paper %", "ours %", "inside"], rows))
    print(
        f"without faults {clean.success.count} of {clean.success.total} succeed; "
        "the same faults with recovery off (old) and on (new):"
    )
    print(comparison_text(compare(off, on)), end="\n\n")
    figures[f"{name}_success_clean"] = clean.success.value
    figures[f"{name}_success_off"] = off.success.value
    figures[f"{name}_success_on"] = on.success.value
    return figures


def scaling(bench: Bench, n: int) -> dict[str, float]:
    """Runs in a second with one and with two workers; wall time, start included.

    Where other programs take turns on the cores, the share of its time that a worker
    really computes says so, and what a run costs in CPU time tells what two workers
    take from each other.
    """
    rates, costs, shares = [], [], []
    with tempfile.TemporaryDirectory() as folder:
        for workers in (1, 2):
            fresh = Bench(Path(folder) / str(workers), workers, bench.seed)
            start = time.perf_counter()
            records = fresh.run("scaling", n)
            spent, wall = sum(r.seconds for r in records), time.perf_counter() - start
            rates.append(n / wall)
            costs.append(spent / n)
            shares.append(spent / (workers * wall))
    rows = [
        [str(k), f"{rate:.3f}", f"{cost:.2f}", f"{100 * share:.0f}"]
        for k, rate, cost, share in zip((1, 2), rates, costs, shares, strict=True)
    ]
    header = ["workers", "runs a second", "CPU s a run", "% of time computing"]
    print(columns(header, rows), end="\n\n")
    return {
        "scaling_1_to_2": rates[1] / rates[0],
        "scaling_by_cpu": 2.0 * costs[0] / costs[1],
        "computing_share_1": shares[0],
        "computing_share_2": shares[1],
        "runs_per_second_2": rates[1],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--n", type=int, default=1000, help="runs of the attack")
    parser.add_argument(
        "--paper-n", type=int, help="runs of each other; default: the paper's"
    )
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--scaling-n", type=int, default=24, help="0: not measured")
    parser.add_argument("--out", type=Path, help="keep the records here, and go on")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        out = options.out or Path(folder)
        bench = Bench(out, options.workers, options.seed)
        figures = attack(bench, options.n) if options.n else {}
        if options.paper_n != 0:
            for name, (*_, runs) in PAPER.items():
                figures |= reenacted(bench, name, options.paper_n or runs)
        if options.scaling_n:
            figures |= scaling(bench, options.scaling_n)
    assert set(CHECKS) <= set(TARGETS)
    rows = [
        [name, TARGETS[name], f"{figures.get(name, float('nan')):.4g}"]
        for name in TARGETS
    ]
    print(columns(["figure", "target", "measured"], rows), end="\n\n")
    publish(figures, options.json)


if __name__ == "__main__":
    main()
