"""Records for tests."""

from __future__ import annotations

from typing import Any

from debrisgrasp.campaign import SUCCESS, RunRecord


def record(name: str, outcome: str = SUCCESS, **changes: Any) -> RunRecord:
    values: dict[str, Any] = {
        "name": name,
        "spec": {},
        "outcome": outcome,
        "reached": ("self_test", "close"),
        "failed_stage": None if outcome == SUCCESS else "close",
        "n_objects": 1,
        "n_removed": int(outcome == SUCCESS),
    }
    return RunRecord(**(values | changes))


def campaign(**counts: int) -> list[RunRecord]:
    """So many runs of each outcome; ``early_`` before a class: before any grasp."""
    records = []
    for key, count in counts.items():
        is_early = key.startswith("early_")
        early = {"reached": ("self_test",), "failed_stage": "self_test"}
        outcome = key.removeprefix("early_")
        records += [
            record(f"{key}-{i}", outcome, **(early if is_early else {}))
            for i in range(count)
        ]
    return records
