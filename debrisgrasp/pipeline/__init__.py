"""The stages chained: from a capture to ranked grasps, from a grasp to its motions."""

from .config import PipelineConfig
from .executable import GraspMotions, first_executable
from .grasp_chain import GraspMotion, MotionsConfig
from .inputs import with_hands
from .notes import ground_notes, mask_notes
from .passage import Passage
from .perception import Perception, motion_space, segmented
from .pipeline import Pipeline, Progress
from .reasons import is_ground, too_small
from .recall import recall_plan
from .result import PlanningResult
from .self_filter import without_robot
from .targets import Target, choose_targets

__all__ = [
    "GraspMotion",
    "GraspMotions",
    "MotionsConfig",
    "Passage",
    "Perception",
    "Pipeline",
    "PipelineConfig",
    "PlanningResult",
    "Progress",
    "Target",
    "choose_targets",
    "first_executable",
    "ground_notes",
    "is_ground",
    "mask_notes",
    "motion_space",
    "recall_plan",
    "segmented",
    "too_small",
    "with_hands",
    "without_robot",
]
