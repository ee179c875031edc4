"""The robot in its own pictures."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.executive import TaskSettings
from debrisgrasp.executive.obstacles import are_near
from debrisgrasp.executive.own_body import own_body, own_pixels
from debrisgrasp.executive.perceive import capture, image, segment
from debrisgrasp.executive.result import Done, FaultFound
from tests.unit.executive.rigs import before_a_brick

SIZES = {"length": 0.2, "width": 0.1, "height": 0.06}
IN_VIEW = {"right": "ready", "left": "ready"}


def context_of(pipeline, start, settings=None, **config):
    _, task = before_a_brick(pipeline, settings=settings, start=start, **config)
    return task.context


def test_arms_in_the_picture_are_no_objects(pipeline):
    context = context_of(pipeline, IN_VIEW)
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
    taken, body = image(context, "own"), own_body(context)
    points = taken.intrinsics.deproject(taken.depth).reshape(-1, 3)
    points = taken.T_base_camera.apply(points)
    expected = np.zeros(len(points), dtype=bool)
    for solid, within in body:
        expected |= are_near(points, [solid], within)
    found = own_pixels(taken.depth, taken.intrinsics, taken.T_base_camera, body)
    np.testing.assert_array_equal(found.ravel(), expected)


def test_a_robot_that_hides_the_pile_does_not_find_the_way_clear(pipeline):
    settings = TaskSettings(max_dropout=0.01)
    found = capture(context_of(pipeline, IN_VIEW, settings, noise=None))
    assert isinstance(found, FaultFound)
    assert found.fault == "depth_dropout"
    assert "the robot itself hides" in found.message
