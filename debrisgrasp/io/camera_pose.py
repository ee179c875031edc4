"""Where the camera is: poses given as numbers, as a file, or taken from the scene."""

from __future__ import annotations

import re
from io import StringIO
from pathlib import Path
from typing import Any, Literal

import numpy as np

from debrisgrasp._arrays import FloatArray, require_metres
from debrisgrasp._files import read_json, read_text, read_yaml
from debrisgrasp._unreadable import UNREADABLE_ARRAY, why_unreadable
from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.geometry import SE3, so3

__all__ = [
    "CameraPose",
    "parse_camera_pose",
    "parse_pose",
    "pose_from_rows",
    "require_radians",
]

CameraPose = SE3 | Literal["level"]
"""A measured pose of the camera in the base frame, or ``"level"`` for the frame that
was derived from the scene."""

_FORMS = "x,y,z,roll,pitch,yaw, or a .npy, .json, .yaml or .txt file with a 4x4"


def parse_camera_pose(text: str) -> CameraPose:
    """Read a camera pose from one word of a command line.

    Parameters
    ----------
    text
        ``level``; or six numbers ``x,y,z,roll,pitch,yaw`` in metres and radians,
        rotation ``Rz(yaw) Ry(pitch) Rx(roll)`` of the optical frame; or a file with the
        4x4 matrix, in JSON and YAML also under the key ``T_base_camera``.

    Raises
    ------
    ConfigError
        If it is none of these, or no rigid transform.
    """
    if text == "level":
        return "level"
    return parse_pose(text, "camera pose", f"'level', {_FORMS}")


def parse_pose(text: str, what: str, forms: str = _FORMS) -> SE3:
    """Read a pose as `parse_camera_pose` does, of whatever an error then names."""
    suffix = Path(text).suffix.lower()
    if suffix in _READERS:
        return pose_from_rows(_READERS[suffix](Path(text)), f"{what} in {text}")
    try:
        numbers = np.array([float(word) for word in text.split(",")])
    except ValueError as error:
        raise ConfigError(what, got=repr(text), expected=forms) from error
    if numbers.shape != (6,):
        raise ConfigError(
            what,
            got=repr(text),
            expected=forms,
            mend="Roll, pitch and yaw of a quaternion x, y, z, w are "
            "scipy.spatial.transform.Rotation.from_quat([x, y, z, w]).as_euler('xyz')."
            if numbers.shape == (7,)
            else "",
        )
    if not np.isfinite(numbers).all():
        raise ConfigError(what, got=repr(text), expected="finite numbers")
    require_metres(what, numbers[:3])
    require_radians(numbers[3:], what)
    return SE3.from_parts(so3.from_rpy(numbers[3:]), numbers[:3])


def require_radians(angles: FloatArray, what: str) -> None:
    """Raise `ConfigError` if angles can only be degrees."""
    largest = float(np.abs(angles).max(initial=0.0))
    if largest > 2 * np.pi:
        raise ConfigError(
            f"angles of the {what}",
            got=f"{largest:g}",
            expected="radians, at most 2 pi = 6.28",
            mend="If these are degrees, multiply by pi / 180.",
        )


def pose_from_rows(rows: Any, name: str) -> SE3:
    """Pose from a 4x4 matrix, its 16 numbers, or a mapping with ``T_base_camera``."""
    if isinstance(rows, dict):
        if "T_base_camera" not in rows:
            keys = ", ".join(map(str, rows)) or "nothing"
            is_carried = "T_link_camera" in rows
            raise ConfigError(
                name,
                got="T_link_camera, of a camera that an arm carries"
                if is_carried
                else keys,
                expected="the key T_base_camera",
                mend="Give T_base_link @ T_link_camera." if is_carried else "",
            )
        rows = rows["T_base_camera"]
    try:
        matrix = np.array(rows, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ConfigError(name, got=rows, expected="a 4x4 matrix") from error
    if matrix.shape not in ((4, 4), (16,), (1, 16)):
        raise ConfigError(name, got=f"shape {matrix.shape}", expected="a 4x4 matrix")
    try:
        pose = SE3.from_matrix(matrix.reshape(4, 4), name)
    except InputError as error:
        raise ConfigError.about(error.what, error) from error
    require_metres(name, pose.p)
    return pose


def _read_npy(path: Path) -> Any:
    return _read_array(path, lambda: np.load(path, allow_pickle=False))


def _read_txt(path: Path) -> Any:
    text = read_text(path).replace(",", " ")
    if not re.sub("#.*", "", text).strip():  # of which NumPy warns
        raise ConfigError(str(path), got="nothing", expected="a 4x4 matrix")
    return _read_array(path, lambda: np.loadtxt(StringIO(text), ndmin=2))


def _read_array(path: Path, read: Any) -> Any:
    try:
        return read()
    except UNREADABLE_ARRAY as error:
        raise ConfigError(
            str(path), got=why_unreadable(error), expected="a 4x4 matrix"
        ) from error


_READERS = {
    ".npy": _read_npy,
    ".txt": _read_txt,
    ".json": read_json,
    ".yaml": read_yaml,
    ".yml": read_yaml,
}
