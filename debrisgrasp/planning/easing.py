"""Other postures for grasps in which an arm can't give way to a push."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, Rng
from debrisgrasp.geometry import SE3

from .load import Loads
from .plan import Grasp
from .reach import Arm, Distance

__all__ = ["LEEWAY", "Easing", "lifted", "way_of"]

_LIFT = 0.15
"""How far the hand goes up with the object [m]: there too it has to give way."""
LEEWAY = 0.9
"""Share of the pushes that a posture has to give way to; other postures of the same
grasp give way to the last few."""


class Easing:
    """Finds them in one scene, clear of it and of the robot.

    Parameters
    ----------
    arms
        Those that take the grasps.
    distance
        Obstacles for their links, in the base frame.
    weigh
        Loads of grasps, the torque of joints aside.
    rng
        Source of the solver's seeds.
    """

    def __init__(
        self,
        arms: Sequence[Arm],
        distance: Distance,
        weigh: Callable[[Sequence[Grasp]], Loads],
        *,
        rng: Rng,
    ) -> None:
        self._arms = {arm.name: arm for arm in arms}
        self._distance, self._weigh, self._rng = distance, weigh, rng

    def __call__(self, grasps: Sequence[Grasp]) -> dict[int, Grasp]:
        """Find the same grasps in such postures, by their places among those given.

        Left out are those that have none, or none that leaves the forecast of the load
        as it is.
        """
        found: dict[int, Grasp] = {}
        for name in dict.fromkeys(grasp.arm for grasp in grasps):
            arm = self._arms[str(name)]
            rows = [i for i, grasp in enumerate(grasps) if grasp.arm == name]
            mine = [grasps[i] for i in rows]
            _, T_base_hand, Ts_base_away = way_of(mine, arm.joint_names)
            joints = arm.yielding(
                T_base_hand, Ts_base_away, self._distance, LEEWAY, rng=self._rng
            )
            for i in np.flatnonzero(self._is_borne(mine, joints, arm)).tolist():
                values = dict(zip(arm.joint_names, joints[i].tolist(), strict=True))
                found[rows[i]] = replace(mine[i], joints=values)
        return found

    def _is_borne(
        self, grasps: Sequence[Grasp], joints: FloatArray, arm: Arm
    ) -> BoolArray:
        """Whether joints (k, d) are there, and the forecast of the load holds, (k,)."""
        loads = self._weigh(grasps)
        share = arm.effort(joints, loads.wrench)[:, None] / loads.mass[1]
        margins = np.array([_margins(grasp) for grasp in grasps])
        # Of NaN nothing is true.
        return np.asarray((share * loads.mass * margins <= 1.0).all(axis=1))


def _margins(grasp: Grasp) -> tuple[float, float, float]:
    """Limit over load of a grasp at the least, expected and greatest mass."""
    load = grasp.load
    if load is None:
        return np.inf, np.inf, np.inf
    return load.margins[1], load.margin, load.margins[0]


def way_of(
    grasps: Sequence[Grasp], joint_names: Sequence[str]
) -> tuple[FloatArray, SE3, SE3]:
    """Joints (k, d) and poses (k,) of grasps, and pre-grasp and lift (k, 2)."""
    joints = [[(grasp.joints or {})[name] for name in joint_names] for grasp in grasps]
    hand = np.array([grasp.T_base_hand.matrix for grasp in grasps])
    away = np.array([grasp.T_base_pregrasp.matrix for grasp in grasps])
    ways = np.stack([away, lifted(hand)], axis=1)
    return np.array(joints), SE3(hand), SE3(ways)


def lifted(Ts_base_hand: FloatArray) -> FloatArray:
    """Poses (k, 4, 4) of hands once they have lifted the object."""
    found = Ts_base_hand.copy()
    found[:, 2, 3] += _LIFT
    return found
