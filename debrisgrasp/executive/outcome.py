"""What became of a run: attempts, faults with their evidence, and one class."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

from debrisgrasp.control import FaultClass

from .faults import Action, fault_named
from .states import STAGES, State

__all__ = ["Attempt", "FaultEvent", "RunEnd", "RunResult"]


class RunEnd(Enum):
    """How a run ended."""

    CLEARED = "cleared"
    """Nothing that can be removed is left."""
    FINISHED = "finished"
    """As many objects were removed as was asked for."""
    LEFT = "left"
    """In order, with objects left that no try could take; `RunResult.left` has why."""
    ABORTED = "aborted"
    """Ended in order; the fault says why."""
    STOPPED = "stopped"
    """A stop is latched."""
    INTERRUPTED = "interrupted"
    """A person ended it."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FaultEvent:
    """One fault, when it was noticed, and what was done."""

    time: float
    """By the robot's clock [s]."""
    state: State
    fault: str
    """Name of its `FaultSpec`."""
    message: str
    """What was measured, and which limit it met."""
    action: Action
    """What was done about it."""
    arm: str | None = None
    values: Mapping[str, float] = field(default_factory=dict)
    """Evidence in SI units, by name."""

    @property
    def fault_class(self) -> FaultClass:
        """Class of the fault."""
        return fault_named(self.fault).fault_class

    def facts(self) -> dict[str, object]:
        """Tell what a record has of it."""
        return {
            "state": self.state.value,
            "fault": self.fault,
            "class": self.fault_class.value,
            "message": self.message,
            "action": self.action.value,
            "arm": self.arm,
            "values": dict(self.values),
            "time": round(self.time, 4),
        }


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Attempt:
    """One try at one object."""

    number: int
    """From 1."""
    reached: tuple[State, ...]
    """Stages that were begun, in order."""
    is_removed: bool
    """Whether the object was put down at the drop-off, verified."""
    pushed: float = 0.0
    """How far it was pushed aside instead [m]."""
    faults: tuple[FaultEvent, ...] = ()
    object_label: int | None = None
    look: int | None = None
    """In which the object has that label, from 1: each look labels objects anew."""
    centroid: tuple[float, float, float] | None = None
    """Of the object's visible points, base frame [m]."""
    arm: str | None = None
    prototype: str | None = None
    score: float | None = None
    peak_force: float = 0.0
    """Largest force on the hand, absolute [N]."""
    peak_torque: float = 0.0
    """[N m]."""

    @property
    def has_set_out(self) -> bool:
        """Whether an arm went to the object; else it was only looked for a way."""
        return State.PREGRASP in self.reached or self.pushed > 0.0

    def facts(self) -> dict[str, object]:
        """Tell what a record has of it."""
        return {
            "number": self.number,
            "reached": [state.value for state in self.reached],
            "removed": self.is_removed,
            "pushed": round(self.pushed, 3),
            "faults": [event.fault for event in self.faults],
            "object": self.object_label,
            "look": self.look,
            "centroid": self.centroid,
            "arm": self.arm,
            "prototype": self.prototype,
            "score": self.score,
            "peak_force": round(self.peak_force, 2),
            "peak_torque": round(self.peak_torque, 3),
        }


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RunResult:
    """A whole run."""

    end: RunEnd
    attempts: tuple[Attempt, ...]
    faults: tuple[FaultEvent, ...]
    """All of them, in the order of time, those between attempts included."""
    left: Mapping[str, str] = field(default_factory=dict)
    """Objects that stay, in words, and why."""
    duration: float = 0.0
    """From begin to end, by the robot's clock [s]."""
    silent: tuple[str, ...] = ()
    """Arms, or the base, that were told to stop and did not, in words: somebody must
    press the emergency stop."""
    holding: str | None = None
    """Arm whose hand still holds something, which falls as it is opened."""

    @property
    def n_removed(self) -> int:
        """Objects put down at the drop-off."""
        return sum(attempt.is_removed for attempt in self.attempts)

    @property
    def n_pushed(self) -> int:
        """How often something was pushed aside."""
        return sum(attempt.pushed > 0.0 for attempt in self.attempts)

    @property
    def is_nothing_there(self) -> bool:
        """Whether the way was clear from the start, with nothing in it at all."""
        is_clear = self.end is RunEnd.CLEARED and not (self.n_removed or self.n_pushed)
        return is_clear and not self.left

    @property
    def is_all_driven_over(self) -> bool:
        """Whether the way is clear with nothing removed, for all in it is low."""
        is_low = [reason.startswith("drive over") for reason in self.left.values()]
        is_clear = self.end is RunEnd.CLEARED and not (self.n_removed or self.n_pushed)
        return is_clear and bool(is_low) and all(is_low)

    @property
    def first_fault(self) -> FaultEvent | None:
        """First fault of all attempts in the order of the stages; there the earliest.

        With recovery it is often one that was answered and cost nothing.
        """
        return min(self.faults, key=_stage_of, default=None)

    @property
    def fault_class(self) -> FaultClass | None:
        """The one class that the run counts in; None: success.

        It is that of the last fault, whose answer was to end the run. Those before were
        answered, and the run went on: they did not make it fail.
        """
        if self.end in (RunEnd.CLEARED, RunEnd.FINISHED):
            return None
        ending = self.faults[-1] if self.faults else None
        return FaultClass.SAFETY if ending is None else ending.fault_class

    @property
    def counted_as(self) -> str | None:
        """``success``, or the class; a run that a person ended says nothing: None."""
        if self.end is RunEnd.INTERRUPTED:
            return None
        return "success" if self.fault_class is None else self.fault_class.value


def _stage_of(event: FaultEvent) -> tuple[int, float]:
    is_stage = event.state in STAGES
    return STAGES.index(event.state) if is_stage else len(STAGES), event.time
