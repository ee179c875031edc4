"""A driver for RealSense cameras, and a recording that stands in for one.

Both fulfil `debrisgrasp.robot.DepthCamera`.

Run: python examples/22_depth_camera.py [--camera] [--pose=X,Y,Z,ROLL,PITCH,YAW]
"""

import argparse
import time
from pathlib import Path

import numpy as np

import debrisgrasp
from debrisgrasp import Capture, Intrinsics
from debrisgrasp.io import data_path, parse_camera_pose
from debrisgrasp.robot import DepthCamera, DepthFrame


class RealSenseCamera:
    """Depth stream of a RealSense camera; needs pyrealsense2."""

    def __init__(self, width: int = 848, height: int = 480, rate: int = 15) -> None:
        import pyrealsense2 as rs

        config = rs.config()
        config.enable_stream(rs.stream.depth, width, height, rs.format.z16, rate)
        self._pipeline = rs.pipeline()
        profile = self._pipeline.start(config)
        self._scale = profile.get_device().first_depth_sensor().get_depth_scale()
        for _ in range(rate):  # the exposure settles within the first second
            self._pipeline.wait_for_frames()

    def capture(self) -> DepthFrame:
        frame = self._pipeline.wait_for_frames().get_depth_frame()
        return depth_frame(frame, self._scale)


def depth_frame(frame, scale: float) -> DepthFrame:
    """Take depth [m] and intrinsics from a ``pyrealsense2.depth_frame``."""
    seen = frame.profile.as_video_stream_profile().get_intrinsics()
    if any(abs(value) > 1e-6 for value in seen.coeffs):
        raise ValueError(f"depth with distortion {seen.coeffs}: rectify it first")
    matrix = [[seen.fx, 0, seen.ppx], [0, seen.fy, seen.ppy], [0, 0, 1]]
    K = Intrinsics.from_matrix(matrix, (seen.height, seen.width))
    depth = np.asanyarray(frame.get_data()) * scale
    return DepthFrame(time=time.monotonic(), depth=depth, intrinsics=K)


class RecordedCamera:
    """Gives the image of a stored capture, again and again."""

    def __init__(self, path: str | Path) -> None:
        self.stored = Capture.load(path)

    def capture(self) -> DepthFrame:
        depth, K = self.stored.depth, self.stored.intrinsics
        return DepthFrame(time=time.monotonic(), depth=depth, intrinsics=K)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--camera", action="store_true", help="take a real camera")
    parser.add_argument("--pose", help="of the camera, if not that of the recording")
    arguments = parser.parse_args()
    recorded = RecordedCamera(data_path("captures", "pile.npz"))
    camera: DepthCamera = RealSenseCamera() if arguments.camera else recorded
    pose = recorded.stored.T_base_camera
    if arguments.pose:
        pose = parse_camera_pose(arguments.pose)
    frame = camera.capture()
    K = frame.intrinsics
    capture = Capture(depth=frame.depth, intrinsics=K, T_base_camera=pose)
    plan = debrisgrasp.plan(capture, robot="none", gripper="robotiq_3f").plan
    print(plan.why_empty or f"{len(plan.grasps)} grasps, Q {plan.grasps[0].Q:.2f}")


if __name__ == "__main__":
    main()
