"""What objects weigh, what they carry, and in which order nothing falls."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray

__all__ = ["carried_loads", "removal_sequence", "support_shares"]

_CERTAIN = 0.7
"""Confidence from which on a relation counts in the lower bound of a load."""
_POSSIBLE = 0.2
"""Confidence from which on a relation counts in the upper bound of a load."""


def support_shares(
    relations: IntArray,
    confidence: FloatArray,
    places: FloatArray,
    middles: FloatArray,
    reach: FloatArray,
) -> FloatArray:
    """Bounds on the share of an object's weight that each of its supports takes.

    One support takes all. Two take what the lever rule gives them, with the centre of
    mass known to ``reach``. Of three and more each may take anything; so may two of
    which one is doubtful, or where a third may be hidden.

    Parameters
    ----------
    relations
        (above, below) labels, shape (r, 2).
    confidence
        In [0, 1], shape (r,).
    places
        Middle of each contact [m], shape (r, 3).
    middles, reach
        Estimated centre of mass of each label and how far it may be off [m], shapes
        (s + 1, 3) and (s + 1,).

    Returns
    -------
    FloatArray
        Lower and upper share, shape (r, 2).
    """
    shares = np.tile([0.0, 1.0], (len(relations), 1))
    shares[confidence < _POSSIBLE] = 0.0
    for label in np.unique(relations[:, 0]):
        own = np.flatnonzero((relations[:, 0] == label) & (confidence >= _POSSIBLE))
        if (confidence[own] < _CERTAIN).any():
            continue
        if len(own) == 1:
            shares[own] = 1.0
        elif len(own) == 2:
            first, second = places[own, :2]
            span = second - first
            length = max(float(np.linalg.norm(span)), 1e-3)
            along = (middles[label, :2] - first) @ span / length**2
            slack = reach[label] / length
            part = np.clip([along - slack, along + slack], 0.0, 1.0)
            shares[own[1]] = part
            shares[own[0]] = 1.0 - part[::-1]
    return shares


def carried_loads(
    relations: IntArray,
    shares: FloatArray,
    weights: FloatArray,
    sequence: Sequence[int] | IntArray,
) -> FloatArray:
    """Weight that rests on each object, passed down from the top.

    Each of several supports may carry all, but none more than all that is above it.

    Parameters
    ----------
    relations, shares
        (above, below) labels and the bounds on the part of the load that goes this way,
        both of shape (r, 2). Label 0 is the ground.
    weights
        Bounds on the weight of each object [N], shape (s, 2); row k is label k + 1.
    sequence
        Labels in an order of removal. A relation against it (below removed before
        above) closes a ring of mutual support and passes nothing on.

    Returns
    -------
    FloatArray
        Bounds on the load [N], shape (s + 1, 2); row 0 is the ground.
    """
    loads = np.zeros((len(weights) + 1, 2))
    own_weight = np.vstack([np.zeros(2), weights])
    comes_from = np.eye(len(weights) + 1, dtype=np.bool_)
    turn = np.full(len(weights) + 1, len(weights))
    turn[np.asarray(sequence, dtype=np.int64)] = np.arange(len(weights))
    for label in sequence:
        own = np.flatnonzero(relations[:, 0] == label)
        own = own[turn[relations[own, 1]] > turn[label]]
        above = comes_from[label] @ own_weight - own_weight[label]
        loads[label] = np.minimum(loads[label], above)
        passed = own_weight[label] + loads[label]
        np.add.at(loads, relations[own, 1], shares[own] * passed)
        comes_from[relations[own[shares[own, 1] > 0.0], 1]] |= comes_from[label]
    loads[0] = np.minimum(loads[0], comes_from[0] @ own_weight)
    return loads


def removal_sequence(
    relations: IntArray, confidence: FloatArray, encumbrance: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Take what is least likely to carry something, again and again.

    Where relations have no ring, this is a topological order; in a ring the least
    certain relation gives way.

    Parameters
    ----------
    relations
        (above, below) labels, shape (r, 2).
    confidence
        In [0, 1], shape (r,).
    encumbrance
        What settles ties: the smaller is taken first, shape (n,).

    Returns
    -------
    sequence, confidence
        Labels, and for each the probability that nothing bears on it at its turn,
        shapes (n,).
    """
    n = len(encumbrance)
    log_free = np.zeros(n + 1)
    cost = -np.log1p(-np.minimum(confidence, 1 - 1e-9))
    np.add.at(log_free, relations[:, 1], cost)
    left: BoolArray = np.ones(n + 1, dtype=np.bool_)
    left[0] = False
    sequence, certain = np.empty(n, dtype=np.int64), np.empty(n)
    for turn in range(n):
        waiting = np.flatnonzero(left)
        ranked = np.lexsort((encumbrance[waiting - 1], log_free[waiting].round(9)))
        label = waiting[ranked[0]]
        sequence[turn], certain[turn] = label, np.exp(-max(log_free[label], 0.0))
        left[label] = False
        gone = relations[:, 0] == label
        np.add.at(log_free, relations[gone, 1], -cost[gone])
    return sequence, certain
