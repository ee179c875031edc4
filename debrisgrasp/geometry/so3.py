"""Rotations, batch-first: matrices (..., 3, 3), rotation vectors (..., 3)."""

from __future__ import annotations

import numpy as np

from debrisgrasp._arrays import FloatArray, as_floats
from debrisgrasp.errors import InputError

__all__ = [
    "exp",
    "from_quat_wxyz",
    "from_rpy",
    "hat",
    "left_jacobian",
    "log",
    "to_quat_wxyz",
]

_SMALL_ANGLE = 1e-4
"""Below this angle [rad] the series is exact to double precision."""


def hat(v: FloatArray) -> FloatArray:
    """Cross-product matrix: ``hat(a) @ b == cross(a, b)``.

    Parameters
    ----------
    v
        Vectors, shape (..., 3).

    Returns
    -------
    FloatArray
        Skew-symmetric matrices, shape (..., 3, 3).
    """
    v = as_floats(v, "vectors", (3,))
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out


def _angle_coefficients(angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """``sin t / t`` and ``(1 - cos t) / t^2``, safe near 0."""
    is_small = angle < _SMALL_ANGLE
    t = np.where(is_small, 1.0, angle)
    t2 = angle * angle
    a = np.where(is_small, 1.0 - t2 / 6.0, np.sin(t) / t)
    half = np.sin(t / 2.0)
    b = np.where(is_small, 0.5 - t2 / 24.0, 2.0 * half * half / (t * t))
    return a, b


def _third_coefficient(angle: FloatArray) -> FloatArray:
    """``(t - sin t) / t^3``, safe near 0."""
    # t - sin t cancels below about 0.01 rad; the series reaches 1e-16 up to there.
    is_small, t2 = angle < 1e-2, angle * angle
    t = np.where(is_small, 1.0, angle)
    series = 1.0 / 6.0 - t2 / 120.0 + t2 * t2 / 5040.0
    return np.where(is_small, series, (t - np.sin(t)) / (t * t * t))


def exp(rotvec: FloatArray) -> FloatArray:
    """Rotation matrix of a rotation vector (Rodrigues).

    Parameters
    ----------
    rotvec
        Axis times angle [rad], shape (..., 3); zero gives the identity.

    Returns
    -------
    FloatArray
        Rotation matrices, shape (..., 3, 3).

    Raises
    ------
    ShapeError
        If the last axis is not of size 3.
    """
    rotvec = as_floats(rotvec, "rotation vector", (3,))
    a, b = _angle_coefficients(np.linalg.norm(rotvec, axis=-1))
    k = hat(rotvec)
    return np.eye(3) + a[..., None, None] * k + b[..., None, None] * (k @ k)


def left_jacobian(rotvec: FloatArray) -> FloatArray:
    """Matrix ``V`` with ``exp6(v, w) = (exp(w), V(w) v)``, shape (..., 3, 3)."""
    rotvec = as_floats(rotvec, "rotation vector", (3,))
    angle = np.linalg.norm(rotvec, axis=-1)
    (_, b), c = _angle_coefficients(angle), _third_coefficient(angle)
    k = hat(rotvec)
    return np.eye(3) + b[..., None, None] * k + c[..., None, None] * (k @ k)


def log(R: FloatArray) -> FloatArray:
    """Rotation vector of a rotation matrix, angle in [0, pi].

    Goes through the quaternion, so it is accurate near 0 and near pi alike. At exactly
    pi the axis is found up to its sign.

    Parameters
    ----------
    R
        Rotation matrices, shape (..., 3, 3).

    Returns
    -------
    FloatArray
        Rotation vectors [rad], shape (..., 3).

    Raises
    ------
    ShapeError
        If the last axes are not 3 by 3.
    """
    quat = to_quat_wxyz(R)
    w, v = quat[..., 0], quat[..., 1:]
    sine = np.linalg.norm(v, axis=-1)
    angle = 2.0 * np.arctan2(sine, w)
    is_small = sine < _SMALL_ANGLE
    scale = np.where(
        is_small, 2.0 + sine * sine / 3.0, angle / np.where(is_small, 1.0, sine)
    )
    rotvec: FloatArray = v * scale[..., None]
    return rotvec


def to_quat_wxyz(R: FloatArray) -> FloatArray:
    """Return unit quaternions (w, x, y, z) with w >= 0, shape (..., 4).

    Raises
    ------
    ShapeError
        If the last axes are not 3 by 3.
    """
    R = as_floats(R, "rotation matrix", (3, 3))
    d0, d1, d2 = R[..., 0, 0], R[..., 1, 1], R[..., 2, 2]
    # Row i is the quaternion times four times its i-th component; the longest is safe.
    rows = np.empty((*R.shape[:-2], 4, 4))
    rows[..., 0, 0] = 1.0 + d0 + d1 + d2
    rows[..., 1, 1] = 1.0 + d0 - d1 - d2
    rows[..., 2, 2] = 1.0 - d0 + d1 - d2
    rows[..., 3, 3] = 1.0 - d0 - d1 + d2
    rows[..., 0, 1] = rows[..., 1, 0] = R[..., 2, 1] - R[..., 1, 2]
    rows[..., 0, 2] = rows[..., 2, 0] = R[..., 0, 2] - R[..., 2, 0]
    rows[..., 0, 3] = rows[..., 3, 0] = R[..., 1, 0] - R[..., 0, 1]
    rows[..., 1, 2] = rows[..., 2, 1] = R[..., 0, 1] + R[..., 1, 0]
    rows[..., 1, 3] = rows[..., 3, 1] = R[..., 0, 2] + R[..., 2, 0]
    rows[..., 2, 3] = rows[..., 3, 2] = R[..., 1, 2] + R[..., 2, 1]
    diagonal = np.diagonal(rows, axis1=-2, axis2=-1)
    best = np.argmax(diagonal, axis=-1)[..., None, None]
    quat: FloatArray = np.take_along_axis(rows, best, axis=-2)[..., 0, :]
    quat = quat / np.linalg.norm(quat, axis=-1, keepdims=True)
    return np.where(quat[..., :1] < 0.0, -quat, quat)


def from_quat_wxyz(quat_wxyz: FloatArray) -> FloatArray:
    """Rotation matrix (..., 3, 3) of a quaternion (w, x, y, z); it is normalised first.

    Raises
    ------
    ShapeError
        If the last axis is not of size 4.
    InputError
        If a quaternion is zero, or not finite.
    """
    quat = as_floats(quat_wxyz, "quaternion (w, x, y, z)", (4,))
    norm = np.linalg.norm(quat, axis=-1, keepdims=True)
    if not ((norm > 0.0) & np.isfinite(norm)).all():
        raise InputError(
            "quaternion (w, x, y, z)",
            got="all zero, NaN or infinite",
            expected="four finite numbers, not all zero",
            mend="(1, 0, 0, 0) turns nothing; an empty message holds only zeros.",
        )
    quat = quat / norm
    w, x, y, z = np.moveaxis(quat, -1, 0)
    R = np.empty((*quat.shape[:-1], 3, 3))
    R[..., 0, 0], R[..., 0, 1] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z)
    R[..., 0, 2], R[..., 1, 0] = 2 * (x * z + w * y), 2 * (x * y + w * z)
    R[..., 1, 1], R[..., 1, 2] = 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    R[..., 2, 0], R[..., 2, 1] = 2 * (x * z - w * y), 2 * (y * z + w * x)
    R[..., 2, 2] = 1 - 2 * (x * x + y * y)
    return R


def from_rpy(rpy: FloatArray) -> FloatArray:
    """Rotation ``Rz(yaw) Ry(pitch) Rx(roll)`` of (roll, pitch, yaw) [rad], (..., 3, 3).

    Raises
    ------
    ShapeError
        If the last axis is not of size 3.
    """
    rpy = as_floats(rpy, "roll, pitch, yaw", (3,))
    x, y, z = np.eye(3)
    return exp(rpy[..., 2:3] * z) @ exp(rpy[..., 1:2] * y) @ exp(rpy[..., 0:1] * x)
