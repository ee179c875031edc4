"""Settings of the planner, one record for each stage."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from debrisgrasp._arrays import require_range
from debrisgrasp._checked import checked_fields
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
from .success import SuccessModel

__all__ = ["SETTLED", "PlannerConfig"]

SETTLED = 0.8
"""From this score on, searching on hardly finds a better grasp of the same object.
Below which score other objects are tried, `PipelineConfig.doubtful` says."""

_MOST = 10_000
"""More walkers, steps or rounds than this fill memory, and outlast every deadline."""
_EFFORTS = ("walkers", "rounds", "refinement_sweeps", "refinement_steps")
_COUNTS = (
    "search_points",
    "final_points",
    "max_refined",
    "exchanged",
    "max_ranked",
    "n_best",
    "n_per_hand",
    "n_per_prototype",
)


@checked_fields
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
    refinement: LocalMove = LocalMove(position=(0.012, 0.0036), rotation=(0.12, 0.036))
    """Steps of the refinement that follows the annealing: on what the list is sorted
    by."""
    refinement_sweeps: int = 4
    """How often steps are offered; only improvements are taken."""
    doubtful_sweeps: int = 10
    """So many more where the best pose scores below `SETTLED`."""
    doubtful_share: int = 2
    """Before these a doubtful search explores once more, with so many times the starts
    and walkers."""
    refinement_steps: int = 144
    """Steps offered in each sweep, to all poses together."""
    refined: tuple[int, int] = (28, 8)
    """So many poses take steps in the first sweep, and in the last: the best."""
    max_refined: int = 48
    """At most so many distinct poses are judged by what the list is sorted by."""
    exchanged: int = 48
    """At so many of the best poses every other prototype of the hand is tried."""
    starts: int = 64
    """Jumps of each prototype of which the best become walkers."""
    walkers: int = 12
    """Chains per prototype. More find rarer grasps and take proportionally long."""
    alignments: int = 2
    """Steps that fit a pose to the surface before it is walked from, and before it is
    refined."""
    rounds: int = 3
    """Parts of the annealing; after each only the best walkers go on."""
    survivors: float = 0.5
    """Share of the walkers that go on after a round."""
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
    is. Where a side was not seen, what is short of it lowers the score. 0 trusts the
    prototype instead."""
    success: SuccessModel | None = None
    """Coefficients of the score, as fitted to flights of your own; None: the shipped
    ones."""
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

    def __post_init__(self) -> None:
        if self.reach not in ("search", "after"):
            raise ConfigError(
                "PlannerConfig.reach", got=repr(self.reach), expected="search or after"
            )
        for name in _COUNTS:
            require_range(f"PlannerConfig.{name}", getattr(self, name), 1)
        for name in _EFFORTS:
            require_range(f"PlannerConfig.{name}", getattr(self, name), 1, _MOST)
        # Fewer points never make a match, and no pose would resemble anything.
        seen = self.similarity.minimum_seen
        for name in ("search_points", "final_points"):
            if getattr(self, name) < seen:
                raise ConfigError(
                    f"PlannerConfig.{name}",
                    got=getattr(self, name),
                    expected=f"{seen} or more, which is similarity.minimum_seen",
                )
        # Farther back than the grid goes, nothing would be in the way.
        for name, way in (
            ("clearance.approach", self.clearance.approach),
            ("approach.longest", self.approach.longest),
        ):
            if way > self.scene.hand_reach:
                raise ConfigError(
                    f"PlannerConfig.{name}",
                    got=f"{way:g} m",
                    expected=f"at most {self.scene.hand_reach:g}, which is "
                    "scene.hand_reach",
                    mend="Shorten the way, or raise scene.hand_reach too.",
                )
        require_range("PlannerConfig.doubtful_sweeps", self.doubtful_sweeps, 0, _MOST)
        require_range("PlannerConfig.doubtful_share", self.doubtful_share, 1, 100)
        require_range("PlannerConfig.region_size [m]", self.region_size, 0.0, 10.0)
        require_range("PlannerConfig.starts", self.starts, self.walkers, _MOST)
        require_range("PlannerConfig.alignments", self.alignments, 0, 100)
        require_range("PlannerConfig.survivors", self.survivors, 0.01, 1.0)
        many, few = self.refined
        require_range("PlannerConfig.refined", few, 1, many)
        for share in self.global_share:
            require_range("PlannerConfig.global_share", share, 0.0, 1.0)
        require_range("PlannerConfig.minimum_score", self.minimum_score, 0.0, 1.0)
        require_range("PlannerConfig.minimum_evidence", self.minimum_evidence, 0.0, 1.0)
        require_range("PlannerConfig.mode_distance [m]", self.mode_distance, 0.0, 10.0)
        require_range("PlannerConfig.mode_angle", self.mode_angle, 0.0, 3.2)

    @property
    def first_sweeps(self) -> range:
        """Sweeps of the refinement that every search makes."""
        return range(self.refinement_sweeps)

    @property
    def last_sweeps(self) -> range:
        """Sweeps of the refinement that doubtful poses are given besides."""
        first = self.refinement_sweeps
        return range(first, first + self.doubtful_sweeps)

    def wider(self) -> PlannerConfig:
        """Return the settings with which a doubtful search explores once more."""
        starts, walkers = (
            min(self.doubtful_share * count, _MOST)
            for count in (self.starts, self.walkers)
        )
        return replace(self, starts=starts, walkers=walkers)
