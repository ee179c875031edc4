"""Rigid transforms between matched points: closed form, and by consensus."""

from __future__ import annotations

from math import comb

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray
from debrisgrasp.geometry import SE3

__all__ = ["NEAR", "consensus", "fit_rigid", "triples"]

_MOST_TRIPLES = 400
"""Enough to hit an all-good triple although half of the points are wrong."""
NEAR = 25.0
"""Squared distance, in units of its variance, up to which a point supports a
hypothesis. Wider than a test would be: three points predict a fourth badly."""


def fit_rigid(points_a: FloatArray, points_b: FloatArray) -> SE3:
    """Least-squares ``T_a_b`` with ``points_a = T_a_b points_b`` (Kabsch, Umeyama).

    Parameters
    ----------
    points_a, points_b
        Matched points [m], shape (..., n, 3); n is 3 or more, not on one line.

    Returns
    -------
    SE3
        Shape (...). Never mirrored: the best proper rotation, however bad it is.
    """
    w = 1.0 / points_a.shape[-2]
    middle_a, middle_b = (points_a * w).sum(axis=-2), (points_b * w).sum(axis=-2)
    from_a, from_b = (
        points_a - middle_a[..., None, :],
        points_b - middle_b[..., None, :],
    )
    u, _, vt = np.linalg.svd(np.swapaxes(from_a * w, -1, -2) @ from_b)
    u = u.copy()
    u[..., :, 2] *= np.sign(np.linalg.det(u) * np.linalg.det(vt))[..., None]
    R = u @ vt
    return SE3.from_parts(R, middle_a - (R @ middle_b[..., None])[..., 0])


def triples(n: int) -> IntArray:
    """All sets of three of n indices, or an even share of them if they are many."""
    total = comb(n, 3)
    if total <= _MOST_TRIPLES:
        ranks = np.arange(total)
    else:
        # Multiples of the golden ratio fall evenly over the list of all sets.
        shares = (np.arange(_MOST_TRIPLES) * 0.6180339887498949) % 1.0
        ranks = np.unique((shares * total).astype(np.int64))
    # Rank of {a > b > c} in the usual order is C(a, 3) + C(b, 2) + C(c, 1).
    numbers = np.arange(n)
    threes = numbers * (numbers - 1) * (numbers - 2) // 6
    twos = numbers * (numbers - 1) // 2
    a = np.searchsorted(threes, ranks, side="right") - 1
    rest = ranks - threes[a]
    b = np.searchsorted(twos, rest, side="right") - 1
    return np.stack([a, b, rest - twos[b]], axis=1)


def consensus(
    points_a: FloatArray, points_b: FloatArray, variances: FloatArray
) -> tuple[BoolArray, float]:
    """Which points agree with the hypothesis that most points agree with.

    Every triple of points proposes a transform. Each point adds its squared distance in
    units of its variance, at most a fixed amount, so that a wrong pick costs the same
    however far off it is.

    Parameters
    ----------
    points_a, points_b
        Matched points [m], shape (n, 3).
    variances
        Of one coordinate of the difference of each pair [m^2], shape (n,).

    Returns
    -------
    agrees, cost
        Shape (n,), at least three of them True; and the sum that was least.
    """
    chosen = triples(len(points_a))
    T_a_b = fit_rigid(points_a[chosen], points_b[chosen])
    gaps = T_a_b[:, None].apply(points_b) - points_a
    squared = (gaps**2).sum(axis=-1) / variances
    costs = np.minimum(squared, NEAR).sum(axis=1)
    best = int(np.argmin(costs))
    agrees = squared[best] < NEAR
    agrees[chosen[best]] = True
    return np.asarray(agrees), float(costs[best])
