"""A run of a campaign done again, to see whether it comes out as it did."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields

from debrisgrasp.errors import UnknownNameError
from debrisgrasp.executive.replay import tasks_apart

from .arm_run import run_arm
from .fake_run import pipeline_of, run_fake
from .physics_run import run_physics
from .record import RunRecord
from .runner import RunFunction, guarded
from .specs import LEVELS, RunSpec

__all__ = ["Change", "asked_apart", "changes", "done_again", "run_function"]

_RUNS: Mapping[tuple[str, str], RunFunction] = {
    ("fake", "hand"): run_fake,
    ("mujoco", "hand"): run_physics,
    ("mujoco", "arm"): run_arm,
}
_COMPARED = (
    "outcome",
    "end",
    "failed_stage",
    "fault",
    "faults",
    "reached",
    "injected",
    "n_objects",
    "n_removed",
    "checks",
)
"""Fields in which equal specs give equal records."""


@dataclass(frozen=True, slots=True)
class Change:
    """A field of a record that came out otherwise."""

    field: str
    before: object
    now: object

    def __str__(self) -> str:
        return f"{self.field}: {_words(self.before)} before, {_words(self.now)} now"


def run_function(world: str, level: str) -> RunFunction:
    """Look up what does a run in a world, at a level.

    Raises
    ------
    UnknownNameError
        If there are no such runs in that world.
    """
    if (world, level) not in _RUNS:
        known = [name for name in LEVELS if (world, name) in _RUNS]
        raise UnknownNameError(f"level of world {world}", level, known)
    return _RUNS[world, level]


def done_again(record: RunRecord) -> RunRecord:
    """Do the run of a record again with this version.

    What it raises is kept in the record, as in a campaign.

    Raises
    ------
    ConfigError
        If the spec of the record is none of `RunSpec`, or its site can't be had.
    UnknownNameError
        If it asks for something that there is not.
    """
    spec = RunSpec.from_json(record.spec)
    function = run_function(spec.world, spec.level)
    pipeline_of(spec.site)
    return guarded(function, spec)


def changes(before: RunRecord, now: RunRecord) -> tuple[Change, ...]:
    """Fields in which two records of a run differ."""
    pairs = ((name, getattr(before, name), getattr(now, name)) for name in _COMPARED)
    return tuple(Change(*pair) for pair in pairs if pair[1] != pair[2])


def asked_apart(before: RunRecord, now: RunRecord) -> list[str]:
    """Say in which fields the specs of two records differ, but for their names."""
    usual = {f.name: f.default for f in fields(RunSpec) if f.default is not MISSING}
    return tasks_apart(before.spec, now.spec, usual)


def _words(value: object) -> str:
    if isinstance(value, Mapping):
        counts = [f"{count} {name}" for name, count in value.items() if count]
        return ", ".join(counts) or "nothing"
    if isinstance(value, tuple):
        return ", ".join(map(str, value)) or "none"
    return "none" if value is None else str(value)
