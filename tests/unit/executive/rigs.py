"""A task on the robot in memory, and the states in which its tests begin."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from debrisgrasp.control import GripConfig, GripController
from debrisgrasp.executive import Executive, TaskSettings
from debrisgrasp.executive.context import Held
from debrisgrasp.executive.perceive import capture, segment
from debrisgrasp.executive.result import Done
from debrisgrasp.geometry import SE3
from debrisgrasp.robot import FakeConfig, fake_robot
from debrisgrasp.worlds import World, make_body

POINTS = np.random.default_rng(0).uniform(-0.1, 0.1, (50, 3))
"""Of something in a hand."""


PERIOD = 0.008
"""Of the loop [s]: twice as long as by default, and so in half the time."""
JUST_NOW = 1e-3
"""Before a test begins [s]."""


def task_before(pipeline, *bodies, settings=None, **config):
    """The robot in memory before some bodies, and its task, which has not begun.

    The bias of its sensors is known, as after a self test: else the arms creep.
    """
    settings = settings or TaskSettings(period=PERIOD)
    config = FakeConfig(is_initialised=True, period=settings.period, **config)
    rng = np.random.default_rng(0)
    fake = fake_robot(pipeline.robot, World(bodies), rng=rng, config=config)
    rng = np.random.default_rng(0)
    task = Executive(fake.robot, settings, pipeline=pipeline, rng=rng)
    for limb in task.context.limbs.values():
        limb.baseline_time = JUST_NOW
    return fake, task


def brick_at(x):
    """A flat brick of 2 kg that lies straight ahead."""
    sizes = {"length": 0.2, "width": 0.1, "height": 0.06}
    return make_body("brick", sizes, 2.0).at(SE3.from_parts(p=[x, 0.0, 0.03]))


def before_a_brick(pipeline, *bodies, **config):
    """The robot before a brick that it hardly reaches, and other bodies; its task."""
    return task_before(pipeline, brick_at(1.3), *bodies, **config)


def look(context):
    """Take an image, and divide it into objects."""
    for step in (capture, segment):
        assert isinstance(step(context), Done)


def holding(**changes):
    """What the right hand holds, its grip as it was before it closed."""
    grip = GripController(GripConfig(opening=0.1, width=0.05, sides=(-1, 1, 1)))
    held = {"arm": "right", "grip": grip, "watch": grip, "state": grip.preshape()}
    return Held(**{**held, **changes})


def gripped_below(context, arm, backed):
    """Have a hand stand back from where it gripped by so much; its pose (4, 4)."""
    limb = context.limbs[arm]
    T = limb.pose(context.posture(limb))
    grasp = SimpleNamespace(
        T_base_hand=SE3.from_parts(p=[0.0, 0.0, -backed]) @ T,
        preshape=next(iter(limb.hand.preshapes)),
    )
    context.cycle.motion = SimpleNamespace(arm=arm, grasp=grasp)
    return T
