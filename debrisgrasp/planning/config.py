"""Settings of the planner, one record for each stage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from debrisgrasp._arrays import require_range
from debrisgrasp.errors import ConfigError

from .annealing import Schedule
from .approach import ApproachConfig
from .clearance import ClearanceConfig
from .contacts import ContactConfig
from .inspection import InspectionConfig
from .mass import LoadConfig
from .proposals import LocalMove
from .robustness import PoseUncertainty
from .scene import SceneConfig
from .similarity import SimilarityConfig

__all__ = ["PlannerConfig"]


_COUNTS = (
    "walkers",
    "rounds",
    "settle_every",
    "search_points",
    "final_points",
    "refinement_sweeps",
    "max_refined",
    "max_steadied",
    "steadying_sweeps",
    "max_ranked",
    "n_best",
    "n_per_hand",
    "n_per_prototype",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannerConfig:
    """Everything about the search that is worth tuning."""

    scene: SceneConfig = SceneConfig()
    similarity: SimilarityConfig = SimilarityConfig()
    clearance: ClearanceConfig = ClearanceConfig()
    inspection: InspectionConfig = InspectionConfig()
    contact: ContactConfig = ContactConfig()
    load: LoadConfig = LoadConfig()
    approach: ApproachConfig = ApproachConfig()
    schedule: Schedule = Schedule()
    local: LocalMove = LocalMove()
    """Small steps of the annealing."""
    global_share: tuple[float, float] = (0.6, 0.1)
    """Probability of a jump instead of a small step, at the start and at the end."""
    refinement: LocalMove = LocalMove(position=(0.006, 0.001), rotation=(0.06, 0.01))
    """Steps of the refinement that follows the annealing."""
    refinement_sweeps: int = 15
    """Steps offered to every distinct pose; only improvements are taken."""
    steadying: LocalMove = LocalMove(position=(0.01, 0.002), rotation=(0.1, 0.02))
    """Steps of what follows: the best go to where they expect the highest quality."""
    steadying_sweeps: int = 8
    """Steps offered to each of them; only improvements are taken."""
    max_steadied: int = 24
    """At most so many poses take those steps."""
    max_refined: int = 200
    """At most so many distinct poses are refined."""
    starts: int = 64
    """Jumps of each prototype of which the best become walkers."""
    walkers: int = 32
    """Chains per prototype. More find rarer grasps and take proportionally long."""
    alignments: int = 2
    """Steps that fit a pose to the surface before it is walked from, and before it is
    refined."""
    rounds: int = 5
    """Parts of the annealing; after each only the best walkers go on."""
    survivors: float = 0.5
    """Share of the walkers that go on after a round."""
    settle_every: int = 6
    """Sweeps after which the best states are solved for the arms. More often keeps the
    search closer to what can be reached, and takes longer."""
    search_points: int = 24
    """Visible points of each prototype used during the search."""
    final_points: int = 80
    """Visible points of each prototype that the final score uses."""
    uncertainty: PoseUncertainty = PoseUncertainty()
    """How far the hand may end up from the planned pose: the ranking is by the quality
    expected then."""
    minimum_score: float = 0.35
    """Grasps whose Q-hat is below this are not offered."""
    minimum_evidence: float = 0.5
    """Where a finger ends in space that was never seen, this share of the prototype's
    surface facing the palm must have been seen to match: it tells how thick the object
    is. 0 trusts the prototype instead."""
    n_best: int = 20
    """How many distinct grasps to return."""
    n_per_hand: int = 1000
    """At most so many of them of each hand."""
    n_per_prototype: int = 1000
    """At most so many of them of each prototype."""
    region_size: float = 0.10
    """Grips nearer than this [m] are in the same region of the object: the best of each
    region is returned before the second best of any."""
    mode_distance: float = 0.03
    """Palms of one hand nearer than this [m], and within ``mode_angle``, are the same
    grasp."""
    mode_angle: float = 0.4
    """See ``mode_distance`` [rad]."""
    max_ranked: int = 120
    """At most so many distinct poses are tried on the arms."""
    reach: Literal["search", "after"] = "search"
    """``"search"``: poses that no arm may reach count as matching nothing during the
    search (Eq. 2-3 as written). ``"after"``: the search knows of no arm, and what it
    finds is tried on the arms in the end, which is how the paper had to do it."""
    lever_scale: float = 0.35
    """Horizontal distance from the object's visible centre at which the score is
    halved [m]: a heavy object gripped at its end twists out of the hand."""

    def __post_init__(self) -> None:
        if self.reach not in ("search", "after"):
            raise ConfigError(
                "PlannerConfig.reach", got=repr(self.reach), expected="search or after"
            )
        for name in _COUNTS:
            require_range(f"PlannerConfig.{name}", getattr(self, name), 1)
        require_range("PlannerConfig.region_size", self.region_size, 0.0)
        require_range("PlannerConfig.starts", self.starts, self.walkers)
        require_range("PlannerConfig.alignments", self.alignments, 0)
        require_range("PlannerConfig.survivors", self.survivors, 0.01, 1.0)
        for share in self.global_share:
            require_range("PlannerConfig.global_share", share, 0.0, 1.0)
        require_range("PlannerConfig.minimum_score", self.minimum_score, 0.0, 1.0)
        require_range("PlannerConfig.minimum_evidence", self.minimum_evidence, 0.0, 1.0)
        require_range("PlannerConfig.mode_distance", self.mode_distance, 0.0)
        require_range("PlannerConfig.mode_angle", self.mode_angle, 0.0, 3.2)
        require_range("PlannerConfig.lever_scale", self.lever_scale, 0.01)
