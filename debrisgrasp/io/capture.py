"""The capture: one look at the scene, as a camera or scanner gave it."""

from __future__ import annotations

import os
from dataclasses import dataclass, fields, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, sealed
from debrisgrasp._checked import checked, checked_fields
from debrisgrasp._files import write_atomic
from debrisgrasp._unreadable import PULL, is_pointer, why_nothing_there
from debrisgrasp._words import as_text, shortened
from debrisgrasp.errors import CaptureError, InputError
from debrisgrasp.geometry import (
    SE3,
    Intrinsics,
    PointCloud,
    depth_facets,
    neighborhood_normals,
)

from ._checks import checked_depth, checked_image, checked_points, checked_pose
from ._fields import CaptureFields, naming_the_file
from .arrays_npz import read_npz
from .camera_pose import CameraPose
from .depth_images import read_depth_png, read_folder
from .pcd import read_pcd
from .ply import read_ply

__all__ = ["Capture"]


@checked_fields
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Capture:
    """A depth image with its camera, or a cloud with its viewpoint."""

    depth: FloatArray | None = None
    """Metres along the optical axis, shape (height, width); NaN where nothing was
    measured (0 and infinity are taken as that too)."""
    intrinsics: Intrinsics | None = None
    """Camera of the depth image."""
    points: FloatArray | None = None
    """Positions of an unorganised cloud [m], shape (n, 3), in its own frame, which is
    called ``camera`` here wherever its origin may be; rows that are not finite, or are
    the viewpoint, count as not measured."""
    viewpoint: FloatArray | None = None
    """Position of the sensor in the frame of the points [m], shape (3,)."""
    T_base_camera: SE3 | None = None
    """Measured pose of the camera, or of the frame of the points, in the base frame."""
    T_level_camera: SE3 | None = None
    """Pose in a frame that was derived from the scene: z up, z = 0 on the ground, but
    with an origin that has nothing to do with the robot."""
    rgb: NDArray[np.uint8] | None = None
    """Colours registered to the depth image or to the points, shape (..., 3)."""
    mask: BoolArray | None = None
    """Which pixels or points belong to an object of interest, shape (height, width) or
    (n,)."""
    labels: IntArray | None = None
    """Reference segmentation, one integer for each pixel or point: shape (height,
    width) or (n,)."""
    name: str = "capture"

    def __post_init__(self) -> None:
        checked: dict[str, Any] = {}
        if (self.depth is None) == (self.points is None):
            raise CaptureError(
                "capture",
                got="both depth and points" if self.points is not None else "neither",
                expected="either depth with K, or points with viewpoint",
            )
        if self.depth is not None:
            depth = checked_depth(self.depth, self.intrinsics)
            checked["depth"], shape = depth, depth.shape
        else:
            points, viewpoint = checked_points(self.points, self.viewpoint)
            checked["points"], checked["viewpoint"] = points, viewpoint
            shape = points.shape[:1]
        for name in ("rgb", "mask", "labels"):
            image = getattr(self, name)
            if image is not None:
                checked[name] = checked_image(image, name, shape)
        checked_pose(self.T_base_camera, "T_base_camera")
        checked_pose(self.T_level_camera, "T_level_camera")
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        words = []
        if self.depth is not None:
            height, width = self.depth.shape
            words.append(f"depth of {width} x {height} pixels")
        if self.points is not None:
            words.append(f"{len(self.points)} points")
        for name in ("T_base_camera", "T_level_camera", "rgb", "mask", "labels"):
            if getattr(self, name) is not None:
                words.append(name)
        return f"<Capture {self.name}: {', '.join(words)}>"

    @classmethod
    @checked
    def load(
        cls,
        path: str | os.PathLike[str],
        *,
        camera_pose: CameraPose | None = None,
        camera_file: str | os.PathLike[str] | None = None,
        viewpoint: ArrayLike | None = None,
    ) -> Capture:
        """Read a capture: .npz, depth PNG or folder with its camera, PLY or PCD.

        Parameters
        ----------
        path
            The file or folder.
        camera_pose
            Pose in the base frame that replaces the stored one, or ``"level"`` to take
            the stored ``T_level_camera`` for it.
        camera_file
            JSON or YAML with the camera of a depth PNG; looked for beside it if absent.
        viewpoint
            Position of the sensor [m], shape (3,), that replaces the one in the file of
            a cloud.

        Raises
        ------
        CaptureError, ConfigError
            Naming the file, what is wrong with it, and how to mend it.
        """
        if not os.fspath(path):
            raise CaptureError("path", got="an empty one", expected="a file or folder")
        path = Path(path)
        with naming_the_file(path):
            content = _read(path, camera_file)
            if viewpoint is not None:
                if content.get("points") is None:
                    raise _unused("viewpoint", "a depth image, seen from its camera")
                content["viewpoint"] = np.asarray(viewpoint)
            name = as_text(path.name if path.is_dir() else path.stem)
            capture = cls(**content, name=name)
            return capture if camera_pose is None else capture.posed(camera_pose)

    def posed(self, camera_pose: CameraPose) -> Capture:
        """Return the capture with another pose in the base frame.

        ``"level"`` takes `T_level_camera`, whose origin is not the robot: good for
        looking at the scene and for a floating hand, not for moving an arm.

        Raises
        ------
        CaptureError
            For ``"level"``, if the capture has no `T_level_camera`.
        InputError
            If it is neither that nor a transform.
        """
        if isinstance(camera_pose, SE3):
            return replace(self, T_base_camera=camera_pose)
        if not isinstance(camera_pose, str) or camera_pose != "level":
            raise InputError(
                "camera pose",
                got=shortened(repr(camera_pose))
                if isinstance(camera_pose, str)
                else type(camera_pose).__name__,
                expected="an SE3 or 'level'",
                mend="SE3.from_matrix(matrix) makes one.",
            )
        if self.T_level_camera is None:
            raise CaptureError(
                f"camera pose of {self.name}",
                got="'level', but the capture has no T_level_camera",
                expected="a capture with T_level_camera, or a measured pose",
                mend="Give the pose as a file or as x,y,z,roll,pitch,yaw.",
            )
        return replace(self, T_base_camera=self.T_level_camera)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the capture as .npz, whole or not at all.

        Raises
        ------
        CaptureError
            If the name does not end in .npz.
        """
        path = Path(path)
        if path.suffix != ".npz":
            raise CaptureError(
                "file to save to", got=str(path), expected="a name that ends in .npz"
            )
        arrays: dict[str, Any] = {}
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, SE3):
                arrays[field.name] = value.matrix
            elif isinstance(value, np.ndarray):
                arrays[field.name] = _compact(value)
        if self.intrinsics is not None:
            arrays["K"] = self.intrinsics.matrix
        buffer = BytesIO()
        np.savez_compressed(buffer, **arrays)
        write_atomic(path, buffer.getvalue())

    def cloud(self) -> PointCloud:
        """Points with normals in the base frame.

        Raises
        ------
        CaptureError
            If it isn't known where the camera is.
        """
        if self.T_base_camera is None:
            raise CaptureError(
                f"camera pose of {self.name}",
                got="none (no T_base_camera)"
                + (", only T_level_camera" if self.T_level_camera else ""),
                expected="the measured pose of the camera in the base frame",
                mend="Store T_base_camera in the capture, or give camera_pose "
                "(--camera-pose FILE or x,y,z,roll,pitch,yaw)"
                + (
                    ", 0,0,0,0,0,0 if its points are in the base frame"
                    if self.points is not None
                    else ""
                )
                + (
                    "; 'level' takes T_level_camera, whose origin is not the robot"
                    if self.T_level_camera
                    else ""
                )
                + ".",
            )
        if self.depth is not None and self.intrinsics is not None:
            return _image_cloud(self.depth, self.intrinsics, self.T_base_camera)
        if self.points is None or self.viewpoint is None:
            raise AssertionError("the constructor admits no other capture")
        points = self.points[np.isfinite(self.points).all(axis=-1)]
        normals = neighborhood_normals(points, self.viewpoint)
        own = PointCloud(points, normals, self.viewpoint, frame="camera")
        return own.in_frame(self.T_base_camera, "base")


def _image_cloud(
    depth: FloatArray, intrinsics: Intrinsics, T_base_camera: SE3
) -> PointCloud:
    """Cloud of a depth image in the base frame."""
    # Taking rows by number is several times faster than by mask.
    pixels = np.flatnonzero(np.isfinite(depth))
    points = intrinsics.deproject(depth).reshape(-1, 3).take(pixels, axis=0)
    facets = depth_facets(depth, intrinsics)
    normals = T_base_camera.rotate(facets.normals)
    return PointCloud(
        sealed(T_base_camera.apply(points)),
        sealed(normals.take(facets.of_pixels.ravel().take(pixels), axis=0)),
        T_base_camera.p,
        frame="base",
        pixels=pixels,
        image_shape=(intrinsics.height, intrinsics.width),
    )


def _read(path: Path, camera_file: str | os.PathLike[str] | None) -> CaptureFields:
    """Choose the reader by the name of the file."""
    if nothing := why_nothing_there(path):
        raise CaptureError("capture", got=nothing, expected="an existing path")
    if not (path.is_file() or path.is_dir()):
        raise CaptureError(
            "capture", got="a pipe or a device", expected="a regular file or a folder"
        )
    if is_pointer(path):
        raise CaptureError(
            "capture", got="a pointer of Git LFS", expected="the file itself", mend=PULL
        )
    camera = None if camera_file is None else Path(camera_file)
    if path.is_dir():
        return read_folder(path, camera)
    match path.suffix.lower():
        case ".npz" | ".ply" | ".pcd" if camera is not None:
            raise _unused("camera file", f"a {path.suffix} file, which has its own")
        case ".npz":
            return read_npz(path)
        case ".png":
            return read_depth_png(path, camera)
        case ".ply":
            return read_ply(path)
        case ".pcd":
            return read_pcd(path)
    raise CaptureError(
        "kind of capture",
        got=f"suffix {path.suffix!r}",
        expected=".npz, .png, .ply, .pcd or a folder",
    )


def _unused(what: str, whose: str) -> CaptureError:
    """Say that something was given that would change nothing."""
    return CaptureError(what, got=f"one for {whose}", expected="none", mend="Omit it.")


def _compact(array: NDArray[Any]) -> NDArray[Any]:
    """Return the array in single precision if that loses nothing."""
    if array.dtype != np.float64:
        return array
    single = array.astype(np.float32)
    return single if np.array_equal(single, array, equal_nan=True) else array
