"""Hands of a folder on a robot whose URDF has none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from debrisgrasp.io import data_path
from debrisgrasp.kinematics import ArmReach, RobotModel
from debrisgrasp.pipeline import Pipeline


def test_a_hand_that_the_urdf_lacks_may_not_touch_the_own_arm():
    roman = RobotModel.load("roman")
    fingers = [link for link in roman.tree.shapes if "finger" in link]
    bare = replace(
        roman,
        tree=replace(
            roman.tree, shapes={**roman.tree.shapes, **dict.fromkeys(fingers, ())}
        ),
    )
    without, known = ArmReach(bare, "right"), ArmReach(roman, "right")
    (arm,) = Pipeline(robot=bare, arm="right").arms
    q = arm.chain.sampled(2000, rng=np.random.default_rng(0))
    missed = known.collision.hits_itself(q) & ~without.collision.hits_itself(q)
    assert missed.sum() > 20
    assert arm.collision.hits_itself(q)[missed].mean() > 0.8


def test_a_robot_is_named_given_as_a_path_or_given_as_it_is():
    path = data_path("robots", "roman.yaml")
    for robot in ("roman", str(path), path, RobotModel.load(path)):
        (arm,) = Pipeline(robot=robot, arm="right").arms
        assert arm.name == "right"


def test_a_pipeline_plans_around_an_arm_where_it_stands():
    before = Pipeline(robot="roman", arm="right")
    after = before.standing({"left_arm_joint1": 0.9})
    (arm,), (as_before,) = after.arms, before.arms
    assert arm.robot.joint_values()["left_arm_joint1"] == 0.9
    assert as_before.robot.joint_values()["left_arm_joint1"] != 0.9
    assert after.library is before.library
    floating = Pipeline(robot="none")
    assert floating.standing({}) is floating
