"""Settings of the planner, one record for each stage."""

from __future__ import annotations

from dataclasses import dataclass

from debrisgrasp._arrays import require_range

from .annealing import Schedule
from .clearance import ClearanceConfig
from .inspection import InspectionConfig
from .proposals import LocalMove
from .scene import SceneConfig
from .similarity import SimilarityConfig

__all__ = ["PlannerConfig"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannerConfig:
    """Everything about the search that is worth tuning."""

    scene: SceneConfig = SceneConfig()
    similarity: SimilarityConfig = SimilarityConfig()
    clearance: ClearanceConfig = ClearanceConfig()
    inspection: InspectionConfig = InspectionConfig()
    schedule: Schedule = Schedule()
    local: LocalMove = LocalMove()
    """Small steps of the annealing."""
    global_share: tuple[float, float] = (0.6, 0.1)
    """Probability of a jump instead of a small step, at the start and at the end."""
    refinement: LocalMove = LocalMove(position=(0.006, 0.001), rotation=(0.06, 0.01))
    """Steps of the refinement that follows the annealing."""
    refinement_sweeps: int = 40
    """Steps offered to every distinct pose; only improvements are taken."""
    walkers: int = 32
    """Chains per prototype. More find rarer grasps and take proportionally long."""
    search_points: int = 40
    """Points of each prototype used during the search."""
    final_points: int = 160
    """Points of each prototype that the final score uses."""
    minimum_score: float = 0.35
    """Grasps whose Q-hat is below this are not offered."""
    minimum_evidence: float = 0.5
    """Where a finger ends in space that was never seen, this share of the prototype's
    surface facing the palm must have been seen to match: it tells how thick the object
    is. 0 trusts the prototype instead."""
    n_best: int = 20
    """How many distinct grasps to return."""
    mode_distance: float = 0.03
    """Palms of one hand nearer than this [m], and within ``mode_angle``, are the same
    grasp."""
    mode_angle: float = 0.4
    """See ``mode_distance`` [rad]."""
    max_ranked: int = 120
    """At most so many distinct poses are tried on the arms."""
    lever_scale: float = 0.35
    """Horizontal distance from the object's visible centre at which the score is
    halved [m]: a heavy object gripped at its end twists out of the hand."""

    def __post_init__(self) -> None:
        counts = ("walkers", "search_points", "final_points", "n_best", "max_ranked")
        for name in counts:
            require_range(f"PlannerConfig.{name}", getattr(self, name), 1)
        require_range("PlannerConfig.refinement_sweeps", self.refinement_sweeps, 1)
        for share in self.global_share:
            require_range("PlannerConfig.global_share", share, 0.0, 1.0)
        require_range("PlannerConfig.minimum_score", self.minimum_score, 0.0, 1.0)
        require_range("PlannerConfig.minimum_evidence", self.minimum_evidence, 0.0, 1.0)
        require_range("PlannerConfig.mode_distance", self.mode_distance, 0.0)
        require_range("PlannerConfig.mode_angle", self.mode_angle, 0.0, 3.2)
        require_range("PlannerConfig.lever_scale", self.lever_scale, 0.01)
