"""Layer 2: a cloud divided into objects, and which of them to take first."""

from .given import segmentation_of_labels
from .ground import GroundConfig
from .lccp import LccpConfig
from .marked import WHOLE_SHARE, with_mark
from .pipeline import SegmentationConfig, segment_cloud
from .segmentation import (
    GroundReport,
    PointKind,
    Segment,
    Segmentation,
    SegmentEdges,
    Surrounding,
)
from .selection import (
    DEFAULT_POINT,
    Candidate,
    OperatorPick,
    PriorityPoint,
    SelectionPolicy,
    ordered,
    region_of_interest,
)
from .singulation import SingulationConfig
from .supervoxel_config import SupervoxelConfig
from .support import CLEAR, GROUND, SupportConfig, SupportGraph, support_graph
from .support_aware import SupportAware
from .surroundings import SurroundingsConfig
from .voxels import Binning

__all__ = [
    "CLEAR",
    "DEFAULT_POINT",
    "GROUND",
    "WHOLE_SHARE",
    "Binning",
    "Candidate",
    "GroundConfig",
    "GroundReport",
    "LccpConfig",
    "OperatorPick",
    "PointKind",
    "PriorityPoint",
    "Segment",
    "SegmentEdges",
    "Segmentation",
    "SegmentationConfig",
    "SelectionPolicy",
    "SingulationConfig",
    "SupervoxelConfig",
    "SupportAware",
    "SupportConfig",
    "SupportGraph",
    "Surrounding",
    "SurroundingsConfig",
    "ordered",
    "region_of_interest",
    "segment_cloud",
    "segmentation_of_labels",
    "support_graph",
    "with_mark",
]
