"""Conversions to ROS messages, against the definitions of the messages."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from debrisgrasp import ros
from debrisgrasp.errors import CaptureError, ConfigError, InputError
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.kinematics import Trajectory
from debrisgrasp.prototypes import GripperModel
from tests.grasps import grasp_at

typesys = pytest.importorskip("rosbags.typesys")

MOVEIT = {
    "moveit_msgs/msg/Grasp": """
string id
trajectory_msgs/JointTrajectory pre_grasp_posture
trajectory_msgs/JointTrajectory grasp_posture
geometry_msgs/PoseStamped grasp_pose
float64 grasp_quality
GripperTranslation pre_grasp_approach
GripperTranslation post_grasp_retreat
GripperTranslation post_place_retreat
float32 max_contact_force
string[] allowed_touch_objects
""",
    "moveit_msgs/msg/GripperTranslation": """
geometry_msgs/Vector3Stamped direction
float32 desired_distance
float32 min_distance
""",
}
TURNED = SE3.from_parts(so3.from_rpy(np.array([0.3, -0.4, 2.0])), [0.9, -0.2, 0.4])


@pytest.fixture(scope="module")
def store() -> Any:
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    for name, text in MOVEIT.items():
        store.register(typesys.get_types_from_msg(text, name))
    return store


@pytest.fixture(scope="module")
def sent(store):
    """Send fields as a message: filled, serialised and read back."""

    def send(name: str, fields: dict[str, Any]) -> Any:
        message = filled(store, name, fields)
        return store.deserialize_cdr(store.serialize_cdr(message, name), name)

    return send


def filled(store: Any, name: str, fields: dict[str, Any]) -> Any:
    """Fill a message; a field too many or too few is an error."""
    kind = store.types[name]
    known = {n: v for n, v in kind.__annotations__.items() if n != "__msgtype__"}
    assert set(fields) == set(known), name
    values = {}
    for field, annotation in known.items():
        value, text = fields[field], str(annotation)
        if isinstance(value, dict):
            value = filled(store, text.replace("__", "/"), value)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            inner = text.removeprefix("list[").removesuffix("]").replace("__", "/")
            value = [filled(store, inner, item) for item in value]
        elif "ndarray" in text:
            value = np.array(value, dtype=np.float64)
        values[field] = value
    return kind(**values)


def image(depth: np.ndarray, encoding: str, *, padding: int = 0, big: bool = False):
    kind = np.dtype((">" if big else "<") + ("f4" if encoding == "32FC1" else "u2"))
    rows = np.ascontiguousarray(depth.astype(kind)).view(np.uint8)
    rows = np.pad(rows, ((0, 0), (0, padding)), constant_values=77)
    return {
        "header": {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": "camera"},
        "height": depth.shape[0],
        "width": depth.shape[1],
        "encoding": encoding,
        "is_bigendian": int(big),
        "step": rows.shape[1],
        "data": rows.ravel(),
    }


def image_message(store: Any, fields: dict[str, Any]) -> Any:
    header = filled(store, "std_msgs/msg/Header", fields["header"])
    return store.types["sensor_msgs/msg/Image"](**(fields | {"header": header}))


@pytest.fixture
def info(store):
    kind = store.types["sensor_msgs/msg/CameraInfo"]
    roi = store.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, do_rectify=False)
    header = filled(store, "std_msgs/msg/Header", ros._header("camera", 0.0))
    K = np.array([60.0, 0, 31.5, 0, 60.0, 23.5, 0, 0, 1])
    return kind(
        header, 48, 64, "plumb_bob", np.zeros(5), K, np.eye(3).ravel(),
        np.zeros(12), 0, 0, roi,
    )  # fmt: skip


@pytest.fixture
def depth(rng) -> np.ndarray:
    return np.round(rng.uniform(0.5, 3.0, (48, 64)), 3)


@pytest.mark.parametrize("encoding", ["16UC1", "mono16", "32FC1"])
@pytest.mark.parametrize(("padding", "big"), [(0, False), (6, False), (0, True)])
def test_a_depth_image_becomes_a_capture(store, info, depth, encoding, padding, big):
    values = depth if encoding == "32FC1" else np.round(1000 * depth)
    fields = image(values, encoding, padding=padding, big=big)
    capture = ros.capture_of(image_message(store, fields), info, TURNED)
    np.testing.assert_allclose(capture.depth, depth, atol=1e-6)
    assert capture.intrinsics.fx == 60.0
    assert capture.T_base_camera is TURNED


def test_pixels_without_a_measurement_stay_so(store, info, depth):
    values = np.round(1000 * depth)
    values[3, 5] = 0
    message = image_message(store, image(values, "16UC1"))
    assert np.isnan(ros.capture_of(message, info, TURNED).depth[3, 5])
    depth[3, 5:8] = np.nan, np.inf, -np.inf
    message = image_message(store, image(depth, "32FC1"))
    assert np.isnan(ros.capture_of(message, info, TURNED).depth[3, 5:8]).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"encoding": "rgb8"}, "a depth image"),
        ({"step": 12}, "rows of at least 128 bytes"),
        ({"data": np.zeros(12, dtype=np.uint8)}, "image data"),
    ],
)
def test_what_is_no_depth_image_is_refused(store, info, depth, change, message):
    fields = image(np.round(1000 * depth), "16UC1") | change
    with pytest.raises(CaptureError, match=message):
        ros.capture_of(image_message(store, fields), info, TURNED)


def test_a_camera_of_another_size_or_with_distortion_is_refused(store, info, depth):
    message = image_message(store, image(np.round(1000 * depth), "16UC1"))
    with pytest.raises(CaptureError, match=r"32 x 48 pixels.*64 x 48"):
        ros.capture_of(message, replace(info, width=32), TURNED)
    with pytest.raises(CaptureError, match=r"rectified.*left 3 x 3 of p as k"):
        ros.capture_of(message, replace(info, d=np.array([0.1, 0, 0, 0, 0])), TURNED)
    with pytest.raises(CaptureError, match=r"distortion.*nan"):
        ros.capture_of(message, replace(info, d=np.full(5, np.nan)), TURNED)


def test_k_of_another_size_is_refused(store, info, depth):
    message = image_message(store, image(np.round(1000 * depth), "16UC1"))
    with pytest.raises(CaptureError, match=r"K of camera info.*4 numbers.*9"):
        ros.capture_of(message, replace(info, k=np.ones(4)), TURNED)


def test_messages_of_another_kind_are_told(store, info, depth):
    message = image_message(store, image(np.round(1000 * depth), "16UC1"))
    with pytest.raises(InputError, match=r"without encoding.*sensor_msgs/Image"):
        ros.capture_of(info, message, TURNED)
    with pytest.raises(InputError, match=r"without k, d.*sensor_msgs/CameraInfo"):
        ros.capture_of(message, message, TURNED)
    pose = SimpleNamespace(position=None, orientation=None)
    with pytest.raises(InputError, match=r"translation.*geometry_msgs/Transform"):
        ros.pose_of(pose)


def test_a_pose_survives_the_way_there_and_back(store, sent):
    message = sent(
        "geometry_msgs/msg/PoseStamped",
        ros.pose_stamped(TURNED, frame_id="base_link", stamp=1.25),
    )
    assert message.header.frame_id == "base_link"
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1, 250_000_000)
    transform = store.types["geometry_msgs/msg/Transform"](
        message.pose.position, message.pose.orientation
    )
    np.testing.assert_allclose(ros.pose_of(transform).matrix, TURNED.matrix, atol=1e-12)
    stamped = SimpleNamespace(transform=transform)  # as tf2 looks it up
    np.testing.assert_allclose(ros.pose_of(stamped).matrix, TURNED.matrix, atol=1e-12)


def test_what_no_message_can_be_made_of_is_told():
    with pytest.raises(InputError, match=r"T: got ndarray.*SE3"):
        ros.pose_stamped(TURNED.matrix)
    with pytest.raises(InputError, match=r"T: got a batch.*one pose"):
        ros.pose_stamped(SE3(np.stack([TURNED.matrix] * 3)))
    with pytest.raises(InputError, match="stamp"):
        ros.pose_stamped(TURNED, stamp=np.nan)
    with pytest.raises(InputError, match="trajectory"):
        ros.joint_trajectory(None)


def test_a_transform_that_nobody_filled_in_is_no_pose(store):
    types = store.types
    empty = types["geometry_msgs/msg/Transform"](
        types["geometry_msgs/msg/Vector3"](1.0, 0.0, 0.0),
        types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 0.0),
    )
    with pytest.raises(InputError, match="an empty message holds only zeros"):
        ros.pose_of(empty)
    lost = SimpleNamespace(
        translation=SimpleNamespace(x=np.nan, y=0.0, z=0.0),
        rotation=SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0),
    )
    with pytest.raises(InputError, match="transform"):
        ros.pose_of(lost)


def test_a_trajectory_is_sent_by_its_knots_or_at_a_period(sent):
    motion = Trajectory(
        joint_names=("a", "b"),
        times=np.array([0.0, 0.5, 1.1]),
        q=np.array([[0.0, 1.0], [0.2, 0.9], [0.5, 0.5]]),
        dq=np.array([[0.0, 0.0], [0.5, -0.4], [0.0, 0.0]]),
        limits_hash="x",
    )
    name = "trajectory_msgs/msg/JointTrajectory"
    knots = sent(name, ros.joint_trajectory(motion))
    with pytest.raises(ConfigError, match="period"):
        ros.joint_trajectory(motion, period=0.0)
    assert knots.joint_names == ["a", "b"]
    np.testing.assert_allclose([p.positions for p in knots.points], motion.q)
    np.testing.assert_allclose([p.velocities for p in knots.points], motion.dq)
    fine = sent(name, ros.joint_trajectory(motion, period=0.1))
    times = [
        p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in fine.points
    ]
    np.testing.assert_allclose(np.diff(times), 0.1)
    np.testing.assert_allclose(
        [p.positions for p in fine.points], motion.at(np.array(times))[0], atol=1e-8
    )


def test_a_grasp_becomes_one_of_moveit(sent):
    hand = GripperModel.load("robotiq_3f")
    grasp = grasp_at(
        TURNED,
        TURNED @ SE3.from_parts(p=[0.0, 0.0, -0.12]),
        prototype="pipe",
        expected=0.7,
        score=0.6,
        object_label=4,
    )
    message = sent("moveit_msgs/msg/Grasp", ros.moveit_grasp(grasp, hand))
    assert message.id == "pipe on object 4"
    assert message.grasp_quality == 0.6
    approach = message.pre_grasp_approach
    assert approach.desired_distance == pytest.approx(0.12)
    v = approach.direction.vector
    np.testing.assert_allclose((v.x, v.y, v.z), TURNED.R[:, 2])
    for posture, opening in (
        (message.pre_grasp_posture, 0.1),
        (message.grasp_posture, 0.06),
    ):
        values = dict(
            zip(posture.joint_names, posture.points[0].positions, strict=True)
        )
        assert values == pytest.approx(hand.joint_values("basic", opening))
    some = next(iter(values))
    named = ros.moveit_grasp(grasp, hand, joint_names={some: "finger_joint"})
    assert named["grasp_posture"]["joint_names"] == ["finger_joint"]
