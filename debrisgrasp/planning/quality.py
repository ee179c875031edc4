"""Q-hat = S C (Eq. 4), and nothing where no arm can reach, as one batched callable."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray

from .clearance import HandClearance
from .similarity import ShapeSimilarity

__all__ = ["GraspQuality"]

_FLOOR = 1e-4
"""Quality of a pose that matches nothing; above zero so that a chain can leave it."""


class GraspQuality:
    """log Q-hat of all walkers; S first, the rest only where S leaves a chance.

    The paper searches Q-hat = S C and looks at reachability afterwards. A quick upper
    bound of R costs less than C, so poses that no arm can reach are dropped at once.
    """

    def __init__(
        self,
        similarity: ShapeSimilarity,
        clearance: HandClearance,
        prototype: IntArray,
        may_reach: Callable[[FloatArray, IntArray], BoolArray],
    ) -> None:
        self._similarity, self._clearance = similarity, clearance
        self._prototype, self._may_reach = prototype, may_reach

    def __call__(self, Ts_base_hand: FloatArray, needed: FloatArray) -> FloatArray:
        """See `annealing.LogQuality`; one pose for each walker, shape (k, 4, 4)."""
        similarity, _ = self._similarity(Ts_base_hand, self._prototype)
        value = np.log(np.maximum(similarity, _FLOOR).astype(np.float64))
        # C is at most 1, so a candidate whose S alone falls short is lost already.
        worth = np.flatnonzero((value > needed) & (similarity > _FLOOR))
        if len(worth):
            is_near = self._may_reach(Ts_base_hand[worth], self._prototype[worth])
            value[worth[~is_near]] = np.log(_FLOOR)
            worth = worth[is_near]
        if len(worth):
            least_clearance = np.exp(needed[worth] - value[worth])
            clearance = self._clearance(
                Ts_base_hand[worth], self._prototype[worth], least_clearance
            )
            value[worth] = np.log(np.maximum(similarity[worth] * clearance, _FLOOR))
        return value
