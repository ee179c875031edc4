"""One run of the whole task with both arms in the physics of the extra ``sim``."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from debrisgrasp.errors import ConfigError
from debrisgrasp.executive import Executive, Simulated
from debrisgrasp.geometry import SE3, Bounds
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.prototypes import with_shipped
from debrisgrasp.robot import FakeConfig
from debrisgrasp.sim import tier_scene
from debrisgrasp.sim_robot import sim_robot
from debrisgrasp.worlds import World

from .fake_run import Watch, pipeline_of, record_of, settings_of, unclassified
from .in_the_way import account
from .record import RunRecord
from .specs import RunSpec

__all__ = ["run_arm"]

_APART = 0.02
"""Between the robot, where it stands at first, and what lies before it [m]."""


def run_arm(spec: RunSpec) -> RunRecord:
    """Clear a scene once with a robot that has weight, drives and contacts.

    Raises
    ------
    UnknownNameError
        If there is no such tier.
    ConfigError
        If the site has no robot with arms.
    MissingExtraError
        If MuJoCo is not installed.
    """
    start = time.thread_time()
    robot_rng, task_rng = np.random.default_rng(spec.seed).spawn(2)
    pipeline = pipeline_of(spec.site)
    model = pipeline.robot
    if model is None:
        raise ConfigError("robot of the site", got="none", expected="a robot with arms")
    world = _ahead_of(model, tier_scene(spec.tier, spec.seed).world)
    config = FakeConfig(is_initialised=True)
    grippers = with_shipped(pipeline.grippers)
    robot = sim_robot(model, world, rng=robot_rng, config=config, grippers=grippers)
    watch, settings = Watch(recovery=spec.recovery), settings_of(spec, pipeline)
    executive = Executive(
        robot.robot, settings, pipeline=pipeline, observers=(watch,), rng=task_rng
    )
    try:
        result = executive.run()
    except Exception:  # noqa: BLE001 - nothing was removed, but there was something
        return unclassified(spec, world, settings)
    is_latched = all(arm.is_stopped for arm in robot.arms.values())
    truth = robot.truth()
    done = Simulated(result, truth, (), is_latched)
    record = record_of(spec, done, watch, settings, time.thread_time() - start)
    objects = account(truth, settings)
    gone, kept = (
        sum(body.mass for body in bodies) for bodies in (objects.gone, objects.kept)
    )
    more = {
        "deepest_mm": {arm: round(1e3 * d, 3) for arm, d in truth.deepest.items()},
        "peak_at_s": {arm: round(when, 3) for arm, when in truth.peak_time.items()},
        "removable_kg": round(gone + kept, 3),
        "removed_kg": round(gone, 3),
    }
    return replace(record, details={**record.details, **more})


def _ahead_of(model: RobotModel, world: World) -> World:
    """Move bodies ahead until nothing of them is where the robot stands.

    Scenes are made for hands without a robot: a long object may reach back to it.
    """
    links = [solid.bounds.grown(_APART) for _, solid in model.links_solids()]
    boxes = [solid.bounds for body in world.bodies for solid in body.solids]
    ahead = 0.0
    while more := max((_way_out(a, b, ahead) for a in links for b in boxes), default=0):
        ahead += more
    if not ahead:
        return world
    step = SE3.from_parts(p=[ahead, 0.0, 0.0])
    return world.placed([step @ body.T_base_body for body in world.bodies])


def _way_out(link: Bounds, body: Bounds, ahead: float) -> float:
    """How far a box, moved ahead already, is to go on along x until it is free [m]."""
    step = np.array([ahead, 0.0, 0.0])
    lower, upper = body.lower + step, body.upper + step
    meets = bool((lower < link.upper).all() and (upper > link.lower).all())
    return float(link.upper[0] - lower[0]) if meets else 0.0
