"""The examples of embedding, run against what stands in for ROS and for hardware."""

from __future__ import annotations

import json
import socket
import sys
import threading
import urllib.error
import urllib.request
from contextlib import contextmanager
from importlib import util
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from debrisgrasp import Capture, Pipeline
from debrisgrasp.geometry import so3
from debrisgrasp.robot import DepthCamera

EXAMPLES = Path(__file__).parents[2] / "examples"


def example(name: str) -> ModuleType:
    spec = util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def vector(values: Any, names: str = "xyz") -> SimpleNamespace:
    return SimpleNamespace(**dict(zip(names, map(float, values), strict=True)))


def messages(capture: Capture) -> tuple[SimpleNamespace, ...]:
    """Image, camera info and transform, as ROS would bring the capture."""
    millimetres = np.nan_to_num(1000.0 * capture.depth).round().astype("<u2")
    height, width = millimetres.shape
    image = SimpleNamespace(
        height=height, width=width, encoding="16UC1", is_bigendian=0,
        step=2 * width, data=millimetres.tobytes(),
    )  # fmt: skip
    K = capture.intrinsics.matrix.ravel()
    info = SimpleNamespace(height=height, width=width, k=K, d=[])
    T = capture.T_base_camera
    quaternion = np.roll(so3.to_quat_wxyz(T.R), -1)
    transform = SimpleNamespace(
        translation=vector(T.p), rotation=vector(quaternion, "xyzw")
    )
    return image, info, transform


def test_importing_the_examples_and_conversions_needs_no_ros_and_no_camera():
    for name in ("20_ros2_node", "22_depth_camera"):
        example(name)
    assert not {"rclpy", "pyrealsense2"} & set(sys.modules)


def test_the_node_answers_with_a_pose_and_a_motion(pipe_capture, dictionary):
    node = example("20_ros2_node")
    pipeline = Pipeline(arm="right", prototypes=dictionary)
    pose, motion, why = node.answer(pipeline, *messages(pipe_capture))
    assert not why
    assert pose["header"]["frame_id"] == "base"
    position = pose["pose"]["position"]
    away = [position[axis] for axis in "xyz"] - np.array([0.9, 0.0, 0.3])
    assert np.linalg.norm(away) < 0.6
    assert motion["joint_names"] == list(pipeline.arms[0].joint_names)
    assert motion["points"][0]["velocities"] == [0.0] * len(motion["joint_names"])


def test_the_node_says_why_there_is_no_grasp(floor_capture, dictionary):
    node = example("20_ros2_node")
    pipeline = Pipeline(arm="right", prototypes=dictionary)
    pose, motion, why = node.answer(pipeline, *messages(floor_capture))
    assert pose is motion is None
    assert "no object" in why


def test_the_recording_stands_in_for_a_camera(pipe_file, pipe_capture):
    camera = example("22_depth_camera").RecordedCamera(pipe_file)
    assert isinstance(camera, DepthCamera)
    np.testing.assert_allclose(camera.capture().depth, pipe_capture.depth, atol=1e-4)


def test_frames_of_a_realsense_camera_arrive_in_metres():
    """Needs pyrealsense2, but no camera: its software device takes any image."""
    rs = pytest.importorskip("pyrealsense2")
    depth = (500 + np.arange(64 * 48).reshape(48, 64) % 2000).astype(np.uint16)
    frame = software_frame(rs, depth)
    taken = example("22_depth_camera").depth_frame(frame, 0.001)
    np.testing.assert_allclose(taken.depth, 0.001 * depth)
    assert (taken.intrinsics.fx, taken.intrinsics.cy) == (60.0, 23.0)


def software_frame(rs: Any, depth: np.ndarray) -> Any:
    height, width = depth.shape
    intrinsics = rs.intrinsics()
    intrinsics.width, intrinsics.height = width, height
    intrinsics.fx, intrinsics.fy, intrinsics.ppx, intrinsics.ppy = 60, 61, 31, 23
    intrinsics.coeffs = [0.0] * 5
    stream = rs.video_stream()
    stream.type, stream.fmt, stream.bpp = rs.stream.depth, rs.format.z16, 2
    stream.width, stream.height, stream.fps = width, height, 15
    stream.intrinsics = intrinsics
    device = rs.software_device()
    sensor = device.add_sensor("Depth")
    profile, queue = sensor.add_video_stream(stream), rs.frame_queue(2)
    sensor.open(profile)
    sensor.start(queue)
    frame = rs.software_video_frame()
    frame.stride, frame.bpp, frame.pixels = 2 * width, 2, depth
    frame.frame_number, frame.profile = 1, profile.as_video_stream_profile()
    sensor.on_video_frame(frame)
    return queue.wait_for_frame().as_depth_frame()


@contextmanager
def served(server):
    """Address of a server that answers in a thread of its own."""
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield server.server_address
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def asked(address, content):
    """Status and fields of the answer of a server."""
    try:
        url = "http://{}:{}/".format(*address)
        with urllib.request.urlopen(url, content, timeout=60.0) as reply:
            return reply.status, json.load(reply)
    except urllib.error.HTTPError as refused:
        with refused:
            return refused.code, json.load(refused)


def test_the_server_plans_on_what_it_is_sent(pipe_file, dictionary):
    pipeline = Pipeline(robot="none", gripper="robotiq_3f", prototypes=dictionary)
    with served(example("23_plan_server").serve(pipeline, 0)) as address:
        status, plan = asked(address, pipe_file.read_bytes())
        assert (status, plan["schema"]) == (200, "debrisgrasp/grasps/1")
        assert plan["grasps"]
        status, answer = asked(address, b"no capture")
        assert status == 422
        assert "capture" in answer["error"]


def test_a_client_that_stalls_or_leaves_does_not_keep_others_waiting(
    monkeypatch, capfd
):
    module = example("23_plan_server")
    monkeypatch.setattr(module, "PATIENCE", 0.2)
    half = b"POST / HTTP/1.1\r\nContent-Length: 1000\r\n\r\nhalf of it"
    with served(module.serve(SimpleNamespace(plan=None), 0)) as address:
        with socket.create_connection(address) as stalling:
            stalling.sendall(half)
            assert asked(address, b"no capture")[0] == 422
        with socket.create_connection(address) as leaving:
            leaving.sendall(half)
        assert asked(address, b"no capture")[0] == 422
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.parametrize("told", ["", "many", "-1", "0", "9" * 20, "9" * 5000])
def test_a_request_of_no_length_that_can_be_is_refused(told):
    server = example("23_plan_server").serve(SimpleNamespace(plan=None), 0)
    with served(server) as address, socket.create_connection(address) as client:
        client.sendall(f"POST / HTTP/1.1\r\nContent-Length: {told}\r\n\r\n".encode())
        assert client.makefile("rb").readline().split()[1] == b"413"
