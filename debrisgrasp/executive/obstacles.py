"""What an arm must keep out of, by what was seen and by what was put down since."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.spatial import cKDTree

from debrisgrasp._arrays import BoolArray, FloatArray
from debrisgrasp.geometry import SE3, PointCloud, lattice
from debrisgrasp.kinematics.urdf import UrdfShape
from debrisgrasp.motion import MotionPlanner, MotionSpace, UnknownSpace
from debrisgrasp.pipeline.self_filter import are_near

from .context import Context
from .limb_state import LimbState

__all__ = ["BARE", "box_around", "lying", "room_for", "space_of"]

_UNSURE = 0.015
"""How much farther than its points what was let go may reach [m]."""
_GRAIN = 0.025
"""Spacing of the points that stand for it [m]."""
_STANDS_FREE = 0.02
"""Where an arm stands there is nothing, whatever noise and boxes say, nor so near [m]:
else no way out would begin."""
_THINNEST = 0.01
"""No box is thinner [m]."""
_TURNS = np.radians(np.linspace(-45.0, 45.0, 31))
_ABOUT = (0, 1, 2, 0, 1, 2)
"""Axes about which it is turned, one after another, by the best of some angles."""
BARE = np.array([0.0, 0.0, 1.0, 0.0])
"""Plane of the ground where none was seen."""


def space_of(
    context: Context,
    without: BoolArray | None = None,
    *,
    unknown: UnknownSpace,
    stands: tuple[MotionPlanner, FloatArray] | None = None,
    with_guesses: bool = True,
) -> MotionSpace:
    """Obstacles by the last look, and what was put down, or touched, since.

    Parameters
    ----------
    without
        Which points of that look are no obstacle, because the hand holds them.
    stands
        Of an arm, and postures (d,) or (k, d) in which it stands, or stood on its way:
        points so near to it there are left out.
    with_guesses
        Whether what was put down is also where nobody has seen it.
    """
    seen = context.cycle.seen or context.last_seen
    # Where the base has moved, only that is known that was put down.
    points = np.zeros((0, 3)) if seen is None else seen.cloud.points
    if context.cycle.around is not None:
        points = context.cycle.around
    elif seen is not None and without is not None:
        points = points[~without]
    memory = context.memory
    guesses = memory.guesses if with_guesses else []
    points = np.concatenate([points, *memory.settled, *memory.felt, *guesses])
    if stands is not None:
        planner, tree = stands[0], cKDTree(points)
        balls = [planner.balls_at(q, _STANDS_FREE) for q in np.atleast_2d(stands[1])]
        places = np.concatenate(balls)
        rows = tree.query_ball_point(places[:, :3], places[:, 3])
        points = np.delete(points, np.unique(np.concatenate(rows)).astype(int), axis=0)
        links = context.model.links_solids(context.joint_values())
        robot = [(solid, _STANDS_FREE) for _, solid in links]  # idle arms, too
        points = points[~are_near(points, robot)]
    normals = np.full(points.shape, np.nan)
    viewpoint = np.zeros(3) if seen is None else seen.cloud.viewpoint
    everything = PointCloud(points, normals, viewpoint)
    plane = None if seen is None else seen.ground_plane
    return MotionSpace.build(
        everything,
        None if seen is None else seen.sight,
        BARE if plane is None else plane,
        unknown=unknown,
    )


def room_for(
    context: Context,
    limbs: Iterable[LimbState],
    without: BoolArray | None = None,
    *,
    unknown: UnknownSpace,
) -> MotionSpace:
    """Obstacles of arms, none where they stand, or no motion would begin.

    Rubble that leans on an arm, or slid there, would else hold it for ever.
    """
    space = space_of(context, without, unknown=unknown)
    for limb in limbs:
        q = context.posture(limb)
        if not limb.planner.stands_free(q, space):
            stands = limb.planner, q
            return space_of(context, without, unknown=unknown, stands=stands)
    return space


def lying(T_base_hand: SE3, points_hand: FloatArray) -> FloatArray:
    """Surface of what a hand leaves where it is, base frame [m], shape (n, 3).

    A box around all of it, for little of it was seen, a bit larger than that.
    """
    box = box_around(points_hand)
    half = 0.5 * np.array(box.size) + _UNSURE
    sides = [np.linspace(-h, h, int(np.ceil(2.0 * h / _GRAIN)) + 1) for h in half]
    grid = lattice(*sides).reshape(-1, 3)
    surface = grid[(np.abs(grid) > half - 1e-6).any(axis=1)]
    return (T_base_hand @ box.T_link_shape).apply(surface)


def box_around(points: FloatArray) -> UrdfShape:
    """Small box around points (n, 3), in their frame.

    That along their principal axes may be much larger, for they say little of something
    that is about as wide as it is high: it is turned until it is small.
    """
    middle = points.mean(axis=0)
    _, _, principal = np.linalg.svd(points - middle, full_matrices=len(points) < 3)
    turned = [_turned(points - middle, axes) for axes in (principal, np.eye(3))]
    axes = min(turned, key=lambda axes: _volume(axes @ (points - middle).T))
    if np.linalg.det(axes) < 0.0:
        axes[2] = -axes[2]
    along = (points - middle) @ axes.T
    low, high = along.min(axis=0), along.max(axis=0)
    center = middle + 0.5 * (low + high) @ axes
    size = np.maximum(high - low, _THINNEST)
    return UrdfShape(
        kind="box",
        size=tuple(size.tolist()),
        T_link_shape=SE3.from_parts(axes.T, center),
    )


def _turned(points: FloatArray, axes: FloatArray) -> FloatArray:
    """Axes (3, 3), in rows, turned about each other until the box is small."""
    coordinates = np.ascontiguousarray(points.T)
    for fixed in _ABOUT:
        one, other = (fixed + 1) % 3, (fixed + 2) % 3
        c, s = np.cos(_TURNS), np.sin(_TURNS)
        tried = np.tile(axes, (len(_TURNS), 1, 1))
        tried[:, one] = c[:, None] * axes[one] + s[:, None] * axes[other]
        tried[:, other] = c[:, None] * axes[other] - s[:, None] * axes[one]
        axes = tried[int(_volume(tried @ coordinates).argmin())]
    return axes


def _volume(along: FloatArray) -> FloatArray:
    """Volume of boxes around points (..., 3, n) along their axes [m^3], shape (...).

    NumPy is slow across a short last axis, so the points come last.
    """
    size = np.maximum(np.ptp(along, axis=-1), _THINNEST)
    return np.asarray(size.prod(axis=-1))
