"""A plan together with all that led to it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass

from debrisgrasp._arrays import FloatArray
from debrisgrasp._checked import checked
from debrisgrasp.geometry import PointCloud
from debrisgrasp.io import Capture
from debrisgrasp.io.plan_json import save_plan
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.planning import GraspPlan
from debrisgrasp.prototypes import GraspPrototype, GripperModel
from debrisgrasp.segmentation import Candidate, Segmentation

from .targets import whole_of

__all__ = ["PlanningResult"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PlanningResult:
    """A plan together with all that led to it."""

    plan: GraspPlan
    capture: Capture
    cloud: PointCloud
    segmentation: Segmentation
    order: tuple[Candidate, ...]
    robot: RobotModel | None
    grippers: Mapping[str, GripperModel]
    dictionary: tuple[GraspPrototype, ...] = ()
    """The prototypes that were sought, in the order in which `Rejections` has them."""

    @property
    def object_points(self) -> FloatArray:
        """Points of what the plan is for [m], base frame, shape (n, 3)."""
        plan, labels = self.plan, self.segmentation.labels
        is_own = labels == (plan.object_label or -1)
        if not plan.object_label and plan.region is not None:
            is_own = (labels > 0) & plan.region.contains(self.cloud.points)
        if not plan.object_label or self.capture.mask is not None:
            is_own = whole_of(self.segmentation, plan.object_label, is_own)
        points: FloatArray = self.cloud.points[is_own]
        return points

    @checked
    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the grasps as JSON (docs/formats.md)."""
        save_plan(self.plan, path)
