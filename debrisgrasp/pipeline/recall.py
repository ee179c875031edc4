"""A plan that was saved, beside the capture that it was made on."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from debrisgrasp._checked import checked
from debrisgrasp._stopwatch import Stopwatch
from debrisgrasp._words import arm_called
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import SE3, Bounds, so3
from debrisgrasp.io import Capture
from debrisgrasp.io.plan_json import load_plan
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.planning import Grasp, GraspPlan, SceneConfig
from debrisgrasp.prototypes import FURTHER_HANDS, GripperModel, load_grippers
from debrisgrasp.segmentation import SegmentationConfig, region_of_interest

from .inputs import with_hands
from .perception import Perception
from .result import PlanningResult
from .targets import Target, choose_targets

__all__ = ["recall_plan"]

_SAME = 0.9
"""So much of an object lies in the region of its plan, if it is the same object."""
_FARTHEST = 0.5
"""No pre-grasp is farther from its grasp [m]."""
_STRAIGHT = 1e-3
"""Angle by which pre-grasp and grasp may be turned to each other [rad]."""
_NEAR, _TURNED = 0.01, 0.05
"""Distance [m] and angle [rad] between a grasp and where its joints take the palm."""
_TOGETHER = "Pose, pre-grasp and joints of a grasp belong together: plan anew."
_ROUNDED = 1e-8
"""Joints [rad or m] in a file are rounded to a tenth of this."""
_EVEN = 1e-4
"""Margins of a region are equal within this [m]."""


@checked
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
    UnknownNameError
        If a grasp has an arm or a preshape that there is not.
    CaptureError
        If the capture has a mask with no measured point inside it.
    """
    plan, name = load_plan(path), "none" if robot is None else robot.name
    if plan.robot != name:
        raise ConfigError(
            "robot", got=name, expected=f"{plan.robot}, for which {path} was made"
        )
    seen = Perception.of(
        capture, SegmentationConfig(), SceneConfig(), Stopwatch(None), workers=1
    )
    found = seen.segmentation
    is_there = plan.object_label <= len(found.segments)
    if is_there and plan.object_label and plan.region is not None:
        points = seen.cloud.points[found.points_of(plan.object_label)]
        is_there = bool(plan.region.contains(points).mean() >= _SAME)
    if not is_there:
        raise ConfigError(
            "capture",
            got=f"one without object {plan.object_label} where the plan has it",
            expected=f"the one that {path} was made on",
        )
    hands = load_grippers(grippers)
    grasps = []
    for i, grasp in enumerate(plan.grasps):
        _require_known(f"{path}, grasps[{i}]", grasp, plan, robot, hands)
        grasps.append(_within_limits(grasp, robot))
        _require_consistent(f"{path}, grasps[{i}]", grasps[-1], robot)
    return PlanningResult(
        plan=replace(plan, grasps=tuple(grasps)),
        capture=capture,
        cloud=seen.cloud,
        segmentation=found,
        is_own=seen.lifted_with(_target_of(plan, seen)),
        order=(),
        robot=None if robot is None else with_hands(robot, hands),
        grippers=hands,
    )


def _target_of(plan: GraspPlan, seen: Perception) -> Target | None:
    """Find again what a plan was for; None if that was nothing."""
    if plan.region is None:
        return None
    if seen.is_marked is not None and _is_around(plan.region, seen):
        return Target(plan.object_label, plan.region, seen.is_marked)
    (target,) = choose_targets(
        seen.cloud,
        seen.segmentation,
        (),
        region=plan.region,
        object_label=plan.object_label or None,
        is_marked=seen.is_marked,
        margin=0.0,
    )
    return target


def _is_around(region: Bounds, seen: Perception) -> bool:
    """Whether a region is that of the marked points, whatever its margin."""
    if not np.any(seen.is_marked):
        return False  # `choose_targets` says so
    box = region_of_interest(seen.cloud.points[seen.is_marked], margin=0.0)
    margins = [box.lower - region.lower, region.upper - box.upper]
    return bool(np.ptp(margins) < _EVEN)


def _require_known(
    what: str,
    grasp: Grasp,
    plan: GraspPlan,
    robot: RobotModel | None,
    hands: Mapping[str, GripperModel],
) -> None:
    """Refuse a grasp with a hand, an arm or an object that the plan can't have."""
    if grasp.gripper not in hands:
        raise ConfigError(
            f"{what}.gripper",
            got=grasp.gripper,
            expected=" or ".join(sorted(hands)),
            mend=FURTHER_HANDS,
        )
    if robot is not None and grasp.arm is not None:
        own = robot.arm(grasp.arm).gripper
        if grasp.gripper != own:
            raise ConfigError(
                f"{what}.gripper",
                got=grasp.gripper,
                expected=f"{own}, which the {arm_called(grasp.arm)} carries",
            )
        joints = robot.chain(grasp.arm).joint_names
        if set(grasp.joints or ()) != set(joints):
            raise ConfigError(
                f"{what}.joints",
                got=", ".join(grasp.joints or ()) or "none",
                expected=", ".join(joints),
            )
    hands[grasp.gripper].preshape(grasp.preshape)
    if plan.object_label and grasp.object_label != plan.object_label:
        raise ConfigError(
            f"{what}.object",
            got=grasp.object_label,
            expected=f"{plan.object_label}, which the plan is for",
        )


def _within_limits(grasp: Grasp, robot: RobotModel | None) -> Grasp:
    """Take joints back to a limit that they are beyond by the rounding of the file."""
    if robot is None or grasp.arm is None or not grasp.joints:
        return grasp
    chain = robot.chain(grasp.arm)
    q = chain.vector(grasp.joints)
    inner = np.clip(q, chain.lower, chain.upper)
    is_rounded = np.abs(inner - q) < _ROUNDED
    return replace(grasp, joints=chain.named(np.where(is_rounded, inner, q)))


def _require_consistent(what: str, grasp: Grasp, robot: RobotModel | None) -> None:
    """Refuse a grasp whose pre-grasp or joints are not those of its pose."""
    T, away = grasp.T_base_hand, grasp.T_base_pregrasp
    far, turn = _apart(T, away)
    ahead = float((T.p - away.p) @ T.R[:, 2])
    if not 0.0 < far <= _FARTHEST or turn > _STRAIGHT or ahead <= 0.5 * far:
        raise ConfigError(
            f"{what}.approach.pregrasp",
            got=f"{far:.3f} m from the pose, turned by {turn:.3f} rad",
            expected=f"the same palm up to {_FARTHEST:g} m behind the pose",
            mend=_TOGETHER,
        )
    if robot is None or grasp.arm is None or not grasp.joints:
        return
    chain = robot.chain(grasp.arm)
    q = chain.vector(grasp.joints)
    gap, turn = _apart(T, chain.fk(q))
    if gap > _NEAR or turn > _TURNED or ((q < chain.lower) | (q > chain.upper)).any():
        raise ConfigError(
            f"{what}.joints",
            got=f"values that take the palm {gap:.3f} m, {turn:.2f} rad off the pose",
            expected="values within the joint limits that take it there",
            mend=_TOGETHER,
        )


def _apart(a: SE3, b: SE3) -> tuple[float, float]:
    """Distance [m] and angle [rad] between two poses."""
    turn = so3.log(a.R.T @ b.R)
    return float(np.linalg.norm(b.p - a.p)), float(np.linalg.norm(turn))
