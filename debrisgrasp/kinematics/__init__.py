"""Layer 2: arms. Chains, inverse kinematics, collision of links, robot models."""

from .chain import KinematicChain
from .collision import ArmCollision
from .following import follow
from .ik import solve, solve_distinct
from .ik_types import Freedom, IkConfig, IkResult, IkStatus
from .limits import DeflectionLimits, LimitFamily, LimitSet
from .mounted import with_hand
from .nearest import solve_nearest
from .placement import BasePlacement, PlacementConfig, base_placements
from .posture import PostureCost, dexterity, mobility
from .reach import ArmReach
from .reach_files import (
    cache_folder,
    cached_reach_map,
    load_reach_map,
    save_reach_map,
)
from .reach_map import ReachMap, ReachMapConfig
from .reach_types import ReachConfig, ReachResult
from .robot import RobotModel
from .robot_file import ArmSpec
from .survey import (
    APPROACHES,
    Approach,
    ReachSurvey,
    grid_places,
    palm_poses,
    survey_reach,
)
from .trajectory import Trajectory

__all__ = [
    "APPROACHES",
    "Approach",
    "ArmCollision",
    "ArmReach",
    "ArmSpec",
    "BasePlacement",
    "DeflectionLimits",
    "Freedom",
    "IkConfig",
    "IkResult",
    "IkStatus",
    "KinematicChain",
    "LimitFamily",
    "LimitSet",
    "PlacementConfig",
    "PostureCost",
    "ReachConfig",
    "ReachMap",
    "ReachMapConfig",
    "ReachResult",
    "ReachSurvey",
    "RobotModel",
    "Trajectory",
    "base_placements",
    "cache_folder",
    "cached_reach_map",
    "dexterity",
    "follow",
    "grid_places",
    "load_reach_map",
    "mobility",
    "palm_poses",
    "save_reach_map",
    "solve",
    "solve_distinct",
    "solve_nearest",
    "survey_reach",
    "with_hand",
]
