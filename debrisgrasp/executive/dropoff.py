"""Postures that hold an object low over where it is to be put down."""

from __future__ import annotations

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.control import CartesianLeg, LegPlanner
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.kinematics import solve, solve_distinct

from .context import Context, Held, LimbState

__all__ = ["drop_postures"]

_YAWS = 16
"""Attitudes tried: the object as it was lifted, turned about the vertical."""
_PLACES = ((0.0, 0.0), (-0.2, 0.0), (0.2, 0.0), (-0.4, 0.0))
"""Places around a drop-off, tried in turn as it fills [m]."""
_ENOUGH = 12
"""Postures to plan to; any of them may end the motion."""
_LOWERED = 0.05
"""By so much the hand should be able to go down from there [m] ..."""
_PARTLY = 0.6
"""... or by this share of it, where there is no better place."""


def drop_postures(
    context: Context, limb: LimbState, held: Held, q: FloatArray
) -> FloatArray:
    """Find postures from which what is held can be lowered, nearest first, (g, d)."""
    chain, T = limb.reach.chain, limb.pose(q)
    reach_map = limb.reach.reach_map
    limits = limb.limits.planner
    legs = LegPlanner(chain, limb.limits.controller)
    found: list[FloatArray] = []
    partly: list[FloatArray] = []
    for shift in _PLACES:
        place = np.add(context.settings.drop_off[held.arm], shift)
        goals = _poses(context, held, T, place)
        near = solve(chain, goals, q_seed=q, reach_map=reach_map, rng=context.rng)
        more = solve_distinct(chain, goals, 2, reach_map=reach_map, rng=context.rng)
        rows = np.concatenate([near.q[:, None], more.q], axis=1)
        solved = np.concatenate([near.is_solved[:, None], more.is_solved], axis=1)
        solved &= near.is_solved[:, None]
        which, column = np.nonzero(solved)
        postures = chain.unwound(rows[which, column], q)
        for i in np.argsort(np.abs(postures - q).max(axis=1), kind="stable"):
            row = postures[i]
            down = CartesianLeg.along(goals[which[i]], (0.0, 0.0, -_LOWERED)).goal
            if limits.violation(row):
                continue
            share = legs.plan(row, down).share
            if share >= _PARTLY:
                (found if share > 1.0 - 1e-6 else partly).append(row)
            if len(found) >= _ENOUGH:
                return np.array(found)
    return np.array(found or partly[:_ENOUGH]).reshape(-1, len(q))


def _poses(context: Context, held: Held, T: SE3, place: FloatArray) -> SE3:
    """Poses of the palm that hold the object over a place, one for each yaw."""
    points = T.rotate(held.points_hand)
    if not len(points):
        points = np.array([[0.0, 0.0, -0.15]])
    poses = []
    for yaw in np.linspace(0.0, 2.0 * np.pi, _YAWS, endpoint=False):
        R = so3.from_rpy(np.array([0.0, 0.0, yaw]))
        turned = points @ R.T
        low, high = turned.min(axis=0), turned.max(axis=0)
        middle = 0.5 * (low + high)[:2]
        top = _height_at(context, place, 0.5 * (high - low)[:2])
        z = top + context.settings.drop_height - low[2]
        poses.append(SE3.from_parts(R @ T.R, [*(place - middle), z]).matrix)
    return SE3(np.array(poses))


def _height_at(context: Context, place: FloatArray, half: FloatArray) -> float:
    """Height of what was put down where an object is to go [m]."""
    if not context.dropped:
        return 0.0
    points = np.concatenate(context.dropped)
    inside = (np.abs(points[:, :2] - place) < half + 0.03).all(axis=1)
    return float(points[inside, 2].max(initial=0.0))
