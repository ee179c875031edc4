"""Postures that hold an object low over where it is to be put down."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray
from debrisgrasp.control import CartesianLeg, LegPlanner
from debrisgrasp.geometry import SE3, so3, voxel_downsample
from debrisgrasp.kinematics import solve, solve_distinct

from .context import Context, LimbState
from .obstacles import lying

__all__ = ["drop_postures", "may_lie", "object_in_hand", "with_underside"]

_YAWS = 16
"""Attitudes tried: the object as it was lifted, turned about the vertical."""
_PLACES = (
    *((0.0, 0.0), (-0.2, 0.0), (0.2, 0.0), (0.0, 0.12), (-0.2, 0.12), (-0.4, 0.0)),
    *((0.2, 0.12), (-0.4, 0.12), (-0.3, -0.1), (0.0, -0.08)),
)
"""Places around a drop-off, ahead and outward, tried in turn as it fills [m]."""
_BESIDE = 0.03
"""So far from the base [m]."""
_FROM_REST, _FEW = 0.03, 200
"""So far from the arm at rest is what is put down [m], by so many of its points."""
_LEANING = 3
"""Over so many places."""
_HALF = 0.12
"""Around a place, how high things lie there already counts [m]."""
_TILTS = ((0.0, 0.0), (0.35, 0.0), (-0.35, 0.0), (0.0, 0.35), (0.0, -0.35))
"""Where it can't be held level over any of them, about x and y of base [rad]."""
_THICKEST = 0.1
"""What is not seen to be thicker than a hand spans [m]."""
_ENOUGH = 12
"""Postures to plan to; any of them may end the motion."""
_AT_ONCE = 8
"""Postures looked at together; often the first few will do."""
_LOWERED = 0.05
"""By so much the hand should be able to go down from there [m] ..."""
_PARTLY = 0.6
"""... or by this share of it, where there is no better place."""


def object_in_hand(context: Context, T_base_hand: SE3, width: float) -> FloatArray:
    """Surface of the chosen object in the frame of a hand at a pose [m], shape (n, 3).

    Of its underside nothing was seen; see `with_underside`.
    """
    seen, label = context.cycle.seen, context.cycle.label
    assert seen is not None
    assert label is not None
    points = seen.cloud.points[seen.segmentation.points_of(label)]
    points = points[voxel_downsample(points, 0.01)]
    middle = float(np.sort(seen.segmentation.segment(label).extents)[1])
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


def drop_postures(
    context: Context,
    limb: LimbState,
    points_hand: FloatArray,
    q: FloatArray,
    is_free: Callable[[FloatArray], BoolArray],
    enough: int = _ENOUGH,
) -> FloatArray:
    """Find postures from which what is held can be lowered, nearest first, (g, d).

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
    partly: list[FloatArray] = []
    places, rest = _places(context, limb), _at_rest(context, limb)
    # As it will be remembered where it lies, and is planned with: the corners of a box
    # may be lower than all that was seen.
    body = lying(SE3.identity(), points_hand) if len(points_hand) else points_hand
    tries = [(points_hand, _TILTS[0]), *((body, tilt) for tilt in _TILTS)]
    for n, (points, tilt) in enumerate(tries):
        for place in places[: _LEANING if n > 1 else None]:
            goals = _poses(context, points, limb.pose(q), place, tilt)
            goals = goals[~_is_met(rest, body, goals)]
            if not len(goals.p):
                continue
            solved = _solved(context, limb, goals, q)
            rows = [pair for pair in solved if not limits.violation(pair[0])]
            for row, goal in _free(rows, is_free):
                down = CartesianLeg.along(goal, (0.0, 0.0, -_LOWERED)).goal
                share = legs.plan(row, down).share
                if share >= _PARTLY:
                    (found if share > 1.0 - 1e-6 else partly).append(row)
                if len(found) >= enough:
                    return np.array(found)
        if found or partly:
            break
    return np.array(found or partly[:enough]).reshape(-1, len(q))


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
    if _is_met(_at_rest(context, limb), points_hand, SE3(T_base_hand.matrix[None]))[0]:
        return False
    across, tree = T_base_hand.apply(points_hand)[:, :2], context.model.tree
    for link, solid in context.model.links_solids():
        if all(joint.kind == "fixed" for joint in tree.joints_above(link)):
            low, high = solid.bounds.lower[:2], solid.bounds.upper[:2]
            if ((across > low - _BESIDE) & (across < high + _BESIDE)).all(axis=1).any():
                return False
    return True


def _at_rest(context: Context, limb: LimbState) -> FloatArray:
    """Balls around the robot with its arm at rest, base frame [m], shape (b, 4)."""
    posture = context.model.posture(limb.name, context.settings.rest or limb.rest_of)
    return limb.planner.balls_at(limb.reach.chain.vector(posture), _FROM_REST)


def _is_met(balls: FloatArray, points_hand: FloatArray, Ts_base_hand: SE3) -> BoolArray:
    """Which poses (n,) put down the points where balls are, or above, shape (n,)."""
    points = points_hand[:: max(1, len(points_hand) // _FEW)]
    where = Ts_base_hand.R @ points.T + Ts_base_hand.p[..., None]
    met = np.zeros(len(Ts_base_hand.p), dtype=bool)
    for x, y, z, radius in balls.tolist():
        away = np.linalg.norm(where - np.array([x, y, z])[:, None], axis=1)
        met |= (away < radius).any(axis=1)
    return met


def _places(context: Context, limb: LimbState) -> list[FloatArray]:
    """Places around the drop-off of an arm, the emptiest first, each (2,)."""
    drop_off = np.array(context.settings.drop_off[limb.name])
    side = float(np.sign(drop_off[1])) or 1.0
    shifts = np.array(_PLACES) * (1.0, side)
    places = [drop_off + shift for shift in shifts]
    heights = [_height_at(context, place, np.full(2, _HALF)) for place in places]
    return [places[i] for i in np.argsort(np.round(heights, 1), kind="stable")]


def _solved(
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
    context: Context,
    points_hand: FloatArray,
    T: SE3,
    place: FloatArray,
    tilt: tuple[float, float],
) -> SE3:
    """Poses of the palm that hold the object over a place, one for each yaw."""
    points = T.rotate(points_hand)
    if not len(points):
        points = np.array([[0.0, 0.0, -0.15]])
    leaning = so3.from_rpy(np.array([*tilt, 0.0]))
    poses = []
    for yaw in np.linspace(0.0, 2.0 * np.pi, _YAWS, endpoint=False):
        R = leaning @ so3.from_rpy(np.array([0.0, 0.0, yaw]))
        turned = points @ R.T
        low, high = turned.min(axis=0), turned.max(axis=0)
        middle = 0.5 * (low + high)[:2]
        top = _height_at(context, place, 0.5 * (high - low)[:2])
        z = top + context.settings.drop_height - low[2]
        poses.append(SE3.from_parts(R @ T.R, [*(place - middle), z]).matrix)
    return SE3(np.array(poses))


def _height_at(context: Context, place: FloatArray, half: FloatArray) -> float:
    """Height of what was put down where an object is to go [m]."""
    if not context.put_down:
        return 0.0
    points = np.concatenate(context.put_down)
    inside = (np.abs(points[:, :2] - place) < half + 0.03).all(axis=1)
    return float(points[inside, 2].max(initial=0.0))
