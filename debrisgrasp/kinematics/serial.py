r"""A serial chain in the form that costs least to evaluate for thousands of postures.

Every joint gets a frame whose z axis is the joint's axis. Its origin along the axis and
its turn about the axis are free, and are chosen as in the Denavit-Hartenberg
convention: x along the common normal to the next axis. Then

.. math:: T_\text{base,tip}(q) = T_\text{base,first}
          \prod_i \left[ J_i(q_i) \, M_i \right] T_\text{last,tip}

with :math:`J_i` a turn about or a shift along z, and most entries of the constants
:math:`M_i` are 0 or 1 and cost nothing. Nearly parallel axes, whose common normal runs
off to infinity, keep a general :math:`M_i` instead.

Arrays here are *lanes last*: joints (d, lanes), vectors (3, lanes), so that every
operation runs over contiguous lanes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from debrisgrasp._arrays import BoolArray, FloatArray, snapped

__all__ = ["ComplexLanes", "LaneFrames", "Lanes", "SerialForm", "cross"]

Lanes = NDArray[np.floating[Any]]
"""Floats of single or double precision, last axis: lanes."""
ComplexLanes = NDArray[np.complexfloating[Any]]
"""Complex numbers of single or double precision, last axis: lanes."""

_PARALLEL = 1e-2
"""Axes whose angle [rad] is below this have no usable common normal."""


@dataclass(frozen=True, slots=True, eq=False)
class LaneFrames:
    """Joint frames of many postures, in the frame of the first joint."""

    axes: Lanes
    """Directions of the joint axes, shape (3, d, lanes)."""
    origins: Lanes
    """Points on the joint axes [m], shape (3, d, lanes)."""
    turns: tuple[ComplexLanes, ...]
    """First and second columns of the frames' rotations, as x + i y: d times
    (3, lanes). A turn about z is then one complex product."""

    @property
    def x(self) -> Lanes:
        """First column of the last frame's rotation, shape (3, lanes)."""
        return self.turns[-1].real

    @property
    def y(self) -> Lanes:
        """Second column of the last frame's rotation, shape (3, lanes)."""
        return self.turns[-1].imag

    @property
    def z(self) -> Lanes:
        """Third column: the axis of the last joint, shape (3, lanes)."""
        return self.axes[:, -1]

    @property
    def p(self) -> Lanes:
        """Origin of the last frame [m], shape (3, lanes)."""
        return self.origins[:, -1]

    def matrices(self) -> FloatArray:
        """Homogeneous matrices of the last frame, shape (lanes, 4, 4)."""
        turn = self.turns[-1]
        columns = (turn.real, turn.imag, self.axes[:, -1], self.origins[:, -1])
        T = np.zeros((self.axes.shape[-1], 4, 4))
        for k, column in enumerate(columns):
            T[:, :3, k] = column.T
        T[:, 3, 3] = 1.0
        return T


@dataclass(frozen=True, slots=True, eq=False)
class SerialForm:
    """Constants of a chain in Denavit-Hartenberg-like form, in one precision."""

    is_revolute: BoolArray
    """Revolute or continuous (True), or prismatic (False); shape (d,)."""
    offsets: FloatArray
    """Added to the joint values of revolute joints [rad], shape (d,)."""
    rotations: FloatArray
    """Rotations of the constants M_i, shape (d - 1, 3, 3)."""
    shifts: FloatArray
    """Translations of the constants M_i [m], shape (d - 1, 3)."""
    T_base_first: FloatArray
    """Homogeneous matrix, shape (4, 4)."""
    T_last_tip: FloatArray
    """Homogeneous matrix, shape (4, 4)."""
    frames_at_zero: FloatArray
    """Joint frames F_i in base when all joints stand at zero, shape (d, 4, 4)."""
    T_first_base: FloatArray
    """Inverse of ``T_base_first``, shape (4, 4)."""
    T_tip_last: FloatArray
    """Inverse of ``T_last_tip``, shape (4, 4)."""
    dtype: type[np.floating[Any]] = np.float64

    @classmethod
    def fit(
        cls,
        is_revolute: BoolArray,
        axes: FloatArray,
        points: FloatArray,
        T_base_tip: FloatArray,
    ) -> SerialForm:
        """Derive the form from the axes (d, 3) and points on them (d, 3) at zero.

        ``T_base_tip`` is the (4, 4) pose of the tip at zero; all are given in base.
        """
        n = len(axes)
        normals, arrivals = _normals(axes, points)
        frames = np.tile(np.eye(4), (n, 1, 1))
        rotations = np.tile(np.eye(3), (max(n - 1, 0), 1, 1))
        shifts = np.zeros((max(n - 1, 0), 3))
        offsets = np.zeros(n)
        for i in range(n):
            frames[i, :3, :3] = _basis(normals[i], axes[i])
            frames[i, :3, 3] = arrivals[i]
        for i in range(n - 1):
            R_base_i, R_base_next = frames[i, :3, :3], frames[i + 1, :3, :3]
            bare = _basis(
                normals[i] - (normals[i] @ axes[i + 1]) * axes[i + 1], axes[i + 1]
            )
            turn = bare.T @ R_base_next
            if is_revolute[i + 1]:
                offsets[i + 1] = np.arctan2(turn[1, 0], turn[0, 0])
                rotations[i] = R_base_i.T @ bare
            else:
                rotations[i] = R_base_i.T @ R_base_next
            shifts[i] = R_base_i.T @ (arrivals[i + 1] - arrivals[i])
        return cls(
            is_revolute=is_revolute,
            offsets=offsets,
            rotations=snapped(rotations, 1e-14),
            shifts=snapped(shifts, 1e-14),
            T_base_first=frames[0],
            T_last_tip=np.linalg.inv(frames[-1]) @ T_base_tip,
            frames_at_zero=frames,
            T_first_base=np.linalg.inv(frames[0]),
            T_tip_last=np.linalg.inv(T_base_tip) @ frames[-1],
        )

    def in_single_precision(self) -> SerialForm:
        """Return the form for float32 lanes, rid of terms below their precision."""
        return replace(
            self,
            rotations=snapped(self.rotations, 1e-7),
            shifts=snapped(self.shifts, 1e-8),
            dtype=np.float32,
        )

    def frames(self, q: Lanes) -> LaneFrames:
        """Joint frames of postures q (d, lanes) [rad or m]."""
        n, lanes = q.shape
        angles = q + self.offsets.astype(self.dtype)[:, None]
        complex_dtype = np.result_type(self.dtype, np.complex64)
        # (x + i y) exp(-i angle) turns the columns x and y about z.
        phases = np.empty((n, lanes), dtype=complex_dtype)
        np.cos(angles, out=phases.real)
        np.sin(-angles, out=phases.imag)
        axes = np.empty((3, n, lanes), dtype=self.dtype)
        origins = np.empty((3, n, lanes), dtype=self.dtype)
        xy = np.zeros((3, lanes), dtype=complex_dtype)
        z, p = (np.zeros((3, lanes), dtype=self.dtype) for _ in range(2))
        xy[0], xy[1], z[2] = 1.0, 1.0j, 1.0
        turns: list[ComplexLanes] = []
        for i in range(n):
            if self.is_revolute[i]:
                xy = xy * phases[i]
            else:
                p = p + q[i] * z
            axes[:, i], origins[:, i] = z, p
            turns.append(xy)
            if i < n - 1:
                columns = (xy.real, xy.imag, z)
                p = _combined(self.shifts[i], columns, p)
                R = self.rotations[i]
                xy = np.empty_like(xy)
                xy.real = _combined(R[:, 0], columns, None)
                xy.imag = _combined(R[:, 1], columns, None)
                z = _combined(R[:, 2], columns, None)
        return LaneFrames(axes, origins, tuple(turns))

    def jacobian(self, frames: LaneFrames) -> Lanes:
        """Jacobian of the last frame's origin, axes of the first frame, linear first.

        Returns
        -------
        Lanes
            Shape (6, d, lanes).
        """
        axes = frames.axes
        J = np.empty((6, *axes.shape[1:]), dtype=axes.dtype)
        J[:3] = cross(axes, frames.p[:, None] - frames.origins)
        J[3:] = axes
        for i in np.flatnonzero(~self.is_revolute):
            J[:3, i], J[3:, i] = axes[:, i], 0.0
        return J

    def reach_bound(self, lower: FloatArray, upper: FloatArray) -> float:
        """Distance from first to last origin that no posture exceeds [m]."""
        travel = np.maximum(np.abs(lower), np.abs(upper))[~self.is_revolute]
        return float(np.linalg.norm(self.shifts, axis=-1).sum() + travel.sum())


def cross(a: Lanes, b: Lanes) -> Lanes:
    """Cross product of vectors (3, ...): `numpy.cross`, at a fraction of its cost."""
    product: Lanes = a[[1, 2, 0]] * b[[2, 0, 1]]
    product -= a[[2, 0, 1]] * b[[1, 2, 0]]
    return product


def _combined(
    weights: FloatArray, columns: Sequence[Lanes], start: Lanes | None
) -> Lanes:
    """Return ``start`` plus weighted columns; weights 0 and 1 cost nothing."""
    total = start
    for weight, column in zip(weights.tolist(), columns, strict=True):
        if weight == 0.0:
            continue
        if total is None:
            total = column if weight == 1.0 else weight * column
        elif weight == 1.0:
            total = total + column
        elif weight == -1.0:
            total = total - column
        else:
            total = total + weight * column
    return np.zeros_like(columns[0]) if total is None else total


def _basis(x: FloatArray, z: FloatArray) -> FloatArray:
    """Rotation with the given z and an x along the given normal, shape (3, 3)."""
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=-1)


def _perpendicular(axis: FloatArray) -> FloatArray:
    """Return some unit vector perpendicular to an axis."""
    helper = np.eye(3)[np.argmin(np.abs(axis))]
    normal: FloatArray = np.cross(axis, helper)
    return normal / np.linalg.norm(normal)


def _normals(axes: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Directions of the common normals, and where they meet the next axis; (d, 3).

    The first axis has no incoming normal; its point is the foot of the outgoing one.
    """
    n = len(axes)
    normals = np.empty((n, 3))
    arrivals = points.copy()
    for i in range(n - 1):
        z, z_next = axes[i], axes[i + 1]
        across = np.cross(z, z_next)
        sine = float(np.linalg.norm(across))
        if sine > _PARALLEL:
            normals[i] = across / sine
            gap = points[i + 1] - points[i]
            cosine = float(z @ z_next)
            along = (gap @ z - cosine * (gap @ z_next)) / sine**2
            along_next = (cosine * (gap @ z) - gap @ z_next) / sine**2
            arrivals[i + 1] = points[i + 1] + along_next * z_next
            if i == 0:
                arrivals[0] = points[0] + along * z
        else:
            gap = points[i + 1] - arrivals[i]
            foot = points[i + 1] - (gap @ z_next) * z_next
            arrivals[i + 1] = foot
            offset = foot - arrivals[i]
            offset = offset - (offset @ z) * z
            distance = float(np.linalg.norm(offset))
            normals[i] = offset / distance if distance > 1e-9 else _perpendicular(z)
    last = axes[-1]
    carried = normals[-2] - (normals[-2] @ last) * last if n > 1 else np.zeros(3)
    size = float(np.linalg.norm(carried))
    normals[-1] = carried / size if size > 1e-9 else _perpendicular(last)
    return normals, arrivals
