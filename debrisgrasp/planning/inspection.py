"""The close look at the few poses that survive the search, and its reasons.

The search saw the hand as spheres; here every measured point near the hand is looked
up in the hand's own solids, at the final pose and on the way in, and what the fingers
would close on is counted by object.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from debrisgrasp._arrays import (
    BoolArray,
    Float32Array,
    FloatArray,
    IntArray,
    require_range,
)
from debrisgrasp._checked import checked_fields

from .hand_space import MARGIN_SHIFT, HandSpace
from .hands import PackedHands
from .scene import GraspScene

__all__ = ["Inspection", "InspectionConfig", "Inspector"]


@checked_fields
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
    """The fingers must have at least so many points of what is sought between them."""

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
    """Points of what is sought between the open fingers, shape (k,)."""
    own: IntArray
    """Points between them of what that is part of, itself included, shape (k,)."""
    foreign: IntArray
    """Points of anything else between them, shape (k,)."""
    is_in_ground: BoolArray
    """Whether a part of the hand would be below the ground, shape (k,)."""
    margin: FloatArray
    """How far the hand may be off before it touches something, shape (k,) [m]."""

    def reasons(self, config: InspectionConfig) -> dict[str, BoolArray]:
        """Which poses each reason rules out; only the first that applies counts."""
        crowded = self.foreign > config.max_foreign_share * (self.own + self.foreign)
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

    def is_stuck(self, config: InspectionConfig) -> BoolArray:
        """Which poses something rules out whatever way the hand comes in, (k,)."""
        free = replace(self, approach_hits=np.zeros_like(self.approach_hits))
        return np.asarray(np.any(list(free.reasons(config).values()), axis=0))

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

    def __getitem__(self, rows: BoolArray) -> Inspection:
        return Inspection(**{f.name: getattr(self, f.name)[rows] for f in fields(self)})

    def with_free_approach(self, rows: IntArray) -> Inspection:
        """Return the same counts, but nothing on the way in for some poses."""
        hits = self.approach_hits.copy()
        hits[rows] = 0
        return replace(self, approach_hits=hits)


class Inspector:
    """Looks closely at poses of the hands of a dictionary in one scene."""

    def __init__(self, scene: GraspScene, hands: PackedHands) -> None:
        self._ground_plane, self._hands = scene.ground_plane, hands
        # In the order of x, so that a slice holds all points of a range.
        order = np.argsort(scene.cloud.points[:, 0], kind="stable")
        points = np.ones((4, len(order)), dtype=np.float32)
        points[:3] = scene.cloud.points[order].T
        self._points = points
        # 0: something else, 1: what the object is part of, 2: what is sought of it,
        # 3: the ground.
        kind = np.where(scene.is_target, 2, scene.is_own)
        kind[(kind == 0) & _is_ground(scene)] = _GROUND
        self._kind = kind[order]

    def __call__(self, Ts_base_hand: FloatArray, prototype: IntArray) -> Inspection:
        """Count what the hand touches in each pose.

        Parameters
        ----------
        Ts_base_hand
            Poses, shape (k, 4, 4).
        prototype
            Whose hand each carries, shape (k,).
        """
        met = np.zeros((len(Ts_base_hand), _N_KINDS, _N_FLAGS), dtype=np.int64)
        spaces = self._hands.spaces
        which = self._hands.space_index[prototype]
        Ts = Ts_base_hand.astype(np.float32)
        R, t = Ts[:, :3, :3], Ts[:, :3, 3]
        middle = (R @ spaces.middle[which][..., None])[..., 0] + t
        half = (np.abs(R) @ spaces.half[which][..., None])[..., 0]
        # Poses near each other share the points around them.
        cube = np.floor(middle / _GROUP)
        order = np.lexsort(cube.T)
        ends = np.flatnonzero(np.diff(cube[order], axis=0).any(axis=1)) + 1
        for poses in np.split(order, ends) if len(order) else []:
            lower = (middle[poses] - half[poses]).min(axis=0)
            upper = (middle[poses] + half[poses]).max(axis=0)
            near = self._within(lower, upper)
            for some in np.split(poses, range(_TOGETHER, len(poses), _TOGETHER)):
                met[some] = self._met(near, Ts[some], which[some])
        comes_down = self._comes_down(Ts_base_hand)
        palm, finger, approach, swept, held, own, foreign = _counts(met, comes_down)
        return Inspection(
            palm_hits=palm,
            finger_hits=finger,
            approach_hits=approach,
            swept_hits=swept,
            held=held,
            own=own,
            foreign=foreign,
            is_in_ground=self._is_in_ground(Ts_base_hand, prototype),
            margin=spaces.spacing * _margin(met, comes_down),
        )

    def _within(self, lower: Float32Array, upper: Float32Array) -> IntArray:
        """Which points lie inside a box [m], base frame."""
        x, y, z = self._points[:3]
        first, last = np.searchsorted(x, [lower[0], upper[0]])
        is_near = (y[first:last] >= lower[1]) & (y[first:last] <= upper[1])
        is_near &= (z[first:last] >= lower[2]) & (z[first:last] <= upper[2])
        found: IntArray = np.flatnonzero(is_near) + first
        return found

    def _met(self, near: IntArray, Ts: Float32Array, which: IntArray) -> IntArray:
        """How often poses meet each kind and combination of flags, (k, 4, 256)."""
        points, kind = self._points[:, near], self._kind[near]
        flags, pose, point = self._hands.spaces.marked(points, Ts, which)
        meets = (_N_KINDS * pose + kind[point]) * _N_FLAGS + flags
        n_each = np.bincount(meets, minlength=_N_KINDS * _N_FLAGS * len(Ts))
        return n_each.reshape(len(Ts), _N_KINDS, _N_FLAGS)

    def _comes_down(self, Ts: FloatArray) -> BoolArray:
        """Whether poses come down on the ground rather than along it, shape (k,)."""
        plane = self._ground_plane
        if plane is None:
            return np.zeros(len(Ts), dtype=bool)
        return np.asarray(Ts[:, :3, 2] @ plane[:3] < -_STEEP)

    def _is_in_ground(self, Ts: FloatArray, prototype: IntArray) -> BoolArray:
        """Whether the middle of any sphere of the hand is below the ground, shape (k,).

        The ground is solid also where something hides it from the camera.
        """
        plane = self._ground_plane
        if plane is None:
            return np.zeros(len(Ts), dtype=bool)
        up = plane[:3] @ Ts[:, :3, :3]
        offset = Ts[:, :3, 3] @ plane[:3] + plane[3]
        centers = self._hands.centers[prototype]
        height = (up[:, None] @ centers)[:, 0] + offset[:, None]
        is_low = (height < 0.0) & np.isfinite(self._hands.radii[prototype])
        found: BoolArray = is_low.any(axis=1)
        return found


_STRAY = 2
"""So many points nearest to a hand don't tell its margin."""
_GROUP = 0.2
"""Poses within a cube of this edge [m] are looked at together."""
_TOGETHER = 16
"""At most so many: their arrays stay in the cache."""
_N_KINDS = 4
"""Points of others, of what the object is part of, of what is sought, of the ground."""
_GROUND = 3
_STEEP = 0.7
"""Cosine between its way in and straight down of a hand that comes down."""
_EVEN = 0.012
"""What is no farther from the plane of the ground is the ground [m]."""
_N_FLAGS = 256
"""Combinations of the five flags of `HandSpace` and the three bits of the margin."""


def _is_ground(scene: GraspScene) -> BoolArray:
    """Which points of a scene lie in the plane of the ground, shape (n,)."""
    plane = scene.ground_plane
    if plane is None:
        return np.zeros(len(scene.cloud), dtype=bool)
    height = scene.cloud.points @ plane[:3] + plane[3]
    return np.asarray(np.abs(height) < _EVEN)


def _counts(met: IntArray, comes_down: BoolArray) -> IntArray:
    """Rows of an `Inspection` for poses that met points (k, 4, 256), shape (7, k).

    The ground under a hand that comes down is nothing that its fingers close on: they
    slide over it.
    """
    # Counts of points are exact in float64, whose products are much faster.
    met = (met.astype(np.float64) @ _HAS).astype(np.int64)
    met[comes_down, _GROUND, _CLOSES:] = 0
    others, parts, sought, ground = met[:, :, -1].T
    solid = met.sum(axis=1)[:, :-1].T
    return np.concatenate([solid, [sought, parts + sought, others + ground]])


def _margin(met: IntArray, comes_down: BoolArray) -> FloatArray:
    """Cells between hand and points, but for the nearest few, shape (k,).

    The ground under a hand that comes down stops it at its place, at worst.
    """
    n_steps = _N_FLAGS >> MARGIN_SHIFT
    by_step = met.reshape(len(met), _N_KINDS, n_steps, 1 << MARGIN_SHIFT).sum(axis=3)
    by_step[comes_down, _GROUND] = 0
    nearest_first = np.cumsum(by_step.sum(axis=1)[:, :0:-1], axis=1)
    found: IntArray = np.count_nonzero(nearest_first <= _STRAY, axis=1)
    return found.astype(np.float64)


_HAS = (
    np.arange(_N_FLAGS)[:, None]
    & (
        HandSpace.PALM,
        HandSpace.FINGER,
        HandSpace.APPROACH,
        HandSpace.SWEPT,
        HandSpace.CLOSING,
    )
    > 0
).astype(np.float64)
"""1 for each combination of flags that has one of these, else 0, shape (256, 5)."""
_CLOSES = 3
"""From this column on, flags are about fingers that close."""
