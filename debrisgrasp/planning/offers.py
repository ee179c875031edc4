"""Which of the grasps that arms take are offered: those that can give way to a push."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, Rng
from debrisgrasp.geometry import SE3

from .plan import Grasp
from .reach import Arm

__all__ = ["Offers"]

_LIFT = 0.15
"""How far the hand goes up with the object [m]: there too it has to give way."""
_LEEWAY = 0.9
"""Share of the pushes that a posture has to give way to; other postures of the same
grasp give way to the last few."""


class Offers:
    """Grasps that arms take in one scene, and which of them to offer.

    A controller that is compliant would refuse the approach or the lift of a grasp in
    which the arm can't give way. Such a grasp makes room for the next one, be it the
    same hand turned by half, unless there is no other.

    Parameters
    ----------
    arms
        Those that take the grasps.
    chosen
        Rows of the grasps to offer, best first.
    approached
        The same grasps with the place that the hand comes from.
    rng
        Source of the solver's seeds.
    """

    def __init__(
        self,
        arms: Sequence[Arm],
        chosen: Callable[[Sequence[Grasp]], IntArray],
        approached: Callable[[Sequence[Grasp]], Sequence[Grasp]],
        *,
        rng: Rng,
    ) -> None:
        self._arms, self._rng = arms, rng
        self._chosen, self._approached = chosen, approached
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
            found = self._approached([every[row] for row in asked])
            yields = self._yields(found)
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

    def _yields(self, grasps: Sequence[Grasp]) -> BoolArray:
        """Which grasps leave their arm room to give way, shape (k,)."""
        yields = np.ones(len(grasps), dtype=bool)
        for arm in self._arms:
            rows = [i for i, grasp in enumerate(grasps) if grasp.arm == arm.name]
            if rows:
                way = _way_of([grasps[i] for i in rows], arm.joint_names)
                yields[rows] = arm.leeway(*way, rng=self._rng) >= _LEEWAY
        return yields


def _way_of(
    grasps: Sequence[Grasp], joint_names: Sequence[str]
) -> tuple[FloatArray, SE3, SE3]:
    """Joints (k, d) and poses (k,) of grasps, and pre-grasp and lift (k, 2)."""
    joints = [[(grasp.joints or {})[name] for name in joint_names] for grasp in grasps]
    hand = np.array([grasp.T_base_hand.matrix for grasp in grasps])
    away = np.array([grasp.T_base_pregrasp.matrix for grasp in grasps])
    lifted = hand.copy()
    lifted[:, 2, 3] += _LIFT
    return np.array(joints), SE3(hand), SE3(np.stack([away, lifted], axis=1))
