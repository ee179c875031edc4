"""From thousands of states near a few poses to a handful of distinct grasps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray

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
    worse, first = _worse_ones(Ts[order], group[order], distance, angle)
    kept: list[int] = []
    is_open = np.ones(len(order), dtype=bool)
    for i in range(len(order)):
        if len(kept) == limit:
            break
        if is_open[i]:
            kept.append(i)
            is_open[worse[first[i] : first[i + 1]]] = False
    return order[np.array(kept, dtype=np.int64)]


def _worse_ones(
    Ts: FloatArray, group: IntArray | NDArray[np.str_], distance: float, angle: float
) -> tuple[IntArray, IntArray]:
    """Find later poses of the same group near each of (n, 4, 4), best first.

    Returns
    -------
    worse, first
        Those of pose i are ``worse[first[i] : first[i + 1]]``.
    """
    pairs = cKDTree(Ts[:, :3, 3]).query_pairs(distance, output_type="ndarray")
    a, b = pairs.T
    is_same = group[a] == group[b]
    a, b = a[is_same], b[is_same]
    R = Ts[:, :3, :3].reshape(-1, 9)
    trace = np.einsum("ij,ij->i", R[a], R[b])
    is_near = trace > 1.0 + 2.0 * np.cos(angle)
    a, b = a[is_near], b[is_near]
    by_better = np.argsort(a, kind="stable")
    first = np.searchsorted(a[by_better], np.arange(len(Ts) + 1))
    return b[by_better], first


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
    is_near = _near(Ts, others, distance, angle)
    found: IntArray = (is_near & (group[:, None] == others_group)).sum(axis=1)
    return found


def _near(
    Ts: FloatArray, others: FloatArray, distance: float, angle: float
) -> BoolArray:
    """Which poses (k, 4, 4) lie near which others (n, 4, 4), shape (k, n)."""
    a, b = Ts[:, :3, 3], others[:, :3, 3]
    gap2 = np.square(a).sum(axis=1)[:, None] + np.square(b).sum(axis=1) - 2.0 * a @ b.T
    trace = Ts[:, :3, :3].reshape(-1, 9) @ others[:, :3, :3].reshape(-1, 9).T
    return np.asarray((gap2 < distance**2) & (trace > 1.0 + 2.0 * np.cos(angle)))
