"""A plan that was saved, beside the capture that it was made on."""

from __future__ import annotations

import os

from debrisgrasp.errors import ConfigError
from debrisgrasp.io import Capture, point_colors
from debrisgrasp.io.plan_json import load_plan
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.prototypes import load_grippers
from debrisgrasp.segmentation import segment_cloud

from .result import PlanningResult

__all__ = ["recall_plan"]


def recall_plan(
    path: str | os.PathLike[str],
    capture: Capture,
    robot: RobotModel | None,
    *,
    grippers: str | os.PathLike[str] | None = None,
) -> PlanningResult:
    """Read a saved plan as the result that it was, with nothing searched anew.

    Parameters
    ----------
    path
        What `PlanningResult.save` wrote.
    capture
        The one that the plan was made on.
    robot
        The one that it was made for; None for a floating hand.
    grippers
        Folder of files of further hands.

    Raises
    ------
    ConfigError
        If the file is malformed, or the plan is for another robot or capture.
    """
    plan, name = load_plan(path), "none" if robot is None else robot.name
    if plan.robot != name:
        raise ConfigError(
            "robot", got=name, expected=f"{plan.robot}, for which {path} was made"
        )
    cloud = capture.cloud()
    found = segment_cloud(cloud, colors=point_colors(capture))
    is_there = plan.object_label <= len(found.segments)
    if is_there and plan.object_label and plan.region is not None:
        points = cloud.points[found.points_of(plan.object_label)]
        is_there = bool(plan.region.contains(points).any())
    if not is_there:
        raise ConfigError(
            "capture",
            got=f"one without object {plan.object_label} where the plan has it",
            expected=f"the one that {path} was made on",
        )
    return PlanningResult(
        plan=plan,
        capture=capture,
        cloud=cloud,
        segmentation=found,
        order=(),
        robot=robot,
        grippers=load_grippers(grippers),
    )
