r"""From the raw reading of a wrist sensor to the load on the hand.

The sensor sees contact, the tool's weight, what the tool holds, and a bias that drifts:

.. math:: s W_\text{raw} = W_\text{contact} + W_\text{tool}(R) + W_\text{payload}(R) + b

What is left after bias and tool is the *load*. It is absolute: zero only for an empty
hand in free space. Limits hold for it, and never for a tared value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import (
    FloatArray,
    as_floats,
    finite,
    frozen,
    require_finite,
    require_range,
)
from debrisgrasp._checked import checked_fields
from debrisgrasp._physics import GRAVITY
from debrisgrasp.errors import ConfigError, InputError, ShapeError
from debrisgrasp.geometry import SE3, so3

from ._rigid import (
    Rotation,
    Vector,
    Wrench,
    added,
    cross,
    parts,
    six,
    turned,
    turned_back,
)

__all__ = [
    "Body",
    "LoadModel",
    "ToolFit",
    "felt_weight",
    "identify_payload",
    "identify_tool",
]

MOST_NOISE = (1.0, 0.1)
"""With more, a touch would be felt too late, or where there is none [N, N m]."""
_DOWN = (0.0, 0.0, -GRAVITY)
_TURNS = "orientations of the sensor"
_LEAST_POSES = 4
_LEAST_SPAN = np.deg2rad(60.0)


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """Something rigid that hangs on the sensor."""

    mass: float = 0.0
    """[kg]."""
    com: FloatArray = field(default_factory=lambda: np.zeros(3))
    """Centre of mass in the sensor frame [m], shape (3,)."""

    def __post_init__(self) -> None:
        require_range("mass of a body [kg]", self.mass, 0.0, 1e4)
        object.__setattr__(self, "com", finite(self.com, "centre of mass", (3,)))


@checked_fields
@dataclass(frozen=True, eq=False, kw_only=True)
class LoadModel:
    """What a sensor reads without contact, and where the hand is on it."""

    T_ee_ft: SE3
    """Pose of the sensor frame in the frame of the hand, ``ee``."""
    tool: Body = field(default_factory=Body)
    """Everything beyond the sensor that is always there."""
    payload: Body = field(default_factory=Body)
    """What the hand holds, once it is known; it is part of the load."""
    bias: FloatArray = field(default_factory=lambda: np.zeros(6))
    """Reading without any force [N, N m], sensor frame, shape (6,)."""
    wrench_sign: float = 1.0
    """-1 for a driver that reports what the tool exerts on the environment."""
    sensor_range: tuple[float, float] = (660.0, 60.0)
    """Each axis ends there [N, N m], by the sensor's data sheet."""
    sensor_noise: tuple[float, float] = (0.3, 0.01)
    """Of each axis at rest, one standard deviation, up to 1 N and 0.1 N m. More than
    twice that counts as movement; what counts as a touch depends not on it."""
    gravity: FloatArray = field(default_factory=lambda: np.array(_DOWN))
    """In base [m/s^2], shape (3,)."""
    _mount: tuple[Rotation, Vector] = field(init=False, repr=False)
    """`T_ee_ft` as plain floats."""
    _tool: tuple[Vector, Vector, Wrench] = field(init=False, repr=False)
    """Mass times gravity in base; centre of mass and bias at the hand."""

    _payload: tuple[Vector, Vector] = field(init=False, repr=False)
    """Mass times gravity in base, and centre of mass at the hand."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "bias", frozen(six(self.bias, "bias"), "bias", (6,)))
        object.__setattr__(self, "gravity", finite(self.gravity, "gravity", (3,)))
        _require_sign(self.wrench_sign)
        for value in self.sensor_range:
            require_range("LoadModel.sensor_range [N, N m]", value, 1e-6, 1e6)
        for value, most in zip(self.sensor_noise, MOST_NOISE, strict=True):
            require_range("LoadModel.sensor_noise [N, N m]", value, 1e-6, most)
        object.__setattr__(self, "_mount", parts(self.T_ee_ft))
        # All that doesn't change is moved to the hand once.
        bias = tuple(self.T_ee_ft.map_wrench(self.bias).tolist())
        object.__setattr__(self, "_tool", (*self._hung(self.tool), bias))
        object.__setattr__(self, "_payload", self._hung(self.payload))

    def _hung(self, body: Body) -> tuple[Vector, Vector]:
        """Mass times gravity in base, and centre of mass at the hand."""
        com = self.T_ee_ft.apply(body.com).tolist()
        return tuple((body.mass * self.gravity).tolist()), tuple(com)

    def with_bias(self, bias: ArrayLike) -> LoadModel:
        """Return the model after a new baseline: the bias [N, N m], shape (6,)."""
        return replace(self, bias=six(bias, "bias"))

    def with_payload(self, payload: Body) -> LoadModel:
        """Return the model once the payload is identified."""
        return replace(self, payload=payload)

    def load_ft(self, raw: ArrayLike, R_base_ft: ArrayLike) -> FloatArray:
        """Return loads in the sensor frame, shape (..., 6).

        Parameters
        ----------
        raw
            Readings (f, tau) [N, N m], shape (..., 6).
        R_base_ft
            Orientation of the sensor at each reading, shape (..., 3, 3).
        """
        raw, R = np.asarray(raw, dtype=np.float64), np.asarray(R_base_ft)
        weight = _weight(self.tool, R, self.gravity)
        return self.wrench_sign * raw - self.bias - weight

    def payload_ee(self, R_base_ee: Rotation) -> Wrench:
        """Weight of the payload in the axes and at the origin of the hand."""
        g, com = self._payload
        f = turned_back(R_base_ee, g)
        return (*f, *cross(com, f))

    def reading(self, load_ee: ArrayLike, R_base_ee: Rotation) -> FloatArray:
        """Return what the sensor reads under a load; undoes `load_ee`, shape (6,)."""
        return np.array(self.reading_of(six(load_ee, "load").tolist(), R_base_ee))

    def reading_of(self, load_ee: Sequence[float], R_base_ee: Rotation) -> Wrench:
        """Return the same for six floats that are known to be finite, as floats."""
        (R, p), (g, com, bias), s = self._mount, self._tool, self.wrench_sign
        weight = turned_back(R_base_ee, g)
        moment = cross(com, weight)
        a = load_ee[0] + weight[0] + bias[0]
        b = load_ee[1] + weight[1] + bias[1]
        c = load_ee[2] + weight[2] + bias[2]
        x, y, z = cross(p, (a, b, c))
        torque = turned_back(
            R,
            (
                load_ee[3] + moment[0] + bias[3] - x,
                load_ee[4] + moment[1] + bias[4] - y,
                load_ee[5] + moment[2] + bias[5] - z,
            ),
        )
        i, j, k = turned_back(R, (a, b, c))
        return s * i, s * j, s * k, s * torque[0], s * torque[1], s * torque[2]

    def load_ee(self, raw: Sequence[float], R_base_ee: Rotation) -> Wrench:
        """Load at the hand: equation (7) with the inverse that power demands.

        Parameters
        ----------
        raw
            One reading in the sensor frame, six floats.
        R_base_ee
            Measured orientation of the hand.
        """
        (R, p), (g, com, bias), s = self._mount, self._tool, self.wrench_sign
        a, b, c, d, e, f = raw
        force = turned(R, (s * a, s * b, s * c))
        torque = added(turned(R, (s * d, s * e, s * f)), cross(p, force))
        weight = turned_back(R_base_ee, g)
        moment = cross(com, weight)
        return (
            force[0] - weight[0] - bias[0],
            force[1] - weight[1] - bias[1],
            force[2] - weight[2] - bias[2],
            torque[0] - moment[0] - bias[3],
            torque[1] - moment[1] - bias[4],
            torque[2] - moment[2] - bias[5],
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ToolFit:
    """Tool and bias found from readings in several orientations."""

    tool: Body
    bias: FloatArray
    """[N, N m], shape (6,)."""
    rms: FloatArray
    """Root mean square of what the model leaves of force [N] and torque [N m], (2,)."""
    span: float
    """Largest angle between two directions of gravity as the sensor felt it [rad]."""


def identify_tool(
    raw: ArrayLike,
    R_base_ft: ArrayLike,
    *,
    wrench_sign: float = 1.0,
    expected_mass: float | None = None,
    gravity: ArrayLike = _DOWN,
) -> ToolFit:
    """Find mass, centre of mass and bias of an empty hand in free space.

    Parameters
    ----------
    raw
        Mean reading in each orientation [N, N m], shape (n, 6), n at least 4.
    R_base_ft
        Orientations of the sensor, shape (n, 3, 3); gravity must turn by at least
        60 degrees between two of them.
    expected_mass
        Configured mass of the tool [kg]; a fit that misses it by more than 10 % is
        refused.

    Raises
    ------
    InputError
        If there are too few or too similar orientations, the fitted mass is negative
        (the sign of the sensor is inverted), it is not the expected one, or
        ``wrench_sign`` is neither 1 nor -1.
    """
    _require_sign(wrench_sign)
    if expected_mass is not None:
        require_range("expected mass of the tool [kg]", expected_mass, 1e-3, 1e4)
    raw, R, g = _readings(raw, R_base_ft, gravity)
    n = len(raw)
    g_ft = np.einsum("nji,j->ni", R, g)
    unit = g_ft / np.linalg.norm(g)
    span = float(np.arccos(np.clip(unit @ unit.T, -1.0, 1.0)).max())
    if n < _LEAST_POSES or span < _LEAST_SPAN:
        raise InputError(
            "orientations for the identification of the tool",
            got=f"{n} that turn gravity by {np.rad2deg(span):.0f} degrees",
            expected="at least 4 that turn it by 60 degrees or more",
            mend="Tilt the hand further, about two different axes.",
        )
    A = np.zeros((n, 6, 10))
    A[:, :3, 0], A[:, 3:, 1:4] = g_ft, -so3.hat(g_ft)
    A[:, :3, 4:7] = A[:, 3:, 7:] = np.eye(3)
    rows = A.reshape(-1, 10)
    rank = np.linalg.matrix_rank(rows, tol=0.02 * float(np.linalg.norm(g)))
    if rank < 10:
        raise InputError(
            "orientations for the identification of the tool",
            got=f"rank {rank}",
            expected="rank 10",
            mend="Add an orientation tilted about another axis.",
        )
    y = wrench_sign * raw
    x = np.asarray(np.linalg.lstsq(rows, y.ravel(), rcond=None)[0], dtype=np.float64)
    mass = float(x[0])
    if mass < 0.0:
        raise InputError(
            "mass of the tool",
            got=f"{mass:.3g} kg",
            expected="a positive mass",
            mend="The sign of the sensor is inverted: set wrench_sign to "
            f"{-wrench_sign:g}. Do not start before that.",
        )
    if expected_mass is not None and abs(mass - expected_mass) > 0.1 * expected_mass:
        raise InputError(
            "mass of the tool",
            got=f"{mass:.3f} kg",
            expected=f"{expected_mass:g} kg within 10 %",
            mend="Something hangs on the hand, or it touches something.",
        )
    rest = (y.ravel() - rows @ x).reshape(n, 2, 3)
    com = x[1:4] / mass if mass > 1e-9 else np.zeros(3)
    return ToolFit(
        tool=Body(mass, com),
        bias=x[4:],
        rms=np.sqrt((rest**2).sum(axis=2).mean(axis=0)),
        span=span,
    )


def felt_weight(
    loads: LoadModel, Rs_base_ft: FloatArray, forces: FloatArray
) -> tuple[float, float]:
    """Compare how a turn of an empty hand changes the force, and how it must.

    Parameters
    ----------
    Rs_base_ft
        Orientation of the sensor before and after, shape (2, 3, 3).
    forces
        Raw forces read there [N], shape (2, 3).

    Returns
    -------
    felt, due : float
        Change along the way in which the tool's weight changes it, and the change of
        that weight [N]: equal if the sensor is right, opposite if its sign is wrong.
    """
    before, after = Rs_base_ft.swapaxes(1, 2) @ (loads.tool.mass * loads.gravity)
    change, due = after - before, float(np.linalg.norm(after - before))
    felt = loads.wrench_sign * (forces[1] - forces[0])
    return float(change @ felt) / max(due, 1e-9), due


def identify_payload(
    model: LoadModel,
    raw: ArrayLike,
    R_base_ft: ArrayLike,
    *,
    expected_com: ArrayLike = (0.0, 0.0, 0.0),
) -> tuple[Body, bool]:
    """Find what a hand holds freely in the air.

    The mass needs one orientation, the whole centre of mass two: along gravity it has
    no effect. A constant tare instead of this is wrong by ``2 m g sin(angle / 2)``
    after the hand has turned by an angle.

    Parameters
    ----------
    raw
        Readings of the sensor [N, N m], shape (n, 6).
    R_base_ft
        Orientation of the sensor at each, shape (n, 3, 3).
    expected_com
        Where the centre of mass should be [m], sensor frame, shape (3,): it is as near
        to there as the readings allow.

    Returns
    -------
    payload, is_complete
        ``is_complete`` is false if the centre of mass is only known across gravity.

    Raises
    ------
    InputError
        If the mass comes out negative: something pushes the hand up.
    """
    raw, R, g = _readings(raw, R_base_ft, model.gravity)
    load = model.load_ft(raw, R)
    g_ft = np.einsum("nji,j->ni", R, g)
    mass = float((load[:, :3] * g_ft).sum() / (g_ft * g_ft).sum())
    if mass < 0.0:
        raise InputError(
            "mass of the payload",
            got=f"{mass:.3g} kg",
            expected="zero or more",
            mend="The hand is pushed up by something, or the bias has drifted.",
        )
    if mass < 1e-3:
        return Body(0.0), False
    expected = finite(expected_com, "expected centre of mass [m]", (3,))
    A = -so3.hat(g_ft).reshape(-1, 3)
    rest = load[:, 3:].ravel() - mass * (A @ expected)
    solution = np.linalg.lstsq(A, rest, rcond=0.05)
    com = expected + np.asarray(solution[0]) / mass
    return Body(mass, com), bool(solution[2] == 3)


def _weight(body: Body, R_base_ft: FloatArray, gravity: FloatArray) -> FloatArray:
    """Wrench of a body's weight in the sensor frame, shape (..., 6)."""
    f = body.mass * np.einsum("...ji,j->...i", R_base_ft, gravity)
    return np.concatenate([f, np.cross(body.com, f)], axis=-1)


def _readings(
    raw: ArrayLike, R_base_ft: ArrayLike, gravity: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray]:
    raw = np.atleast_2d(as_floats(raw, "readings", ()))
    R = as_floats(R_base_ft, _TURNS, (3, 3)).reshape(-1, 3, 3)
    if raw.shape != (len(R), 6) or not len(R):
        raise ShapeError("readings", got=raw.shape, expected=f"({len(R) or 'n'}, 6)")
    require_finite(raw, "readings")
    SE3.from_matrix(SE3.from_parts(R).matrix, _TURNS)
    g = finite(gravity, "gravity", (3,))
    require_range("size of gravity [m/s^2]", float(np.linalg.norm(g)), 0.1, 100.0)
    return raw, R, g


def _require_sign(wrench_sign: float) -> None:
    if wrench_sign not in (1.0, -1.0):
        raise ConfigError("wrench_sign", got=wrench_sign, expected="1 or -1")
