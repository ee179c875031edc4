"""Objects that lie flat, wider than any hand: none of their sides can be gripped."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from debrisgrasp._arrays import FloatArray

from .scene import GraspScene

__all__ = ["lies_flat"]

_LOW = 0.04
"""Below what rises no higher over the ground, no finger finds room [m]."""
_OUTLIERS = 0.02
"""Share of the points that may be higher."""
_CELL = 0.02
_CLOSED = 0.8
"""A sheet covers this share of its outline; through less, fingers may pass."""


def lies_flat(scene: GraspScene, widest: float) -> str | None:
    """Say so if an object is a sheet on the ground that no hand reaches across.

    Two pads need two faces that look away from each other: of a sheet these are its
    edges, if a hand opens so far, or its broad faces, if a finger gets under it.

    Parameters
    ----------
    widest
        How far the hands open [m].
    """
    if scene.ground_plane is None:
        return None
    plane, points = scene.ground_plane, scene.cloud.points[scene.is_target]
    if np.quantile(points @ plane[:3] + plane[3], 1.0 - _OUTLIERS) > _LOW:
        return None
    width, share = _outline(points[:, :2])
    if width <= widest or share < _CLOSED:
        return None
    return (
        f"it lies flat on the ground, {100 * width:.0f} cm across where the hands open "
        f"{100 * widest:.0f} cm, and no finger gets under it"
    )


def _outline(points: FloatArray) -> tuple[float, float]:
    """Least width [m] of the outline of points (n, 2), and the share they cover."""
    try:
        hull = ConvexHull(points)
    except QhullError:
        return 0.0, 0.0
    inward = -(points[hull.vertices] @ hull.equations[:, :2].T + hull.equations[:, 2])
    cells = len(np.unique(np.floor(points / _CELL), axis=0))
    return float(inward.max(axis=0).min()), cells * _CELL**2 / float(hull.volume)
