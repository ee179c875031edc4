"""Where the eye of a rendered picture is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import SE3, Intrinsics

__all__ = ["View"]


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """Where the eye is, and what it sees: a pinhole camera."""

    T_base_eye: SE3
    """Pose of the eye; x right, y down, z forward."""
    intrinsics: Intrinsics

    @classmethod
    def fitted(
        cls,
        points: FloatArray,
        direction: ArrayLike,
        size: tuple[int, int],
        *,
        field_of_view: float = 0.6,
        margin: float = 1.06,
    ) -> View:
        """Look along ``direction`` from where all ``points`` are just in the picture.

        Parameters
        ----------
        points
            What must be seen [m], shape (n, 3), base frame.
        direction
            From the eye into the scene, shape (3,); any length but zero.
        size
            Width and height of the picture in pixels.
        field_of_view
            Angle [rad] that the longer side of the picture covers.
        margin
            Factor by which the picture is wider than the points.
        """
        R = _rotation_looking(np.asarray(direction, dtype=np.float64))
        width, height = size
        focal = max(size) / 2.0 / np.tan(field_of_view / 2.0)
        tangents = np.array([width, height]) / 2.0 / focal / margin
        local = points @ R
        # Per axis, the two planes of the frustum that touch the points fix centre and
        # distance; the larger distance wins.
        plus = (local[:, :2] / tangents - local[:, 2:]).max(axis=0)
        minus = (-local[:, :2] / tangents - local[:, 2:]).max(axis=0)
        eye_xy = tangents * (plus - minus) / 2.0
        eye_z = -((plus + minus) / 2.0).max()
        eye = R @ np.array([*eye_xy, eye_z])
        return cls(SE3.from_parts(R, eye), _pinhole(size, focal))

    def project(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Pixel coordinates (..., 2) and depth (...) [m] of points, base frame."""
        return self.intrinsics.project(self.T_base_eye.inverse().apply(points))

    def scaled(self, factor: int) -> View:
        """Give the same view ``factor`` times as many pixels along each side."""
        k = self.intrinsics
        return View(
            self.T_base_eye,
            Intrinsics(
                fx=k.fx * factor,
                fy=k.fy * factor,
                cx=(k.cx + 0.5) * factor - 0.5,
                cy=(k.cy + 0.5) * factor - 0.5,
                width=k.width * factor,
                height=k.height * factor,
            ),
        )


def _rotation_looking(direction: FloatArray) -> FloatArray:
    """Axes of an eye that looks along ``direction`` with base z upwards."""
    forward = direction / np.linalg.norm(direction)
    # Straight down has no upward side: there base x points up in the picture.
    up = np.array([0.0, 0.0, 1.0] if abs(forward[2]) < 0.999 else [1.0, 0.0, 0.0])
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward], axis=1)


def _pinhole(size: tuple[int, int], focal: float) -> Intrinsics:
    width, height = size
    return Intrinsics(
        fx=focal,
        fy=focal,
        cx=(width - 1) / 2.0,
        cy=(height - 1) / 2.0,
        width=width,
        height=height,
    )
