"""Edge: captures, plans and settings on disk.

Plans are in `debrisgrasp.io.plan_json`, apart because they need the planner's records.
"""

from debrisgrasp._files import data_path, read_json, read_yaml, write_atomic

from .camera_pose import CameraPose, parse_camera_pose
from .capture import Capture
from .labels import measured, point_colors, save_labels

__all__ = [
    "CameraPose",
    "Capture",
    "data_path",
    "measured",
    "parse_camera_pose",
    "point_colors",
    "read_json",
    "read_yaml",
    "save_labels",
    "write_atomic",
]
