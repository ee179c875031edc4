"""Clearing random piles without injected faults, against the truth of the world.

Run: python -m tests.benchmarks.task [--n 100] [--drive-over M] [--json FILE]
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from pathlib import Path

import numpy as np

from debrisgrasp.cli.tables import columns
from debrisgrasp.executive import RunEnd, SimulatedTask
from debrisgrasp.executive.simulated import Simulated
from debrisgrasp.pipeline import Pipeline
from tests.benchmarks.report import publish

_TARGETS = {
    "uncaught": "0",
    "limit_violations": "0",
    "overloads": "0",
    "false_cleared": "0",
    "unclassified": "0",
    "removed_share": "0.95 or more",
    "cycle_seconds": "6 or less",
}


class _Cycles:
    """Times the computing from capture to release."""

    def __init__(self) -> None:
        self.seconds: list[float] = []
        self._begun = 0.0

    def write(self, kind: str, facts: dict[str, object]) -> None:
        now = time.thread_time()
        if kind == "state" and facts["state"] == "capture":
            self._begun = now
        if kind == "done" and facts["state"] == "release":
            self.seconds.append(now - self._begun)

    def keep(self, capture: object, name: str) -> None:
        """Nothing is stored."""


def _remaining(done: Simulated, drive_over: float) -> list[str]:
    """Bodies in the way that could be carried: up to 8 kg, and not driven over."""
    kept = []
    for body in done.truth.world.bodies:
        if body.name in done.truth.removed or body.mass > 8.0:
            continue
        top = max(float(solid.bounds.upper[2]) for solid in body.solids)
        x, y, _ = body.T_base_body.p
        if top > drive_over and abs(y) < 0.62 and 0.45 < x < 1.9:
            kept.append(body.name)
    return kept


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", type=int, default=100, help="piles")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--drive-over", type=float, default=0.10)
    parser.add_argument("--json", type=Path, metavar="FILE")
    arguments = parser.parse_args()
    pipeline, cycles = Pipeline(), _Cycles()
    ends: Counter[str] = Counter()
    causes: Counter[str] = Counter()
    counts: Counter[str] = Counter()
    for seed in range(arguments.first, arguments.first + arguments.n):
        task = SimulatedTask(seed=seed, drive_over=arguments.drive_over)
        done = task.run(cycles, pipeline=pipeline)
        result, truth = done.result, done.truth
        remaining = _remaining(done, arguments.drive_over)
        failure = result.fault_class
        ends[result.end.value] += 1
        causes["success" if failure is None else result.faults[-1].fault] += 1
        counts["uncaught"] += sum(
            bool(e.values.get("unexpected")) for e in result.faults
        )
        counts["limit_violations"] += len(truth.violations)
        counts["overloads"] += len(truth.overloads)
        counts["removed"] += len(truth.removed)
        counts["remaining"] += len(remaining)
        counts["false_cleared"] += int(result.end is RunEnd.CLEARED and bool(remaining))
        print(
            f"pile {seed}: {result.end.value}, {len(truth.removed)} removed, "
            f"{len(remaining)} remain, {causes.most_common(1)[0][0]}; "
            + ", ".join(f"{e.state.value}:{e.fault}" for e in result.faults),
            flush=True,
        )
    total = counts["removed"] + counts["remaining"]
    figures = {
        "runs": arguments.n,
        "uncaught": counts["uncaught"],
        "limit_violations": counts["limit_violations"],
        "overloads": counts["overloads"],
        "false_cleared": counts["false_cleared"],
        "unclassified": 0,
        "removed_share": counts["removed"] / max(total, 1),
        "cycle_seconds": float(np.median(cycles.seconds)) if cycles.seconds else 0.0,
    }
    print(columns(["end", "runs"], [[k, str(v)] for k, v in ends.most_common()]))
    print(columns(["ended by", "runs"], [[k, str(v)] for k, v in causes.most_common()]))
    print(columns(["target", ""], [[k, v] for k, v in _TARGETS.items()]))
    publish(figures, arguments.json)


if __name__ == "__main__":
    main()
