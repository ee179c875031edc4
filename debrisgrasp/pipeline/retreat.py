"""Which way to take the object out once it is gripped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._memo import Memo
from debrisgrasp.control import PullConfig, choose_pull
from debrisgrasp.planning import Grasp, GraspPlanner, GraspScene, Retreat

__all__ = ["Retreats"]

_PULL = PullConfig(cell=0.02)
"""Coarser cells than the points are apart: no holes for neighbours to slip through."""
_FIRST = np.array([[*_PULL.along_road[:2], _PULL.rise], [0.0, 0.0, 1.0]])
"""Back along the road and up, and straight up: if one of them is free, it will do."""
_FREE = 0.03
"""Share of its size that an object may sweep through neighbours and count as free."""
_GROUND = 0.02
"""Points no higher over the ground than this are no neighbours [m]."""


class _Pull(NamedTuple):
    """Way to take one object out."""

    direction: FloatArray
    """Unit vector in base, shape (3,)."""
    overlap: float
    """Neighbours in its way, as a share of the object's own cells."""
    lift_overlap: float
    """Neighbours in the way straight up."""


class Retreats:
    """Gives grasps their retreats; the pull of an object is chosen once in a scene."""

    def __init__(self) -> None:
        self._pulls: Memo[GraspScene, _Pull] = Memo()

    def added(
        self, grasps: Sequence[Grasp], planner: GraspPlanner, scene: GraspScene
    ) -> tuple[Grasp, ...]:
        """Add to each grasp the pull that sweeps through the fewest neighbours.

        The pull is that of the object; how far the hand gets along it is the grasp's
        own.
        """
        if not grasps:
            return ()
        pull = self._pulls.get(scene)
        if pull is None:
            pull = self._pulls[scene] = _pull(scene)
        ways = np.stack([pull.direction, _FIRST[1]])
        free = planner.retreats(scene, grasps, ways, _PULL.distance)
        x, y, z = pull.direction.tolist()
        return tuple(
            replace(
                grasp,
                retreat=Retreat(
                    direction=(x, y, z),
                    overlap=pull.overlap,
                    hand_free=float(free[row, 0]),
                    lift_overlap=pull.lift_overlap,
                    lift_hand_free=float(free[row, 1]),
                ),
            )
            for row, grasp in enumerate(grasps)
        )


def _pull(scene: GraspScene) -> _Pull:
    """Pull of the object through the fewest neighbours."""
    points = scene.cloud.points
    others = points[~scene.is_own & (_height(points, scene.ground_plane) > _GROUND)]
    own = points[scene.is_own]
    choice = choose_pull(own, others, _PULL, candidates=_FIRST)
    lift_overlap = float(choice.overlaps[1])
    if choice.overlaps.min() > _FREE:
        choice = choose_pull(own, others, _PULL)
    return _Pull(choice.direction, choice.overlap, lift_overlap)


def _height(points: FloatArray, plane: FloatArray | None) -> FloatArray:
    if plane is None:
        return np.full(len(points), np.inf)
    height: FloatArray = points @ plane[:3] + plane[3]
    return height
