"""What comes of the search of one scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from .ledger import Rejections
from .plan import Grasp

__all__ = ["SearchResult"]


@dataclass(frozen=True, slots=True, eq=False)
class SearchResult:
    """Grasps of one search, best first, and what was ruled out."""

    grasps: tuple[Grasp, ...]
    rejections: Mapping[str, int] = field(default_factory=dict)
    """How many distinct poses each reason ruled out."""
    ruled_out: Rejections = field(default_factory=Rejections)
    """Those poses."""
    least_mass: float = 0.0
    """Lower bound on the mass of the object [kg]."""
    effective_samples: float = 0.0
    """See `GraspPlan.effective_samples`."""
    obstacle: str | None = None
    """What of the object itself rules out every grasp, if that is known."""
    promise: float = 0.0
    """Best score that the search came to, whether or not an arm takes it."""
    further: Callable[[float], SearchResult] | None = None
    """Search on, given a score that a grasp must exceed to be of use; all that was
    found counts again. None: that is needless, or was done."""

    def why_empty(self) -> str | None:
        """One sentence that says why there is no grasp, or None if there is one."""
        if self.grasps:
            return None
        if not self.rejections:
            return "no pose of any prototype resembles what the camera saw"
        ordered = sorted(self.rejections.items(), key=lambda item: -item[1])
        causes = "; ".join(f"{count} because {reason}" for reason, count in ordered)
        told = f"of {sum(self.rejections.values())} candidate poses: {causes}"
        return f"{self.obstacle}; {told}" if self.obstacle else told
