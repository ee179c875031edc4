"""The close look at the few poses that survive the search, and its reasons.

The search saw the hand as spheres; here every measured point near the hand is looked
up in the hand's own solids, at the final pose and on the way in, and what the fingers
would close on is counted by object.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from debrisgrasp._arrays import (
    BoolArray,
    Float32Array,
    FloatArray,
    IntArray,
    require_range,
)

from .hands import HandSpace, PackedHands
from .scene import GraspScene

__all__ = ["Inspection", "InspectionConfig", "Inspector"]


@dataclass(frozen=True, slots=True, kw_only=True)
class InspectionConfig:
    """When a measured point counts as hit, and how many hits a grasp survives."""

    tolerance: float = 0.004
    """A point this deep inside a solid is hit [m]; shallower ones are sensor noise."""
    max_hits: int = 1
    """Single points in the air are flying pixels of the sensor."""
    max_foreign_share: float = 0.10
    """Share of the points between the fingers that may belong to something else."""
    min_held_points: int = 5
    """The fingers must have at least this many points of the object between them."""

    def __post_init__(self) -> None:
        require_range("InspectionConfig.tolerance", self.tolerance, 0.0, 0.02)
        require_range("InspectionConfig.max_hits", self.max_hits, 0)
        share = self.max_foreign_share
        require_range("InspectionConfig.max_foreign_share", share, 0.0, 1.0)
        require_range("InspectionConfig.min_held_points", self.min_held_points, 1)


@dataclass(frozen=True, slots=True, eq=False)
class Inspection:
    """Counts of thinned points per pose; the reasons follow from them."""

    palm_hits: IntArray
    """Inside the palm at the final pose, shape (k,)."""
    finger_hits: IntArray
    """Inside an open finger at the final pose, shape (k,)."""
    approach_hits: IntArray
    """Swept by the hand on the way in, shape (k,)."""
    swept_hits: IntArray
    """In the way of the closing fingers before they grip, shape (k,)."""
    held: IntArray
    """Points of the object between the open fingers, shape (k,)."""
    foreign: IntArray
    """Points of anything else between them, shape (k,)."""
    is_in_ground: BoolArray
    """Whether a part of the hand would be below the ground, shape (k,)."""

    def reasons(self, config: InspectionConfig) -> dict[str, BoolArray]:
        """Which poses each reason rules out; only the first that applies counts."""
        crowded = self.foreign > config.max_foreign_share * (self.held + self.foreign)
        causes = {
            "the hand would be in the ground": self.is_in_ground,
            "the palm would hit something": self.palm_hits > config.max_hits,
            "an open finger would hit something": self.finger_hits > config.max_hits,
            "the approach is blocked": self.approach_hits > config.max_hits,
            "nothing is between the fingers": self.held < config.min_held_points,
            "the fingers would be stopped before they grip": (
                self.swept_hits > config.max_hits
            ),
            "the fingers would close on something else too": crowded,
        }
        is_open = np.ones(len(self.held), dtype=bool)
        first = {}
        for name, applies in causes.items():
            first[name] = applies & is_open
            is_open &= ~applies
        return first

    def amount(self, reason: str) -> IntArray | None:
        """How many points a reason is about, shape (k,); None if it isn't about any."""
        counts = {
            "the palm would hit something": self.palm_hits,
            "an open finger would hit something": self.finger_hits,
            "the approach is blocked": self.approach_hits,
            "nothing is between the fingers": self.held,
            "the fingers would be stopped before they grip": self.swept_hits,
            "the fingers would close on something else too": self.foreign,
        }
        return counts.get(reason)

    def with_free_approach(self, rows: IntArray) -> Inspection:
        """Return the same counts, but nothing on the way in for some poses."""
        hits = self.approach_hits.copy()
        hits[rows] = 0
        return replace(self, approach_hits=hits)


class Inspector:
    """Looks closely at poses of the hands of a dictionary in one scene."""

    def __init__(self, scene: GraspScene, hands: PackedHands) -> None:
        self._scene, self._hands = scene, hands
        self._points = np.ascontiguousarray(scene.cloud.points.T, dtype=np.float32)
        self._tree = cKDTree(scene.cloud.points)

    def __call__(self, Ts_base_hand: FloatArray, prototype: IntArray) -> Inspection:
        """Count what the hand touches in each pose.

        Parameters
        ----------
        Ts_base_hand
            Poses, shape (k, 4, 4).
        prototype
            Whose hand each carries, shape (k,).
        """
        counts = np.zeros((6, len(Ts_base_hand)), dtype=np.int64)
        spaces = self._hands.spaces
        which = self._hands.space_index[prototype]
        Ts = Ts_base_hand.astype(np.float32)
        middle = (Ts[:, :3, :3] @ spaces.middle[which][..., None])[..., 0] + Ts[
            :, :3, 3
        ]
        # Poses near each other share the points around them.
        cells, group = np.unique(
            np.floor(middle / _GROUP).astype(np.int64), axis=0, return_inverse=True
        )
        reach = float(spaces.radius.max()) + _GROUP * 3**0.5 / 2
        near = self._tree.query_ball_point((cells + 0.5) * _GROUP, reach)
        order = np.argsort(group.ravel(), kind="stable")
        ends = np.cumsum(np.bincount(group.ravel(), minlength=len(cells)))
        for points, poses in zip(near, np.split(order, ends[:-1]), strict=True):
            if points:
                index = np.array(points)
                counts[:, poses] = self._counts(index, Ts[poses], which[poses])
        palm, finger, approach, swept, held, foreign = counts
        return Inspection(
            palm_hits=palm,
            finger_hits=finger,
            approach_hits=approach,
            swept_hits=swept,
            held=held,
            foreign=foreign,
            is_in_ground=self._is_in_ground(Ts_base_hand, prototype),
        )

    def _counts(self, index: IntArray, Ts: Float32Array, which: IntArray) -> IntArray:
        """Rows of an `Inspection` for poses and the points around them, (6, k)."""
        to_hand = Ts[:, :3, :3].transpose(0, 2, 1)
        local = to_hand @ self._points[:, index] - to_hand @ Ts[:, :3, 3:]
        flags = self._hands.spaces.at(local, which)
        is_target = self._scene.is_target[index]
        between = (flags & HandSpace.CLOSING) > 0
        cases = (
            flags & HandSpace.PALM,
            flags & HandSpace.FINGER,
            flags & HandSpace.APPROACH,
            flags & HandSpace.SWEPT,
            between & is_target,
            between & ~is_target,
        )
        return np.stack([np.count_nonzero(case, axis=1) for case in cases])

    def _is_in_ground(self, Ts: FloatArray, prototype: IntArray) -> BoolArray:
        """Whether the middle of any sphere of the hand is below the ground, shape (k,).

        The ground is solid also where something hides it from the camera.
        """
        plane = self._scene.ground_plane
        if plane is None:
            return np.zeros(len(Ts), dtype=bool)
        up = plane[:3] @ Ts[:, :3, :3]
        offset = Ts[:, :3, 3] @ plane[:3] + plane[3]
        centers = self._hands.centers[prototype]
        height = (up[:, None] @ centers)[:, 0] + offset[:, None]
        is_low = (height < 0.0) & np.isfinite(self._hands.radii[prototype])
        found: BoolArray = is_low.any(axis=1)
        return found


_GROUP = 0.08
"""Poses within a cube of this edge [m] are looked at together."""
