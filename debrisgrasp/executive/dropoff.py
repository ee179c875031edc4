"""Postures that hold an object low over where it is to be put down."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray
from debrisgrasp.control import CartesianLeg, LegPlanner
from debrisgrasp.geometry import SE3, so3, voxel_downsample
from debrisgrasp.kinematics import solve, solve_distinct

from .context import Context
from .limb_state import LimbState
from .obstacles import box_around, lying
from .pacing import widest_corners

__all__ = [
    "drop_postures",
    "longer",
    "may_lie",
    "no_place",
    "object_in_hand",
    "postures_at",
    "room_below",
    "with_underside",
]

_YAWS = 16
"""Attitudes tried: the object turned about the vertical."""
_ALONG = (0.0, -0.15, 0.15, -0.3, 0.3, -0.45)
"""Places around a drop-off, ahead of it ..."""
_OUTWARD = (0.0, 0.12, -0.1, 0.24, 0.36)
"""... and away from the robot [m]: the nearer ones first, as long as they are empty."""
_CLEAR = 0.1
"""Nearer to the way what is put down may be taken for something in it [m]."""
_BESIDE = 0.03
"""So far from the base [m]."""
_FROM_REST, _FEW = 0.03, 200
"""So far from the arm at rest is what is put down [m], by so many of its points."""
_STEP = 0.04
"""Spacing of points of what was not seen of an object [m]."""
_AS_LOW = 0.05
"""Places that differ by less in how high things lie there are about as empty [m]."""
_TURNED = 0.35
"""An object that must be turned by more [rad] to lie on a side of the box around it,
which is a guess, may slip as it is turned in the air: it is held as it hangs, and is
turned where it is put down."""
_TILTS = ((0.35, 0.0), (-0.35, 0.0), (0.0, 0.35), (0.0, -0.35))
"""Where it can't be held level over any of them, about x and y of base [rad]."""
_OVER = 0.01
"""So far over the lowest that was seen of what lies on a side an open hand must be [m].
"""
_TRIED, _LEANING = 160, 48
"""Poses tried of an object that is level, and of one that leans."""
_THICKEST = 0.1
"""What is not seen to be thicker than a hand spans [m]."""
_STEEP = 0.5
"""Of the axis of what goes on along it: its share of the vertical."""
_LONGEST = 0.6
"""What was not seen of an object is no longer [m]."""
_FEWEST = 3
"""Fewer points have no axis."""
_ENOUGH = 12
"""Postures to plan to; any of them may end the motion."""
_SOLVED, _AT_ONCE = 16, 8
"""Poses solved, and postures looked at, together; often the first few will do."""
_LOWERED = 0.12
"""By so much the hand should be able to go down from there [m]: where an object ends
below is mostly a guess, and what is let go over the ground falls on an end, or over ...
"""
_PARTLY = 0.4
"""... or by this share of it, where there is no better place."""
_PATIENCE = 8
"""After so many of these for each that is wanted no better place is sought."""
_DRAWN = 0.1
"""From down there it should come off what it let go: straight back, so far [m]."""


def object_in_hand(context: Context, T_base_hand: SE3, width: float) -> FloatArray:
    """Surface of the chosen object in the frame of a hand at a pose [m], shape (n, 3).

    Of its underside nothing was seen; see `with_underside`.
    """
    seen, is_own = context.cycle.seen, context.cycle.is_own
    assert seen is not None
    assert is_own is not None
    points = seen.cloud.points[is_own]
    _, axes = np.linalg.eigh(np.cov(points.T))
    middle = float(np.sort(np.ptp(points @ axes, axis=0))[1])
    points = points[voxel_downsample(points, 0.01)]
    return T_base_hand.inverse().apply(with_underside(points, width, middle))


def with_underside(points: FloatArray, width: float, middle: float) -> FloatArray:
    """Points of an object seen from above (n, 3), with its underside, (2 n, 3) [m].

    It is as far below as the object is wide (``middle``), and at least as far as the
    grip (``width``), but not lower than that below the lowest that was seen of it.
    """
    thin = min(width, _THICKEST)
    lowest = float(np.quantile(points[:, 2], 0.02)) - thin
    under = points.copy()
    under[:, 2] = np.minimum(
        points[:, 2] - thin, np.maximum(points[:, 2] - middle, lowest)
    )
    return np.concatenate([points, under])


def longer(points_hand: FloatArray, T_base_hand: SE3, room: float) -> FloatArray:
    """Points of an object that stands on what lies below all that was seen of it.

    It goes on down to there: along its axis if that is steep, as that of a pole is.

    Parameters
    ----------
    points_hand
        As `with_underside` has them, frame of the hand [m], shape (2 n, 3).
    room
        Below the lowest of them [m].

    Returns
    -------
    FloatArray
        Shape (2 m, 3).
    """
    n = len(points_hand)
    if not _STEP < room < _LONGEST or n < 2 * _FEWEST or n % 2:
        return points_hand
    seen, under = np.split(T_base_hand.apply(points_hand), 2)
    axis = np.linalg.eigh(np.cov(seen.T))[1][:, -1]
    axis = axis if axis[2] < 0.0 else -axis
    down = axis if axis[2] < -_STEEP else np.array([0.0, 0.0, -1.0])
    along = seen @ down
    end = seen[along > along.max() - _STEP]
    steps = np.arange(_STEP, room / -down[2] + _STEP, _STEP)
    reached = np.minimum(steps, room / -down[2])
    more = (end + reached[:, None, None] * down).reshape(-1, 3)
    return T_base_hand.inverse().apply(np.concatenate([seen, more, under, more]))


def drop_postures(
    context: Context,
    limb: LimbState,
    points_hand: FloatArray,
    q: FloatArray,
    is_free: Callable[[FloatArray], BoolArray],
    enough: int = _ENOUGH,
) -> FloatArray:
    """Find postures from which what is held can be lowered, and let go, (g, d).

    Those over the emptiest places first, and among a few of these the nearest.

    Parameters
    ----------
    points_hand
        Of what is held, frame of the hand [m], shape (n, 3).
    q
        Posture from which it is carried there, shape (d,).
    is_free
        Which of some postures (n, d) touch nothing.
    enough
        So many will do.
    """
    limits = limb.limits.planner
    legs = LegPlanner(limb.reach.chain, limb.limits.controller)
    found: list[FloatArray] = []
    partly: list[tuple[float, float, FloatArray]] = []
    rest = _at_rest(context, limb)
    for points, body, R, most in _attitudes(limb, points_hand, limb.pose(q)):
        goals = _poses(context, limb, points, R)
        goals = SE3(goals.matrix[: 2 * most])
        is_met = _is_met(rest, body, goals)
        is_met |= _is_over_base(context, _thinned(body), goals)
        goals = SE3(goals.matrix[~is_met][:most])
        for k in range(0, len(goals.p), _SOLVED):
            some = SE3(goals.matrix[k : k + _SOLVED])
            solved = postures_at(context, limb, some, q)
            rows = [pair for pair in solved if not limits.violation(pair[0])]
            for row, goal in _free(rows, is_free):
                lowered, drawn = _shares(legs, row, goal)
                if min(lowered, drawn) > 1.0 - 1e-6:
                    found.append(row)
                elif lowered >= _PARTLY:
                    partly.append((round(drawn, 1), round(lowered, 1), row))
                if len(found) >= enough:
                    return np.array(found)
            if len(partly) > _PATIENCE * enough:
                break
        if found or partly:
            break
    # Lower than it could be something falls; where no hand comes off it, it is caught.
    partly.sort(key=lambda place: place[:2], reverse=True)
    return np.array(found or [row for *_, row in partly[:enough]]).reshape(-1, len(q))


def _shares(legs: LegPlanner, q: FloatArray, T: SE3) -> tuple[float, float]:
    """How much of the way down, and of that back from there, a hand can go."""
    down = legs.plan(q, CartesianLeg.along(T, (0.0, 0.0, -_LOWERED)).goal)
    way = -_DRAWN * down.reached.R[:, 2]
    back = legs.plan(down.q[-1], CartesianLeg.along(down.reached, way).goal)
    return down.share, back.share


def no_place(
    context: Context, limb: LimbState, points_hand: FloatArray, T_base_hand: SE3
) -> str:
    """Say that no posture was found to put an object down, and whether it is full."""
    x, y = context.settings.drop_off[limb.name]
    high = context.settings.drop_height
    words = f"no posture holds it {high:g} m over the drop-off at ({x:g}, {y:g})"
    points, _, R, _ = next(_attitudes(limb, points_hand, T_base_hand))
    goals = _poses(context, limb, points, R)
    bottom = (goals.R[:, 2] @ points.T).min(axis=1)
    raised = goals.p[:, 2] + bottom - context.settings.drop_height
    if raised.min() < _AS_LOW:
        return words
    pile = 100.0 * float(raised.min())
    return f"{words}: it is full, {pile:.0f} cm high or more wherever that could lie"


def _attitudes(
    limb: LimbState, points_hand: FloatArray, T_base_hand: SE3
) -> Iterator[tuple[FloatArray, FloatArray, FloatArray, int]]:
    """How to hold an object, best first: points and body, attitude of the hand, effort.

    On a side of the box around it, it lies as it is let go, if that is not far from how
    it hangs. But no finger may be below it then.
    """
    R = T_base_hand.R
    if not len(points_hand):
        points_hand = np.array([[0.0, 0.0, -0.15]]) @ R  # it hangs below the hand
        yield points_hand, points_hand, R, _TRIED
        return
    # As it will be remembered where it lies, and is planned with: the corners of a box
    # may be lower than all that was seen.
    body = lying(SE3.identity(), points_hand)
    turn = _upright(R @ box_around(points_hand).T_link_shape.R)
    flat = turn @ R
    seen = points_hand[: (len(points_hand) + 1) // 2]  # the rest is a guess
    over = (widest_corners(limb) @ flat[2]).min() - (seen @ flat[2]).min()
    ways = (flat, R) if np.linalg.norm(so3.log(turn)) < _TURNED else (R, flat)
    for attitude in ways if over > _OVER else (R,):
        yield points_hand, body, attitude, _TRIED
        yield body, body, attitude, _TRIED
    for tilt in _TILTS:
        yield body, body, so3.from_rpy(np.array([*tilt, 0.0])) @ R, _LEANING


def _upright(axes: FloatArray) -> FloatArray:
    """Smallest rotation that makes one of three axes, in columns, vertical, (3, 3)."""
    up = axes[:, int(np.abs(axes[2]).argmax())]
    x, y, z = (up if up[2] > 0.0 else -up).tolist()
    across = float(np.hypot(x, y))
    if across < 1e-9:
        return np.eye(3)
    return so3.exp(np.arctan2(across, z) / across * np.array([y, -x, 0.0]))


def _free(
    rows: list[tuple[FloatArray, SE3]], is_free: Callable[[FloatArray], BoolArray]
) -> Iterator[tuple[FloatArray, SE3]]:
    """Those of some postures, each with its pose, that touch nothing."""
    for k in range(0, len(rows), _AT_ONCE):
        chunk = rows[k : k + _AT_ONCE]
        free = is_free(np.array([row for row, _ in chunk]))
        yield from (pair for pair, is_ok in zip(chunk, free, strict=True) if is_ok)


def may_lie(
    context: Context, limb: LimbState, points_hand: FloatArray, T_base_hand: SE3
) -> bool:
    """Whether what is held at a pose may be put down there: not onto the robot."""
    one = SE3(T_base_hand.matrix[None])
    is_met = _is_met(_at_rest(context, limb), points_hand, one)
    return not (is_met | _is_over_base(context, points_hand, one)).any()


def room_below(context: Context, points: FloatArray) -> float:
    """How far points (n, 3) are over the ground, or what was put down there [m]."""
    above = points[:, 2] - context.memory.heights(points)
    return float(above.min(initial=np.inf))


def _at_rest(context: Context, limb: LimbState) -> FloatArray:
    """Balls around the robot with its arm at rest, base frame [m], shape (b, 4)."""
    posture = context.model.posture(limb.name, context.settings.rest or limb.rest_of)
    return limb.planner.balls_at(limb.reach.chain.vector(posture), _FROM_REST)


def _thinned(points: FloatArray) -> FloatArray:
    """Take some of many points (n, 3)."""
    return points[:: max(1, len(points) // _FEW)]


def _is_over_base(
    context: Context, points_hand: FloatArray, Ts_base_hand: SE3
) -> BoolArray:
    """Which poses (n,) put down the points onto what carries the arms, shape (n,)."""
    where = Ts_base_hand.R @ points_hand.T + Ts_base_hand.p[..., None]
    x, y = where[:, 0], where[:, 1]
    found = np.zeros(len(where), dtype=bool)
    for solid in context.model.fixed_solids:
        low, high = solid.bounds.lower - _BESIDE, solid.bounds.upper + _BESIDE
        is_over = (x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1])
        found |= is_over.any(axis=1)
    return found


def _is_met(balls: FloatArray, points_hand: FloatArray, Ts_base_hand: SE3) -> BoolArray:
    """Which poses (n,) put down the points where balls are, or above, shape (n,)."""
    points = _thinned(points_hand)
    where = Ts_base_hand.R @ points.T + Ts_base_hand.p[..., None]
    reach = np.linalg.norm(points, axis=1).max(initial=0.0)
    away = np.linalg.norm(Ts_base_hand.p[:, None] - balls[:, :3], axis=-1)
    is_near = away < balls[:, 3] + reach
    met = np.zeros(len(where), dtype=bool)
    for (*middle, radius), near in zip(balls.tolist(), is_near.T, strict=True):
        rows = np.flatnonzero(near & ~met)
        away = np.linalg.norm(where[rows] - np.array(middle)[:, None], axis=1)
        met[rows] = (away < radius).any(axis=1)
    return met


def postures_at(
    context: Context, limb: LimbState, goals: SE3, q: FloatArray
) -> list[tuple[FloatArray, SE3]]:
    """Postures for poses (n,) of the palm, each with its pose, nearest first."""
    chain, reach_map = limb.reach.chain, limb.reach.reach_map
    near = solve(chain, goals, q_seed=q, reach_map=reach_map, rng=context.rng)
    more = solve_distinct(chain, goals, 2, reach_map=reach_map, rng=context.rng)
    rows = np.concatenate([near.q[:, None], more.q], axis=1)
    solved = np.concatenate([near.is_solved[:, None], more.is_solved], axis=1)
    which, column = np.nonzero(solved & near.is_solved[:, None])
    postures = chain.unwound(rows[which, column], q)
    order = np.argsort(np.abs(postures - q).max(axis=1), kind="stable")
    return [(postures[i], goals[which[i]]) for i in order]


def _poses(
    context: Context, limb: LimbState, points_hand: FloatArray, R: FloatArray
) -> SE3:
    """Poses of the palm that hold an object over the drop-off, the emptiest first.

    Those in which it reaches into the way, or almost lies in it, come last.

    Parameters
    ----------
    R
        Attitude of the hand in base; the object is turned from there, shape (3, 3).
    """
    drop_off = np.array(context.settings.drop_off[limb.name])
    side = float(np.sign(drop_off[1])) or 1.0
    shifts = np.array([(x, side * y) for y in _OUTWARD for x in _ALONG])
    shifts = shifts[np.argsort(np.linalg.norm(shifts, axis=1), kind="stable")]
    yaws = np.linspace(0.0, 2.0 * np.pi, _YAWS, endpoint=False)
    Rs = so3.from_rpy(np.stack([0.0 * yaws, 0.0 * yaws, yaws], axis=-1)) @ R
    thin = _thinned(points_hand)
    turned = points_hand @ Rs.transpose(0, 2, 1)
    low, high = turned.min(axis=1), turned.max(axis=1)
    middle, bottom = 0.5 * (low + high)[:, :2], low[:, 2]
    p = np.empty((len(shifts), _YAWS, 3))
    p[..., :2] = (drop_off + shifts)[:, None] - middle
    where = np.tile(thin @ Rs.transpose(0, 2, 1), (len(shifts), 1, 1, 1))
    where[..., :2] += p[..., None, :2]
    under = context.memory.heights(where) - where[..., 2]
    p[..., 2] = np.maximum(under.max(axis=-1), -bottom)
    raised = np.floor((p[..., 2] + bottom) / _AS_LOW)
    where[..., 2] += p[..., None, 2]
    is_in_way = np.any(context.is_in_way(where), axis=-1)
    places = np.pad(drop_off + shifts, ((0, 0), (0, 1)))
    is_in_way |= context.is_in_way(places, _CLEAR)[:, None]
    p[..., 2] += context.settings.drop_height
    poses = np.tile(np.eye(4), (*p.shape[:2], 1, 1))
    poses[..., :3, :3], poses[..., :3, 3] = Rs, p
    order = np.lexsort([raised.ravel(), is_in_way.ravel()])
    return SE3(poses.reshape(-1, 4, 4)[order])
