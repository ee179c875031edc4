"""Faults on purpose, of hands, head, images, and the world."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.control import GripCommand
from debrisgrasp.robot import INJECTABLE, Injection, inject
from debrisgrasp.worlds import named_scene

from .stub import STATES, StubWorld, struck


def test_nothing_appears_where_an_arm_may_be(robot, rng):
    scene = StubWorld(named_scene("wood_on_truss"))
    injection = Injection(fault="plan_collision", state="approach")
    injected = inject(robot, [injection], states=STATES, rng=rng, world=scene)
    injected.on_state("approach")
    assert injected.happened == ()
    injected.on_state("capture")
    assert injected.happened == ("plan_collision",)
    assert len(scene.world.bodies) == 4


def test_the_same_thing_may_appear_twice(robot, rng):
    scene = StubWorld(named_scene("wood_on_truss"))
    twice = [Injection(fault="plan_collision", state="capture")] * 2
    injected = inject(robot, twice, states=STATES, rng=rng, world=scene)
    injected.on_state("capture")
    assert injected.happened == ("plan_collision",) * 2
    assert len({body.name for body in scene.world.bodies}) == 5


def test_a_gripper_without_zero_ignores_commands_until_it_is_initialised(robot, rng):
    spoiled = struck(
        robot, "gripper_uninitialised", severity=1, arm="left", rng=rng
    ).robot
    hand, inner = spoiled.limbs["left"].gripper, robot.limbs["left"].gripper
    assert not hand.is_initialised
    hand.preshape("pinch", 0.02)
    assert inner.openings == (0.1,) * 3
    hand.initialise()
    assert hand.is_initialised
    hand.preshape("pinch", 0.02)
    assert inner.openings == (0.02,) * 3
    assert spoiled.limbs["right"].gripper is robot.limbs["right"].gripper


def test_only_one_hand_loses_its_zero_unless_told_otherwise(robot, rng):
    lost = set()
    for _ in range(20):
        limbs = struck(robot, "gripper_uninitialised", rng=rng).robot.limbs
        (name,) = (n for n, limb in limbs.items() if not limb.gripper.is_initialised)
        lost.add(name)
    assert lost == {"left", "right"}


def test_a_jammed_finger_stays_while_the_others_move(robot, rng):
    spoiled = struck(robot, "finger_jammed", severity=1, rng=rng).robot
    hand, inner = spoiled.limbs["left"].gripper, robot.limbs["left"].gripper
    hand.command(GripCommand((0.05, 0.05, 0.05), 20.0))
    assert inner.openings == (0.05, 0.1, 0.05)
    robot.clock.time += 21.0
    hand.command(GripCommand((0.03, 0.03, 0.03), 20.0))
    assert inner.openings == (0.03, 0.03, 0.03)


def test_a_head_that_slipped_looks_elsewhere_than_it_reads(robot, rng):
    spoiled = struck(robot, "calibration_off", rng=rng).robot
    spoiled.head.move_to([0.2, 0.3])
    np.testing.assert_allclose(spoiled.head.read().q, [0.2, 0.3])
    true = np.array(robot.head.read().q)
    np.testing.assert_allclose(true, [0.15, 0.335])


def test_a_head_that_does_not_turn_stays(robot, rng):
    spoiled = struck(robot, "calibration_poses", rng=rng).robot
    spoiled.head.move_to([0.2, 0.3])
    assert robot.head.q == (0.0, 0.0)


@pytest.mark.parametrize(
    ("fault", "least", "most"),
    [
        ("empty_cloud", 0.0, 0.0),
        ("depth_dropout", 0.2, 0.6),
        ("plane_eats_pile", 0.1, 0.15),
        ("fiducial_lost", 0.66, 0.67),
    ],
)
def test_images_with_too_little_in_them(robot, rng, fault, least, most):
    spoiled = struck(robot, fault, rng=rng).robot
    share = np.mean(spoiled.camera.capture().depth > 0.0)
    assert least <= share <= most
    for _ in range(int(INJECTABLE[fault].severity) - 1):
        spoiled.camera.capture()
    if fault != "plane_eats_pile":
        assert np.all(spoiled.camera.capture().depth > 0.0), "only so often"


def test_a_stale_image_is_old_or_of_another_frame(robot, rng):
    kinds = set()
    for _ in range(12):
        spoiled = struck(robot, "stale_cloud", rng=rng).robot
        frame = spoiled.camera.capture()
        kinds.add((frame.time < robot.clock.now() - 1.0, frame.frame == "camera"))
    assert kinds == {(True, True), (False, False)}


def world_of(robot, fault, rng, **changes):
    scene = StubWorld(named_scene("wood_on_truss"))
    struck(robot, fault, rng=rng, world=scene, **changes)
    return scene


def test_what_happens_in_the_world(robot, rng):
    before = named_scene("wood_on_truss")
    far = world_of(robot, "unreachable", rng).world
    for old, new in zip(before.bodies, far.bodies, strict=True):
        np.testing.assert_allclose(new.T_base_body.p - old.T_base_body.p, [0.75, 0, 0])
    barred = world_of(robot, "plan_collision", rng).world
    assert len(barred.bodies) == len(before.bodies) + 1
    bulky = world_of(robot, "no_grasp", rng).world
    assert all(b.volume == pytest.approx(0.6**3) for b in bulky.bodies)
    assert world_of(robot, "slip", rng).log == [("friction", 0.03)]
    assert world_of(robot, "not_released", rng).log == [("stick", 30.0)]
    assert world_of(robot, "start_outside_limits", rng, arm="left").log == [
        ("misplace", 0.01, "left")
    ]


def test_the_world_changes_in_time_and_once_hands_are_empty(robot, rng):
    scene = StubWorld(named_scene("wood_on_truss"), is_held=True)
    injection = Injection(fault="empty_grip", at=0.5)
    injected = inject(robot, [injection], states=STATES, rng=rng, world=scene)
    injected.on_state("close")
    injected.robot.clock.wait_until(0.4)
    injected.robot.clock.wait_until(1.0)
    assert injected.robot.clock.now() == 1.0
    assert injected.happened == ()
    scene.is_held = False
    injected.robot.clock.wait_until(1.1)
    assert injected.happened == ("empty_grip",)
    x = [body.T_base_body.p[0] for body in scene.world.bodies]
    injected.robot.clock.wait_until(2.0)
    assert x == [body.T_base_body.p[0] for body in scene.world.bodies]
