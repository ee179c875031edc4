"""Which of many good grasps to offer: distinct ones, spread over the object."""

from __future__ import annotations

from collections import Counter

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray
from debrisgrasp.prototypes import GripperModel

from .config import PlannerConfig

__all__ = ["choose", "is_half_turn_symmetric", "turns"]

_SAME_PLACE = 0.003
"""Pads this near to each other after a half turn are in the same place [m]."""
_HALF_TURN = np.array([-1.0, -1.0, 1.0])
"""Signs of the axes of a frame after a half turn about its z axis."""


def is_half_turn_symmetric(gripper: GripperModel, preshape: str) -> bool:
    """Whether a half turn about the palm's axis leaves the pads where they were."""
    opening = float(gripper.preshape(preshape).openings[0])
    pads = gripper.pad_positions(preshape, opening)
    turned = pads * _HALF_TURN
    gap = np.linalg.norm(pads[:, None] - turned[None], axis=-1)
    return bool((gap.min(axis=1) < _SAME_PLACE).all())


def choose(
    Ts: FloatArray,
    places: FloatArray,
    grippers: list[str],
    prototypes: list[str],
    is_symmetric: BoolArray,
    value: FloatArray,
    config: PlannerConfig,
) -> IntArray:
    """Choose the grasps to offer.

    Two poses of a symmetric hand that are half a turn apart are the same grasp, and the
    better one stays. The best grasp of each region of the object is chosen before the
    second best of any.

    Parameters
    ----------
    Ts
        Palm poses, shape (k, 4, 4).
    places
        Middle of each grip [m], shape (k, 3).
    grippers, prototypes
        Names, k of each.
    is_symmetric
        Whether the hand may turn by half about its axis, shape (k,).
    value
        Larger is better, shape (k,).

    Returns
    -------
    IntArray
        At most ``config.n_best`` indices, the best first.
    """
    if not len(Ts):
        return np.zeros(0, dtype=np.int64)
    order = _apart(Ts, grippers, is_symmetric, value, config)
    order = _capped(order, grippers, config.n_per_hand)
    order = _capped(order, prototypes, config.n_per_prototype)
    turn = turns(places[order], config.region_size)
    chosen = order[np.argsort(turn, kind="stable")[: config.n_best]]
    best: IntArray = chosen[np.argsort(-value[chosen], kind="stable")]
    return best


def _apart(
    Ts: FloatArray,
    grippers: list[str],
    is_symmetric: BoolArray,
    value: FloatArray,
    config: PlannerConfig,
) -> IntArray:
    """Rows that are no half turn of a better one, best first."""
    hand = np.unique(grippers, return_inverse=True)[1].ravel()
    p, R = Ts[:, :3, 3], Ts[:, :3, :3]
    kept: list[int] = []
    for i in np.argsort(-value, kind="stable").tolist():
        better = np.array(kept, dtype=np.int64)
        trace = np.einsum("nij,ij->n", R[better], R[i] * _HALF_TURN)
        is_same = (trace - 1.0) / 2.0 > np.cos(config.mode_angle)
        is_same &= np.linalg.norm(p[better] - p[i], axis=1) < config.mode_distance
        is_same &= (hand[better] == hand[i]) & is_symmetric[i]
        if not is_same.any():
            kept.append(i)
    return np.array(kept, dtype=np.int64)


def _capped(order: IntArray, names: list[str], most: int) -> IntArray:
    """First ``most`` of each name, in the same order."""
    taken: Counter[str] = Counter()
    kept = []
    for i in order.tolist():
        taken[names[i]] += 1
        if taken[names[i]] <= most:
            kept.append(i)
    return np.array(kept, dtype=np.int64)


def turns(places: FloatArray, size: float) -> IntArray:
    """How many better places (k, 3), best first, are in the region of each, (k,)."""
    middles: list[FloatArray] = []
    counts: list[int] = []
    turn = np.zeros(len(places), dtype=np.int64)
    for row, place in enumerate(places):
        gaps = [float(np.linalg.norm(place - middle)) for middle in middles]
        near = int(np.argmin(gaps)) if gaps else -1
        if near < 0 or gaps[near] > size:
            middles.append(place)
            counts.append(0)
            near = len(counts) - 1
        turn[row] = counts[near]
        counts[near] += 1
    return turn
