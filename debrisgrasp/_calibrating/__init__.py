"""Layer 6: calibration of a robot's camera, where the points come from its arm."""

from .of_file import Rig, limits_with, observations_of, require_same_robot, rig_of
from .on_arm import pose_on_arm
from .postures import Posture, PosturePlan, View, choose_postures, information_of
from .rig import CalibrationRig
from .wrist import WristRig

__all__ = [
    "CalibrationRig",
    "Posture",
    "PosturePlan",
    "Rig",
    "View",
    "WristRig",
    "choose_postures",
    "information_of",
    "limits_with",
    "observations_of",
    "pose_on_arm",
    "require_same_robot",
    "rig_of",
]
