"""Camera, head, base, sensor and hand of the robot in memory."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.control import GripCommand, identify_tool
from debrisgrasp.errors import ConfigError, UnknownNameError
from debrisgrasp.geometry import SE3
from debrisgrasp.robot import (
    Base,
    Clock,
    DepthCamera,
    FakeConfig,
    ForceSensor,
    Gripper,
    Head,
    fake_robot,
)
from debrisgrasp.worlds import World, render
from tests.unit.robot.rigs import CHAINS, FAR, GRIPPERS, ROMAN, Rig, beam, drive

NEAR = beam("near", 2.0, (1.3, 0.1, 0.0445), yaw=0.4)


def made(seed=0, **config):
    return fake_robot(
        ROMAN,
        World((FAR, NEAR)),
        rng=np.random.default_rng(seed),
        config=FakeConfig(**config),
        grippers=GRIPPERS,
    )


def test_all_devices_fulfil_their_protocols():
    robot = made().robot
    limb = robot.limbs["left"]
    for device, protocol in (
        (robot.clock, Clock),
        (robot.camera, DepthCamera),
        (robot.head, Head),
        (robot.base, Base),
        (limb.sensor, ForceSensor),
        (limb.gripper, Gripper),
    ):
        assert isinstance(device, protocol)


def test_the_camera_sees_the_world_from_where_it_is():
    fake = made(noise=None, sees_itself=False)
    frame = fake.robot.camera.capture()
    T = ROMAN.T_base_camera(CHAINS["right"].named(fake.arms["right"].q))
    expected = render(fake.world, frame.intrinsics, T, max_depth=6.0)
    assert np.allclose(frame.depth, expected.depth)
    assert (frame.rgb == expected.rgb).all()
    assert frame.frame == ROMAN.camera


def test_a_camera_with_something_over_its_lens_sees_nothing():
    eye = made().truth().T_base_camera.p
    over = beam("over", 2.0, tuple(eye.tolist()))
    fake = fake_robot(
        ROMAN,
        World((FAR, over)),
        rng=np.random.default_rng(0),
        config=FakeConfig(),
        grippers=GRIPPERS,
    )
    frame = fake.robot.camera.capture()
    assert frame.depth.shape == frame.rgb.shape[:2]
    assert not frame.depth.any()
    assert not frame.rgb.any()


def test_a_calibration_error_moves_the_camera_but_not_what_the_model_says():
    error = SE3.exp([0.03, 0.0, 0.0, 0.0, 0.02, 0.0])
    right = made(noise=None, sees_itself=False).robot.camera.capture()
    fake = made(noise=None, sees_itself=False, calibration_error=error)
    wrong = fake.robot.camera.capture()
    assert not np.allclose(right.depth, wrong.depth)
    nominal = ROMAN.T_base_camera(CHAINS["right"].named(fake.arms["right"].q))
    assert np.allclose(fake.truth().T_base_camera.matrix, (nominal @ error).matrix)


def test_the_camera_sees_hands_that_are_in_its_way():
    rig = Rig([FAR, NEAR], place=(0.8, -0.3, 0.35))
    rig.robot.head.move_to([-0.4, 0.75])
    rig.wait(1.0)
    depth = rig.robot.camera.capture().depth
    blind = Rig([FAR, NEAR], place=(0.8, -0.3, 0.35), sees_itself=False)
    blind.robot.head.move_to([-0.4, 0.75])
    blind.wait(1.0)
    empty = blind.robot.camera.capture().depth
    hidden = (depth > 0) & (empty > 0) & (depth < empty - 0.05)
    assert hidden.sum() > 100
    points = depth[hidden]
    assert points.min() > 0.2


def test_pan_and_tilt_turn_the_view_at_their_speed():
    fake = made()
    head = fake.robot.head
    assert head.joint_names == ("ptu_pan_joint", "ptu_tilt_joint")
    assert head.read().q == (0.0, 0.75)
    before = fake.truth().T_base_camera
    head.move_to([0.5, 0.5])
    assert not head.is_still
    fake.robot.clock.wait_until(0.4)
    assert head.read().q[0] == pytest.approx(0.4)
    fake.robot.clock.wait_until(0.6)
    assert head.is_still
    turned = before.inverse() @ fake.truth().T_base_camera
    assert 0.4 < np.linalg.norm(turned.log()[3:]) < 0.6
    head.move_to([0.0, 3.0])
    assert head.is_still
    assert fake.violations[0].device == "head"


def test_the_base_drives_by_its_odometry():
    fake = made()
    base, clock = fake.robot.base, fake.robot.clock
    drive(fake.robot, 0.2, 0.0, 5.0)
    base.stop()
    clock.wait_until(7.0)
    # Trapezoid: 0.4 s to speed up, as long to stop.
    assert np.allclose(base.read().p, [0.2 * 5.0, 0.0, 0.0], atol=1e-2)
    stood = base.read()
    clock.wait_until(8.0)
    assert np.array_equal(stood.matrix, base.read().matrix)
    drive(fake.robot, 0.0, 0.3, 2.0)
    base.stop()
    clock.wait_until(11.0)
    turn = (stood.inverse() @ base.read()).log()
    assert turn[5] == pytest.approx(0.6, abs=0.02)
    base.drive(np.nan, 0.0)
    base.drive(9.0, 0.0)
    assert [v.device for v in fake.violations] == ["base", "base"]


def test_a_base_that_is_told_no_more_stands_by_itself():
    fake = made(base_watchdog=0.3)
    base, clock = fake.robot.base, fake.robot.clock
    base.drive(0.2, 0.0)
    clock.wait_until(0.25)
    base.drive(0.2, 0.0)
    clock.wait_until(0.5)
    assert not base.is_still
    clock.wait_until(60.0)
    assert base.is_still
    assert base.read().p[0] == pytest.approx(0.2 * 0.55, abs=5e-3)


def test_the_view_goes_along_with_the_base():
    fake = made(noise=None, sees_itself=False)
    before = fake.robot.camera.capture()
    drive(fake.robot, 0.2, 0.0, 2.0)
    fake.robot.base.stop()
    fake.robot.clock.wait_until(4.0)
    shift = fake.robot.base.read().p
    after = fake.robot.camera.capture()
    moved = World(tuple(
        body.at(SE3.from_parts(p=-shift) @ body.T_base_body)
        for body in fake.world.bodies
    ))  # fmt: skip
    T = fake.truth().T_base_camera
    expected = render(moved, after.intrinsics, T, max_depth=6.0)
    assert np.allclose(after.depth, expected.depth, atol=1e-6)
    assert not np.allclose(after.depth, before.depth)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_tool_is_identified_from_what_the_sensor_reads(sign):
    rows, turns = [], []
    for q in ({}, {"right_arm_joint6": 1.2}, {"right_arm_joint6": -1.2},
              {"right_arm_joint7": 1.5, "right_arm_joint6": 0.9},
              {"right_arm_joint2": -1.0, "right_arm_joint7": -1.2}):  # fmt: skip
        fake = made(
            start={"right": q}, wrench_sign=sign, sensor_noise=(0, 0), drift=(0, 0)
        )
        limb = fake.robot.limbs["right"]
        rows.append(limb.sensor.read().wrench_ft)
        hand = CHAINS["right"].fk(limb.arm.read().q)
        turns.append(hand.R @ limb.loads.T_ee_ft.R)
    fit = identify_tool(rows, turns, wrench_sign=sign, expected_mass=2.3)
    assert fit.tool.mass == pytest.approx(2.3)
    assert np.allclose(fit.tool.com, limb.loads.tool.com, atol=1e-9)
    assert np.allclose(fit.bias, limb.loads.bias, atol=1e-9)


def test_the_sensor_is_where_the_urdf_says():
    loads = made().robot.limbs["right"].loads
    # 12 mm of tool plate and 111 mm of palm lie between sensor and palm face.
    assert np.allclose(loads.T_ee_ft.p, [0.0, 0.0, -0.123], atol=1e-9)
    assert np.allclose(loads.T_ee_ft.R[:, 2], [0.0, 0.0, 1.0], atol=1e-9)


def test_noise_and_drift_are_as_large_as_they_are_set():
    fake = made(sensor_noise=(0.3, 0.01), drift=(3600.0, 0.0))
    sensor, clock = fake.robot.limbs["right"].sensor, fake.robot.clock
    rows = []
    for k in range(1000):
        clock.wait_until(k * 0.004)
        rows.append(sensor.read().wrench_ft)
        assert sensor.read().wrench_ft is rows[-1]
    rows = np.array(rows)
    assert np.diff(rows, axis=0)[:, :3].std() == pytest.approx(0.3 * 2**0.5, rel=0.1)
    assert np.diff(rows, axis=0)[:, 3:].std() == pytest.approx(0.01 * 2**0.5, rel=0.1)
    drift = rows[-100:].mean(axis=0) - rows[:100].mean(axis=0)
    assert np.linalg.norm(drift[:3]) == pytest.approx(0.9 * 4.0, rel=0.1)


def test_readings_end_at_the_range_of_the_sensor():
    fake = made(sensor_range=(3.0, 0.01))
    raw = np.abs(fake.robot.limbs["right"].sensor.read().wrench_ft)
    assert raw[:3].max() == 3.0
    assert raw[3:].max() == 0.01


def test_a_hand_takes_commands_once_it_is_initialised():
    fake = made(initialise_time=0.3)
    hand = fake.robot.limbs["left"].gripper
    wide = hand.read().openings
    hand.preshape("claw", 0.1)
    assert "before it was initialised" in fake.violations[0].message
    hand.initialise()
    assert not hand.is_initialised
    fake.robot.clock.wait_until(0.4)
    assert hand.is_initialised
    assert hand.read().openings == wide
    hand.preshape("claw", 0.1)
    fake.robot.clock.wait_until(3.0)
    assert np.allclose(hand.read().openings, 0.1)


def test_fingers_move_at_their_speed_each_to_its_own_place():
    fake = made(is_initialised=True, finger_speed=0.05)
    hand, clock = fake.robot.limbs["right"].gripper, fake.robot.clock
    start = hand.read().openings[0]
    hand.command(GripCommand((start - 0.02, 0.05, 0.1), 20.0))
    clock.wait_until(clock.now() + 0.2)
    moved = start - np.array(hand.read().openings)
    assert np.allclose(moved, 0.01)
    clock.wait_until(clock.now() + 3.0)
    assert np.allclose(hand.read().openings, [start - 0.02, 0.05, 0.1])


@pytest.mark.parametrize(
    "command",
    [
        GripCommand((0.05, 0.05), 20.0),
        GripCommand((np.nan,) * 3, 20.0),
        GripCommand((0.05,) * 3, np.inf),
        GripCommand((0.05,) * 3, 400.0),
        GripCommand((50.0,) * 3, 20.0),
        GripCommand((-0.05,) * 3, 20.0),
    ],
    ids=["two of three", "nan", "inf", "too strong", "millimetres", "below zero"],
)
def test_what_a_hand_cannot_do_is_refused(command):
    fake = made(is_initialised=True)
    hand = fake.robot.limbs["right"].gripper
    before = hand.read().openings
    hand.command(command)
    fake.robot.clock.wait_until(1.0)
    assert hand.read().openings == before
    assert fake.violations[0].device == "gripper robotiq_3f"


def test_an_unknown_preshape_names_those_that_are_known():
    hand = made(is_initialised=True).robot.limbs["right"].gripper
    with pytest.raises(UnknownNameError, match="pinch"):
        hand.preshape("punch", 0.1)


@pytest.mark.parametrize(
    "settings",
    [
        {"period": 0.0}, {"stiffness": -1.0}, {"friction": np.nan},
        {"wrench_sign": 0.5}, {"bias": (0.0,) * 5}, {"drift": (1.0,)},
        {"base_speed": (-1.0, 0.0)}, {"finger_speed": 0.0},
    ],
    ids=str,
)  # fmt: skip
def test_settings_are_checked(settings):
    with pytest.raises(ConfigError):
        FakeConfig(**settings)
