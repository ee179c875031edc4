"""Layer 4: motion of an arm through known space, from posture to posture."""

from .config import MotionConfig
from .edges import EdgeTest
from .exact import Contact, ExactTest
from .ompl_engine import connect_by_ompl
from .planner import MotionPlanner
from .query import samples_of
from .result import MotionCounts, MotionPlan, MotionStatus
from .rrt import PathQuery, PathSearch, connect
from .space import MotionSpace, UnknownSpace

__all__ = [
    "Contact",
    "EdgeTest",
    "ExactTest",
    "MotionConfig",
    "MotionCounts",
    "MotionPlan",
    "MotionPlanner",
    "MotionSpace",
    "MotionStatus",
    "PathQuery",
    "PathSearch",
    "UnknownSpace",
    "connect",
    "connect_by_ompl",
    "samples_of",
]
