"""The look at the own hand, on the robot in memory."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp import Pipeline
from debrisgrasp.executive import TaskSettings
from debrisgrasp.executive.calibrated import calib_check
from debrisgrasp.executive.result import Done, FaultFound
from debrisgrasp.executive.seen_hand import rigid_links
from debrisgrasp.geometry import SE3, Box, Intrinsics, so3
from debrisgrasp.kinematics import RobotModel
from tests.unit.executive.rigs import PERIOD, before_a_brick

BESIDE = 0.5
"""Turn of the first joint that brings a hand from before the camera to beside that."""


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


def test_another_arm_beside_the_hand_is_not_taken_for_it(pipeline):
    q = (-0.92, 1.56, 0.98, 0.16, -1.96, -2.08, -1.23)
    stands = {f"left_arm_joint{i}": value for i, value in enumerate(q, 1)}
    settings = TaskSettings(period=PERIOD, arms=("right",))
    _, task = before_a_brick(pipeline, settings=settings, start={"left": stands})
    found = calib_check(task.context)
    assert isinstance(found, Done), found.message
    assert found.facts["hand_seen"]
    assert np.linalg.norm(found.facts["shift_mm"]) < 10.0


@pytest.mark.parametrize("focal", [200.0, 260.0, 300.0])
def test_a_hand_at_the_edge_of_a_narrow_picture_blames_no_camera(pipeline, focal):
    narrow = Intrinsics(fx=focal, fy=focal, cx=159.5, cy=89.5, width=320, height=180)
    fake, task = before_a_brick(pipeline, intrinsics=narrow)
    found = calib_check(task.context)
    assert isinstance(found, Done), found.message
    if not found.facts["hand_seen"]:
        assert "in the picture" in found.facts["why"]
    assert fake.truth().violations == ()


def test_a_hand_behind_the_robot_itself_is_not_lost(pipeline, monkeypatch):
    beam = Box(np.array([0.1, 0.1, 0.02]), SE3.from_parts(p=[0.59, -0.15, 0.77]))
    links_solids = RobotModel.links_solids

    def with_beam(model, values=None):
        return [*links_solids(model, values), ("mast_link", beam)]

    monkeypatch.setattr(RobotModel, "links_solids", with_beam)
    _, task = before_a_brick(pipeline)
    found = calib_check(task.context)
    assert isinstance(found, Done), found.message
    assert "to be seen in the picture" in found.facts["why"]


def beside(pipeline):
    """Where the right hand is in the picture, but not where it is compared."""
    posture = pipeline.robot.posture("right", "ready")
    turned = posture["right_arm_joint1"] + BESIDE
    return {"right": {**posture, "right_arm_joint1": turned}}


@pytest.mark.parametrize("off", [0.0, 0.05])
def test_an_arm_in_the_picture_is_not_in_its_own_way(pipeline, off):
    error = SE3.from_parts(p=[off, 0.0, 0.0])
    start = beside(pipeline)
    _, task = before_a_brick(pipeline, start=start, calibration_error=error)
    found = calib_check(task.context)
    if off:
        assert isinstance(found, FaultFound)
        assert found.fault == "calibration_off"
        assert found.values["shift"] == pytest.approx(off, abs=0.01)
    else:
        assert isinstance(found, Done), found.message
        assert np.linalg.norm(found.facts["shift_mm"]) < 10.0


@pytest.mark.parametrize(
    ("turn", "why"), [(0.0, "'ready'.*`idle` out of it"), (0.5, "turns the camera")]
)
def test_what_can_not_be_compared_is_left_out_with_a_note(pipeline, turn, why, caplog):
    start = {**pipeline.robot.posture("right", "ready"), "torso_joint": turn}
    _, task = before_a_brick(pipeline, start={"right": start})
    found = calib_check(task.context)
    assert isinstance(found, Done)
    assert re.search(why, found.facts["why"])
    assert re.search(f"no hand was held before the camera.*{why}", caplog.text)


def test_a_forearm_near_the_hand_is_no_hand_elsewhere(pipeline, monkeypatch):
    def end(context, limb, values):
        rigid = rigid_links(context, limb, values)
        return [solid for link, solid in rigid if link == "right_arm_link7"]

    for module in ("calibrated", "seen_hand"):
        monkeypatch.setattr(f"debrisgrasp.executive.{module}.end_of_arm", end)
    _, task = before_a_brick(pipeline)
    found = calib_check(task.context)
    assert isinstance(found, Done), found.message
    assert np.linalg.norm(found.facts["shift_mm"]) < 10.0


class Reversed:
    """A head whose driver names its joints from the camera down."""

    def __init__(self, head):
        self._head = head

    def __getattr__(self, name):
        return getattr(self._head, name)

    @property
    def joint_names(self):
        return self._head.joint_names[::-1]

    def read(self):
        reading = self._head.read()
        return reading._replace(q=reading.q[::-1])

    def move_to(self, q):
        self._head.move_to(q[::-1])


def test_joints_of_a_head_are_told_by_their_names(pipeline):
    _, task = before_a_brick(pipeline)
    robot = task.context.robot
    task.context.robot = replace(robot, head=Reversed(robot.head))
    found = calib_check(task.context)
    assert isinstance(found, Done), found.message
    assert np.linalg.norm(found.facts["shift_mm"]) < 10.0


def test_a_head_that_slides_is_no_camera_that_moved():
    """In the place of tilting it slides, and stands 0.1 m back at rest."""
    roman, slide = RobotModel.load("roman"), "ptu_tilt_joint"
    joints = dict(roman.tree.joints)
    joints[slide] = replace(joints[slide], kind="prismatic", lower=-0.3, upper=0.3)
    R = so3.from_rpy(np.array([0.0, 0.75, 0.0]))
    seat = joints["tilt_to_camera"]
    down = SE3.from_parts(R) @ seat.T_parent_joint
    joints["tilt_to_camera"] = replace(seat, T_parent_joint=down)
    tree = replace(roman.tree, joints=joints)
    sliding = replace(roman, tree=tree, rest={**roman.rest, slide: -0.1})
    fake, task = before_a_brick(Pipeline(robot=sliding))
    found = calib_check(task.context)
    assert isinstance(found, Done), found.message
    assert found.facts["hand_seen"]
    assert np.linalg.norm(found.facts["shift_mm"]) < 10.0
    assert task.context.camera_watch.calibration.head.joint_names == ("ptu_pan_joint",)
    assert fake.truth().violations == ()
