"""Layer 2: what a graspable shape is, and the hands that grip it."""

from .check import Finding, check
from .gripper import GripperModel, known_grippers, load_grippers
from .library import PrototypeLibrary
from .prototype import GraspPrototype, PackedPrototypes, PrototypeDefinition
from .symmetry import SpinAxis, Symmetry
from .visibility import VisibilityTable, nearest_view

__all__ = [
    "Finding",
    "GraspPrototype",
    "GripperModel",
    "PackedPrototypes",
    "PrototypeDefinition",
    "PrototypeLibrary",
    "SpinAxis",
    "Symmetry",
    "VisibilityTable",
    "check",
    "known_grippers",
    "load_grippers",
    "nearest_view",
]
