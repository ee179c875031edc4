"""Layer 3: search for grasps, Q = S R C (Eq. 2-5)."""

from .annealing import Schedule
from .clearance import ClearanceConfig
from .config import PlannerConfig
from .inspection import InspectionConfig
from .obstacles import ObstacleMap
from .plan import Grasp, GraspPlan, PassedOver
from .planner import GraspPlanner, SearchResult
from .proposals import LocalMove
from .reach import Arm, ReachAnswer
from .robustness import PoseUncertainty
from .scene import GraspScene, SceneConfig
from .search import Watch
from .similarity import SimilarityConfig

__all__ = [
    "Arm",
    "ClearanceConfig",
    "Grasp",
    "GraspPlan",
    "GraspPlanner",
    "GraspScene",
    "InspectionConfig",
    "LocalMove",
    "ObstacleMap",
    "PassedOver",
    "PlannerConfig",
    "PoseUncertainty",
    "ReachAnswer",
    "SceneConfig",
    "Schedule",
    "SearchResult",
    "SimilarityConfig",
    "Watch",
]
