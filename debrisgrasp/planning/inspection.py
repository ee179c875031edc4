"""The close look at the few poses that survive the search, and its reasons.

The search saw the hand as spheres; here every measured point near the hand is looked
up in the hand's own solids, at the final pose and on the way in, and what the fingers
would close on is counted by object.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, require_range

from .hands import HandSpace, PackedHands, SpaceOfHand
from .scene import GraspScene

__all__ = ["Inspection", "InspectionConfig", "inspect"]


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


def inspect(
    scene: GraspScene,
    hands: PackedHands,
    Ts_base_hand: FloatArray,
    prototype: IntArray,
) -> Inspection:
    """Count what the hand touches in each pose.

    Parameters
    ----------
    Ts_base_hand
        Poses, shape (k, 4, 4).
    prototype
        Whose hand each carries, shape (k,).
    """
    counts = np.zeros((6, len(Ts_base_hand)), dtype=np.int64)
    tree = cKDTree(scene.cloud.points)
    for index, space in enumerate(hands.spaces):
        poses = np.flatnonzero(hands.space_index[prototype] == index)
        if len(poses):
            counts[:, poses] = _counts(scene, tree, space, Ts_base_hand[poses])
    palm, finger, approach, swept, held, foreign = counts
    return Inspection(
        palm_hits=palm,
        finger_hits=finger,
        approach_hits=approach,
        swept_hits=swept,
        held=held,
        foreign=foreign,
        is_in_ground=_is_in_ground(scene, hands, Ts_base_hand, prototype),
    )


def _is_in_ground(
    scene: GraspScene, hands: PackedHands, Ts: FloatArray, prototype: IntArray
) -> BoolArray:
    """Whether the middle of any sphere of the hand is below the ground, shape (k,).

    The ground is solid also where something hides it from the camera.
    """
    if scene.ground_plane is None:
        return np.zeros(len(Ts), dtype=bool)
    up = scene.ground_plane[:3] @ Ts[:, :3, :3]
    offset = Ts[:, :3, 3] @ scene.ground_plane[:3] + scene.ground_plane[3]
    height = np.einsum("ki,kis->ks", up, hands.centers[prototype]) + offset[:, None]
    is_low = (height < 0.0) & np.isfinite(hands.radii[prototype])
    found: BoolArray = is_low.any(axis=1)
    return found


def _counts(
    scene: GraspScene, tree: cKDTree, space: SpaceOfHand, Ts: FloatArray
) -> IntArray:
    """Rows of an `Inspection` for poses of one preshaped hand, shape (6, k)."""
    half = (np.array(space.flags.shape) - 1) * space.spacing / 2.0
    middle = Ts[:, :3, :3] @ (space.origin + half) + Ts[:, :3, 3]
    pairs = cKDTree(middle).sparse_distance_matrix(
        tree, float(np.linalg.norm(half)), output_type="ndarray"
    )
    pose, point = pairs["i"], pairs["j"]
    offset = scene.cloud.points[point] - Ts[pose, :3, 3]
    flags = space.at(np.einsum("nj,nji->ni", offset, Ts[pose, :3, :3]))
    between, is_target = (flags & HandSpace.CLOSING) > 0, scene.is_target[point]
    cases = (
        (flags & HandSpace.PALM) > 0,
        (flags & HandSpace.FINGER) > 0,
        (flags & HandSpace.APPROACH) > 0,
        (flags & HandSpace.SWEPT) > 0,
        between & is_target,
        between & ~is_target,
    )
    return np.stack([np.bincount(pose[case], minlength=len(Ts)) for case in cases])
