"""Where what was seen of an object meets something else: it may go on there."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from debrisgrasp._arrays import BoolArray, FloatArray

from .scene import GraspScene

__all__ = ["is_behind", "missing"]

_BESIDE = 0.015
"""What is seen in a direction that differs by less may hide the rest of it [rad]."""
_NEARER = 0.03
"""It does if it is so much nearer to the camera [m]."""
_LOOKED_AT = 8
"""So many points of others nearest to that direction."""
_TOUCHING = 0.02
"""Points of others that are nearer than this touch it; lower over the ground, they
belong to the ground [m]."""
_OUTLIERS = 0.02
"""Share of the points at each end of an axis that the size leaves out."""
_WHOLE = 0.3
"""Debris is mostly larger than this, measured across [m]."""
_BORDERED = 0.15
"""If so much of what was seen is beside something else, it is taken for a part."""


def is_behind(scene: GraspScene, chosen: BoolArray) -> BoolArray:
    """Which of some points lie where something nearer may hide what follows.

    Parameters
    ----------
    chosen
        Which points of the scene are asked about, shape (n,); t of them are.

    Returns
    -------
    BoolArray
        Shape (t,).
    """
    rays = scene.cloud.points - scene.cloud.viewpoint
    distance = np.linalg.norm(rays, axis=1)
    rays /= np.maximum(distance, 1e-9)[:, None]
    others = np.flatnonzero(~scene.is_target)
    if not len(others):
        return np.zeros(np.count_nonzero(chosen), dtype=bool)
    _, row = cKDTree(rays[others]).query(
        rays[chosen], k=_LOOKED_AT, distance_upper_bound=_BESIDE
    )
    # Where there are fewer neighbours, the row is one past the last.
    away = np.append(distance[others], np.inf)[row]
    found: BoolArray = (away < distance[chosen, None] - _NEARER).any(axis=1)
    return found


def missing(scene: GraspScene) -> float:
    """How much smaller than debris mostly is what was seen of the object is [m].

    Zero for what stands alone: it is that small. But a small piece that vanishes
    behind other things, or into them, is part of something larger: of a plank under
    others, of a pallet whose slats were told apart. It weighs more than it seems, and
    its middle is elsewhere.
    """
    points = scene.cloud.points[scene.is_target]
    short = _WHOLE - _size(points)
    if short <= 0.0 or (points < scene.region.lower + _TOUCHING / 2).any():
        return 0.0
    if (points > scene.region.upper - _TOUCHING / 2).any():
        return 0.0
    others = scene.cloud.points[~scene.is_target]
    plane = scene.ground_plane
    if plane is not None:
        others = others[others @ plane[:3] + plane[3] > _TOUCHING]
    is_bordered = is_behind(scene, scene.is_target)
    if len(others):
        gap, _ = cKDTree(others).query(points, distance_upper_bound=_TOUCHING)
        is_bordered |= np.isfinite(gap)
    return float(short * min(1.0, is_bordered.mean() / _BORDERED))


def _size(points: FloatArray) -> float:
    """Diagonal of the box along the main axes of points (n, 3) [m]."""
    offsets = points - points.mean(axis=0)
    along = offsets @ np.linalg.eigh(offsets.T @ offsets)[1]
    low, high = np.quantile(along, [_OUTLIERS, 1.0 - _OUTLIERS], axis=0)
    return float(np.linalg.norm(high - low))
