"""Layer 2: a cloud divided into objects, and which of them to take first."""

from .ground import GroundConfig
from .lccp import LccpConfig
from .pipeline import SegmentationConfig, segment_cloud
from .segmentation import GroundReport, Segment, Segmentation, SegmentEdges
from .selection import (
    Candidate,
    PriorityPoint,
    SelectionPolicy,
    region_of_interest,
)
from .singulation import SingulationConfig
from .supervoxels import SupervoxelConfig
from .voxels import Binning

__all__ = [
    "Binning",
    "Candidate",
    "GroundConfig",
    "GroundReport",
    "LccpConfig",
    "PriorityPoint",
    "Segment",
    "SegmentEdges",
    "Segmentation",
    "SegmentationConfig",
    "SelectionPolicy",
    "SingulationConfig",
    "SupervoxelConfig",
    "region_of_interest",
    "segment_cloud",
]
