"""Whether hand and held object pass by everything else on a planned way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import SE3, Solid, voxel_downsample
from debrisgrasp.planning import Grasp
from debrisgrasp.prototypes import GripperModel

__all__ = ["Passage"]

_CELL = 0.01
"""Points of the object are thinned to one for each cell of this edge [m]."""
_SKIN = 0.015
"""What is so near to the object at the start is taken for the object itself [m]."""
_DEPTH = 0.006
"""A point so deep inside a solid is hit [m]; shallower ones are noise."""
_COMPANY, _WITHIN, _SPACINGS = 3, 0.025, 3.0
"""Points with fewer others within that distance [m], or within so many times the usual
one of neighbours if that is larger, are flying pixels of the sensor, as are ..."""
_MAX_HITS = 1
"""... so many points in the air."""
_NEAR = 0.006
"""A point of the held object so near to a neighbour touches it [m]."""
_MOST_TOUCHING = 12
"""Points of the held object, one for each square centimetre, that may touch neighbours:
these give way, or are skimmed by the noise of the sensor."""


class Passage:
    """Everything that was measured but for the object that is to be taken.

    Parameters
    ----------
    points
        Measured points, thinned [m], shape (n, 3).
    object_points
        Points of the object [m], shape (m, 3).
    grippers
        The hands that grasps name.
    along
        Points of what may well be one with the object, no obstacles to its lift
        [m], shape (k, 3); None: nothing is.
    """

    def __init__(
        self,
        points: FloatArray,
        object_points: FloatArray,
        grippers: Mapping[str, GripperModel],
        along: FloatArray | None = None,
    ) -> None:
        self._own = object_points[voxel_downsample(object_points, _CELL)]
        points = _apart(points, self._own)
        self._before = _Neighbors.of(points)
        self._on_lift = self._before
        if along is not None and len(along):
            along = along[voxel_downsample(along, _CELL)]
            self._on_lift = _Neighbors.of(_apart(points, along))
        self._grippers = grippers

    def finger_joints(self, grasp: Grasp) -> dict[str, float]:
        """Value of every joint of the open hand [rad or m]."""
        gripper = self._grippers[grasp.gripper]
        return gripper.joint_values(grasp.preshape, grasp.opening)

    def hand_solids(self, grasp: Grasp) -> tuple[Solid, ...]:
        """Solids of the open hand, palm frame."""
        return self._grippers[grasp.gripper].solids(grasp.preshape, grasp.opening)

    def approach_fault(self, grasp: Grasp, Ts_base_hand: SE3) -> str:
        """Say where the open hand hits a neighbour on palm poses (n,), or nothing."""
        where = self._first_hit(self._before, grasp, grasp.opening, Ts_base_hand)
        return f"the hand hits something {where}" if where else ""

    def lift_fault(self, grasp: Grasp, Ts_base_hand: SE3) -> str:
        """Say where closed hand or held object hit a neighbour, or nothing.

        The object moves with the hand from the first of the palm poses (n,).
        """
        others = self._on_lift
        where = self._first_hit(others, grasp, grasp.width, Ts_base_hand)
        if where:
            return f"the hand hits something {where}"
        if not len(self._own) or not others.tree.n:
            return ""
        held = Ts_base_hand[0].inverse().apply(self._own)
        last = max(len(Ts_base_hand.matrix) - 1, 1)
        for row in range(len(Ts_base_hand.matrix)):
            gap, index = others.tree.query(
                Ts_base_hand[row].apply(held), distance_upper_bound=_NEAR
            )
            touched = others.points[np.asarray(index)[np.isfinite(gap)]]
            if len(touched) > _MOST_TOUCHING:
                return f"the held object hits something {_where(touched, row / last)}"
        return ""

    def _first_hit(
        self, others: _Neighbors, grasp: Grasp, opening: float, Ts: SE3
    ) -> str:
        """Say where, and after which share of the way, the hand hits something."""
        gripper = self._grippers[grasp.gripper]
        low = gripper.preshape(grasp.preshape).narrowest
        solids = gripper.solids(grasp.preshape, max(opening, low))
        middle, radius = _ball(solids)
        last = max(len(Ts.matrix) - 1, 1)
        near = others.tree.query_ball_point(Ts.apply(middle), radius)
        for row, found in enumerate(near):
            index = np.array(found, dtype=np.int64)
            if len(index) <= _MAX_HITS:
                continue
            local = Ts[row].inverse().apply(others.points[index])
            depth = np.min([solid.signed_distance(local) for solid in solids], axis=0)
            is_hit = depth < -_DEPTH
            if np.count_nonzero(is_hit) > _MAX_HITS:
                return _where(others.points[index[is_hit]], row / last)
        return ""


@dataclass(frozen=True, slots=True, eq=False)
class _Neighbors:
    """What stays where it is while a hand moves."""

    points: FloatArray
    tree: cKDTree

    @classmethod
    def of(cls, points: FloatArray) -> _Neighbors:
        """Take measured points (n, 3) without flying pixels."""
        points = _surfaces(points)
        return cls(points, cKDTree(points))


def _where(touched: FloatArray, share: float) -> str:
    """Say where points (n, 3) are [m], and after which share of a way they are met."""
    place = ", ".join(f"{value:z.2f}" for value in np.median(touched, axis=0))
    return f"at ({place}) m after {share:.0%}"


def _apart(points: FloatArray, own: FloatArray) -> FloatArray:
    """Keep the points (n, 3) that are no part of what own points (m, 3) are of."""
    if not len(own) or not len(points):
        return points
    apart: FloatArray = points[np.asarray(cKDTree(own).query(points)[0]) > _SKIN]
    return apart


def _surfaces(points: FloatArray) -> FloatArray:
    """Leave out points (n, 3) that stand alone; a thin rod is a row of points."""
    if len(points) <= _COMPANY:
        return points
    apart = np.asarray(cKDTree(points).query(points, k=_COMPANY + 1)[0])
    within = max(_WITHIN, _SPACINGS * float(np.median(apart[:, 1])))
    return points[apart[:, _COMPANY] < within]


def _ball(solids: Sequence[Solid]) -> tuple[FloatArray, float]:
    """Centre (3,) and radius of a ball around solids [m]."""
    lower = np.min([solid.bounds.lower for solid in solids], axis=0)
    upper = np.max([solid.bounds.upper for solid in solids], axis=0)
    return (lower + upper) / 2, float(np.linalg.norm(upper - lower)) / 2
