"""Which files the viewer opens, and how they become something to show."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from debrisgrasp._files import is_yaml, read_json, yaml_files
from debrisgrasp._unreadable import why_nothing_there
from debrisgrasp.errors import ConfigError, UnknownNameError
from debrisgrasp.executive.record import load_run
from debrisgrasp.io import Capture
from debrisgrasp.io.calibration_json import SCHEMA as CALIBRATION
from debrisgrasp.io.calibration_json import load_calibration
from debrisgrasp.io.motion_json import MOTION_SCHEMA, StoredMotion, load_motion
from debrisgrasp.io.plan_json import SCHEMA as PLAN
from debrisgrasp.io.plan_json import load_plan
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.pipeline import segmented
from debrisgrasp.planning import GraspPlan
from debrisgrasp.prototypes import PrototypeLibrary, load_grippers
from debrisgrasp.segmentation import SupportAware

from .contents import PlanContent, RunContent, ViewContent

__all__ = ["content_of", "seen"]

_THERE = 0.01
"""Nearer to a grasp [m] a motion has come there."""
_KNOWN = (
    "a capture (.npz, .ply, .pcd, depth .png or its folder), a plan, a calibration, a "
    "prototype (.yaml) or a folder of them, or the folder of a run"
)


def content_of(
    path: str | os.PathLike[str],
    *,
    capture: Capture | None = None,
    robot: str | None = None,
    motion: str | os.PathLike[str] | None = None,
    grippers: str | os.PathLike[str] | None = None,
) -> ViewContent:
    """Read a file or folder that the viewer can show.

    Parameters
    ----------
    capture
        What a plan was made on; needed for a plan, and taken for ``path`` if that is a
        capture that was read already.
    robot
        Shown beside a plan, calibration or run; by default the one that a plan names,
        and roman beside a calibration or run. ``"none"`` for no robot.
    motion
        Motions of a grasp of a plan (``debrisgrasp motion --out``).
    grippers
        Folder of further hands.

    Raises
    ------
    ConfigError, CaptureError
        If the file is malformed, or of no kind that can be shown.
    """
    path = Path(path)
    if nothing := why_nothing_there(path):
        raise ConfigError(str(path), got=nothing, expected=_KNOWN)
    if path.is_dir() and (path / "events.jsonl").exists():
        return RunContent(run=load_run(path), robot=_robot(robot or "roman"))
    if is_yaml(path) or (
        path.is_dir() and yaml_files(path, "prototypes") and not any(path.glob("*.png"))
    ):
        return PrototypeLibrary.load(path, grippers=load_grippers(grippers))
    if path.suffix.lower() == ".json":
        return _from_json(path, capture, robot, motion, grippers)
    return seen(path.stem, capture or Capture.load(path))


def _from_json(
    path: Path,
    capture: Capture | None,
    robot: str | None,
    motion: str | os.PathLike[str] | None,
    grippers: str | os.PathLike[str] | None,
) -> ViewContent:
    content = read_json(path)
    schema = content.get("schema") if isinstance(content, dict) else None
    if schema == CALIBRATION:
        return load_calibration(path)
    if schema != PLAN:
        raise ConfigError(
            f"schema of {path}",
            got=repr(schema),
            expected=f"{PLAN!r}, {CALIBRATION!r}",
            mend="Motions are shown beside a plan: give that, and these by --motion."
            if schema == MOTION_SCHEMA
            else "",
        )
    plan = load_plan(path)
    if capture is None:
        raise ConfigError(
            "capture",
            got="none",
            expected="the capture that the plan was made on",
            mend="Give it with --capture FILE (capture=...).",
        )
    shown = seen(path.stem, capture)
    if plan.object_label > len(shown.segmentation.segments):
        raise ConfigError(
            "capture",
            got=f"one without object {plan.object_label}",
            expected=f"the one that {path} was made on",
        )
    model = _robot_of(plan, robot, path)
    stored = None if motion is None else _motion_of(motion, plan, model)
    return replace(
        shown,
        plan=plan,
        grippers=load_grippers(grippers),
        robot=model,
        motions={} if stored is None else stored.trajectories,
        motion_grasp=0 if stored is None else (stored.rank or 1) - 1,
        motion_arm="" if stored is None else stored.arm or "",
    )


def _motion_of(
    path: str | os.PathLike[str], plan: GraspPlan, robot: RobotModel | None
) -> StoredMotion:
    """Read motions, whose approach has to end at their grasp of the plan."""
    stored = load_motion(path)
    rank, arm = stored.rank, stored.arm
    approach = stored.trajectories.get("approach")
    if approach is None or rank is None or arm is None or robot is None:
        return stored
    of_rank = plan.grasps[rank - 1 : rank]
    is_there = [grasp.arm for grasp in of_rank] == [arm]
    if is_there:
        joints = dict(zip(approach.joint_names, approach.q[-1].tolist(), strict=True))
        palm = robot.link_poses(joints)[robot.arm(arm).tip]
        beside = np.linalg.norm(palm.p - of_rank[0].T_base_hand.p)
        is_there = bool(beside < _THERE)
    if not is_there:
        raise ConfigError(
            f"motions in {path}",
            got=f"an approach that does not end at grasp {rank} of the plan",
            expected=f"motions of the {arm} arm to a grasp of this plan",
            mend="Plan them anew: debrisgrasp motion CAPTURE --grasps PLAN --out FILE.",
        )
    return stored


def seen(title: str, capture: Capture) -> PlanContent:
    """Divide a capture into objects, to show them in their order."""
    cloud = capture.cloud()
    found = segmented(capture, cloud)
    return PlanContent(
        title=title,
        capture=capture,
        cloud=cloud,
        segmentation=found,
        order=SupportAware().order(found, cloud),
    )


def _robot_of(plan: GraspPlan, given: str | None, path: Path) -> RobotModel | None:
    """Load the robot of a plan, which knows its name only."""
    try:
        robot = _robot(given or plan.robot)
    except UnknownNameError as error:
        if given is not None:
            raise
        raise ConfigError(
            "robot",
            got="none",
            expected=f"the file of {plan.robot}, for which {path} was made",
            mend="Give it with --robot FILE (robot=...).",
        ) from error
    if robot is not None and plan.robot not in ("none", robot.name):
        raise ConfigError(
            "robot", got=robot.name, expected=f"{plan.robot}, for which {path} was made"
        )
    return robot


def _robot(name: str) -> RobotModel | None:
    return None if name == "none" else RobotModel.load(name)
