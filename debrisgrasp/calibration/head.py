"""What carries the camera: nothing that moves, or the joints of a pan-tilt head."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import FloatArray, as_floats, finite, require_finite
from debrisgrasp._words import counted
from debrisgrasp.errors import InputError, ShapeError
from debrisgrasp.geometry import SE3, so3

__all__ = ["Head"]

_UNIT = 1e-3
"""The length of an axis may be so far from 1."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Head:
    """Revolute joints in a row between base and camera, first to last.

    The pose of the camera is a product of exponentials: the joints turn about axes that
    are fixed in the base while all joints before them stand at zero.
    """

    T_base_camera_at_zero: SE3
    """Pose of the camera's optical frame with all joints at zero."""
    axes: FloatArray
    """Unit joint axes in base with all joints at zero, shape (k, 3)."""
    points: FloatArray
    """A point on each axis in base with all joints at zero [m], shape (k, 3)."""
    joint_names: tuple[str, ...] = ()
    offsets: FloatArray | None = None
    """What each joint's reading lacks to its true angle [rad], shape (k,)."""

    def __post_init__(self) -> None:
        k = len(self.joint_names)
        offsets = np.zeros(k) if self.offsets is None else self.offsets
        for name, array, shape in (
            ("axes", np.reshape(self.axes, (-1, 3)), (k, 3)),
            ("points", np.reshape(self.points, (-1, 3)), (k, 3)),
            ("offsets", offsets, (k,)),
        ):
            checked = finite(array, f"{name} of the head", shape)
            object.__setattr__(self, name, checked)
        lengths = np.linalg.norm(self.axes, axis=1)
        off = np.flatnonzero(np.abs(lengths - 1.0) > _UNIT)
        if len(off):
            raise InputError(
                f"axis of joint {self.joint_names[off[0]]!r} of the head",
                got=f"length {lengths[off[0]]:.6g}",
                expected="1: else the joint would turn by as many times its reading",
                mend="Divide the axis by its length.",
            )

    def __repr__(self) -> str:
        names = ", ".join(self.joint_names)
        return f"<Head of {counted(self.n_joints, 'joint')}{names and ': ' + names}>"

    @classmethod
    def fixed(cls, T_base_camera: SE3) -> Head:
        """Head without joints: the camera is bolted to the base."""
        none = np.zeros((0, 3))
        return cls(T_base_camera_at_zero=T_base_camera, axes=none, points=none)

    @property
    def n_joints(self) -> int:
        """Number of joints k."""
        return len(self.joint_names)

    def carriers(self, readings: ArrayLike) -> SE3:
        """Motion of the head from zero to joint readings (..., k), offsets added.

        The camera is then at ``carriers(q) @ T_base_camera_at_zero``.

        Raises
        ------
        ShapeError, InputError
            If the readings are not (..., k), or not finite.
        """
        readings = self._checked(readings)
        moved = SE3.from_parts(np.broadcast_to(np.eye(3), (*readings.shape[:-1], 3, 3)))
        for step in self._steps(readings):
            moved = moved @ step
        return moved

    def T_base_camera(self, readings: ArrayLike = ()) -> SE3:
        """Pose of the camera for joint readings (..., k) [rad]."""
        return self.carriers(readings) @ self.T_base_camera_at_zero

    def screws(self, readings: ArrayLike) -> FloatArray:
        """Twist of the camera in base for unit speed of each joint, (..., k, 6)."""
        readings = self._checked(readings)
        batch = readings.shape[:-1]
        out = np.zeros((*batch, self.n_joints, 6))
        before = SE3.from_parts(np.broadcast_to(np.eye(3), (*batch, 3, 3)))
        for j, step in enumerate(self._steps(readings)):
            axis, point = before.rotate(self.axes[j]), before.apply(self.points[j])
            out[..., j, :3], out[..., j, 3:] = np.cross(point, axis), axis
            before = before @ step
        return out

    def slipped(self, change: ArrayLike) -> Head:
        """Return the head with its offsets changed by so much [rad], shape (k,)."""
        return replace(self, offsets=np.asarray(self.offsets) + np.asarray(change))

    def mounted(self, T_base_camera_at_zero: SE3) -> Head:
        """Return the head with its camera bolted on elsewhere."""
        return replace(self, T_base_camera_at_zero=T_base_camera_at_zero)

    def _checked(self, readings: ArrayLike) -> FloatArray:
        """Joint readings (..., k) as finite floats."""
        shape = np.shape(readings)
        if not shape or shape[-1] != self.n_joints:
            raise ShapeError(
                "joint readings of the head",
                got=f"shape {shape}",
                expected=f"trailing axis {self.n_joints} "
                f"({', '.join(self.joint_names) or 'no joints'})",
            )
        angles = as_floats(readings, "joint readings of the head", (None,))
        require_finite(angles, "joint readings of the head")
        return angles

    def _steps(self, readings: FloatArray) -> list[SE3]:
        if not self.n_joints:
            return []
        angles = readings + np.asarray(self.offsets)
        R = so3.exp(angles[..., None] * self.axes)
        # A turn about a line through a point leaves the point where it is.
        p = self.points - (R @ self.points[..., None])[..., 0]
        turns = SE3.from_parts(R, p)
        return [turns[..., j, :, :] for j in range(self.n_joints)]
