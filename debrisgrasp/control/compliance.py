r"""How the hand gives way to a wrench (Eq. 8-14).

A compliance says by how much: so many metres for a newton, so many radians for a newton
metre, in the axes and about the point of a *task frame*. With H the frame that has the
origin of the hand and the axes of base:

.. math:: W_H = R_{BE} W_E, \quad V_T = C\, Ad(T_{HT})^T W_H,
          \quad V_H = Ad(T_{HT}) V_T, \quad T_{BE}' = T_{BE}\, \exp(R_{BE}^T V_H)

The paper prints Eq. 9 with a transpose, which turns the reaction by twice the yaw of
the tool; a hand yawed by 90 degrees would push into what it touches.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from math import sqrt

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import (
    FloatArray,
    as_floats,
    finite,
    require_finite,
    require_range,
)
from debrisgrasp._checked import checked_fields
from debrisgrasp.errors import ConfigError, ShapeError
from debrisgrasp.geometry import SE3

from ._rigid import (
    Rotation,
    Vector,
    Wrench,
    added,
    cross,
    exp3,
    left_jacobian_times,
    parts,
    pose,
    six,
    times,
    turned,
    turned_back,
)

__all__ = ["Compliance", "DeflectionMode", "TaskFrame", "deflected", "in_base_axes"]

_SYMMETRY = 1e-9


class DeflectionMode(Enum):
    """How a deflection twist becomes a pose."""

    SE3 = "se3"
    """As in the paper: unit time along the screw. A turn bends the translation."""
    DECOUPLED = "decoupled"
    """Translation along its axis exactly, then the rotation about the hand."""


class _Anchor(Enum):
    HAND_BASE_AXES = "the hand, axes of base"
    BASE = "base"
    HAND = "the hand, axes of the hand"


@dataclass(frozen=True, slots=True, eq=False)
class TaskFrame:
    """Point and axes in which a compliance is given; made by one of the methods."""

    anchor: _Anchor
    T_anchor_task: SE3
    _parts: tuple[Rotation, Vector] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_parts", parts(self.T_anchor_task))

    @classmethod
    def ecra(cls) -> TaskFrame:
        """Origin of the hand, axes of base; the paper's choice."""
        return cls(_Anchor.HAND_BASE_AXES, SE3.identity())

    @classmethod
    def fixed_in_base(cls, T_base_task: SE3) -> TaskFrame:
        """Stay where it is: a support edge, a hinge, the feet of what is lifted."""
        return cls(_Anchor.BASE, T_base_task)

    @classmethod
    def on_hand(cls, T_ee_task: SE3) -> TaskFrame:
        """Move with the hand: a point of what it holds."""
        return cls(_Anchor.HAND, T_ee_task)

    @classmethod
    def about_line(cls, point: ArrayLike, direction: ArrayLike) -> TaskFrame:
        """Return a frame fixed in base whose x axis is a line, say a support edge.

        Parameters
        ----------
        point, direction
            In base [m], shapes (3,); the direction need not have unit length.

        Raises
        ------
        ConfigError
            If the direction is zero.
        """
        x = as_floats(direction, "direction of the line", ())
        require_finite(x, "direction of the line")
        length = float(np.linalg.norm(x))
        if x.shape != (3,) or length < 1e-9:
            raise ConfigError(
                "direction of the line", got=x.tolist(), expected="3 numbers, not zero"
            )
        x = x / length
        helper = np.eye(3)[2] if abs(x[2]) < 0.9 else np.eye(3)[1]
        y = np.cross(helper, x)
        y = y / np.linalg.norm(y)
        R = np.stack([x, y, np.cross(x, y)], axis=1)
        return cls.fixed_in_base(SE3.from_parts(R, point))

    def placed(self, R: Rotation, p: Vector) -> tuple[Rotation, Vector]:
        """Axes of the frame in base, and its origin seen from the hand, axes of base.

        ``R, p`` is the pose of the hand in base.
        """
        R_task, p_task = self._parts
        if self.anchor is _Anchor.BASE:
            return R_task, added(p_task, p, -1.0)
        if self.anchor is _Anchor.HAND:
            return times(R, R_task), turned(R, p_task)
        return R_task, p_task


@checked_fields
@dataclass(frozen=True, eq=False)
class Compliance:
    """What the operator sets: how far a push moves the hand."""

    tensor: FloatArray
    """Symmetric and positive semidefinite, shape (6, 6), linear part first: [m/N] and
    [rad/(N m)] on the diagonal."""
    frame: TaskFrame = field(default_factory=TaskFrame.ecra)
    mode: DeflectionMode = DeflectionMode.DECOUPLED
    dead_band_force: float = 0.6
    """Forces below this don't move the hand [N]; twice the noise of the sensor."""
    dead_band_torque: float = 0.02
    """Torques below this don't turn it [N m]."""
    _rows: tuple[tuple[float, ...], ...] = field(init=False, repr=False)
    """The tensor as plain floats."""
    _diagonal: tuple[float, ...] = field(init=False, repr=False)
    """Its diagonal, if it has nothing else; else empty."""
    _is_ecra: bool = field(init=False, repr=False)
    """Whether the task frame is the hand's origin with the axes of base."""

    def __post_init__(self) -> None:
        C = finite(self.tensor, "compliance tensor", (6, 6))
        if np.abs(C - C.T).max() > _SYMMETRY:
            raise ConfigError(
                "compliance tensor",
                got=f"asymmetry of {np.abs(C - C.T).max():.3g}",
                expected="a symmetric (6, 6) matrix",
            )
        least = float(np.linalg.eigvalsh(C).min())
        if least < -_SYMMETRY:
            raise ConfigError(
                "compliance tensor",
                got=f"eigenvalue {least:.3g}",
                expected="none below zero",
                mend="A negative compliance pushes into the contact.",
            )
        require_range("dead_band_force [N]", self.dead_band_force, 0.0, 100.0)
        require_range("dead_band_torque [N m]", self.dead_band_torque, 0.0, 100.0)
        object.__setattr__(self, "tensor", C)
        object.__setattr__(self, "_rows", tuple(tuple(row) for row in C.tolist()))
        is_diagonal = np.array_equal(C, np.diag(np.diag(C)))
        diagonal = tuple(np.diag(C).tolist()) if is_diagonal else ()
        object.__setattr__(self, "_diagonal", diagonal)
        is_ecra = self.frame.anchor is _Anchor.HAND_BASE_AXES and np.array_equal(
            self.frame.T_anchor_task.matrix, np.eye(4)
        )
        object.__setattr__(self, "_is_ecra", is_ecra)

    @classmethod
    def diagonal(
        cls,
        translation: ArrayLike,
        rotation: ArrayLike,
        *,
        frame: TaskFrame | None = None,
        mode: DeflectionMode = DeflectionMode.DECOUPLED,
    ) -> Compliance:
        """Give each axis of the task frame its own compliance.

        Parameters
        ----------
        translation
            [m/N], one number or three.
        rotation
            [rad/(N m)], one number or three.
        """
        both = [_by_axis(translation, "translation"), _by_axis(rotation, "rotation")]
        tensor = np.diag(np.concatenate(both))
        return cls(tensor, TaskFrame.ecra() if frame is None else frame, mode)

    def tensor_at_hand(self, T_base_ee: SE3) -> FloatArray:
        """Tensor at the hand's origin in the axes of base, shape (6, 6)."""
        R, p = self.frame.placed(*parts(T_base_ee))
        A = pose(R, p).adjoint()
        return np.asarray(A @ self.tensor @ A.T)

    def twist(
        self,
        wrench_ee: ArrayLike,
        T_base_ee: SE3,
        T_base_ee_nominal: SE3 | None = None,
    ) -> FloatArray:
        """Deflection (v, omega) of the hand in the axes of base, shape (6,).

        Without dead band or clamp; positive work for every wrench.

        Parameters
        ----------
        wrench_ee
            Reaction at the hand, in its axes [N, N m], shape (6,).
        T_base_ee
            Measured pose: it says where the wrench acts.
        T_base_ee_nominal
            Pose to be deflected; None: the measured one.
        """
        measured = parts(T_base_ee)
        wrench = tuple(six(wrench_ee, "wrench at the hand").tolist())
        hybrid = in_base_axes(measured[0], wrench)
        nominal = parts(T_base_ee_nominal or T_base_ee)
        return np.array(self.deflection(hybrid, measured, nominal))

    def deflection(
        self,
        wrench: Wrench,
        measured: tuple[Rotation, Vector],
        nominal: tuple[Rotation, Vector],
        most: tuple[float, float] = (np.inf, np.inf),
    ) -> Wrench:
        """Twist as in `twist`, of a wrench in the axes of base, in plain floats.

        ``most`` clamps translation [m] and rotation [rad] in the task frame, each by
        its norm, so that the direction is kept.
        """
        if self._is_ecra:
            v, w = self._yielded(wrench, most)
            return (*v, *w)
        R, lever = self.frame.placed(*measured)
        f = turned_back(R, wrench[:3])
        # The same wrench about the origin of the task frame.
        tau = turned_back(R, added(wrench[3:], cross(lever, wrench[:3]), -1.0))
        v, w = self._yielded((*f, *tau), most)
        R, lever = self.frame.placed(*nominal)
        v, w = turned(R, v), turned(R, w)
        return (*added(v, cross(lever, w)), *w)

    def _yielded(
        self, wrench: Wrench, most: tuple[float, float]
    ) -> tuple[Vector, Vector]:
        """Clamped deflection for a wrench, both in the task frame (Eq. 10)."""
        x, y, z, i, j, k = wrench
        if self._diagonal:
            a, b, c, d, e, f = self._diagonal
            force, torque = (a * x, b * y, c * z), (d * i, e * j, f * k)
            return _clamped(force, most[0]), _clamped(torque, most[1])
        t = [
            a * x + b * y + c * z + d * i + e * j + f * k
            for a, b, c, d, e, f in self._rows
        ]
        return _clamped((t[0], t[1], t[2]), most[0]), _clamped(
            (t[3], t[4], t[5]), most[1]
        )

    def without_dead_band(self, wrench: Wrench) -> Wrench:
        """Shorten force and torque by their dead bands; continuous at the edge."""
        f = _shortened(wrench[:3], self.dead_band_force)
        return (*f, *_shortened(wrench[3:], self.dead_band_torque))

    def scaled(self, factor: float) -> Compliance:
        """Stiffer for a factor below 1."""
        return Compliance(
            factor * self.tensor,
            self.frame,
            self.mode,
            self.dead_band_force,
            self.dead_band_torque,
        )

    def deflected_pose(
        self,
        wrench_ee: ArrayLike,
        T_base_ee: SE3,
        T_base_ee_nominal: SE3 | None = None,
    ) -> SE3:
        """Goal after the deflection in base (Eq. 13, 14), for a wrench [N, N m], (6,).

        Arguments as for `twist`.
        """
        twist = self.twist(wrench_ee, T_base_ee, T_base_ee_nominal)
        nominal = parts(T_base_ee_nominal or T_base_ee)
        moved = tuple(twist.tolist())
        return pose(*deflected(*nominal, moved, self.mode))


def _by_axis(values: ArrayLike, name: str) -> FloatArray:
    """One number for each axis, shape (3,)."""
    floats = as_floats(values, f"{name} of a compliance", ())
    if floats.shape not in ((), (3,)):
        raise ShapeError(
            f"{name} of a compliance", got=floats.shape, expected="one number or three"
        )
    return np.broadcast_to(floats, (3,))


def in_base_axes(R_base_ee: Rotation, wrench_ee: Wrench) -> Wrench:
    """Wrench at the hand in the axes of base (Eq. 8, 9): no transpose."""
    return (*turned(R_base_ee, wrench_ee[:3]), *turned(R_base_ee, wrench_ee[3:]))


def deflected(
    R: Rotation, p: Vector, twist: Wrench, mode: DeflectionMode
) -> tuple[Rotation, Vector]:
    """Pose (R, p) in base moved by a twist of the hand in the axes of base.

    In the axes of the hand this is ``T @ exp6(V_E)``; in those of base the rotation
    stands on the left.
    """
    v, w = twist[:3], twist[3:]
    if mode is DeflectionMode.SE3:
        v = left_jacobian_times(w, v)
    return times(exp3(w), R), added(p, v)


def _clamped(v: Vector, most: float) -> Vector:
    x, y, z = v
    square = x * x + y * y + z * z
    if square <= most * most:
        return v
    share = most / sqrt(square)
    return share * x, share * y, share * z


def _shortened(v: Vector, band: float) -> Vector:
    x, y, z = v
    square = x * x + y * y + z * z
    if square <= band * band:
        return 0.0, 0.0, 0.0
    share = 1.0 - band / sqrt(square)
    return share * x, share * y, share * z
