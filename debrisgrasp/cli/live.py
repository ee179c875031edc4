"""What is told while long work goes on."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from debrisgrasp._words import arm_called
from debrisgrasp.executive.context import Recorder
from debrisgrasp.io import Capture

__all__ = ["ToldRun", "show_line"]


def show_line(words: str, *, is_last: bool = False) -> None:
    """Keep one line of the terminal up to date, if there is one."""
    if sys.stderr.isatty():
        end = "\n" if is_last else ""
        print(f"\r{words:<60}", end=end, file=sys.stderr, flush=True)


def _clear_line() -> None:
    if sys.stderr.isatty():
        print(f"\r{'':<60}\r", end="", file=sys.stderr, flush=True)


@dataclass(eq=False)
class ToldRun:
    """Passes a run on to its record, and tells how far it is."""

    record: Recorder
    say: Callable[[str], object] = lambda _: None
    """Takes a sentence about each attempt as it ends."""
    _number: int = 1
    _faults: list[str] = field(default_factory=list)
    _why_stays: str = ""

    def write(self, kind: str, facts: Mapping[str, object]) -> None:
        """Take down an event, and tell of it if it matters to a person."""
        self.record.write(kind, facts)
        if kind == "state":
            show_line(f"attempt {self._number}: {facts['state']}")
        elif kind == "fault":
            self._faults.append(f"{facts['fault']} in {facts['state']}")
        elif kind == "done" and "pushed" in facts:
            self._why_stays = str(facts.get("why", ""))
        elif kind == "attempt":
            _clear_line()
            why = [f"can't be pushed: {self._why_stays}"] if self._why_stays else []
            self.say(", ".join([_fate(facts), *why, *self._faults]))
            self._number += 1
            self._faults.clear()
            self._why_stays = ""
        elif kind == "end":
            _clear_line()

    def keep(self, capture: Capture, name: str) -> None:
        """Store a capture."""
        self.record.keep(capture, name)


def _fate(facts: Mapping[str, object]) -> str:
    words = f"attempt {facts['number']}: {'' if facts['removed'] else 'not '}removed"
    if facts.get("pushed"):
        words = f"attempt {facts['number']}: pushed aside"
        words += f" by {100.0 * float(str(facts['pushed'])):.0f} cm"
    if facts["prototype"]:
        words += f", {facts['prototype']} with the {arm_called(str(facts['arm']))}"
    return words
