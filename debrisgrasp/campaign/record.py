"""What one run of a campaign leaves behind."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from debrisgrasp import __version__
from debrisgrasp._arrays import require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp._files import read_json, schema_found
from debrisgrasp.control import FaultClass
from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.executive import STAGES
from debrisgrasp.trials import TrialRecord

__all__ = [
    "CHECKS",
    "CLASSES",
    "GRASPED_STAGE",
    "STAGE_ORDER",
    "SUCCESS",
    "UNCLASSIFIED",
    "RunRecord",
    "flight_of",
]

SUCCESS = "success"
UNCLASSIFIED = "unclassified"
"""Outcome of a run that ended by an exception; there must be none."""

CLASSES = tuple(fault_class.value for fault_class in FaultClass)
"""Ways to fail, by the names that the tables use."""

GRASPED_STAGE = "close"
"""A run that reached this stage got to a grasp."""

CHECKS = (
    "uncaught",
    "commands_outside_limits",
    "wrenches_above_limits",
    "false_cleared",
    "stops_not_latched",
)
"""What must never happen, however a run ends; counted in each run."""

_SCHEMA = "debrisgrasp/campaign-run/1"
_ADDED: Mapping[str, Any] = {"first_fault": None, "version": ""}
"""Fields that older records lack, and what they mean by it."""

STAGE_ORDER = tuple(stage.value for stage in STAGES)
"""Stages of a removal, first to last."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class RunRecord:
    """One run, as its file keeps it.

    Raises
    ------
    ConfigError
        If the outcome is no class, a stage is none, or more objects were removed than
        there were.
    """

    name: str
    """Of the run, unique in its campaign."""
    spec: Mapping[str, Any]
    """What was asked for: whatever repeats the run."""
    outcome: str
    """`SUCCESS`, `UNCLASSIFIED`, or the value of a `FaultClass`."""
    reached: tuple[str, ...] = ()
    """Stages that were begun in any attempt."""
    failed_stage: str | None = None
    """Where the fault that ended the run was noticed; None after a success."""
    fault: str | None = None
    """Name of that fault; the outcome is its class."""
    first_fault: str | None = None
    """Name of the first of all faults in the order of the stages, also of those that
    were answered; None if there was none, or the record is of an older version."""
    end: str = ""
    """How the run ended, in the words of `RunEnd`."""
    faults: tuple[str, ...] = ()
    """All faults that were noticed, in the order of time."""
    injected: tuple[str, ...] = ()
    """Faults that really came to pass of those that the spec asks for."""
    n_objects: int = 0
    """Objects that were in the way at the start, and that a robot could remove."""
    n_removed: int = 0
    """Of these, the ones that are not in the way in the end."""
    checks: Mapping[str, int] = field(default_factory=dict)
    """How often each of `CHECKS` was violated; without those not looked at."""
    seconds: float = 0.0
    """CPU time [s]."""
    error: str = ""
    """Trace of the exception of an unclassified run."""
    details: Mapping[str, Any] = field(default_factory=dict)
    """Anything else that the run function wants to keep."""
    version: str = __version__
    """Of the package that did the run; empty in a record of an older one."""

    def __post_init__(self) -> None:
        known = (SUCCESS, UNCLASSIFIED, *CLASSES)
        if self.outcome not in known:
            raise ConfigError(
                f"outcome of run {self.name}",
                got=repr(self.outcome),
                expected="one of " + ", ".join(known),
            )
        if (self.failed_stage is None) != self.is_success or (
            self.failed_stage not in (None, *STAGE_ORDER)
        ):
            raise ConfigError(
                f"failed stage of run {self.name}",
                got=f"{self.failed_stage!r} with outcome {self.outcome!r}",
                expected="none after a success, else one of " + ", ".join(STAGE_ORDER),
            )
        if unknown := [name for name in self.reached if name not in STAGE_ORDER]:
            raise ConfigError(
                f"reached of run {self.name}",
                got=repr(unknown[0]),
                expected="some of " + ", ".join(STAGE_ORDER),
            )
        for name in ("n_objects", "seconds"):
            require_range(f"{name} of run {self.name}", getattr(self, name), 0)
        require_range(
            f"n_removed of run {self.name}", self.n_removed, 0, self.n_objects
        )
        for name, count in self.checks.items():
            if name not in CHECKS:
                raise ConfigError(
                    f"checks of run {self.name}",
                    got=repr(name),
                    expected="one of " + ", ".join(CHECKS),
                )
            if not isinstance(count, int) or count < 0:
                raise ConfigError(
                    f"{name} of run {self.name}", got=repr(count), expected="a count"
                )

    @staticmethod
    def unclassified(
        name: str, spec: Mapping[str, Any], error: str, *, n_objects: int = 0
    ) -> RunRecord:
        """Make the record of a run that ended by an exception, or with its worker."""
        return RunRecord(
            name=name,
            spec=spec,
            outcome=UNCLASSIFIED,
            failed_stage=STAGE_ORDER[0],
            n_objects=n_objects,
            error=error,
        )

    @property
    def is_success(self) -> bool:
        """Whether the run did all that it was for."""
        return self.outcome == SUCCESS

    @property
    def got_to_a_grasp(self) -> bool:
        """Whether fingers were closed on anything."""
        return GRASPED_STAGE in self.reached

    def to_json(self) -> str:
        """Content of the file."""
        content: dict[str, Any] = {"schema": _SCHEMA}
        content |= {name: getattr(self, name) for name in self.__slots__}
        return json.dumps(content, indent=1, allow_nan=False) + "\n"

    @staticmethod
    def from_json(content: Mapping[str, Any], where: str) -> RunRecord:
        """Read a record, or raise `ConfigError` saying what is wrong in it."""
        if not isinstance(content, Mapping) or content.get("schema") != _SCHEMA:
            raise ConfigError(where, got=schema_found(content), expected=f"a {_SCHEMA}")
        names = RunRecord.__slots__
        try:
            values = {name: content[name] for name in names if name not in _ADDED}
            values |= {name: content.get(name, none) for name, none in _ADDED.items()}
            record = RunRecord(**values)
            flight_of(record)
        except (KeyError, TypeError) as error:
            raise ConfigError(
                where, got=f"{type(error).__name__} {error}", expected=f"a {_SCHEMA}"
            ) from error
        except InputError as error:
            raise ConfigError(
                f"{where}, {error.what}", got=error.got, expected=error.expected
            ) from error
        return record

    @staticmethod
    def load(path: str | os.PathLike[str]) -> RunRecord:
        """Read a record's file, or raise `ConfigError`."""
        return RunRecord.from_json(read_json(path), str(Path(path)))


def flight_of(record: RunRecord) -> TrialRecord | None:
    """Take the flight of a hand out of the record of a run; None if it was another."""
    spec = record.spec
    is_flight = (spec.get("world"), spec.get("level")) == ("mujoco", "hand")
    return TrialRecord(**record.details) if is_flight and record.details else None
