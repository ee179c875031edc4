"""Whether the border between two touching patches is convex.

Stein et al., "Object Partitioning using Local Convexity", CVPR 2014. All functions
take the two centres x (..., 3) [m] and unit normals n (..., 3) of each pair of patches.
Patches without a normal (NaN) are never convex to anything.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray

__all__ = [
    "extended_convexity",
    "is_convex",
    "is_singular",
    "is_step",
    "normal_angle",
]


def normal_angle(n_1: FloatArray, n_2: FloatArray) -> FloatArray:
    """Angle between the normals of each pair [rad], shape (...)."""
    cross = np.linalg.norm(np.cross(n_1, n_2), axis=-1)
    angle: FloatArray = np.arctan2(cross, np.einsum("...i,...i->...", n_1, n_2))
    return angle


def is_convex(
    x_1: FloatArray,
    x_2: FloatArray,
    n_1: FloatArray,
    n_2: FloatArray,
    concavity_tolerance: float,
) -> BoolArray:
    """Convexity criterion CC: the normals open away from each other, or hardly differ.

    With d = x_1 - x_2 a border is convex if (n_1 - n_2) . d >= 0; a concave one passes
    while the normals differ by less than ``concavity_tolerance`` [rad].
    """
    opens = np.einsum("...i,...i->...", n_1 - n_2, x_1 - x_2) >= 0
    passes: BoolArray = opens | (normal_angle(n_1, n_2) < concavity_tolerance)
    return passes


def is_singular(
    x_1: FloatArray, x_2: FloatArray, n_1: FloatArray, n_2: FloatArray
) -> BoolArray:
    """Sanity criterion SC: patches that meet at a corner only, along their crease.

    The crease runs along s = n_1 x n_2. A pair is singular if the angle between s and d
    is below a limit that grows with the angle theta between the normals, 60 degrees /
    (1 + exp(-0.25 (theta - 25))), theta in degrees.
    """
    d = x_1 - x_2
    s = np.cross(n_1, n_2)
    along = np.abs(np.einsum("...i,...i->...", s, d))
    across = np.linalg.norm(np.cross(s, d), axis=-1)
    # Equal normals have no crease to lie along.
    phi = np.where(s.any(axis=-1), np.degrees(np.arctan2(across, along)), 90.0)
    theta = np.degrees(normal_angle(n_1, n_2))
    limit = 60.0 / (1.0 + np.exp(-0.25 * (theta - 25.0)))
    singular: BoolArray = phi < limit
    return singular


def is_step(
    x_1: FloatArray,
    x_2: FloatArray,
    n_1: FloatArray,
    n_2: FloatArray,
    *,
    seed_resolution: float,
    allowance: float,
) -> BoolArray:
    """Smoothness criterion: patches that are offset like the two levels of a stair.

    Bent surfaces may be offset by ``seed_resolution`` [m] times |n_1 x n_2|; beyond
    that the smaller offset along a normal may reach ``allowance`` [m], a length that
    belongs to the noise of the sensor.
    """
    d = x_1 - x_2
    offset = np.minimum(
        np.abs(np.einsum("...i,...i->...", d, n_1)),
        np.abs(np.einsum("...i,...i->...", d, n_2)),
    )
    bend = np.linalg.norm(np.cross(n_1, n_2), axis=-1)
    step: BoolArray = offset > seed_resolution * bend + allowance
    return step


def extended_convexity(
    edges: IntArray, convex: BoolArray, n_patches: int, n_common: int
) -> BoolArray:
    """Convex edges whose ends share ``n_common`` neighbours convex to both.

    Parameters
    ----------
    edges
        Pairs of patches, each once, shape (e, 2).
    convex
        Which of them are convex, shape (e,).
    """
    a, b = edges[convex].T
    ones = np.ones(2 * len(a), dtype=np.int32)
    both_ways = (np.concatenate([a, b]), np.concatenate([b, a]))
    graph = coo_array((ones, both_ways), shape=(n_patches, n_patches)).tocsr()
    valid = convex.copy()
    valid[convex] = graph[a].multiply(graph[b]).sum(axis=1) >= n_common
    return valid
