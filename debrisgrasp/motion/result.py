"""What becomes of the wish to move an arm."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from debrisgrasp._arrays import FloatArray
from debrisgrasp.kinematics import Trajectory

from .exact import Contact

__all__ = ["MotionCounts", "MotionPlan", "MotionStatus"]


class MotionStatus(Enum):
    """How a motion stands."""

    SOLVED = "solved"
    START_IN_COLLISION = "the arm touches something where it stands"
    NO_GOAL_POSTURE = "no posture takes the hand to the goal"
    GOAL_IN_COLLISION = "at the goal the arm touches something in every posture"
    BUDGET = "no way was found within the budget"


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionCounts:
    """How much work it took."""

    goals: int = 0
    """Postures found at the goal."""
    free_goals: int = 0
    """Of them, free of contact."""
    rounds: int = 0
    """Of the search by trees; 0 if a straight edge did."""
    nodes: int = 0
    """Postures in the trees."""
    postures: int = 0
    """Tested for contact by their spheres."""
    exact: int = 0
    """Tested by their solids, where spheres could not tell."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MotionPlan:
    """A motion free of contact, or why there is none."""

    status: MotionStatus
    reason: str
    """In words and numbers; empty if solved."""
    trajectory: Trajectory | None
    """From the start to one of the goals; None unless solved."""
    path: FloatArray | None
    """Its corners [rad or m], shape (m, d); None unless solved."""
    contacts: tuple[Contact, ...] = ()
    """What touches what, at the start or at the goal that comes nearest to free."""
    counts: MotionCounts = MotionCounts()

    def __repr__(self) -> str:
        return f"<MotionPlan {self.status.value}: {self.trajectory or self.reason}>"

    @property
    def is_solved(self) -> bool:
        """Whether there is a trajectory."""
        return self.status is MotionStatus.SOLVED

    @property
    def is_infeasible(self) -> bool:
        """Whether start or goal rule the motion out; no longer search would help."""
        return self.status not in (MotionStatus.SOLVED, MotionStatus.BUDGET)
