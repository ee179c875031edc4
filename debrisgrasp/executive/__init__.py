"""Layer 9: the whole task. States, faults and their answers, and what became of it."""

from .faults import FAULTS, Action, FaultSpec, fault_named
from .outcome import Attempt, FaultEvent, RunEnd, RunResult
from .states import STAGES, State

__all__ = [
    "FAULTS",
    "STAGES",
    "Action",
    "Attempt",
    "FaultEvent",
    "FaultSpec",
    "RunEnd",
    "RunResult",
    "State",
    "fault_named",
]
