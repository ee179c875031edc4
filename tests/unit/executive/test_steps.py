"""Single steps on the robot in memory: the look at the own hand, and the drag."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.control import GripConfig, GripController
from debrisgrasp.executive import Executive, TaskSettings
from debrisgrasp.executive.calibrated import calib_check
from debrisgrasp.executive.context import Held
from debrisgrasp.executive.drag import drag, drive_back
from debrisgrasp.executive.drive import Drive, LegEnd
from debrisgrasp.executive.moves import lying, reversed_motion
from debrisgrasp.executive.result import Done, FaultFound
from debrisgrasp.executive.states import State
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import Trajectory
from debrisgrasp.pipeline import Pipeline
from debrisgrasp.robot import FakeConfig, fake_robot
from debrisgrasp.worlds import World, make_body


@pytest.fixture(scope="module")
def pipeline():
    return Pipeline()


def executive(pipeline, **config):
    sizes = {"length": 0.2, "width": 0.1, "height": 0.06}
    brick = make_body("brick", sizes, 2.0).at(SE3.from_parts(p=[1.3, 0.0, 0.03]))
    fake = fake_robot(
        pipeline.robot,
        World((brick,)),
        rng=np.random.default_rng(0),
        config=FakeConfig(is_initialised=True, **config),
    )
    return fake, Executive(
        fake.robot,
        TaskSettings(),
        pipeline=pipeline,
        rng=np.random.default_rng(0),
    )


def test_a_camera_where_it_should_be_passes(pipeline):
    fake, task = executive(pipeline)
    found = calib_check(task.context)
    assert isinstance(found, Done)
    assert found.facts["hand_seen"]
    assert np.linalg.norm(found.facts["shift_mm"]) < 10.0
    assert fake.truth().violations == ()


def test_a_camera_that_is_off_by_five_centimetres_is_found_out(pipeline):
    error = SE3.from_parts(p=[0.05, 0.0, 0.0])
    _, task = executive(pipeline, calibration_error=error)
    found = calib_check(task.context)
    assert isinstance(found, FaultFound)
    assert found.fault == "calibration_off"
    assert 0.04 < found.values["shift"] < 0.06


def test_a_base_that_drags_comes_back_to_where_it_was(pipeline):
    fake, task = executive(pipeline)
    context = task.context
    context.state = State.LIFT
    config = GripConfig(opening=0.1, width=0.05)
    grip = GripController(config)
    fingers = Drive(context, "right").fingers()
    context.held = Held(
        arm="right",
        grip=grip,
        watch=grip,
        state=grip.preshape(fingers),
        is_watched=False,
    )
    found = drag(context)
    assert isinstance(found, Done)
    assert found.next is State.RELEASE
    assert np.linalg.norm(context.dragged.p) > 0.4
    assert drive_back(context) is None
    assert np.linalg.norm(fake.base.T_odom_base.p) < 0.1
    assert fake.truth().violations == ()


def test_a_motion_run_backwards_ends_where_it_began():
    one = Trajectory(
        joint_names=("a",),
        times=np.array([0.0, 1.0, 3.0]),
        q=np.array([[0.0], [0.4], [1.0]]),
        dq=np.array([[0.0], [0.4], [0.0]]),
        limits_hash="x",
    )
    back = reversed_motion(one)
    t = np.linspace(0.0, 3.0, 13)
    q, dq, _ = one.at(t)
    q_back, dq_back, _ = back.at(3.0 - t)
    assert np.allclose(q, q_back)
    assert np.allclose(dq, -dq_back)


def test_what_was_put_down_stands_in_the_way_with_its_whole_body():
    corners = np.array(np.meshgrid([0, 0.3], [0, 0.1], [0.1, 0.2])).reshape(3, -1).T
    T = SE3.from_parts(p=[1.0, 0.0, 0.5])
    surface = lying(T, corners)
    low, high = T.apply(corners).min(axis=0), T.apply(corners).max(axis=0)
    assert np.all(surface.min(axis=0) < low)
    assert np.all(surface.max(axis=0) > high)
    assert np.all(surface.max(axis=0) < high + 0.03)
    # No link slips between the points.
    inside = np.random.default_rng(0).uniform(low[:2], high[:2], (50, 2))
    on_top = surface[surface[:, 2] > high[2]][:, :2]
    gaps = np.linalg.norm(inside[:, None] - on_top, axis=2).min(axis=1)
    assert gaps.max() < 0.02


def test_a_leg_begins_where_the_arm_was_sent_a_moment_ago(pipeline):
    fake, task = executive(pipeline)
    context = task.context
    drive = Drive(context, "right")
    context.wait(0.1)
    for _ in range(3):
        assert isinstance(drive.leg([0.0, 0.0, -0.02], speed=0.03), LegEnd)
    assert fake.truth().violations == ()


def test_a_joint_at_the_end_of_its_range_may_read_a_little_beyond_it(pipeline):
    _, task = executive(pipeline)
    drive = Drive(task.context, "right")
    reading = drive.read()
    q = np.array(reading.q)
    q[0] = drive.limits.upper[0] + 2e-6
    assert drive._stands_at(reading._replace(q=q))[0] == drive.limits.upper[0]
    q[0] += 0.1
    assert drive._stands_at(reading._replace(q=q))[0] == q[0]
