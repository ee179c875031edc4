"""Which points lie where something nearer to the camera may hide what follows."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from debrisgrasp._arrays import BoolArray, FloatArray

__all__ = ["is_beside_nearer"]

_BESIDE = 0.015
"""What is seen in a direction that differs by less may hide the rest of it [rad]."""
_NEARER = 0.03
"""It does if it is so much nearer to the camera [m]."""
_LOOKED_AT = 8
"""So many points of others nearest to that direction."""


def is_beside_nearer(
    points: FloatArray, others: FloatArray, viewpoint: FloatArray
) -> BoolArray:
    """Which points are seen beside others that are nearer: their surface may go on.

    Parameters
    ----------
    points, others
        Positions [m], shapes (t, 3) and (n, 3).
    viewpoint
        Where the camera is, shape (3,).

    Returns
    -------
    BoolArray
        Shape (t,).
    """
    if not len(others) or not len(points):
        return np.zeros(len(points), dtype=bool)
    rays, away = _rays(others - viewpoint)
    directions, distance = _rays(points - viewpoint)
    # Only what is nearer than the farthest point, and in its field of view, can hide.
    may_hide = away < distance.max() - _NEARER
    for ray, direction in zip(rays.T, directions.T, strict=True):
        may_hide &= ray >= direction.min() - _BESIDE
        may_hide &= ray <= direction.max() + _BESIDE
    rays, away = rays[may_hide], away[may_hide]
    _, row = cKDTree(rays).query(directions, k=_LOOKED_AT, distance_upper_bound=_BESIDE)
    # Where there are fewer neighbours, the row is one past the last.
    nearest = np.append(away, np.inf)[row]
    found: BoolArray = np.any(nearest < distance[:, None] - _NEARER, axis=1)
    return found


def _rays(offsets: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Directions (n, 3) and lengths (n,) of offsets."""
    distance = np.sqrt(np.einsum("ij,ij->i", offsets, offsets))
    return offsets / np.maximum(distance, 1e-9)[:, None], distance
