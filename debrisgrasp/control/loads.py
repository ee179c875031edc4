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

from debrisgrasp._arrays import FloatArray, finite, frozen, require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp._physics import GRAVITY
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import SE3

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

__all__ = ["DOWN", "MOST_NOISE", "Body", "LoadModel", "require_sign"]

MOST_NOISE = (1.0, 0.1)
"""With more, a touch would be felt too late, or where there is none [N, N m]."""
DOWN = (0.0, 0.0, -GRAVITY)
"""Gravity where z is up [m/s^2]."""


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
    gravity: FloatArray = field(default_factory=lambda: np.array(DOWN))
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
        require_sign(self.wrench_sign)
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


def _weight(body: Body, R_base_ft: FloatArray, gravity: FloatArray) -> FloatArray:
    """Wrench of a body's weight in the sensor frame, shape (..., 6)."""
    f = body.mass * np.einsum("...ji,j->...i", R_base_ft, gravity)
    return np.concatenate([f, np.cross(body.com, f)], axis=-1)


def require_sign(wrench_sign: float) -> None:
    """Raise `ConfigError` unless a sensor is read as it is, or turned round."""
    if wrench_sign not in (1.0, -1.0):
        raise ConfigError("wrench_sign", got=wrench_sign, expected="1 or -1")
