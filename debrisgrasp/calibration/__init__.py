"""Layer 3: where the camera is, from points; knows poses and points, not robots."""

from .camera import CalibratedCamera, Known
from .choice import Choice, choose_places, information_at
from .decision import CalibrationConfig, Decision, Finding
from .drift import DriftConfig, DriftMonitor, DriftReport, DriftStatus, Trend
from .hand_eye import Attempt, Calibration, calibrate
from .head import Head
from .marker import MarkerConfig, MarkerFound, MarkerMissing, find_marker
from .observations import (
    KINEMATIC_SIGMA,
    MEASUREMENT_SIGMA,
    Observations,
    require_in_base,
)
from .tags import TagFound, find_tags
from .uncertainty import (
    BEFORE_CAMERA,
    WORKSPACE,
    WorkspaceError,
    displacement,
    predicted_error,
)

__all__ = [
    "BEFORE_CAMERA",
    "KINEMATIC_SIGMA",
    "MEASUREMENT_SIGMA",
    "WORKSPACE",
    "Attempt",
    "CalibratedCamera",
    "Calibration",
    "CalibrationConfig",
    "Choice",
    "Decision",
    "DriftConfig",
    "DriftMonitor",
    "DriftReport",
    "DriftStatus",
    "Finding",
    "Head",
    "Known",
    "MarkerConfig",
    "MarkerFound",
    "MarkerMissing",
    "Observations",
    "TagFound",
    "Trend",
    "WorkspaceError",
    "calibrate",
    "choose_places",
    "displacement",
    "find_marker",
    "find_tags",
    "information_at",
    "predicted_error",
    "require_in_base",
]
