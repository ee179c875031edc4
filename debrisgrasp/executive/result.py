"""What a step of the task returns: it is done, or it met a fault."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from .states import State

__all__ = ["Done", "FaultFound", "FaultRaised", "StepResult"]


@dataclass(frozen=True, slots=True, eq=False)
class Done:
    """The step did what it is for."""

    facts: Mapping[str, object] = field(default_factory=dict)
    """What was decided or measured, for the record; plain JSON values."""
    next: State | None = None
    """Where to go on; None: where the table says."""


@dataclass(frozen=True, slots=True, eq=False)
class FaultFound:
    """The step met a fault; what is done about it is the table's matter."""

    fault: str
    """Name of its `FaultSpec`."""
    message: str
    """What was measured, and which limit it met."""
    arm: str | None = None
    values: Mapping[str, float] = field(default_factory=dict)
    """Evidence in SI units, by name."""


class FaultRaised(Exception):
    """Ends a step from where no result can be returned; never leaves the executive."""

    def __init__(self, found: FaultFound) -> None:
        self.found = found
        super().__init__(found.message)


StepResult = Done | FaultFound
