"""How the surface in a depth image is turned, pixel by pixel."""

from __future__ import annotations

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import Intrinsics

__all__ = ["points_and_normals"]


def points_and_normals(
    depth: FloatArray, intrinsics: Intrinsics
) -> tuple[FloatArray, FloatArray]:
    """Points of a depth image [m] and normals there of any length, camera frame.

    Coordinates come first, as NumPy is slow along short last axes: both (3, h, w).
    Normals point to the camera's side of the surface.
    """
    points = np.ascontiguousarray(np.moveaxis(intrinsics.deproject(depth), -1, 0))
    a, b, c = np.gradient(points, axis=1)
    p, q, r = np.gradient(points, axis=2)
    return points, np.stack([b * r - c * q, c * p - a * r, a * q - b * p])
