"""When an arm is where on its path: as soon as its limits allow.

Along each straight edge the arm speeds up, cruises and slows down. Corners are then
rounded: the stop at a corner gives way to ramps from shortly before to shortly after
it, if these keep the limits and touch nothing. All accelerations are piecewise
constant, so that the cubic pieces of a `Trajectory` hold the motion exactly, and no
limit is broken between samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray
from debrisgrasp.kinematics import LimitSet, Trajectory

from .edges import FreeTest
from .ramps import Ramps

__all__ = ["timed"]

_ROOM = 0.99
"""Share of the limits that is used; the rest is for rounding."""
_WINDOWS = np.array([1.0, 0.75, 0.5, 0.35, 0.2])
"""Parts of the half edges at a corner that are tried for rounding it."""
_TIMES = np.linspace(0.4, 0.95, 12)
"""Times tried for it, as shares of the time with a stop."""
_TRIES = 3
"""Roundings of a corner that are tested for contact."""
_CLOSE = 2e-4
"""Room to the limits of position, for what happens between samples [rad or m]."""
_LEAST = 1e-5
"""Knots nearer than this are one [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class _Leg:
    """A straight edge, from standstill to standstill."""

    q: FloatArray
    way: FloatArray
    pace: float
    """Largest change of the share of the edge [1/s]."""
    ramp: float
    """Its change [1/s^2]."""

    @classmethod
    def of(
        cls, q0: FloatArray, q1: FloatArray, speed: FloatArray, most: FloatArray
    ) -> _Leg:
        way = q1 - q0
        length = np.maximum(np.abs(way), 1e-12)
        ramp = float((most / length).min())
        pace = min(float((speed / length).min()), float(np.sqrt(ramp)))
        return cls(q0, way, pace, ramp)

    @property
    def rise(self) -> float:
        return self.pace / self.ramp

    @property
    def total(self) -> float:
        return 1.0 / self.pace + self.rise

    def at(self, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Posture and speed at times (n,), each (n, d)."""
        left, rise = self.total - t, self.rise
        s = np.where(t < rise, 0.5 * self.ramp * t * t, self.pace * (t - 0.5 * rise))
        s = np.where(left < rise, 1.0 - 0.5 * self.ramp * left * left, s)
        rate = np.minimum(np.minimum(self.ramp * t, self.ramp * left), self.pace)
        return self.q + s[:, None] * self.way, rate[:, None] * self.way


def timed(
    path: FloatArray, limits: LimitSet, is_free: FreeTest, *, step: float
) -> Trajectory:
    """Time a path of straight edges.

    Parameters
    ----------
    path
        Postures (m, d), at least one; edges between them are free.
    limits
        What is kept.
    is_free
        Tests the rounded corners.
    step
        Largest change of a joint between postures tested [rad or m].
    """
    speed, most = _ROOM * limits.velocity, _ROOM * limits.acceleration
    legs = [
        _Leg.of(q0, q1, speed, most)
        for q0, q1 in pairwise(path)
        if np.abs(q1 - q0).max() > 1e-9
    ]
    arcs = _rounded(legs, limits, is_free, step) if len(legs) > 1 else {}
    times, q, dq = [np.zeros(1)], [path[:1]], [np.zeros((1, path.shape[1]))]
    clock = 0.0
    for i, leg in enumerate(legs):
        begin = arcs[i - 1][1] if i - 1 in arcs else 0.0
        end = leg.total - (arcs[i][1] if i in arcs else 0.0)
        knots = np.array([begin, leg.rise, leg.total - leg.rise, end])
        knots = np.unique(np.clip(knots, begin, end))
        at = leg.at(knots)
        times.append(clock + knots - begin)
        clock += end - begin
        if i in arcs:
            ramps = arcs[i][0]
            inner = ramps.knots()
            q_arc, dq_arc = ramps.at(inner[:, None])
            at = np.concatenate([at[0], q_arc]), np.concatenate([at[1], dq_arc])
            times.append(clock + inner)
            clock += float(ramps.total[0])
        q.append(at[0])
        dq.append(at[1])
    t = np.concatenate(times)
    kept = _apart(t)
    return Trajectory(
        joint_names=limits.joint_names,
        times=t[kept],
        q=np.concatenate(q)[kept],
        dq=np.concatenate(dq)[kept],
        limits_hash=limits.hash,
    )


def _apart(times: FloatArray) -> IntArray:
    """Find the knots that are not the same as the one before."""
    kept = [0]
    for i in range(1, len(times)):
        if times[i] - times[kept[-1]] > _LEAST:
            kept.append(i)
        elif len(kept) > 1 and i == len(times) - 1:
            kept[-1] = i
    return np.array(kept)


def _rounded(
    legs: list[_Leg], limits: LimitSet, is_free: FreeTest, step: float
) -> dict[int, tuple[Ramps, float]]:
    """Ramps around the corner after each leg, and the time cut off on either side."""
    speed, most = _ROOM * limits.velocity, _ROOM * limits.acceleration
    found = {}
    for i, (leg, following) in enumerate(pairwise(legs)):
        half = 0.5 * min(leg.total, following.total)
        window = half * _WINDOWS
        q0, v0 = leg.at(leg.total - window)
        q1, v1 = following.at(window)
        total = 2.0 * window[:, None] * _TIMES
        q0, v0, q1, v1 = (state[:, None] for state in (q0, v0, q1, v1))
        ramps = Ramps.between(q0, v0, q1, v1, total, speed)
        fits = ramps.fits & (np.abs(ramps.a) <= most).all(axis=-1)
        saved = np.where(fits, 2.0 * window[:, None] - total, 0.0)
        order = np.argsort(-saved, axis=None, kind="stable")[:_TRIES]
        for flat in order[saved.ravel()[order] > 0.0]:
            row, column = np.unravel_index(flat, saved.shape)
            arc = ramps[row, column]
            n = int(np.ceil(float(arc.total[0]) * float(speed.max()) / step)) + 1
            postures, _ = arc.at(np.linspace(0.0, float(arc.total[0]), n)[:, None])
            within = postures >= limits.lower + _CLOSE
            within &= postures <= limits.upper - _CLOSE
            if within.all() and is_free(postures).all():
                found[i] = arc, float(window[row])
                break
    return found
