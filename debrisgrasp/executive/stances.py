"""Where arms stand that others are planned around."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from debrisgrasp._words import arm_called
from debrisgrasp.errors import InputError
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.pipeline import Pipeline
from debrisgrasp.robot import Arm, Robot

from .context import Context
from .result import FaultFound
from .settings import TaskSettings

__all__ = ["has_moved", "planning_around", "standing"]

_NEARLY = 0.05
"""So far off a joint stands where it should [rad or m]."""


def standing(robot: Robot, settings: TaskSettings) -> RobotModel:
    """Return the model of a robot with its arms where others are planned around them.

    Those in use rest where the settings say. One that is not used stays where it
    stands; what is wrong with one that can't tell where, the self-test says.
    """
    model, rest = robot.model, settings.rest
    used = [name for name in settings.arms or robot.limbs if name in model.arms]
    moved = {joint for name in used for joint in model.arm(name).joints}
    idle, stands = model.joint_values(), dict[str, float]()
    for name, limb in robot.limbs.items():
        told = {} if name in used else _told(limb.arm)
        own = {k: q for k, q in told.items() if k in idle and k not in moved}
        if any(abs(q - idle[k]) > _NEARLY for k, q in own.items()):
            stands |= own
    model = model.standing(stands) if stands else model
    if rest is None:
        return model
    arms = {
        name: replace(model.arm(name), idle=rest)
        for name in used
        if rest in model.arm(name).postures
    }
    return replace(model, arms={**model.arms, **arms})


def planning_around(pipeline: Pipeline, model: RobotModel) -> Pipeline:
    """Return a pipeline that plans around arms where those of a model of it stand.

    Raises
    ------
    InputError
        If it plans for another robot, whose arm gets elsewhere.
    """
    robot = pipeline.robot
    if robot is None or robot.name != model.name:
        raise InputError(
            "pipeline of the task",
            got="one for " + ("a floating hand" if robot is None else robot.name),
            expected=f"one for {model.name}, the model of the robot",
            mend="Pipeline(robot=robot.model, ...) makes one.",
        )
    planned, values = robot.joint_values(), model.joint_values()
    joints = {joint for arm in model.arms.values() for joint in arm.joints}
    moved = {k: values[k] for k in joints if planned.get(k, values[k]) != values[k]}
    return pipeline.standing(moved) if moved else pipeline


def has_moved(context: Context) -> FaultFound | None:
    """See that arms that are not used stand where motions are planned around them."""
    used = {name for s in context.limbs.values() for name in s.limb.arm.joint_names}
    expected = context.model.joint_values()
    for name, limb in context.robot.limbs.items():
        told = np.asarray(limb.arm.read().q, dtype=np.float64)
        if not np.isfinite(told).all():
            words = f"joints read {told.tolist()}"
            return FaultFound("encoder_jump", words, name)
        for joint, q in zip(limb.arm.joint_names, told.tolist(), strict=True):
            # Those that both have are where the other one has them.
            if joint in used or abs(q - expected[joint]) <= _NEARLY:
                continue
            words = f"{joint} of the {arm_called(name)}, which is not used, is at "
            words += f"{q:.2f}, not at {expected[joint]:.2f} any more, where motions "
            words += "are planned around it: leave it there, or use it"
            return FaultFound("plan_collision", words, name)
    return None


def _told(arm: Arm) -> dict[str, float]:
    """Joints of an arm by name; none if it has no numbers to tell."""
    try:
        q = np.asarray(arm.read().q, dtype=np.float64)
        told = dict(zip(arm.joint_names, q.tolist(), strict=True))
    except Exception:  # noqa: BLE001 - a driver may raise anything
        return {}
    return told if np.isfinite(q).all() else {}
