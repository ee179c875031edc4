"""Where what was seen of an object meets something else: it may go on there."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from debrisgrasp._arrays import BoolArray, FloatArray

from .occlusion import is_beside_nearer
from .scene import GraspScene

__all__ = ["is_behind", "missing"]

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
    points, is_target = scene.cloud.points, scene.is_target
    return is_beside_nearer(points[chosen], points[~is_target], scene.cloud.viewpoint)


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
