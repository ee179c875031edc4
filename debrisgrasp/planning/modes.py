"""From thousands of states near a few poses to a handful of distinct grasps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from debrisgrasp._arrays import FloatArray, IntArray

__all__ = ["count_near", "distinct"]


def distinct(
    Ts: FloatArray,
    group: IntArray | NDArray[np.str_],
    value: FloatArray,
    *,
    distance: float,
    angle: float,
    limit: int,
) -> IntArray:
    """Pick the best poses that are apart from each other.

    Poses of one group, best first, are taken unless a taken one lies within both
    ``distance`` and ``angle``.

    Parameters
    ----------
    Ts
        Poses, shape (n, 4, 4).
    group
        Poses of different groups (hands, say) never count as the same, shape (n,).
    value
        Quality, larger is better, shape (n,).
    distance, angle
        Least separation [m] and [rad].
    limit
        Pick at most this many.

    Returns
    -------
    IntArray
        Indices into the n poses, best first.
    """
    order = np.argsort(-value, kind="stable")
    p, R = Ts[order, :3, 3], Ts[order, :3, :3]
    kept: list[int] = []
    is_open = np.ones(len(order), dtype=bool)
    while len(kept) < limit and is_open.any():
        i = int(np.argmax(is_open))
        kept.append(i)
        trace = np.einsum("nij,ij->n", R, R[i])
        is_near = np.linalg.norm(p - p[i], axis=1) < distance
        is_near &= (trace - 1.0) / 2.0 > np.cos(angle)
        is_near &= group[order] == group[order[i]]
        is_open &= ~is_near
        is_open[i] = False
    return order[np.array(kept, dtype=np.int64)]


def count_near(
    Ts: FloatArray,
    group: IntArray | NDArray[np.str_],
    others: FloatArray,
    others_group: IntArray | NDArray[np.str_],
    *,
    distance: float,
    angle: float,
) -> IntArray:
    """Count for each pose (k, 4, 4) the other poses (n, 4, 4) of its group near it.

    Parameters
    ----------
    group, others_group
        Of each pose, shapes (k,) and (n,).
    distance, angle
        What counts as near [m] and [rad].

    Returns
    -------
    IntArray
        Shape (k,).
    """
    gap = np.linalg.norm(Ts[:, None, :3, 3] - others[None, :, :3, 3], axis=-1)
    rotations = others[:, :3, :3].reshape(-1, 9)
    trace = Ts[:, :3, :3].reshape(-1, 9) @ rotations.T
    is_near = (gap < distance) & ((trace - 1.0) / 2.0 > np.cos(angle))
    found: IntArray = (is_near & (group[:, None] == others_group)).sum(axis=1)
    return found
