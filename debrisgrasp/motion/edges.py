"""Straight edges between postures, tested many at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray

__all__ = ["EdgeTest", "FreeTest", "sampled_edges"]

FreeTest = Callable[[FloatArray], BoolArray]
"""Says of postures (n, d) which are free, shape (n,)."""

_STRIDE = 6
"""Every so many samples of an edge are tested first."""
_FEW = 400
"""So many samples are tested at once: a second call would cost more than it spares."""


@dataclass(frozen=True, slots=True)
class EdgeTest:
    """Tests edges sample by sample; all samples of all edges in one array."""

    is_free: FreeTest
    step: float
    """Largest change of a joint between two samples [rad or m]."""

    def free_share(self, q_from: FloatArray, q_to: FloatArray) -> FloatArray:
        """How far one gets along edges (k, d) to (k, d), in [0, 1], shape (k,).

        The beginning of an edge is taken to be free.
        """
        owner, share, count = sampled_edges(q_from, q_to, self.step)
        limit = np.ones(len(q_from))
        place = np.round(share * count[owner]).astype(np.intp)
        is_first = (place % _STRIDE == 0) | (place == count[owner])
        if len(share) <= _FEW:
            is_first[:] = True
        for part in (is_first, ~is_first):
            # What lies behind a blocked sample is not reached anyway.
            rows = np.flatnonzero(part & (share < limit[owner] + 1e-9))
            if not len(rows):
                continue
            q = q_from[owner[rows]]
            q = q + share[rows, None] * (q_to[owner[rows]] - q)
            blocked = rows[~self.is_free(q)]
            before = (place[blocked] - 1) / count[owner[blocked]]
            np.minimum.at(limit, owner[blocked], before)
        return limit

    def are_free(self, q_from: FloatArray, q_to: FloatArray) -> BoolArray:
        """Whether edges (k, d) to (k, d) are free, but for where they begin; (k,)."""
        done: BoolArray = self.free_share(q_from, q_to) >= 1.0
        return done


def sampled_edges(
    q_from: FloatArray, q_to: FloatArray, step: float
) -> tuple[IntArray, FloatArray, IntArray]:
    """Sample k edges: the edge and share of each, and the steps of each edge."""
    length = np.abs(q_to - q_from).max(axis=1)
    count = np.maximum(1, np.ceil(length / step - 1e-9)).astype(np.intp)
    owner = np.repeat(np.arange(len(count)), count)
    first = np.cumsum(count) - count
    share = (np.arange(len(owner)) - first[owner] + 1) / count[owner]
    return owner, share, count
