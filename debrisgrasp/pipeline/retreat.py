"""Which way to take the object out once it is gripped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.control import PullConfig, choose_pull
from debrisgrasp.planning import Grasp, GraspPlanner, GraspScene, Retreat

__all__ = ["with_retreats"]

_PULL = PullConfig(cell=0.02)
"""Coarser cells than the points are apart: no holes for neighbours to slip through."""
_FIRST = np.array([[*_PULL.along_road[:2], _PULL.rise], [0.0, 0.0, 1.0]])
"""Back along the road and up, and straight up: if one of them is free, it will do."""
_FREE = 0.03
"""Share of its size that an object may sweep through neighbours and count as free."""
_GROUND = 0.02
"""Points no higher over the ground than this are no neighbours [m]."""


def with_retreats(
    grasps: Sequence[Grasp], planner: GraspPlanner, scene: GraspScene
) -> tuple[Grasp, ...]:
    """Add to each grasp the pull that sweeps the object through the fewest neighbours.

    The pull is that of the object; how far the hand gets along it is the grasp's own.
    """
    if not grasps:
        return ()
    points = scene.cloud.points
    others = points[~scene.is_own & (_height(points, scene.ground_plane) > _GROUND)]
    own = points[scene.is_own]
    choice = choose_pull(own, others, _PULL, candidates=_FIRST)
    overlaps = choice.overlaps
    if overlaps.min() > _FREE:
        choice = choose_pull(own, others, _PULL)
    ways = np.stack([choice.direction, _FIRST[1]])
    free = planner.retreats(scene, grasps, ways, _PULL.distance)
    return tuple(
        replace(
            grasp,
            retreat=Retreat(
                direction=(float(x), float(y), float(z)),
                overlap=choice.overlap,
                hand_free=float(free[row, 0]),
                lift_overlap=float(overlaps[1]),
                lift_hand_free=float(free[row, 1]),
            ),
        )
        for row, grasp in enumerate(grasps)
        for x, y, z in [choice.direction]
    )


def _height(points: FloatArray, plane: FloatArray | None) -> FloatArray:
    if plane is None:
        return np.full(len(points), np.inf)
    height: FloatArray = points @ plane[:3] + plane[3]
    return height
