"""What the viewer can show, ready to be shown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from debrisgrasp.executive.record import StoredRun
from debrisgrasp.geometry import PointCloud
from debrisgrasp.io import Capture
from debrisgrasp.io.calibration_json import StoredCalibration
from debrisgrasp.kinematics import RobotModel, Trajectory
from debrisgrasp.planning import GraspPlan
from debrisgrasp.prototypes import GraspPrototype, GripperModel, PrototypeLibrary
from debrisgrasp.segmentation import Candidate, Segmentation

__all__ = ["PlanContent", "RunContent", "ViewContent"]


@dataclass(frozen=True, eq=False, kw_only=True)
class PlanContent:
    """A capture, perhaps with a plan on it and the motions of a grasp."""

    title: str
    capture: Capture
    cloud: PointCloud
    segmentation: Segmentation
    order: tuple[Candidate, ...] = ()
    plan: GraspPlan | None = None
    grippers: Mapping[str, GripperModel] = field(default_factory=dict)
    robot: RobotModel | None = None
    dictionary: tuple[GraspPrototype, ...] = ()
    """Prototypes as the indices of the ruled out poses count them."""
    motions: Mapping[str, Trajectory] = field(default_factory=dict)
    """Motions by name, in their order; none if none was planned."""
    motion_grasp: int = 0
    """Place in the plan of the grasp that the motions are for."""
    motion_arm: str = ""


@dataclass(frozen=True, eq=False, kw_only=True)
class RunContent:
    """The record of a run."""

    run: StoredRun
    robot: RobotModel | None = None


ViewContent = PlanContent | PrototypeLibrary | StoredCalibration | RunContent
"""Everything that can be shown."""
