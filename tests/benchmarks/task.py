"""Clearing random piles without injected faults, against the truth of the world.

Run: python -m tests.benchmarks.task [--piles 100] [--first-seed 0] [--json FILE]
"""

from __future__ import annotations

import argparse
import re
import sys
import time
from collections import Counter
from contextlib import AbstractContextManager
from pathlib import Path
from unittest import mock

import numpy as np

from debrisgrasp.campaign import account
from debrisgrasp.cli.tables import columns
from debrisgrasp.executive import RunEnd, SimulatedTask
from debrisgrasp.pipeline import Pipeline
from debrisgrasp.robot.fake import FakeRobot
from debrisgrasp.robot.fake_body import FakeDepthCamera
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
    """Times the computing from capture to release, and shows what goes on."""

    def __init__(self) -> None:
        self.seconds: list[float] = []
        self.own_seconds: list[float] = []
        """Without those that the world in memory takes."""
        self.name = ""
        self._begun = self._of_world = self._of_world_begun = 0.0

    def write(self, kind: str, facts: dict[str, object]) -> None:
        now = time.thread_time()
        if kind == "state" and sys.stderr.isatty():
            print(f"\r{self.name}: {facts['state']:<16}", end="", file=sys.stderr)
        if kind == "state" and facts["state"] == "capture":
            self._begun, self._of_world_begun = now, self._of_world
        if kind == "done" and facts["state"] == "release":
            taken = now - self._begun
            self.seconds.append(taken)
            self.own_seconds.append(taken - (self._of_world - self._of_world_begun))

    def keep(self, capture: object, name: str) -> None:
        """Nothing is stored."""

    def without(self, kind: type, name: str) -> AbstractContextManager[object]:
        """Count what a method takes as time of the world in memory."""
        plain = getattr(kind, name)

        def timed(own: object) -> object:
            begun = time.thread_time()
            try:
                return plain(own)
            finally:
                self._of_world += time.thread_time() - begun

        return mock.patch.object(kind, name, timed)


def _cause(reason: str) -> str:
    """A reason without its numbers, short enough for a table."""
    words = re.sub(r"object \d+: |of \d+ [a-z ]*poses: ", "", reason)
    words = re.sub(r"\([^)]*in vain[^)]*\)", "", words)
    return re.sub(r"-?\d+(\.\d+)?", "#", words)[:90].strip()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--piles", type=int, default=100)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--drive-over", type=float, default=0.10)
    parser.add_argument("--json", type=Path, metavar="FILE")
    arguments = parser.parse_args()
    pipeline, cycles = Pipeline(), _Cycles()
    ends: Counter[str] = Counter()
    left: Counter[str] = Counter()
    faults: Counter[str] = Counter()
    counts: Counter[str] = Counter()
    first = arguments.first_seed
    for seed in range(first, first + arguments.piles):
        cycles.name = f"pile {seed - first + 1} of {arguments.piles}, seed {seed}"
        task = SimulatedTask(seed=seed, drive_over=arguments.drive_over)
        with (
            cycles.without(FakeRobot, "advance"),
            cycles.without(FakeDepthCamera, "capture"),
        ):
            done = task.run(cycles, pipeline=pipeline)
        result, truth = done.result, done.truth
        objects = account(truth, task.settings(pipeline))
        gone, kept = objects.gone, [body.name for body in objects.kept]
        ends[result.end.value] += 1
        faults.update(f"{e.state.value}: {e.fault}" for e in result.faults)
        left.update(
            _cause(reason)
            for reason in result.left.values()
            if not reason.startswith("drive over")
        )
        if result.end not in (RunEnd.LEFT, RunEnd.CLEARED) and result.faults:
            left[
                f"the run {result.end.value}: {_cause(result.faults[-1].message)}"
            ] += 1
        counts["uncaught"] += sum(e.fault == "software_error" for e in result.faults)
        counts["limit_violations"] += len(truth.violations)
        counts["overloads"] += len(truth.overloads)
        counts["removed"] += len(gone)
        counts["remaining"] += len(kept)
        counts["false_cleared"] += int(result.end is RunEnd.CLEARED and bool(kept))
        print(
            f"\r{cycles.name}: {result.end.value}, {len(gone)} removed, "
            f"remain: {', '.join(kept) or 'none'}; at most "
            f"{max(truth.peak_force.values()):.0f} N; {counts['removed']} of "
            f"{counts['removed'] + counts['remaining']} so far",
            flush=True,
        )
    total = counts["removed"] + counts["remaining"]
    figures = {
        "runs": arguments.piles,
        "removable": total,
        "removed": counts["removed"],
        "uncaught": counts["uncaught"],
        "limit_violations": counts["limit_violations"],
        "overloads": counts["overloads"],
        "false_cleared": counts["false_cleared"],
        "unclassified": 0,
        "removed_share": counts["removed"] / max(total, 1),
        "cycle_seconds": float(np.median(cycles.seconds or 0.0)),
        "cycle_seconds_without_the_world": float(np.median(cycles.own_seconds or 0.0)),
    }
    for name, table in (("end", ends), ("fault met", faults), ("why it is left", left)):
        print(columns([name, ""], [[k, str(v)] for k, v in table.most_common()]), "\n")
    print(columns(["target", ""], [[k, v] for k, v in _TARGETS.items()]))
    publish(figures, arguments.json)


if __name__ == "__main__":
    main()
