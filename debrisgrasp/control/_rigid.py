"""Rotations and vectors of one pose as plain numbers.

Inside a control tick a NumPy call costs as much as fifty products of floats, so that a
single rotation is quicker as a row-major tuple of nine, a vector as a tuple of three.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, cos, hypot, isfinite, nan, sin, sqrt

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import FloatArray, as_floats, require_finite
from debrisgrasp.errors import InputError, ShapeError
from debrisgrasp.geometry import SE3, so3

__all__ = [
    "IDENTITY",
    "Rotation",
    "Vector",
    "Wrench",
    "added",
    "cross",
    "exp3",
    "floats_of",
    "left_jacobian_times",
    "norm",
    "number_of",
    "parts",
    "pose",
    "rotation_error",
    "share_within",
    "six",
    "times",
    "turned",
    "turned_back",
]

Vector = tuple[float, ...]
"""Three numbers."""
Wrench = tuple[float, ...]
"""Six: force [N] and torque [N m], or translation and rotation of a twist."""
Rotation = tuple[float, ...]
"""Nine: the matrix row by row."""

IDENTITY: Rotation = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def floats_of(values: Sequence[float] | FloatArray) -> tuple[float, ...]:
    """Plain floats of a sequence or an array; empty if any is not finite."""
    try:
        plain = values if type(values) is tuple else tuple(map(float, values))
        return plain if isfinite(sum(plain)) else ()
    except (TypeError, ValueError, OverflowError):
        return ()


def number_of(value: object) -> float:
    """Plain float of what should be a number; NaN if it is none."""
    try:
        return float(value)  # type: ignore[arg-type]  # which is what is tried
    except (TypeError, ValueError, OverflowError):
        return nan


def turned(R: Rotation, v: Vector) -> Vector:
    """Return ``R @ v``."""
    a, b, c, d, e, f, g, h, i = R
    x, y, z = v
    return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z


def turned_back(R: Rotation, v: Vector) -> Vector:
    """Return ``R.T @ v``."""
    a, b, c, d, e, f, g, h, i = R
    x, y, z = v
    return a * x + d * y + g * z, b * x + e * y + h * z, c * x + f * y + i * z


def times(A: Rotation, B: Rotation) -> Rotation:
    """Return ``A @ B``."""
    a, b, c, d, e, f, g, h, i = A
    p, q, r, s, t, u, v, w, x = B
    return (
        a * p + b * s + c * v,
        a * q + b * t + c * w,
        a * r + b * u + c * x,
        d * p + e * s + f * v,
        d * q + e * t + f * w,
        d * r + e * u + f * x,
        g * p + h * s + i * v,
        g * q + h * t + i * w,
        g * r + h * u + i * x,
    )


def rotation_error(R: Rotation, R_goal: Rotation) -> Vector:
    """Rotation vector of ``R_goal @ R.T``: the turn that is left, in the axes of base.

    By pi its axis is found up to the sign.
    """
    a, b, c, d, e, f, g, h, i = R_goal
    p, q, r, s, t, u, v, w, x = R
    return _log(
        g * s + h * t + i * u - d * v - e * w - f * x,
        a * v + b * w + c * x - g * p - h * q - i * r,
        d * p + e * q + f * r - a * s - b * t - c * u,
        a * p + b * q + c * r + d * s + e * t + f * u + g * v + h * w + i * x,
    ) or _log_near_pi(times(R_goal, (p, s, v, q, t, w, r, u, x)))


def cross(a: Vector, b: Vector) -> Vector:
    """Cross product."""
    x, y, z = a
    p, q, r = b
    return y * r - z * q, z * p - x * r, x * q - y * p


def added(a: Vector, b: Vector, weight: float = 1.0) -> Vector:
    """Return ``a + weight * b``."""
    return a[0] + weight * b[0], a[1] + weight * b[1], a[2] + weight * b[2]


def norm(v: Vector) -> float:
    """Euclidean length."""
    return hypot(v[0], v[1], v[2])


def exp3(w: Vector) -> Rotation:
    """Rotation of a rotation vector [rad]."""
    x, y, z = w
    t2 = x * x + y * y + z * z
    if t2 < 1e-8:
        a, b = 1.0 - t2 / 6.0, 0.5 - t2 / 24.0
    else:
        t = sqrt(t2)
        half = sin(0.5 * t)
        a, b = sin(t) / t, 2.0 * half * half / t2
    return (
        1.0 - b * (y * y + z * z),
        b * x * y - a * z,
        b * x * z + a * y,
        b * x * y + a * z,
        1.0 - b * (x * x + z * z),
        b * y * z - a * x,
        b * x * z - a * y,
        b * y * z + a * x,
        1.0 - b * (x * x + y * y),
    )


def _log(x: float, y: float, z: float, trace: float) -> Vector:
    """Rotation vector from twice the axis times the sine, and the trace.

    Empty near pi, where the sine is too small to tell the axis.
    """
    sine, cosine = 0.5 * hypot(x, y, z), 0.5 * (trace - 1.0)
    if sine >= 1e-4:
        scale = 0.5 * atan2(sine, cosine) / sine
    elif cosine < 0.0:
        return ()
    else:
        scale = 0.5 + sine * sine / 12.0
    return scale * x, scale * y, scale * z


def _log_near_pi(R: Rotation) -> Vector:
    return tuple(so3.log(np.array(R).reshape(3, 3)).tolist())


def left_jacobian_times(w: Vector, v: Vector) -> Vector:
    """Return the translation ``V(w) v`` of ``exp6(v, w)``."""
    t2 = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    if t2 < 1e-4:
        b, c = 0.5 - t2 / 24.0, 1.0 / 6.0 - t2 / 120.0
    else:
        t = sqrt(t2)
        b, c = (1.0 - cos(t)) / t2, (t - sin(t)) / (t2 * t)
    wv = cross(w, v)
    return added(added(v, wv, b), cross(w, wv), c)


def parts(pose: SE3) -> tuple[Rotation, Vector]:
    """Rotation and translation of one pose from outside, as plain numbers."""
    if not isinstance(pose, SE3):
        raise InputError(
            "pose",
            got=type(pose).__name__,
            expected="an SE3",
            mend="Make one of a matrix: SE3.from_matrix(matrix).",
        )
    if pose.batch:
        raise ShapeError("pose", got=pose.matrix.shape, expected="one pose, (4, 4)")
    require_finite(pose.matrix, "pose")
    R, p = tuple(pose.R.ravel().tolist()), tuple(pose.p.tolist())
    return R, p


def pose(R: Rotation, p: Vector) -> SE3:
    """Make a pose of plain numbers."""
    return SE3.from_parts(np.array(R).reshape(3, 3), np.array(p))


def six(values: ArrayLike, what: str) -> FloatArray:
    """Check a wrench or twist (6,) from outside: six finite numbers."""
    array = as_floats(values, what, ())
    if array.shape != (6,):
        raise ShapeError(what, got=array.shape, expected="(6,), linear part first")
    if not np.isfinite(array).all():
        raise InputError(what, got=array.tolist(), expected="finite numbers")
    return array


def share_within(twist: Sequence[float], translation: float, rotation: float) -> float:
    """Share of a twist, at most 1, that keeps both of its parts within bounds."""
    x, y, z, a, b, c = twist
    gap, angle = x * x + y * y + z * z, a * a + b * b + c * c
    share = 1.0
    if gap > translation * translation:
        share = translation / sqrt(gap)
    if angle > rotation * rotation:
        share = min(share, rotation / sqrt(angle))
    return share
