"""Q-hat = S C (Eq. 4), and nothing where no arm can reach, as one batched callable."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray

from .annealing import LogQuality
from .clearance import HandClearance
from .similarity import ShapeSimilarity

__all__ = ["NOTHING", "STIFF", "GraspQuality", "Reach"]

Reach = Callable[[FloatArray, IntArray], FloatArray]
"""Maps poses (k, 4, 4) and prototypes (k,) to 1 where an arm may get there and give way
to pushes, `STIFF` where it may get there, and 0 where none does, (k,)."""

_FLOOR = 1e-4
"""Quality of a pose that matches nothing; above zero so that a chain can leave it."""
NOTHING = float(np.log(_FLOOR))
"""Its log."""
STIFF = 0.4
"""Factor on poses from which an arm can't give way: taken where there is no other."""


class GraspQuality:
    """log of Q-hat times the preference; S first, the rest where S leaves a chance.

    The paper searches Q-hat = S C and looks at reachability afterwards. A quick upper
    bound of R costs less than C, so poses that no arm can reach are dropped at once.

    Parameters
    ----------
    similarity, clearance
        S and C.
    reach
        See `Reach`.
    preference
        Maps poses (k, 4, 4) and prototypes (k,) to a factor in (0, 1] by which good
        grasps are told from better.
    """

    def __init__(
        self,
        similarity: ShapeSimilarity,
        clearance: HandClearance,
        reach: Reach,
        preference: Callable[[FloatArray, IntArray], FloatArray],
    ) -> None:
        self._similarity, self._clearance = similarity, clearance
        self._reach, self._preference = reach, preference

    def of(self, prototype: IntArray) -> LogQuality:
        """Quality of walkers that place these prototypes (k,), for `anneal`."""
        return lambda Ts, needed: self(Ts, prototype, needed)

    def __call__(
        self, Ts_base_hand: FloatArray, prototype: IntArray, needed: FloatArray
    ) -> FloatArray:
        """See `annealing.LogQuality`; poses (k, 4, 4) of prototypes (k,)."""
        wanted = self.promise(Ts_base_hand, prototype)
        value = np.log(np.maximum(wanted, _FLOOR))
        # C is at most 1, so a candidate whose S alone falls short is lost already.
        worth = np.flatnonzero((value > needed) & (wanted > _FLOOR))
        if len(worth):
            wanted[worth] *= self._reach(Ts_base_hand[worth], prototype[worth])
            value[worth] = np.log(np.maximum(wanted[worth], _FLOOR))
            worth = worth[(value[worth] > needed[worth]) & (wanted[worth] > _FLOOR)]
        if len(worth):
            least_clearance = np.exp(needed[worth] - value[worth])
            clearance = self._clearance(
                Ts_base_hand[worth], prototype[worth], least_clearance
            )
            value[worth] = np.log(np.maximum(wanted[worth] * clearance, _FLOOR))
        return value

    def promise(self, Ts_base_hand: FloatArray, prototype: IntArray) -> FloatArray:
        """S times the preference: more the pose can't be worth, shape (k,)."""
        similarity, _ = self._similarity(Ts_base_hand, prototype)
        found: FloatArray = similarity * self._preference(Ts_base_hand, prototype)
        return found

    def aligned(self, Ts_base_hand: FloatArray, prototype: IntArray) -> FloatArray:
        """See `ShapeSimilarity.aligned`."""
        return self._similarity.aligned(Ts_base_hand, prototype)
