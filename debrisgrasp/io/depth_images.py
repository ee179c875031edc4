"""Captures as 16-bit depth PNG with a camera file beside it, alone or in a folder."""

from __future__ import annotations

import os
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from debrisgrasp._arrays import FloatArray
from debrisgrasp._files import read_json, read_yaml
from debrisgrasp._unreadable import why_not_there
from debrisgrasp.errors import CaptureError, ConfigError, InputError
from debrisgrasp.geometry import SE3, Intrinsics

from ._fields import CaptureFields
from .camera_pose import pose_from_rows

__all__ = ["files_read", "lacks_camera", "load_camera", "read_depth_png", "read_folder"]

_DEPTH_NAME, _MASK_NAME, _LABELS_NAME = "depth.png", "mask.png", "labels.png"
_COLOR_NAMES = tuple(
    stem + suffix for suffix in (".png", ".jpg", ".jpeg") for stem in ("rgb", "color")
)
"""Files of a folder; the first image in colours is taken."""
_CAMERA_SUFFIXES = (".json", ".yaml", ".yml")
_MILLIMETRE = 0.001
_K_WORDS = "9 numbers, row by row: [fx, 0, cx, 0, fy, cy, 0, 0, 1]"
_DISTORTION = ("D", "d", "distortion_coefficients")
"""The last, with the numbers as its data, is in the files of ROS's calibration."""
_OPTIONAL = ("depth_scale", "T_base_camera", "width", "height")
_CLOSE = 0.8
"""Keys as like as this are misspelt; others are those of who wrote the file."""


@dataclass(frozen=True, slots=True, eq=False)
class _CameraFile:
    """Fields of a ROS ``CameraInfo`` that matter here, and two of our own."""

    K: FloatArray
    size: tuple[int, int] | None
    """(height, width) of the image that K belongs to."""
    depth_scale: float
    """Metres for each unit of the depth image."""
    T_base_camera: SE3 | None


def lacks_camera(path: str | os.PathLike[str]) -> bool:
    """Whether a capture is a depth image, alone or in a folder, without its camera."""
    path = Path(path)
    if path.is_dir():
        depth = _depth_in(path)
        return depth is not None and _camera_beside(depth) is None
    return path.suffix.lower() == ".png" and _camera_beside(path) is None


def files_read(path: str | os.PathLike[str]) -> tuple[Path, ...]:
    """List what a capture is read from: a file, or those looked for beside a depth PNG.

    In a folder those that are not there count too, for the next look would find them.
    """
    path = Path(path)
    if why_not_there(path, "folder"):
        is_depth = path.suffix.lower() == ".png"
        names = _camera_names(path) if is_depth else []
        return path, *(path.parent / name for name in names)
    depth = _depth_in(path) or path / _DEPTH_NAME
    images = (_DEPTH_NAME, _MASK_NAME, _LABELS_NAME, *_COLOR_NAMES)
    return path, depth, *(path / name for name in (*images, *_camera_names(depth)))


def load_camera(path: Path) -> Intrinsics:
    """Read the camera of depth images that are yet to come.

    Where the file tells no size, its image is taken to lie around the principal point.

    Raises
    ------
    ConfigError
        If no depth image could be read with it.
    """
    camera = _read_camera(path)
    center = np.nan_to_num(camera.K[[1, 0], 2])
    height, width = np.clip(2 * center + 1, 2, 1e6).astype(int).tolist()
    try:
        return Intrinsics.from_matrix(camera.K, camera.size or (height, width))
    except InputError as error:
        raise ConfigError.about(f"{error.what} in {path}", error) from error


def read_folder(folder: Path, camera_file: Path | None) -> CaptureFields:
    """Read ``depth.png`` with its camera, and rgb, mask and labels if there."""
    depth = _depth_in(folder)
    if depth is None:
        present = sorted(entry.name for entry in folder.iterdir())
        raise CaptureError(
            "folder",
            got=", ".join(present[:20]) or "nothing",
            expected="depth.png (or one *depth*.png) and camera.json or .yaml",
        )
    result = read_depth_png(depth, camera_file)
    for name in _COLOR_NAMES:
        if "rgb" not in result and (folder / name).is_file():
            result["rgb"] = _read_image(folder / name, "RGB")
    if (folder / _MASK_NAME).is_file():
        result["mask"] = _read_mask(folder / _MASK_NAME)
    if (folder / _LABELS_NAME).is_file():
        result["labels"] = _read_image(folder / _LABELS_NAME, None)
    return result


def read_depth_png(path: Path, camera_file: Path | None) -> CaptureFields:
    """Read a 16-bit depth image, in millimetres unless its camera file has a scale."""
    camera_file = camera_file or _camera_beside(path)
    if camera_file is None:
        raise CaptureError(
            "camera of the depth image",
            got="no camera file beside it",
            expected="one of " + ", ".join(_camera_names(path)),
            mend="Write there the fields of CameraInfo: width, height, K.",
        )
    camera = _read_camera(camera_file)
    raw = _read_image(path, None)
    if raw.ndim != 2 or raw.dtype.kind not in "iu" or raw.dtype.itemsize < 2:
        raise CaptureError(
            "depth image",
            got=f"{raw.dtype} of shape {raw.shape}",
            expected="one channel of 16 bits",
            mend="An image for viewing is not depth: export the raw stream.",
        )
    if camera.size is not None and camera.size != raw.shape:
        raise CaptureError(
            "depth image",
            got=f"{raw.shape[1]} x {raw.shape[0]} pixels",
            expected=f"{camera.size[1]} x {camera.size[0]}, as its camera file says",
            mend="Scale K together with the image, or give the file of this stream.",
        )
    shape = (int(raw.shape[0]), int(raw.shape[1]))
    result: CaptureFields = {
        "depth": raw.astype(np.float64) * camera.depth_scale,
        "intrinsics": Intrinsics.from_matrix(camera.K, shape),
    }
    if camera.T_base_camera is not None:
        result["T_base_camera"] = camera.T_base_camera
    return result


def _depth_in(folder: Path) -> Path | None:
    """``depth.png``, or else the only image that is called so."""
    if (folder / _DEPTH_NAME).is_file():
        return folder / _DEPTH_NAME
    images = list(folder.glob("*depth*.png"))
    return images[0] if len(images) == 1 else None


def _camera_names(depth: Path) -> list[str]:
    stems = (depth.stem, "camera", "camera_info")
    return [stem + suffix for stem in stems for suffix in _CAMERA_SUFFIXES]


def _camera_beside(depth: Path) -> Path | None:
    places = (depth.parent / name for name in _camera_names(depth))
    return next((place for place in places if place.is_file()), None)


def _read_camera(path: Path) -> _CameraFile:
    content = read_json(path) if path.suffix.lower() == ".json" else read_yaml(path)
    if not isinstance(content, dict):
        raise ConfigError(
            str(path), got=type(content).__name__, expected="a mapping with K"
        )
    for key in map(str, content):
        for meant in get_close_matches(key, _OPTIONAL, cutoff=_CLOSE):
            if key != meant:
                raise ConfigError(f"key of {path}", got=key, expected=meant)
    both = content.get("K"), content.get("k")
    flat = both[1] if both[0] is None else both[0]
    if None not in both and both[0] != both[1]:
        raise ConfigError(
            f"K and k in {path}", got="two that differ", expected="one of them"
        )
    if flat is None:
        keys = ", ".join(map(str, content)) or "nothing"
        raise ConfigError(
            f"keys of {path}",
            got=keys,
            expected="K (or k) among them",
            mend=f"K is {_K_WORDS} [pixels]; where ROS has calibrated the camera, it "
            "is the data of camera_matrix.",
        )
    if isinstance(flat, dict):
        raise ConfigError(f"K in {path}", got=", ".join(flat), expected=_K_WORDS)
    K = _numbers(flat, f"K in {path}")
    if K.size != 9:
        raise ConfigError(f"K in {path}", got=f"{K.size} numbers", expected=_K_WORDS)
    told = next((content[key] for key in _DISTORTION if key in content), None)
    told = told.get("data") if isinstance(told, dict) else told
    distortion = _numbers(told or [], f"D in {path}")
    if not np.all(np.abs(distortion) <= 1e-6):
        raise ConfigError(
            f"D in {path}",
            got=distortion.tolist(),
            expected="no distortion",
            mend="Rectify the image, or leave D out to accept the error.",
        )
    scale = _numbers(content.get("depth_scale", _MILLIMETRE), f"depth_scale in {path}")
    if scale.size != 1 or not 0 < scale.item() <= 1:
        raise ConfigError(
            f"depth_scale in {path}", got=scale.tolist(), expected="metres in (0, 1]"
        )
    size = None
    if "width" in content and "height" in content:
        size = _size(content["height"], content["width"], f"height, width in {path}")
    pose = None
    if "T_base_camera" in content:
        pose = pose_from_rows(content, f"T_base_camera in {path}")
    return _CameraFile(K.reshape(3, 3), size, scale.item(), pose)


def _size(height: Any, width: Any, name: str) -> tuple[int, int]:
    pixels = _numbers([height, width], name)
    is_count = (pixels >= 1) & (pixels < 1 << 16) & (pixels == np.floor(pixels))
    if pixels.size != 2 or not is_count.all():
        raise ConfigError(
            name, got=f"{height!r}, {width!r}", expected="two whole numbers of pixels"
        )
    return int(pixels[0]), int(pixels[1])


def _numbers(values: Any, name: str) -> FloatArray:
    try:
        return np.array(values, dtype=np.float64).ravel()
    except (TypeError, ValueError) as error:
        raise ConfigError(name, got=values, expected="numbers") from error


def _read_mask(path: Path) -> NDArray[Any]:
    """Read a mask; where it has a palette, its numbers and colours have to agree."""
    mask = _read_image(path, None)
    if mask.dtype == np.uint8 and mask.ndim == 2:
        is_black = ~_read_image(path, "RGB").any(axis=-1)
        if (is_black != (mask == 0)).any():
            raise CaptureError(
                f"image {path.name}",
                got="a palette in which 0 is not black, or another colour is",
                expected="0, and black, where the object is not",
                mend="Save it in shades of grey: black, and white for the object.",
            )
    return mask


def _read_image(path: Path, mode: str | None) -> NDArray[Any]:
    try:
        with Image.open(path) as image:
            return np.array(image.convert(mode) if mode else image)
    except (
        OSError,
        SyntaxError,  # how Pillow reports a broken PNG chunk
        ValueError,
        UnidentifiedImageError,
        Image.DecompressionBombError,
    ) as error:
        raise CaptureError(
            f"image {path.name}",
            got=str(error) or type(error).__name__,
            expected="a whole image file",
        ) from error
