"""What a step of the task returns, or a leg: it is done, or it met a fault."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from debrisgrasp.control import LegOutcome, RefusalCause

from .states import State

__all__ = ["Done", "FaultFound", "FaultRaised", "LegEnd", "StepResult"]


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
    refused_for: frozenset[RefusalCause] = frozenset()
    """What stood in the way of a motion that control refused."""


class FaultRaised(Exception):
    """Ends a step from where no result can be returned; never leaves the executive."""

    def __init__(self, found: FaultFound) -> None:
        self.found = found
        super().__init__(found.message)


StepResult = Done | FaultFound


@dataclass(frozen=True, slots=True, eq=False)
class LegEnd:
    """How a leg ended."""

    outcome: LegOutcome
    share: float
    """How much of it was done, in [0, 1]."""
    length: float
    """Of the whole leg [m]."""

    @property
    def left(self) -> float:
        """What was not done [m]."""
        return (1.0 - self.share) * self.length
