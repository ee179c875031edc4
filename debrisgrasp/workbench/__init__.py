"""Layer 8: prototypes made from captures and from recorded grasps."""

from .experience import GraspRecord, load_records, recorded, save_records
from .learn import Cluster, LearnConfig, Learned, learn
from .record import Recording, parse_hand_pose, record, taught_by_joints

__all__ = [
    "Cluster",
    "GraspRecord",
    "LearnConfig",
    "Learned",
    "Recording",
    "learn",
    "load_records",
    "parse_hand_pose",
    "record",
    "recorded",
    "save_records",
    "taught_by_joints",
]
