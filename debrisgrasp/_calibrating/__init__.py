"""Layer 6: calibration of a robot's camera, where the points come from its arm."""

from .postures import Posture, PosturePlan, View, choose_postures
from .rig import CalibrationRig, observations_of, rig_of

__all__ = [
    "CalibrationRig",
    "Posture",
    "PosturePlan",
    "View",
    "choose_postures",
    "observations_of",
    "rig_of",
]
