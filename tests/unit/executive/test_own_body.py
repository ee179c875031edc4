"""The robot in its own pictures."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.errors import CaptureError, ConfigError, UnknownNameError
from debrisgrasp.executive import TaskSettings
from debrisgrasp.executive.perceive import capture, image, segment
from debrisgrasp.executive.result import Done, FaultFound
from debrisgrasp.geometry import SE3
from debrisgrasp.io import Capture
from debrisgrasp.pipeline import without_robot
from debrisgrasp.pipeline.self_filter import are_near, body_at
from tests.unit.executive.rigs import PERIOD, before_a_brick

SIZES = {"length": 0.2, "width": 0.1, "height": 0.06}
BASE = SE3.identity()
IN_VIEW = {"right": "ready", "left": "ready"}


def context_of(pipeline, start, settings=None, **config):
    _, task = before_a_brick(pipeline, settings=settings, start=start, **config)
    return task.context


@pytest.mark.parametrize("used", [(), ("right",), ("left",)])
def test_arms_in_the_picture_are_no_objects(pipeline, used):
    settings = TaskSettings(period=PERIOD, arms=used)
    context = context_of(pipeline, IN_VIEW, settings)
    found = capture(context)
    assert isinstance(found, Done)
    assert found.facts["removed_points"]["robot"] > 1000
    assert isinstance(segment(context), Done)
    (brick,) = context.cycle.seen.segmentation.segments
    assert brick.centroid[:2] == pytest.approx([1.3, 0.0], abs=0.05)


def test_without_an_arm_in_the_picture_nothing_is_removed(pipeline):
    context = context_of(pipeline, {})
    found = capture(context)
    assert isinstance(found, Done)
    assert "removed_points" not in found.facts


def test_pixels_of_the_robot_are_those_whose_points_are_near_to_it(pipeline):
    context = context_of(pipeline, IN_VIEW)
    taken, joints = image(context, "own"), context.joint_values()
    points = taken.intrinsics.deproject(taken.depth).reshape(-1, 3)
    points = taken.T_base_camera.apply(points)
    expected = are_near(points, body_at(pipeline.robot, joints))
    assert expected.sum() > 1000
    was_measured = np.isfinite(points).all(axis=1)
    left = np.isfinite(without_robot(taken, pipeline.robot, joints).depth).ravel()
    np.testing.assert_array_equal(was_measured & ~left, was_measured & expected)
    cloud = Capture(points=points, viewpoint=taken.T_base_camera.p, T_base_camera=BASE)
    left = np.isfinite(without_robot(cloud, pipeline.robot, joints).points[:, 0])
    np.testing.assert_array_equal(was_measured & ~left, was_measured & expected)


def test_where_a_picture_was_taken_from_must_be_known_to_find_the_robot(pipeline):
    cloud = Capture(points=np.ones((9, 3)), viewpoint=np.zeros(3))
    with pytest.raises(CaptureError, match="T_base_camera"):
        without_robot(cloud, pipeline.robot)


def test_a_joint_that_the_robot_lacks_is_named(pipeline):
    cloud = Capture(points=np.ones((9, 3)), viewpoint=np.zeros(3), T_base_camera=BASE)
    with pytest.raises(UnknownNameError, match="elbow"):
        without_robot(cloud, pipeline.robot, {"elbow": 0.0})


@pytest.mark.parametrize(
    ("joints", "words"),
    [
        ({"right_arm_joint2": -72.0}, "90 degrees are 1.571"),
        ({"torso_joint": 1.6}, "-1.571 to 1.571 rad"),
        ({"base_to_chassis": 1.0}, "none, for it is fixed"),
    ],
)
def test_values_that_no_joint_can_have_leave_no_arm_in_the_picture(
    pipeline, joints, words
):
    cloud = Capture(points=np.ones((9, 3)), viewpoint=np.zeros(3), T_base_camera=BASE)
    with pytest.raises(ConfigError, match=words):
        without_robot(cloud, pipeline.robot, joints)


def test_a_joint_may_read_a_little_beyond_its_limit(pipeline):
    cloud = Capture(points=np.ones((9, 3)), viewpoint=np.zeros(3), T_base_camera=BASE)
    limit = pipeline.robot.tree.joints["torso_joint"].upper
    every = pipeline.robot.joint_values({"torso_joint": limit + 0.005})
    assert np.isfinite(without_robot(cloud, pipeline.robot, every).points).all()


def test_a_robot_that_hides_the_pile_does_not_find_the_way_clear(pipeline):
    settings = TaskSettings(max_dropout=0.01)
    found = capture(context_of(pipeline, IN_VIEW, settings, noise=None))
    assert isinstance(found, FaultFound)
    assert found.fault == "depth_dropout"
    assert "the robot itself hides" in found.message


def test_a_robot_that_hides_what_no_other_picture_showed_goes_on(pipeline):
    context = context_of(pipeline, IN_VIEW, TaskSettings(max_dropout=0.01), noise=None)
    context.cycle.gaze = np.array([1.0, 0.0, 0.0])
    found = capture(context)
    assert isinstance(found, Done)
    assert found.facts["removed_points"]["robot"] > 1000
