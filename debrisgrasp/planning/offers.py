"""Which of the grasps that arms take are offered: those that can give way to a push."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from debrisgrasp._arrays import BoolArray, IntArray, Rng

from .easing import LEEWAY, way_of
from .plan import Grasp
from .reach import Arm

__all__ = ["Offers"]


class Offers:
    """Grasps that arms take in one scene, and which of them to offer.

    A controller that is compliant would refuse the approach or the lift of a grasp in
    which the arm can't give way. Such a grasp takes another posture if it is better
    than all that give way, or makes room for the next one, be it the same hand turned
    by half, unless there is no other.

    Parameters
    ----------
    arms
        Those that take the grasps.
    chosen
        Rows of the grasps to offer, best first.
    approached
        The same grasps with the place that the hand comes from.
    eased
        Which of some grasps can give way in another posture, and how; see `Easing`.
    rng
        Source of the solver's seeds.
    """

    def __init__(
        self,
        arms: Sequence[Arm],
        chosen: Callable[[Sequence[Grasp]], IntArray],
        approached: Callable[[Sequence[Grasp]], Sequence[Grasp]],
        eased: Callable[[Sequence[Grasp]], Mapping[int, Grasp]],
        *,
        rng: Rng,
    ) -> None:
        self._arms, self._rng = arms, rng
        self._chosen, self._approached, self._eased = chosen, approached, eased
        self._sure: list[Grasp] = []
        self._rest: list[Grasp] = []
        self._stiff: list[Grasp] = []
        self.yielding: tuple[Grasp, ...] = ()
        """The best that give way."""

    def take(self, grasps: Sequence[Grasp]) -> None:
        """Add grasps; those that are chosen then are asked whether they give way."""
        self._rest += grasps
        is_asked = True
        while is_asked:
            every = [*self._sure, *self._rest]
            rows = self._chosen(every)
            asked = rows[rows >= len(self._sure)].tolist()
            found = list(self._approached([every[row] for row in asked]))
            yields = self._yields(found)
            self._ease(found, yields)
            told = dict(zip(asked, found, strict=True))
            self.yielding = tuple(told.get(row, every[row]) for row in rows.tolist())
            others = range(len(self._sure), len(every))
            self._rest = [every[row] for row in others if row not in told]
            for grasp, gives in zip(found, yields, strict=True):
                (self._sure if gives else self._stiff).append(grasp)
            is_asked = not yields.all()

    @property
    def offered(self) -> tuple[Grasp, ...]:
        """The best that give way; where none does, the best of all."""
        if self.yielding:
            return self.yielding
        return tuple(self._stiff[row] for row in self._chosen(self._stiff).tolist())

    @property
    def left_out(self) -> tuple[Grasp, ...]:
        """Those that were asked, and don't give way although others do."""
        return tuple(self._stiff) if self._sure else ()

    def _ease(self, grasps: list[Grasp], yields: BoolArray) -> None:
        """Put stiff grasps that are better than all others into another posture."""
        giving = [grasp for grasp, gives in zip(grasps, yields, strict=True) if gives]
        best = max((grasp.rank for grasp in (*self._sure, *giving)), default=-np.inf)
        rows = [
            row
            for row, grasp in enumerate(grasps)
            if not yields[row] and grasp.rank > best
        ]
        eased = self._eased([grasps[row] for row in rows]) if rows else {}
        for i, grasp in eased.items():
            grasps[rows[i]], yields[rows[i]] = grasp, True

    def _yields(self, grasps: Sequence[Grasp]) -> BoolArray:
        """Which grasps leave their arm room to give way, shape (k,)."""
        yields = np.ones(len(grasps), dtype=bool)
        for arm in self._arms:
            rows = [i for i, grasp in enumerate(grasps) if grasp.arm == arm.name]
            if rows:
                way = way_of([grasps[i] for i in rows], arm.joint_names)
                yields[rows] = arm.leeway(*way, rng=self._rng) >= LEEWAY
        return yields
