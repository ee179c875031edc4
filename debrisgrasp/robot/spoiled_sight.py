"""A head and a camera that see too little, or not where they say."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray

from .interface import DepthCamera, DepthFrame, Head, JointReading
from .spoiling import Live, Spoiling

__all__ = ["SpoiledCamera", "SpoiledHead"]


class SpoiledHead:
    """A head that slipped on its axes, or does not turn."""

    def __init__(self, head: Head, spoiling: Spoiling) -> None:
        self._head, self._spoiling = head, spoiling

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Joints, in the order of all readings and commands."""
        return self._head.joint_names

    @property
    def is_still(self) -> bool:
        """Whether it has arrived."""
        return self._head.is_still

    def read(self) -> JointReading:
        """Latest measurement, off by the slip."""
        reading = self._head.read()
        slip = self._slip()
        if slip is None:
            return reading
        return JointReading(
            reading.time, np.asarray(reading.q, dtype=np.float64) + slip
        )

    def move_to(self, q: Sequence[float]) -> None:
        """Begin to turn to where the encoders say that this is."""
        for live in self._spoiling.due(("head",)):
            if live.fault == "calibration_poses":
                live.times += 1
                return
        slip = self._slip()
        self._head.move_to(q if slip is None else (np.asarray(q) - slip).tolist())

    def _slip(self) -> FloatArray | None:
        for live in self._spoiling.due(("head",)):
            if live.fault == "calibration_off":
                live.times += 1
                signs = np.array([1.0, -0.7, *[0.0] * 9])[: len(self.joint_names)]
                return np.asarray(live.severity * signs)
        return None


class SpoiledCamera:
    """A depth camera that sees nothing, too little, or the past."""

    def __init__(self, camera: DepthCamera, spoiling: Spoiling) -> None:
        self._camera, self._spoiling = camera, spoiling

    def capture(self) -> DepthFrame:
        """Take an image, and spoil it."""
        frame = self._camera.capture()
        for live in self._spoiling.due(("camera",)):
            if live.times < live.severity or live.fault == "plane_eats_pile":
                live.times += 1
                frame = _SPOILT_IMAGES[live.fault](live, frame)
        return frame


def _without(frame: DepthFrame, is_gone: BoolArray) -> DepthFrame:
    return replace(frame, depth=np.where(is_gone, 0.0, frame.depth))


def _empty(_: Live, frame: DepthFrame) -> DepthFrame:
    return replace(frame, depth=np.zeros_like(frame.depth))


def _holed(live: Live, frame: DepthFrame) -> DepthFrame:
    """Drop patches of an eighth of the height."""
    camera = frame.intrinsics
    size = max(camera.height // 8, 1)
    coarse = live.rng.random((camera.height // size + 1, camera.width // size + 1))
    patches = np.kron(coarse < 0.6, np.ones((size, size), dtype=bool))
    return _without(frame, patches[: camera.height, : camera.width])


def _stale(live: Live, frame: DepthFrame) -> DepthFrame:
    if live.rng.random() < 0.5:
        return replace(frame, time=frame.time - 5.0)
    return replace(frame, frame="rear_camera_optical_frame")


def _cropped(live: Live, frame: DepthFrame) -> DepthFrame:
    rows, columns = np.indices(frame.depth.shape)
    height, width = frame.depth.shape
    inside = np.abs(rows / height - 0.5) < live.severity / 2.0
    inside &= np.abs(columns / width - 0.5) < live.severity / 2.0
    return _without(frame, ~inside)


def _without_near(_: Live, frame: DepthFrame) -> DepthFrame:
    return _without(frame, frame.depth < 1.0)


_SPOILT_IMAGES: Mapping[str, Callable[[Live, DepthFrame], DepthFrame]] = {
    "empty_cloud": _empty,
    "depth_dropout": _holed,
    "stale_cloud": _stale,
    "plane_eats_pile": _cropped,
    "fiducial_lost": _without_near,
}
