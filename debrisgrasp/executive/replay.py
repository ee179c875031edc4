"""Two runs compared, decision by decision."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from debrisgrasp._words import shortened

from .record import plain

__all__ = ["Difference", "decisions", "differences", "tasks_apart"]

_DECISIONS = ("done", "fault", "attempt", "recovered", "stop", "end")
_NO_TASK = ("name", "schema", "version", "contents")
_CLOSE = 1e-6
"""Numbers that differ by no more, as a share of the larger one, are the same."""


@dataclass(frozen=True, slots=True)
class Difference:
    """One decision that came out otherwise."""

    number: int
    """Of the decision, from 1."""
    state: str
    field: str
    one: object
    other: object

    def __str__(self) -> str:
        where = f"decision {self.number} ({self.state}), {self.field}"
        return f"{where}: {_short(self.one)} before, {_short(self.other)} now"


def decisions(events: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Pick from events what was decided; forces and times of states are left out."""
    return [event for event in events if event.get("event") in _DECISIONS]


def tasks_apart(
    one: Mapping[str, Any], other: Mapping[str, Any], usual: Mapping[str, Any]
) -> list[str]:
    """Say in which fields two runs were asked for different things.

    Names and versions of the runs are no part of it.

    Parameters
    ----------
    usual
        What fields mean that older records lack.
    """
    names = [name for name in (*usual, *one, *other) if name not in _NO_TASK]
    pairs = (
        (name, plain({**usual, **one}.get(name)), plain({**usual, **other}.get(name)))
        for name in dict.fromkeys(names)
    )
    return [
        f"{name}: {_short(a)} before, {_short(b)} now" for name, a, b in pairs if a != b
    ]


def differences(
    one: Sequence[Mapping[str, Any]],
    other: Sequence[Mapping[str, Any]],
    most: int = 20,
) -> list[Difference]:
    """Compare the decisions of two runs, in order; at most so many differences.

    After the first decision that leads elsewhere the rest follows from it, so the
    comparison ends where the states part.
    """
    found: list[Difference] = []
    before, now = decisions(one), decisions(other)
    for number, (a, b) in enumerate(zip(before, now, strict=False), start=1):
        state = str(a.get("state", a.get("event")))
        for field in dict.fromkeys((*a, *b)):
            if not _same(a.get(field), b.get(field)):
                found.append(
                    Difference(number, state, field, a.get(field), b.get(field))
                )
        parts = a.get("event") != b.get("event") or a.get("state") != b.get("state")
        if parts or len(found) >= most:
            return found[:most]
    if len(before) != len(now):
        n = min(len(before), len(now))
        longer = (before if len(before) > n else now)[n]
        state = str(longer.get("state", longer.get("event")))
        counts = f"{len(before)} decisions", f"{len(now)} decisions"
        found.append(Difference(n + 1, state, "length", *counts))
    return found[:most]


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        return a.keys() == b.keys() and all(_same(a[key], b[key]) for key in a)
    if isinstance(a, Sequence) and isinstance(b, Sequence) and not isinstance(a, str):
        return len(a) == len(b) and all(map(_same, a, b))
    if isinstance(a, (int, float)) and isinstance(b, (int, float)):
        return abs(a - b) <= _CLOSE * max(1.0, abs(a), abs(b))
    return bool(a == b)


def _short(value: object) -> str:
    return shortened(str(value), most=90)
