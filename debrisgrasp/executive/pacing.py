"""How fast a planned motion is run: slowly where the hand may touch something."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from debrisgrasp._arrays import FloatArray
from debrisgrasp.kinematics import Trajectory

from .context import Context, LimbState

__all__ = ["careful", "feasible", "hand_corners", "times_at"]

_KNOT = 0.05
"""Spacing of the looks along a motion, by its own time [s]."""
_GRAIN = 0.005
"""Spacing of the times between which the pace changes evenly [s]."""
_GAIN = 0.4
"""Change of the pace in a second, at most [1/s]."""
_NEAR, _NEAR_GROUND = 0.05, 0.02
"""What is nearer than this may be touched [m]; an empty hand, whose shape is known,
touches the ground only if it is as near as the other length."""
_BRAKES = 0.6
"""What is farther away may be come to as fast as the arm brakes [m/s^2]."""
_LEAST = 0.02
"""Of the pace."""
_MOST_POINTS = 400
_GROUND = 0.02
"""Points no higher are the ground, which bounds the gap by itself [m]."""


def times_at(trajectory: Trajectory, paces: FloatArray, period: float) -> FloatArray:
    """Give the time of a trajectory [s] at which each tick of its run is, shape (n,).

    Parameters
    ----------
    paces
        Share of the planned speed at equal distances of its own time, shape (k,), one
        or more; between them it changes no faster than the arm can.
    """
    total = trajectory.duration
    s = np.linspace(0.0, total, int(np.ceil(total / _GRAIN)) + 2)
    # Squares of paces: at a steady gain they change evenly along the way.
    squares = np.interp(s, np.linspace(0.0, total, len(paces)), paces) ** 2
    most = 2.0 * _GAIN * float(s[1])
    for way in (squares, squares[::-1]):
        if np.abs(np.diff(way)).max() > most:
            way[:] = np.minimum.accumulate(way - most * np.arange(len(way)))
            way += most * np.arange(len(way))
    rate = np.sqrt(squares)
    clock = np.cumsum(np.append(0.0, 2.0 * np.diff(s) / (rate[1:] + rate[:-1])))
    n = int(np.ceil(clock[-1] / period - 1e-9))
    ticks = np.minimum(period * np.arange(1, n + 1), clock[-1])
    at = np.clip(np.searchsorted(clock, ticks, side="right") - 1, 0, len(s) - 2)
    since, gain = ticks - clock[at], np.diff(squares)[at] / (2.0 * s[1])
    return np.asarray(s[at] + (rate[at] + 0.5 * gain * since) * since)


def feasible(
    trajectory: Trajectory, paces: FloatArray, acceleration: FloatArray
) -> FloatArray:
    """Lower paces that change where a change would ask too much of the arm, (n,).

    A trajectory that is run at a pace that changes accelerates by itself and by the
    change.

    Parameters
    ----------
    paces
        See `times_at`.
    acceleration
        Largest ones of the joints [rad/s^2 or m/s^2], shape (d,).
    """
    if not np.ptp(paces):
        return paces
    total = trajectory.duration
    s = np.linspace(0.0, total, int(np.ceil(total / _GRAIN)) + 2)
    _, speed, own = trajectory.at(s)
    own = np.abs(own)
    own[1:-1] = np.maximum(own[1:-1], np.maximum(own[:-2], own[2:]))  # they jump
    left = np.maximum(acceleration - _GAIN * np.abs(speed), 0.0)
    most = np.sqrt((left / np.maximum(own, 1e-9)).min(axis=1))
    wanted = np.interp(s, np.linspace(0.0, total, len(paces)), paces)
    least = min(_LEAST, float(wanted.min()))
    return np.asarray(np.clip(most, least, np.maximum(wanted, least)))


def hand_corners(limb: LimbState, preshape: str, opening: float) -> FloatArray:
    """Corners of a hand's solids in its frame [m], shape (n, 3)."""
    solids = limb.hand.solids(preshape, opening)
    return np.concatenate([solid.mesh()[0] for solid in solids])


def careful(
    context: Context,
    limb: LimbState,
    points: FloatArray,
    trajectory: Trajectory,
    pace: float,
) -> FloatArray:
    """Paces at which what moves with a hand is slow near all that was seen.

    Until it was seen how large what is held is, its old place included: what lay under
    or behind it was never seen, and is near there.

    Parameters
    ----------
    points
        Of hand or held object, frame of the hand [m], shape (n, 3).
    """
    n = max(int(np.ceil(trajectory.duration / _KNOT)) + 1, 2)
    seen = context.cycle.seen
    if seen is None or not len(points):
        return np.full(n, pace)
    if context.cycle.around is not None:
        others = context.cycle.around
        others = others[others[:, 2] > _GROUND]
    else:
        others = seen.cloud.points[seen.segmentation.labels != 0]
    others = np.concatenate([others, *context.put_down, *context.fallen])
    points = points[:: max(1, len(points) // _MOST_POINTS)]
    rows = trajectory.at(np.linspace(0.0, trajectory.duration, n))[0]
    T = limb.reach.chain.fk(rows)
    where = np.einsum("nij,kj->nki", T.R, points) + T.p[:, None, :]
    is_empty = context.held is None
    # So near to the ground it may be as fast as so much farther from anything else.
    gap = where[..., 2].min(axis=1) + is_empty * (_NEAR - _NEAR_GROUND)
    if len(others):
        tree, flat = cKDTree(others), where.reshape(-1, 3)
        near = np.asarray(tree.query(flat, distance_upper_bound=0.5)[0])
        gap = np.minimum(gap, near.reshape(n, -1).min(axis=1))
    step = np.linalg.norm(np.diff(where, axis=0), axis=2).max(axis=1)
    speed = np.append(step, 0.0)
    speed[1:] = np.maximum(speed[1:], step)
    speed *= (n - 1) / trajectory.duration
    allowed = context.settings.lift_speed + np.sqrt(
        2.0 * _BRAKES * np.maximum(gap - _NEAR, 0.0)
    )
    return np.asarray(np.clip(allowed / np.maximum(speed, 1e-9), _LEAST, pace))
