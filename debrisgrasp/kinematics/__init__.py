"""Layer 2: arms. Chains, inverse kinematics, collision of links, robot models."""

from .chain import KinematicChain
from .collision import ArmCollision
from .ik import solve, solve_distinct
from .ik_types import IkConfig, IkResult, IkStatus
from .reach import ArmReach, ReachConfig, ReachResult
from .reach_map import ReachMap, ReachMapConfig
from .robot import RobotModel
from .robot_file import ArmSpec

__all__ = [
    "ArmCollision",
    "ArmReach",
    "ArmSpec",
    "IkConfig",
    "IkResult",
    "IkStatus",
    "KinematicChain",
    "ReachConfig",
    "ReachMap",
    "ReachMapConfig",
    "ReachResult",
    "RobotModel",
    "solve",
    "solve_distinct",
]
