"""Layer 9: the whole task. States, faults and their answers, and what became of it."""

from .calibrated import is_held_where_it_rests
from .faults import FAULTS, Action, FaultSpec, fault_named
from .grasping import require_room
from .limbs import (
    require_above_ground,
    require_drop_off,
    require_own_joints,
    require_own_sides,
    require_watching,
)
from .outcome import Attempt, FaultEvent, RunEnd, RunResult
from .record import MemoryRecord, RunRecord, StoredRun, load_run
from .replay import Difference, differences
from .run import Executive, Observer
from .settings import TaskSettings
from .simulated import Simulated, SimulatedTask, simulate
from .states import STAGES, State, state_named

__all__ = [
    "FAULTS",
    "STAGES",
    "Action",
    "Attempt",
    "Difference",
    "Executive",
    "FaultEvent",
    "FaultSpec",
    "MemoryRecord",
    "Observer",
    "RunEnd",
    "RunRecord",
    "RunResult",
    "Simulated",
    "SimulatedTask",
    "State",
    "StoredRun",
    "TaskSettings",
    "differences",
    "fault_named",
    "is_held_where_it_rests",
    "load_run",
    "require_above_ground",
    "require_drop_off",
    "require_own_joints",
    "require_own_sides",
    "require_room",
    "require_watching",
    "simulate",
    "state_named",
]
