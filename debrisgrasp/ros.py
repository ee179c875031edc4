"""ROS messages from and to this library, by plain conversion.

Nothing of ROS is imported. What comes in is read by its fields, so that it may be a
message of rclpy, of rospy, of a bag reader, or anything with the same fields. What goes
out is a dictionary with the fields of the message: in ROS 2
``rosidl_runtime_py.set_message_fields(message, dictionary)`` fills a message with it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from debrisgrasp._arrays import FloatArray, require_range
from debrisgrasp._checked import checked
from debrisgrasp.errors import CaptureError, InputError
from debrisgrasp.geometry import SE3, Intrinsics, so3
from debrisgrasp.io import Capture
from debrisgrasp.kinematics import Trajectory
from debrisgrasp.planning import Grasp
from debrisgrasp.prototypes import GripperModel

__all__ = [
    "CameraInfoMessage",
    "ImageMessage",
    "StampedTransformMessage",
    "TransformMessage",
    "capture_of",
    "joint_trajectory",
    "moveit_grasp",
    "pose_of",
    "pose_stamped",
]

_DEPTH_UNITS = {"16UC1": 1e-3, "mono16": 1e-3, "32FC1": 1.0}
"""Metres for each unit of the encodings in which drivers publish depth (REP 118)."""
Fields = dict[str, Any]


class ImageMessage(Protocol):
    """Fields of ``sensor_msgs/Image`` that are read."""

    height: int
    width: int
    encoding: str
    is_bigendian: int
    step: int
    """Bytes of a row."""
    data: Any


class CameraInfoMessage(Protocol):
    """Fields of ``sensor_msgs/CameraInfo`` that are read (in ROS 1: K, D)."""

    height: int
    width: int
    k: Any
    """Nine numbers, row by row [pixels]."""
    d: Any
    """Distortion; anything but zeros is refused."""


class TransformMessage(Protocol):
    """Fields of ``geometry_msgs/Transform``."""

    translation: Any
    """x, y, z [m]."""
    rotation: Any
    """Quaternion x, y, z, w."""


class StampedTransformMessage(Protocol):
    """Field of ``geometry_msgs/TransformStamped`` that is read."""

    transform: TransformMessage


@checked
def capture_of(
    image: ImageMessage, info: CameraInfoMessage, T_base_camera: SE3
) -> Capture:
    """Make a capture of a depth image, its camera, and the camera's pose.

    Parameters
    ----------
    image
        ``sensor_msgs/Image``: encoding 16UC1 (millimetres) or 32FC1 (metres).
    info
        ``sensor_msgs/CameraInfo`` of the same, rectified image.
    T_base_camera
        Pose of the optical frame in the base frame; see `pose_of`.

    Raises
    ------
    CaptureError
        If the image is no depth, incomplete, distorted, or the camera of another size.
    InputError
        If one of them is a message of another kind.
    """
    _require_fields(image, ImageMessage, "sensor_msgs/Image")
    _require_fields(info, CameraInfoMessage, "sensor_msgs/CameraInfo")
    depth = _depth(image)
    size = (int(info.height), int(info.width))
    if size != depth.shape:
        raise CaptureError(
            "camera info",
            got=f"one of {size[1]} x {size[0]} pixels",
            expected=f"{depth.shape[1]} x {depth.shape[0]}, as the image",
            mend="Subscribe to the camera_info topic beside the image.",
        )
    distortion = np.asarray(_field(info, "d"), dtype=np.float64)
    if not np.all(np.abs(distortion) <= 1e-6):
        raise CaptureError(
            "distortion of camera info",
            got=distortion.tolist(),
            expected="none",
            mend="Subscribe to the rectified image. ROS describes that by p beside the "
            "k and d of the raw one: copy its info, with the left 3 x 3 of p as k, and "
            "no d.",
        )
    K = np.asarray(_field(info, "k"), dtype=np.float64)
    if K.size != 9:
        raise CaptureError(
            "K of camera info",
            got=f"{K.size} numbers",
            expected="9, row by row: [fx, 0, cx, 0, fy, cy, 0, 0, 1]",
        )
    return Capture(
        depth=depth,
        intrinsics=Intrinsics.from_matrix(K, size),
        T_base_camera=T_base_camera,
        name="ros",
    )


def pose_of(transform: TransformMessage | StampedTransformMessage) -> SE3:
    """Pose from ``geometry_msgs/Transform``, or from the ``TransformStamped`` of tf2.

    Returns
    -------
    SE3
        Pose of the child frame, as the camera, in the frame of the header, as base [m].

    Raises
    ------
    InputError
        If its quaternion is zero, a number of it is not finite, or it is a message of
        another kind.
    """
    inner: Any = getattr(transform, "transform", None) or transform
    _require_fields(inner, TransformMessage, "geometry_msgs/Transform")
    t, r = inner.translation, inner.rotation
    R = so3.from_quat_wxyz(np.array([r.w, r.x, r.y, r.z], dtype=np.float64))
    return SE3.from_matrix(SE3.from_parts(R, [t.x, t.y, t.z]).matrix)


@checked
def pose_stamped(T: SE3, *, frame_id: str = "base", stamp: float = 0.0) -> Fields:
    """Make the fields of ``geometry_msgs/PoseStamped``.

    Parameters
    ----------
    T
        For instance `Grasp.T_base_hand`.
    frame_id
        Name by which the ROS side knows the frame that the pose is in.
    stamp
        Seconds.

    Raises
    ------
    InputError
        If it is several poses, or none.
    """
    if T.batch:
        raise InputError("T", got=f"a batch {T.batch}", expected="one pose")
    w, x, y, z = so3.to_quat_wxyz(T.R).tolist()
    return {
        "header": _header(frame_id, stamp),
        "pose": {
            "position": _vector(T.p),
            "orientation": {"x": x, "y": y, "z": z, "w": w},
        },
    }


@checked
def joint_trajectory(
    trajectory: Trajectory, *, period: float | None = None, stamp: float = 0.0
) -> Fields:
    """Make the fields of ``trajectory_msgs/JointTrajectory``.

    Parameters
    ----------
    trajectory
        Motion to send.
    period
        Seconds between its points; None: the knots of the trajectory, between which
        ros2_control interpolates with the same cubics.
    stamp
        When it begins; 0: when it arrives.

    Raises
    ------
    ConfigError
        If the period is below 0.1 ms.
    """
    times, q, dq = trajectory.times, trajectory.q, trajectory.dq
    if period is not None:
        require_range("period [s]", period, 1e-4)
        n = max(2, int(np.ceil(trajectory.duration / period - 1e-9)) + 1)
        times = np.linspace(0.0, trajectory.duration, n)
        q, dq, _ = trajectory.at(times)
    points = [
        {
            "positions": q[i].tolist(),
            "velocities": dq[i].tolist(),
            "accelerations": [],
            "effort": [],
            "time_from_start": _time(float(t)),
        }
        for i, t in enumerate(times)
    ]
    return {
        "header": _header("", stamp),
        "joint_names": list(trajectory.joint_names),
        "points": points,
    }


@checked
def moveit_grasp(
    grasp: Grasp,
    hand: GripperModel,
    *,
    joint_names: Mapping[str, str] | None = None,
    frame_id: str = "base",
    hand_frame: str = "hand",
    lift: float = 0.15,
    stamp: float = 0.0,
) -> Fields:
    """Make the fields of ``moveit_msgs/Grasp``.

    Parameters
    ----------
    grasp
        One grasp of a plan.
    hand
        The model of its hand: gives the postures of the fingers.
    joint_names
        Joints of the hand as MoveIt knows them, by our name ``<finger>_<joint>``; those
        not named are left out. None: all, under our names.
    frame_id, hand_frame
        Names by which MoveIt knows the base and the palm frame.
    lift
        How far to lift afterwards [m].
    stamp
        Seconds.
    """
    approach = grasp.T_base_hand.R[:, 2]
    distance = grasp.approach_distance
    return {
        "id": f"{grasp.prototype} on object {grasp.object_label}",
        "pre_grasp_posture": _posture(grasp, hand, grasp.opening, joint_names),
        "grasp_posture": _posture(grasp, hand, grasp.width, joint_names),
        "grasp_pose": pose_stamped(grasp.T_base_hand, frame_id=frame_id, stamp=stamp),
        "grasp_quality": float(grasp.score),
        "pre_grasp_approach": _translation(frame_id, approach, distance),
        "post_grasp_retreat": _translation(frame_id, np.array([0.0, 0.0, 1.0]), lift),
        "post_place_retreat": _translation(
            hand_frame, np.array([0.0, 0.0, -1.0]), distance
        ),
        "max_contact_force": float(hand.max_force),
        "allowed_touch_objects": [],
    }


def _posture(
    grasp: Grasp,
    hand: GripperModel,
    opening: float,
    joint_names: Mapping[str, str] | None,
) -> Fields:
    """Joint trajectory of one point: how the fingers stand at an opening [m]."""
    values = hand.joint_values(grasp.preshape, opening)
    names = {name: name for name in values} if joint_names is None else joint_names
    kept = {names[name]: value for name, value in values.items() if name in names}
    return {
        "header": _header("", 0.0),
        "joint_names": list(kept),
        "points": [
            {
                "positions": list(kept.values()),
                "velocities": [],
                "accelerations": [],
                "effort": [],
                "time_from_start": _time(0.0),
            }
        ],
    }


def _translation(frame_id: str, direction: FloatArray, distance: float) -> Fields:
    """Fields of ``moveit_msgs/GripperTranslation``."""
    return {
        "direction": {"header": _header(frame_id, 0.0), "vector": _vector(direction)},
        "desired_distance": float(distance),
        "min_distance": 0.5 * float(distance),
    }


def _depth(image: ImageMessage) -> FloatArray:
    if image.encoding not in _DEPTH_UNITS:
        raise CaptureError(
            "encoding of the image",
            got=repr(image.encoding),
            expected="a depth image: " + ", ".join(_DEPTH_UNITS),
            mend="Subscribe to the depth topic, not compressed.",
        )
    unit = _DEPTH_UNITS[image.encoding]
    height, width, step = int(image.height), int(image.width), int(image.step)
    order = ">" if image.is_bigendian else "<"
    kind = np.dtype(f"{order}f4" if unit == 1.0 else f"{order}u2")
    data = np.frombuffer(bytes(image.data), dtype=np.uint8)
    if step < width * kind.itemsize or data.size < height * step:
        raise CaptureError(
            "image data",
            got=f"{data.size} bytes in rows of {step}",
            expected=f"{height} rows of at least {width * kind.itemsize} bytes",
        )
    rows = data[: height * step].reshape(height, step)[:, : width * kind.itemsize]
    raw = np.ascontiguousarray(rows).view(kind).astype(np.float64)
    raw[np.isneginf(raw)] = np.nan  # too near to be measured, by REP 117
    return raw * unit


def _require_fields(message: Any, protocol: type, kind: str) -> None:
    """Raise `InputError` if a message lacks what is read of its kind."""
    missing = [
        name
        for name in protocol.__annotations__
        if not (hasattr(message, name) or hasattr(message, name.upper()))
    ]
    if missing:
        raise InputError(
            "message",
            got=f"a {type(message).__name__} without {', '.join(missing)}",
            expected=f"one of {kind}",
        )


def _field(message: Any, name: str) -> Any:
    """Value of a field that ROS 1 writes in capitals."""
    return (
        getattr(message, name)
        if hasattr(message, name)
        else getattr(message, name.upper())
    )


def _header(frame_id: str, stamp: float) -> Fields:
    return {"stamp": _time(stamp), "frame_id": frame_id}


def _time(seconds: float) -> Fields:
    whole, nanoseconds = divmod(round(seconds * 1e9), 10**9)
    return {"sec": int(whole), "nanosec": int(nanoseconds)}


def _vector(values: FloatArray) -> Fields:
    x, y, z = np.asarray(values, dtype=np.float64).tolist()
    return {"x": x, "y": y, "z": z}
