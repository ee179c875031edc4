"""The look at the own hand, on the robot in memory."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.executive.calibrated import calib_check
from debrisgrasp.executive.result import Done, FaultFound
from debrisgrasp.geometry import SE3, Intrinsics
from tests.unit.executive.rigs import before_a_brick


def test_a_camera_where_it_should_be_passes(pipeline):
    fake, task = before_a_brick(pipeline)
    found = calib_check(task.context)
    assert isinstance(found, Done)
    assert found.facts["hand_seen"]
    assert np.linalg.norm(found.facts["shift_mm"]) < 10.0
    assert found.facts["camera"] == "steady"
    # The next check judges its looks together with these.
    assert isinstance(calib_check(task.context), Done)
    assert len(task.context.camera_watch.looks) == 4
    assert fake.truth().violations == ()


def test_a_camera_that_is_off_by_five_centimetres_is_found_out(pipeline):
    error = SE3.from_parts(p=[0.05, 0.0, 0.0])
    _, task = before_a_brick(pipeline, calibration_error=error)
    found = calib_check(task.context)
    assert isinstance(found, FaultFound)
    assert found.fault == "calibration_off"
    assert 0.04 < found.values["shift"] < 0.06
    assert "the mount of the camera" in found.message
    assert len(task.context.camera_watch.looks) == 2


@pytest.mark.parametrize("focal", [200.0, 260.0, 300.0])
def test_a_hand_at_the_edge_of_a_narrow_picture_blames_no_camera(pipeline, focal):
    narrow = Intrinsics(fx=focal, fy=focal, cx=159.5, cy=89.5, width=320, height=180)
    fake, task = before_a_brick(pipeline, intrinsics=narrow)
    found = calib_check(task.context)
    assert isinstance(found, Done), found.message
    if not found.facts["hand_seen"]:
        assert "in the picture" in found.facts["why"]
    assert fake.truth().violations == ()
