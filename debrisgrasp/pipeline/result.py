"""A plan together with all that led to it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass

from debrisgrasp._arrays import BoolArray, FloatArray
from debrisgrasp._checked import checked
from debrisgrasp.geometry import PointCloud
from debrisgrasp.io import Capture
from debrisgrasp.io.plan_json import save_plan
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.planning import GraspPlan
from debrisgrasp.prototypes import GraspPrototype, GripperModel
from debrisgrasp.segmentation import Candidate, Segmentation

__all__ = ["PlanningResult"]

_MAY_WELL = 1 / 3


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PlanningResult:
    """A plan together with all that led to it."""

    plan: GraspPlan
    capture: Capture
    cloud: PointCloud
    segmentation: Segmentation
    is_own: BoolArray
    """Which points of the cloud are of what the plan is for, and lifted with it, shape
    (n,)."""
    order: tuple[Candidate, ...]
    robot: RobotModel | None
    grippers: Mapping[str, GripperModel]
    dictionary: tuple[GraspPrototype, ...] = ()
    """The prototypes that were sought, in the order in which `Rejections` has them."""

    def __repr__(self) -> str:
        return f"<PlanningResult on {self.capture.name}: {self.plan!r}>"

    @property
    def object_points(self) -> FloatArray:
        """Points of what the plan is for [m], base frame, shape (n, 3)."""
        points: FloatArray = self.cloud.points[self.is_own]
        return points

    @property
    def kin_points(self) -> FloatArray:
        """Points of what may well be one with that [m], shape (k, 3).

        A frame, or what is divided by something before it, may fall apart in parts.
        What is lifted with care may touch something; what is not can't be taken at all.
        """
        label = self.plan.object_label
        if not label:
            return self.cloud.points[:0]
        is_kin = self.segmentation.belonging(label) > _MAY_WELL
        kin: FloatArray = self.cloud.points[
            is_kin[self.segmentation.labels] & ~self.is_own
        ]
        return kin

    @checked
    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the grasps as JSON (docs/formats.md); an earlier plan is replaced.

        Raises
        ------
        ConfigError
            If the file's name does not end in .json.
        OutputError
            If it can't be written, or a file is there that is no plan.
        """
        save_plan(self.plan, path)
