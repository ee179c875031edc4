"""What the page of a run tells of its events: states and attempts, over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from debrisgrasp._arrays import FloatArray

__all__ = ["Try", "since_begun", "spans_of", "tries_of"]


@dataclass(eq=False)
class Try:
    """One attempt, collected from the events."""

    number: int
    grasp: Mapping[str, Any] | None = None
    push: Mapping[str, Any] | None = None
    object: Mapping[str, Any] | None = None
    capture: str = ""
    faults: list[Mapping[str, Any]] = field(default_factory=list)
    traces: list[FloatArray] = field(default_factory=list)
    """Time [s], force [N] and torque [N m] of each state, shapes (n, 3)."""
    facts: Mapping[str, Any] = field(default_factory=dict)


def since_begun(events: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Give events with times since the first [s]: a robot's clock began before."""
    begun = min(_times(events), default=0.0)

    def since(time: float | None) -> float | None:
        return None if time is None else time - begun

    found: list[Mapping[str, Any]] = []
    for event in events:
        told = dict(event)
        if _times([event]):
            told["time"] = since(event["time"])
        if event.get("rows"):
            told["rows"] = [[since(time), *felt] for time, *felt in event["rows"]]
        found.append(told)
    return found


def _times(events: Sequence[Mapping[str, Any]]) -> list[float]:
    return [e["time"] for e in events if isinstance(e.get("time"), (int, float))]


def spans_of(
    events: Sequence[Mapping[str, Any]],
) -> tuple[list[tuple[str, float, float]], float]:
    """States with their begin and end [s], and the end of all."""
    marks = [(e["state"], e["time"]) for e in events if e.get("event") == "state"]
    total = max(_times(events), default=1.0)
    ends = [*(begin for _, begin in marks), total][1:]
    spans = [(s, a, b) for (s, a), b in zip(marks, ends, strict=True)]
    return spans, max(total, 1e-3)


def tries_of(events: Sequence[Mapping[str, Any]]) -> list[Try]:
    """Collect the attempts in order, each with what belongs to it."""
    found = [Try(1)]
    capture = ""
    for event in events:
        kind, state, now = event.get("event"), event.get("state"), found[-1]
        if kind == "done" and state == "capture":
            capture = f"capture_{event.get('look', now.number):03d}"
        now.capture = now.capture or capture
        if kind == "done" and state == "capture":
            now.capture = capture
        if kind == "done" and state == "select":
            now.object = event
        if kind == "done" and state == "plan_motion":
            now.grasp = event
        if kind == "done" and state == "push" and "pose" in event:
            now.push = event
        if kind == "fault":
            now.faults.append(event)
        if kind == "trace":
            rows = np.reshape(event.get("rows") or (), (-1, 3)).astype(np.float64)
            now.traces.append(rows[np.isfinite(rows).all(axis=1)])
        if kind == "attempt":
            now.facts = event
            found.append(Try(now.number + 1))
    return [item for item in found if item.facts or item.faults]
