"""Layer 2: what a graspable shape is, and the hands that grip it."""

from .adapt import Adaptation, adapt
from .check import Finding, check
from .coverage import CoverageMap, coverage
from .from_mesh import surface_from_mesh
from .gripper import (
    FURTHER_HANDS,
    GripperModel,
    known_grippers,
    load_grippers,
    require_hands,
    with_shipped,
)
from .hand_poses import HandPose, propose_hand_poses
from .in_hand import around_grip, settled
from .library import PrototypeLibrary
from .likeness import Likeness, duplicates, half_turns, shape_distance
from .parametric import prototype_of_shape
from .placing import Grip, soundest
from .prototype import (
    GraspPrototype,
    PackedPrototypes,
    PrototypeDefinition,
    require_name,
)
from .prototype_file import definition_from, write_new_prototype
from .surface_shape import SurfaceShape
from .symmetry import SpinAxis, Symmetry
from .visibility import VisibilityTable

__all__ = [
    "FURTHER_HANDS",
    "Adaptation",
    "CoverageMap",
    "Finding",
    "GraspPrototype",
    "Grip",
    "GripperModel",
    "HandPose",
    "Likeness",
    "PackedPrototypes",
    "PrototypeDefinition",
    "PrototypeLibrary",
    "SpinAxis",
    "SurfaceShape",
    "Symmetry",
    "VisibilityTable",
    "adapt",
    "around_grip",
    "check",
    "coverage",
    "definition_from",
    "duplicates",
    "half_turns",
    "known_grippers",
    "load_grippers",
    "propose_hand_poses",
    "prototype_of_shape",
    "require_hands",
    "require_name",
    "settled",
    "shape_distance",
    "soundest",
    "surface_from_mesh",
    "with_shipped",
    "write_new_prototype",
]
