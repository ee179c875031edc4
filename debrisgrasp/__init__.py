"""From one depth image of a debris pile to ranked, reachable, explained grasps.

The public names are loaded when first used, so that importing the package is quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .api import calibrate, clear, plan, plan_motion, segment, select
    from .calibration import Calibration
    from .errors import DebrisGraspError
    from .executive import SimulatedTask
    from .geometry import SE3, Bounds, Intrinsics, PointCloud
    from .io import Capture
    from .pipeline import Pipeline, PipelineConfig, PlanningResult, Progress
    from .planning import Grasp, GraspPlan, PlannerConfig
    from .settings import Settings

__version__ = "0.1.0"

__all__ = [
    "SE3",
    "Bounds",
    "Calibration",
    "Capture",
    "DebrisGraspError",
    "Grasp",
    "GraspPlan",
    "Intrinsics",
    "Pipeline",
    "PipelineConfig",
    "PlannerConfig",
    "PlanningResult",
    "PointCloud",
    "Progress",
    "Settings",
    "SimulatedTask",
    "__version__",
    "calibrate",
    "clear",
    "plan",
    "plan_motion",
    "segment",
    "select",
]

_HOME = {
    "api": ("calibrate", "clear", "plan", "plan_motion", "segment", "select"),
    "calibration": ("Calibration",),
    "errors": ("DebrisGraspError",),
    "executive": ("SimulatedTask",),
    "geometry": ("SE3", "Bounds", "Intrinsics", "PointCloud"),
    "io": ("Capture",),
    "pipeline": ("Pipeline", "PipelineConfig", "PlanningResult", "Progress"),
    "planning": ("Grasp", "GraspPlan", "PlannerConfig"),
    "settings": ("Settings",),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'debrisgrasp' has no attribute {name!r}")
    return getattr(import_module(f"debrisgrasp.{_MODULE_OF[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
