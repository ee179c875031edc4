"""Joint motions in time, bound to the limits that they were made for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import FloatArray, finite
from debrisgrasp.errors import ConfigError, ShapeError

from .limits import LimitSet

__all__ = ["Trajectory"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Trajectory:
    """Postures and speeds at given times, cubic in between."""

    joint_names: tuple[str, ...]
    times: FloatArray
    """Seconds from the start, rising from 0, shape (n,)."""
    q: FloatArray
    """Postures [rad or m], shape (n, d)."""
    dq: FloatArray
    """Speeds [rad/s or m/s], shape (n, d)."""
    limits_hash: str
    """`LimitSet.hash` of the limits that it was planned for."""

    def __post_init__(self) -> None:
        d = len(self.joint_names)
        for name, row in (("times", ()), ("q", (d,)), ("dq", (d,))):
            array = finite(getattr(self, name), f"{name} of a trajectory", (None, *row))
            object.__setattr__(self, name, array)
        if not len(self.times) == len(self.q) == len(self.dq) >= 1:
            raise ShapeError(
                "rows of a trajectory",
                got=(len(self.times), len(self.q), len(self.dq)),
                expected="equally many times, postures and speeds, at least one",
            )
        if self.times[0] != 0.0 or np.any(np.diff(self.times) <= 0.0):
            raise ConfigError(
                "times of a trajectory",
                got="some that don't rise from 0",
                expected="rising seconds that begin at 0",
            )

    def __repr__(self) -> str:
        joints, knots = len(self.joint_names), len(self.times)
        return f"<Trajectory of {joints} joints: {knots} knots, {self.duration:.2f} s>"

    @property
    def duration(self) -> float:
        """Seconds from start to end."""
        return float(self.times[-1])

    def at(self, t: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Posture, speed and acceleration at times t (...), each (..., d).

        Before the start and after the end the robot stands.
        """
        t = np.asarray(t, dtype=np.float64)
        if len(self.times) == 1:
            still = np.broadcast_to(self.q[0], (*t.shape, self.q.shape[1]))
            return still.copy(), np.zeros(still.shape), np.zeros(still.shape)
        i = np.clip(np.searchsorted(self.times, t, "right") - 1, 0, len(self.q) - 2)
        h = (self.times[i + 1] - self.times[i])[..., None]
        u = np.clip((t - self.times[i])[..., None] / h, 0.0, 1.0)
        q0, q1 = self.q[i], self.q[i + 1]
        m0, m1 = h * self.dq[i], h * self.dq[i + 1]
        a, b = 2.0 * (q0 - q1) + m0 + m1, 3.0 * (q1 - q0) - 2.0 * m0 - m1
        is_outside = ((t < 0.0) | (t > self.times[-1]))[..., None]
        speed = np.where(is_outside, 0.0, ((3.0 * a * u + 2.0 * b) * u + m0) / h)
        acceleration = np.where(is_outside, 0.0, (6.0 * a * u + 2.0 * b) / (h * h))
        return ((a * u + b) * u + m0) * u + q0, speed, acceleration

    def violation(self, limits: LimitSet, period: float = 0.004) -> str:
        """First limit broken at samples of a period [s], in words; empty if none."""
        n = max(2, int(np.ceil(self.duration / period)) + 1)
        sampled = np.linspace(0.0, self.duration, n)
        t = np.union1d(sampled, self.times)
        return limits.violation(*self.at(t), tolerance=1e-6)

    def require_executable(self, limits: LimitSet) -> None:
        """Raise `ConfigError` unless planned for these limits, and keeping them."""
        limits.require_same(self.limits_hash, "a trajectory")
        broken = self.violation(limits)
        if broken:
            raise ConfigError("trajectory", got=broken, expected="within its limits")
