"""Layer 3: search for grasps, Q = S R C (Eq. 2-5)."""

from .advice import Advice, Situation
from .annealing import Schedule
from .approach import ApproachConfig
from .clearance import ClearanceConfig
from .config import SETTLED, PlannerConfig
from .inspection import InspectionConfig
from .ledger import Rejections
from .load_forecast import LoadForecast
from .mass import LoadConfig, ObjectMass
from .matching import Match
from .obstacles import ObstacleMap
from .plan import Grasp, GraspPlan, PassedOver, Retreat
from .planner import GraspPlanner
from .proposals import LocalMove
from .reach import Arm, ReachAnswer
from .robustness import PoseUncertainty
from .scene import GraspScene, SceneConfig
from .scene_search import Watch
from .search_result import SearchResult
from .similarity import Measure, SimilarityConfig
from .success import SUCCESS_TERMS, SuccessForecast, SuccessModel

__all__ = [
    "SETTLED",
    "SUCCESS_TERMS",
    "Advice",
    "ApproachConfig",
    "Arm",
    "ClearanceConfig",
    "Grasp",
    "GraspPlan",
    "GraspPlanner",
    "GraspScene",
    "InspectionConfig",
    "LoadConfig",
    "LoadForecast",
    "LocalMove",
    "Match",
    "Measure",
    "ObjectMass",
    "ObstacleMap",
    "PassedOver",
    "PlannerConfig",
    "PoseUncertainty",
    "ReachAnswer",
    "Rejections",
    "Retreat",
    "SceneConfig",
    "Schedule",
    "SearchResult",
    "SimilarityConfig",
    "Situation",
    "SuccessForecast",
    "SuccessModel",
    "Watch",
]
