"""What a report shows: one capture, its segments, and the plan made from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from debrisgrasp._arrays import IntArray
from debrisgrasp.geometry import PointCloud
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.planning import GraspPlan
from debrisgrasp.prototypes import GripperModel
from debrisgrasp.segmentation import Candidate, Segmentation

__all__ = ["Image", "Report"]


class Image(Protocol):
    """What a report needs of a capture."""

    @property
    def name(self) -> str:
        """What to call it."""
        ...

    @property
    def rgb(self) -> NDArray[np.uint8] | None:
        """Colours, shape (height, width, 3), or None if there are none."""
        ...


class Planned(Protocol):
    """What a report needs of a `debrisgrasp.PlanningResult`."""

    @property
    def capture(self) -> Image | None:
        """Where the cloud came from."""
        ...

    @property
    def cloud(self) -> PointCloud:
        """All measured points, base frame."""
        ...

    @property
    def segmentation(self) -> Segmentation:
        """Labels of those points."""
        ...

    @property
    def plan(self) -> GraspPlan:
        """Grasps, best first."""
        ...

    @property
    def grippers(self) -> Mapping[str, GripperModel]:
        """Hands that the plan names."""
        ...

    @property
    def robot(self) -> RobotModel | None:
        """None for a floating hand."""
        ...

    @property
    def order(self) -> tuple[Candidate, ...]:
        """Objects in the order in which they would be taken."""
        ...


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Report:
    """Everything that one report shows."""

    title: str
    """Heading, for instance the name of the capture."""
    cloud: PointCloud
    """All measured points, base frame."""
    segmentation: Segmentation
    """Labels of the points of ``cloud``."""
    plan: GraspPlan
    grippers: Mapping[str, GripperModel]
    """The hands that the plan names."""
    capture: Image | None = None
    """Where ``cloud`` came from, for its colour image; None if there is none."""
    robot: RobotModel | None = None
    """Drawn in the posture of each grasp; None for a floating hand."""
    order: tuple[Candidate, ...] = ()
    """Objects in the order in which they would be taken, first to last."""

    @classmethod
    def of(cls, result: Planned, title: str) -> Report:
        """Show all of a planning result, under a heading."""
        return cls(
            title=title,
            capture=result.capture,
            cloud=result.cloud,
            segmentation=result.segmentation,
            plan=result.plan,
            grippers=result.grippers,
            robot=result.robot,
            order=result.order,
        )

    def __post_init__(self) -> None:
        self.cloud.require_frame("base")
        self.segmentation.require_of(self.cloud)

    @property
    def labels(self) -> IntArray:
        """One label per point, shape (n,)."""
        return np.asarray(self.segmentation.labels)
