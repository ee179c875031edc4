r"""Joint motions of constant acceleration between two states in a given time.

Each joint speeds up, may hold its largest speed for a while, and slows down (or the
other way round), with the least acceleration that takes it from one position and speed
to another in a time T. With :math:`\Delta` the distance to go and :math:`\delta` the
change of speed, the acceleration solves

.. math:: T^2 a^2 + (2 T (v_0 + v_1) - 4 \Delta)\, a - \delta^2 = 0

and where the peak would be too fast, a piece at the largest speed is put in between.
K. Hauser and V. Ng-Thow-Hing, "Fast smoothing of manipulator trajectories using optimal
bounded-acceleration shortcuts", ICRA 2010.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray

__all__ = ["Ramps"]


@dataclass(frozen=True, slots=True, eq=False)
class Ramps:
    """Ramps of any number of motions; all arrays broadcast to (..., d)."""

    q: FloatArray
    """Position at the start."""
    v: FloatArray
    """Speed at the start."""
    a: FloatArray
    """Acceleration of the first piece; the last has the opposite one."""
    t_hold: FloatArray
    """When the speed begins to be held."""
    t_end: FloatArray
    """When it ceases to be."""
    total: FloatArray
    """Duration, shape (..., 1)."""
    fits: BoolArray
    """Whether the motion is possible and keeps the limits of speed, (...)."""

    @classmethod
    def between(
        cls,
        q0: FloatArray,
        v0: FloatArray,
        q1: FloatArray,
        v1: FloatArray,
        total: FloatArray,
        velocity: FloatArray,
    ) -> Ramps:
        """Ramps from one state (..., d) to another in a time (...) [s].

        ``velocity`` (d,) is the largest speed.
        """
        T = total[..., None]
        way, gain = q1 - q0, v1 - v0
        b = 2.0 * T * (v0 + v1) - 4.0 * way
        root = np.sqrt(b * b + 4.0 * T * T * gain * gain)
        # Of the two solutions this one switches between start and end.
        a = -(b + np.where(b < 0.0, -root, root)) / (2.0 * T * T)
        with np.errstate(divide="ignore", invalid="ignore"):
            switch = np.where(np.abs(a) > 1e-12, 0.5 * (T + gain / a), 0.5 * T)
        switch = np.clip(switch, 0.0, T)
        peak = v0 + a * switch
        top = np.copysign(velocity, peak)
        is_fast = np.abs(peak) > velocity
        with np.errstate(divide="ignore", invalid="ignore"):
            over = top * T - way
            a_fast = 0.5 * ((top - v0) ** 2 + (top - v1) ** 2) / over
            up, down = (top - v0) / a_fast, (top - v1) / a_fast
        is_bad = is_fast & ~(
            np.isfinite(a_fast)
            & (a_fast * top > 0.0)
            & (up >= 0.0)
            & (down >= 0.0)
            & (up + down <= T)
        )
        use = is_fast & ~is_bad
        return cls(
            q=q0,
            v=v0,
            a=np.where(use, a_fast, a),
            t_hold=np.where(use, up, switch),
            t_end=np.where(use, T - down, switch),
            total=T,
            fits=np.asarray(~is_bad.any(axis=-1)),
        )

    def __getitem__(self, index: tuple[int, ...]) -> Ramps:
        def of(array: FloatArray) -> FloatArray:
            full = np.broadcast_to(array, self.a.shape[:-1] + array.shape[-1:])
            return np.asarray(full[index])

        return Ramps(
            of(self.q),
            of(self.v),
            of(self.a),
            of(self.t_hold),
            of(self.t_end),
            of(self.total),
            np.asarray(self.fits[index]),
        )

    def at(self, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Position and speed at times t, which broadcast to (..., d)."""
        t1 = np.minimum(t, self.t_hold)
        t2 = np.clip(t - self.t_hold, 0.0, self.t_end - self.t_hold)
        t3 = np.maximum(t - self.t_end, 0.0)
        top = self.v + self.a * t1
        q = self.q + self.v * t1 + 0.5 * self.a * t1 * t1
        q = q + top * t2 + top * t3 - 0.5 * self.a * t3 * t3
        return q, top - self.a * t3

    def knots(self) -> FloatArray:
        """Tell when a joint of one motion changes its acceleration, (k,)."""
        return np.unique(np.concatenate([self.t_hold, self.t_end, self.total]))
