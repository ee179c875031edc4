"""How fast a planned motion is run: slowly where the hand may touch something."""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from debrisgrasp._arrays import BoolArray, FloatArray
from debrisgrasp.kinematics import LimitSet, Trajectory

from .context import Context
from .limb_state import LimbState
from .settings import TURN_STIFFNESS

__all__ = [
    "broken_by",
    "careful",
    "cubic_time",
    "feasible",
    "hand_corners",
    "met_safely",
    "moving_points",
    "paced",
    "times_at",
    "widest_corners",
]

_KNOT = 0.05
"""Spacing of the looks along a motion, by its own time [s]."""
_GRAIN = 0.005
"""Spacing of the times between which the pace changes evenly [s]."""
_GAIN = 0.4
"""Change of the pace in a second, at most [1/s]."""
_SPARE = 0.9
"""Share of a planned speed that is used: between its knots a motion, and more so one
that is run backwards, may exceed its acceleration by a few percent."""
_BLEND, _ASIDE = 1.0, 0.1
"""In which it joins the trajectory from where it stands [s], or longer: that takes no
larger share of what the joints can than the other, which the motion leaves."""
_INEXACT = 1e-3
"""By so much a run may exceed positions [rad or m], and shares of other limits: as much
as joints may read outside of them."""
_NEAR, _NEAR_GROUND = 0.05, 0.02
"""What is nearer than this may be touched [m]; an empty hand, whose shape is known,
touches the ground only if it is as near as the other length."""
_STIFFNESS = 3e4
"""Of an arm whose hand meets the hardest thing [N/m]."""
_SENSOR_LAG = 0.012
"""[s]."""
_FELT_AFTER = 2
"""Periods from when a touch is measured until the arm begins to brake: the median of
three samples, and a tick."""
_BORNE_AFTER, _SWINGS_ON = 5, 0.06
"""Readings whose mean tells that the weight on a hand fell; and until the arm stands
then, in which what is held swings on [s]."""
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


def paced(
    trajectory: Trajectory,
    paces: FloatArray,
    q_start: ArrayLike,
    period: float,
    limits: LimitSet,
) -> FloatArray:
    """Postures of each tick of a run, shape (n, d), from where the arm stands.

    It ends where the trajectory does, within the limits.

    Parameters
    ----------
    paces
        See `feasible`.
    q_start
        Where the arm stands (d,): a little beside the begin of the trajectory, perhaps,
        which lies within the limits.
    period
        Of a tick [s].
    limits
        Those that the trajectory was planned for.
    """
    paces = feasible(trajectory, paces, limits.acceleration)
    times = times_at(trajectory, _SPARE * paces, period)
    beside = np.asarray(q_start) - trajectory.q[0]
    n_least = int(np.ceil(cubic_time(np.abs(beside), limits, _ASIDE) / period))
    n = max(len(times), n_least)
    # At the end of a motion that is shorter it waits there until it has joined it.
    times = np.append(times, np.full(n - len(times), trajectory.duration))
    n_blend = max(n_least, min(n, int(np.ceil(_BLEND / period))))
    share = np.minimum(np.arange(1, n + 1) / max(n_blend, 1), 1.0)
    fade = 1.0 - share * share * (3.0 - 2.0 * share)
    path = trajectory.at(times)[0] + fade[:, None] * beside
    # Where it stands first: speeds count from the tick of the last command.
    return np.concatenate([[q_start], path])


def cubic_time(away: FloatArray, limits: LimitSet, share: float = 1.0) -> float:
    """Least time in which a cubic leads joints so far, from rest to rest [s].

    Parameters
    ----------
    away
        How far each is to go [rad or m], shape (d,).
    share
        Of speed and acceleration that it may use.
    """
    speed, most = share * limits.velocity, share * limits.acceleration
    # A cubic is fastest in its middle, and accelerates most at its ends.
    return float(max((1.5 * away / speed).max(), np.sqrt(6.0 * away / most).max()))


def broken_by(path: FloatArray, limits: LimitSet, period: float) -> str:
    """First limit that a run breaks that begins and ends at rest, in words; or "".

    Parameters
    ----------
    path
        Postures of each tick, shape (n, d).
    period
        Of a tick [s].
    """
    # At rest it is where it begins before, and where it ends after.
    q = np.concatenate([path[:1], path[:1], path, path[-1:]])
    dq = np.diff(q, axis=0) / period
    ddq = np.diff(dq, axis=0) / period
    return limits.violation(q[1:-1], dq[1:], ddq, tolerance=_INEXACT)


def hand_corners(limb: LimbState, preshape: str, opening: float) -> FloatArray:
    """Corners of a hand's solids in its frame [m], shape (n, 3)."""
    solids = limb.hand.solids(preshape, opening)
    return np.concatenate([solid.mesh()[0] for solid in solids])


def widest_corners(limb: LimbState) -> FloatArray:
    """Corners of an open hand's solids, whatever its preshape, frame of it, (n, 3)."""
    preshape = limb.first_preshape
    return hand_corners(limb, preshape, limb.hand.preshape(preshape).widest)


def moving_points(context: Context, limb: LimbState) -> FloatArray:
    """Points of a hand, however it is opened, and of what it holds; its frame [m]."""
    corners, held = widest_corners(limb), context.held
    if held is None or held.arm != limb.name:
        return corners
    return np.concatenate([corners, held.points_hand])


def met_safely(
    speed: FloatArray,
    braking: FloatArray,
    room: tuple[float, float],
    reach: float,
    period: float,
) -> FloatArray:
    r"""Paces at which a touch that nobody foresaw stays below the limits, (n,).

    After it is felt a hand goes on until the arm has reacted, in :math:`t`, and braked:
    by :math:`p v t + p^2 v b / 2` at pace p, for the braking time falls with the pace,
    too. Times the stiffness of the arm, which at a lever turns the hand as well, that
    is what the force grows by.

    Parameters
    ----------
    speed
        Of the fastest point that moves with the hand, at full pace [m/s], shape (n,).
    braking
        Time b in which all joints come to rest from full pace [s], shape (n,).
    room
        Force and torque left between where a touch is felt and the limit [N, N m].
    reach
        Farthest point from the origin of the hand [m].
    period
        Of the control loop [s].
    """
    force, torque = max(room[0], 0.0), max(room[1], 0.0)
    # The lever at which a torque grows fastest with the way.
    lever = min(max(reach, 1e-3), sqrt(TURN_STIFFNESS / _STIFFNESS))
    give = 1.0 / (_STIFFNESS * lever) + lever / TURN_STIFFNESS
    depth = min(force / _STIFFNESS, torque * give)
    reacting, stopping = speed * _felt_after(period), speed * braking
    root = np.sqrt(reacting**2 + 2.0 * stopping * depth)
    return np.asarray(2.0 * depth / np.maximum(reacting + root, 1e-12))


def _felt_after(period: float) -> float:
    """From a touch until the arm begins to brake [s]."""
    return _SENSOR_LAG + _FELT_AFTER * period


def lying_speed(room: float, reach: float, period: float) -> float:
    """Speed at which the far end of what is held may come to lie on something [m/s].

    By the time that its weight is felt to be borne, and the drives have braked, the
    arm has gone on, and the end of a long object presses with a long lever.

    Parameters
    ----------
    room
        Torque left up to the limit [N m].
    reach
        Farthest point of it from the origin of the hand [m].
    period
        Of the control loop [s].
    """
    after = _felt_after(period) + _BORNE_AFTER * period + _SWINGS_ON
    return max(room, 0.0) / (_STIFFNESS * max(reach, 1e-3) * after)


def careful(
    context: Context,
    limb: LimbState,
    points: FloatArray,
    trajectory: Trajectory,
    pace: float,
    room: tuple[float, float],
) -> FloatArray:
    """Paces at which whatever a hand, or what it holds, meets stays below the limits.

    What was free when the camera looked may not be by now, and the underside of what is
    held may reach farther than was seen. Near all that was seen they are those of a
    lift. Until it was seen how large what is held is, its old place is included: what
    lay under or behind it was never seen, and is near there.

    Parameters
    ----------
    points
        See `moving_points`, shape (n, 3).
    room
        See `met_safely`.
    """
    n = max(int(np.ceil(trajectory.duration / _KNOT)) + 1, 2)
    points = points[:: max(1, len(points) // _MOST_POINTS)]
    rows, rates, _ = trajectory.at(np.linspace(0.0, trajectory.duration, n))
    T = limb.reach.chain.fk(rows)
    where = np.einsum("nij,kj->nki", T.R, points) + T.p[:, None, :]
    step = np.linalg.norm(np.diff(where, axis=0), axis=2).max(axis=1)
    speed = np.append(step, 0.0)
    speed[1:] = np.maximum(speed[1:], step)
    speed *= (n - 1) / max(trajectory.duration, 1e-9)  # one row stands
    speed = np.maximum(speed, 1e-9)
    braking = (np.abs(rates) / limb.limits.planner.acceleration).max(axis=1)
    reach = float(np.linalg.norm(points, axis=1).max())
    paces = met_safely(speed, braking, room, reach, context.settings.period)
    slow = np.where(_is_near(context, where), context.settings.lift_speed / speed, pace)
    return np.asarray(np.clip(np.minimum(paces, slow), _LEAST, pace))


def _is_near(context: Context, where: FloatArray) -> BoolArray:
    """Whether any of points (n, k, 3) is near what is known, or the ground, (n,)."""
    seen, n = context.cycle.seen, len(where)
    others = np.zeros((0, 3))
    if context.cycle.around is not None:
        others = context.cycle.around
        others = others[others[:, 2] > _GROUND]
    elif seen is not None:
        others = seen.cloud.points[seen.segmentation.labels != 0]
    others = np.concatenate([others, *context.memory.surfaces])
    least = _NEAR if context.held is not None else _NEAR_GROUND
    is_near: BoolArray = where[..., 2].min(axis=1) < least
    if len(others):
        flat = where.reshape(-1, 3)
        gaps = cKDTree(others).query(flat, distance_upper_bound=_NEAR)[0]
        is_near |= np.isfinite(gaps).reshape(n, -1).any(axis=1)
    return is_near
