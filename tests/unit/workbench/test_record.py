"""Prototypes recorded from captures whose objects are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.errors import CaptureError, ConfigError, InputError, UnknownNameError
from debrisgrasp.geometry import SE3, Bounds, so3
from debrisgrasp.io import Capture, data_path
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.prototypes import GripperModel, SurfaceShape
from debrisgrasp.workbench import parse_hand_pose, record, taught_by_joints

HAND = GripperModel.load("robotiq_3f")
BOX = Bounds(np.array([0.85, 0.22, 0.02]), np.array([1.15, 0.45, 0.2]))


@pytest.fixture(scope="module")
def pile() -> Capture:
    return Capture.load(data_path("captures", "pile.npz"))


@pytest.fixture(scope="module")
def recorded(pile):
    return record(pile, "part", HAND, object_label=6, preshape="basic")


def test_an_object_becomes_a_sound_prototype(recorded, pile):
    assert recorded.findings == ()
    definition = recorded.definition
    assert definition.name == "part"
    assert definition.description == "recorded from pile"
    assert isinstance(definition.shape, SurfaceShape)
    assert definition.shape.sides == "seen"
    # Its points are measured ones.
    points = recorded.T_base_hand.apply(definition.shape.points)
    cloud = pile.cloud().points
    for point in points[::40]:
        assert np.linalg.norm(cloud - point, axis=1).min() < 1e-6


def test_a_recording_shows_itself_in_a_line(recorded):
    n = recorded.n_points
    told = f"<Recording part for robotiq_3f, preshape basic: {n} points, fits>"
    assert repr(recorded) == told
    shape = recorded.definition.shape
    assert repr(shape) == f"<SurfaceShape of {len(shape.points)} points, sides seen>"


def test_a_taught_pose_is_kept(recorded, pile):
    again = record(
        pile,
        "part",
        HAND,
        object_label=6,
        T_base_hand=recorded.T_base_hand,
        preshape=recorded.definition.preshape,
    )
    assert again.proposals == ()
    assert np.allclose(again.T_base_hand.matrix, recorded.T_base_hand.matrix)
    assert again.definition.width == pytest.approx(recorded.definition.width, abs=1e-3)
    assert np.allclose(again.definition.shape.points, recorded.definition.shape.points)


def test_a_palm_inside_what_was_seen_is_found_though_no_finger_meets_it():
    angle, height = np.meshgrid(np.linspace(2.0, 4.3, 60), np.linspace(0.0, 0.4, 150))
    post = np.stack([1 + 0.03 * np.cos(angle), 0.03 * np.sin(angle), height], axis=-1)
    seen = Capture(
        points=post.reshape(-1, 3),
        viewpoint=(0.0, 0.0, 0.6),
        T_base_camera=SE3.identity(),
    )
    down = so3.from_rpy(np.array([np.pi, 0.0, np.pi / 2]))
    whole = Bounds(np.array([0.9, -0.1, -0.1]), np.array([1.1, 0.1, 0.5]))

    def findings(height: float) -> tuple[str, ...]:
        palm = SE3.from_parts(down, (1.0, 0.0, height))
        made = record(seen, "a", HAND, region=whole, T_base_hand=palm, preshape="basic")
        return made.findings

    assert findings(0.42) == ()
    (found,) = findings(0.3)
    assert "the open hand reaches 36 mm into the shape" in found


def test_a_box_and_a_mask_choose_the_piece_too(recorded, pile):
    taught = {"T_base_hand": recorded.T_base_hand, "preshape": "basic"}
    by_box = record(pile, "part", HAND, region=BOX, **taught)
    assert by_box.n_points > 1000
    mask = np.zeros(pile.depth.shape, dtype=bool)
    mask.ravel()[pile.cloud().pixels[BOX.contains(pile.cloud().points)]] = True
    by_mask = record(replace(pile, mask=mask), "part", HAND, **taught)
    assert by_mask.n_points == by_box.n_points
    assert np.allclose(by_mask.definition.shape.points, by_box.definition.shape.points)


def test_the_width_may_be_given(recorded, pile):
    made = record(
        pile, "part", HAND, region=BOX, T_base_hand=recorded.T_base_hand, width=0.07
    )
    assert made.definition.width == 0.07
    with pytest.raises(ConfigError, match="width"):
        record(
            pile, "part", HAND, region=BOX, T_base_hand=recorded.T_base_hand, width=70
        )


@pytest.mark.parametrize(
    ("choice", "kind", "said"),
    [
        ({}, ConfigError, "segment CAPTURE"),
        ({"object_label": 77}, UnknownNameError, "label"),
        ({"region": Bounds(np.full(3, 5.0), np.full(3, 6.0))}, CaptureError, "larger"),
        ({"region": Bounds(np.full(3, -9.0), np.full(3, 9.0))}, CaptureError, "1 m"),
        ({"region": BOX, "preshape": "fist"}, UnknownNameError, "basic"),
        ({"region": BOX, "choice": 99, "preshape": "pinch"}, ConfigError, "1 to"),
        (
            {"region": BOX, "T_base_hand": SE3.from_parts(p=(0, 0, 3.0))},
            InputError,
            "between the fingers",
        ),
    ],
)
def test_what_gives_no_prototype_is_refused_with_the_mend(pile, choice, kind, said):
    with pytest.raises(kind, match=said):
        record(pile, "part", HAND, **choice)


def test_joint_values_say_where_the_hand_is():
    robot = RobotModel.load("roman")
    (arm,) = robot.arms_with("robotiq_3f")
    joint = next(iter(robot.posture(arm, "ready")))
    values = robot.posture(arm, "ready")
    pose = taught_by_joints(robot, None, values, "robotiq_3f")
    chain = robot.chain(arm)
    q = [robot.joint_values(values)[name] for name in chain.joint_names]
    expected = chain.fk(q)
    assert np.allclose(pose.matrix, expected.matrix)
    other = taught_by_joints(
        robot, arm, values | {joint: values[joint] + 0.1}, "robotiq_3f"
    )
    assert not np.allclose(other.matrix, pose.matrix)
    with pytest.raises(UnknownNameError, match="joint"):
        taught_by_joints(robot, arm, {"elbow_joint_9": 0.0}, "robotiq_3f")
    with pytest.raises(ConfigError, match="carries"):
        taught_by_joints(robot, arm, values, "camhand")
    with pytest.raises(UnknownNameError, match="gripper"):
        taught_by_joints(robot, None, values, "tongs")
    with pytest.raises(ConfigError, match=r"90 degrees are 1\.571"):
        taught_by_joints(robot, None, {"right_arm_joint1": 109.0}, "robotiq_3f")


def test_poses_are_read_from_numbers_and_files(tmp_path):
    pose = parse_hand_pose("0.9,0.1,0.4,3.1,0,0")
    np.save(tmp_path / "pose.npy", pose.matrix)
    again = parse_hand_pose(str(tmp_path / "pose.npy"))
    assert np.allclose(again.matrix, pose.matrix)
    for text in ("level", "1,2,3", "0.9,0.1,0.4,180,0,0", str(tmp_path / "no.npy")):
        with pytest.raises(ConfigError):
            parse_hand_pose(text)
    with pytest.raises(ConfigError, match="pose of the hand"):
        parse_hand_pose("left")
