"""How the hand comes to a grasp, and how it leaves: straight ways that are free.

The straight way along the palm's axis is the best one, because it keeps the object
between the fingers. Where something stands in it, a shorter one may do, or one that
comes in at a slant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    require_range,
)
from debrisgrasp.errors import ConfigError

from .hand_space import HandSpace
from .hands import PackedHands
from .inspection import Inspection, InspectionConfig
from .scene import GraspScene

__all__ = ["ApproachConfig", "Ways"]

_MOST_RELIEVED = 30
"""Poses with a blocked approach for which other ways are looked for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ApproachConfig:
    """Which straight ways to a grasp are tried."""

    longest: float = 0.16
    """Largest stand-off [m]; farther away the motion planner takes over."""
    shortest: float = 0.06
    """Smallest stand-off from which the hand can still come in straight [m]."""
    slants: tuple[float, ...] = (0.3, 0.55)
    """Angles off the palm's axis that are tried if the way along it is blocked
    [rad]."""
    n_around: int = 8
    """Slanted ways around the axis for each angle."""
    step: float = 0.01
    """Distance between the places on a way that are looked at [m]; thinner than a
    finger."""

    def __post_init__(self) -> None:
        require_range("ApproachConfig.step", self.step, 0.002, 0.05)
        require_range("ApproachConfig.shortest", self.shortest, self.step, 1.0)
        require_range("ApproachConfig.longest", self.longest, self.shortest, 1.0)
        require_range("ApproachConfig.n_around", self.n_around, 1, 64)
        if not all(0 < slant < np.pi / 2 for slant in self.slants):
            raise ConfigError(
                "ApproachConfig.slants", got=self.slants, expected="above 0, below pi/2"
            )

    def directions(self) -> FloatArray:
        """List unit vectors of retreat, palm frame, the preferred first, (d, 3)."""
        around = np.arange(self.n_around) * (2 * np.pi / self.n_around)
        found = [np.array([[0.0, 0.0, -1.0]])]
        for slant in self.slants:
            level = np.sin(slant) * np.stack([np.cos(around), np.sin(around)], axis=1)
            height = np.full((len(level), 1), -np.cos(slant))
            found.append(np.concatenate([level, height], axis=1))
        return np.concatenate(found)


class Ways:
    """Looks for free ways of hands in one scene."""

    def __init__(
        self,
        scene: GraspScene,
        hands: PackedHands,
        config: ApproachConfig,
        inspection: InspectionConfig,
    ) -> None:
        self._scene, self._hands = scene, hands
        self._config, self._inspection = config, inspection
        self._max_hits = inspection.max_hits
        self._points = scene.cloud.points.T.astype(np.float32, order="C")

    def relieved(
        self, look: Inspection, Ts_base_hand: FloatArray, prototype: IntArray
    ) -> Inspection:
        """Forget a blocked approach wherever another way in is free.

        Poses that fail for other reasons too are not worth the effort.
        """
        blocked = np.flatnonzero(look.approach_hits > self._max_hits)
        others = look.with_free_approach(blocked).reasons(self._inspection)
        is_lost = np.any(list(others.values()), axis=0)
        blocked = blocked[~is_lost[blocked]][:_MOST_RELIEVED]
        if not len(blocked):
            return look
        offsets = self.approaches(Ts_base_hand[blocked], prototype[blocked])
        return look.with_free_approach(blocked[np.any(offsets, axis=1)])

    def approaches(self, Ts_base_hand: FloatArray, prototype: IntArray) -> FloatArray:
        """Stand-off of each pose, as an offset of the palm.

        The way along the palm's axis if it is free for the shortest stand-off at least,
        and as long as it is free; else the free one with the smallest slant.

        Parameters
        ----------
        Ts_base_hand, prototype
            Palm poses (k, 4, 4), and whose hand each carries (k,).

        Returns
        -------
        FloatArray
            Offsets in base [m], shape (k, 3); zero where no way is free.
        """
        found = np.zeros((len(Ts_base_hand), 3))
        directions, least = self._config.directions(), self._config.shortest
        for row, (T, which) in enumerate(zip(Ts_base_hand, prototype, strict=True)):
            local, _ = self._around(T, which, self._config.longest)
            ways = directions @ T[:3, :3].T
            length = self.free_length(local, which, directions[:1])[0]
            best = 0
            if length < least:
                # Slanted ways must not lead deeper down than the straight one.
                is_high = ways[:, 2] >= min(0.0, ways[0, 2]) - 1e-9
                is_high[0] = False
                slanted = np.flatnonzero(is_high)
                free = self.free_length(local, which, directions[slanted], least)
                good = slanted[free >= least - 1e-9]
                if not len(good):
                    continue
                best = good[0]
                length = self.free_length(local, which, directions[best, None])[0]
            found[row] = length * ways[best]
        return found

    def retreats(
        self,
        Ts_base_hand: FloatArray,
        prototype: IntArray,
        directions: FloatArray,
        distance: float,
    ) -> FloatArray:
        """How far each hand goes along directions (d, 3) before it hits a neighbour.

        Points of the object don't count: it comes along.

        Returns
        -------
        FloatArray
            At most ``distance`` [m], shape (k, d).
        """
        found = np.zeros((len(Ts_base_hand), len(directions)))
        for row, (T, which) in enumerate(zip(Ts_base_hand, prototype, strict=True)):
            local, is_target = self._around(T, which, distance)
            others, ways = local[:, ~is_target], directions @ T[:3, :3]
            found[row] = self.free_length(others, which, ways, distance)
        return found

    def free_length(
        self,
        local: FloatArray,
        which: int,
        directions: FloatArray,
        longest: float | None = None,
    ) -> FloatArray:
        """How far a hand can be moved back before points get into its solids.

        Parameters
        ----------
        local
            Points in the palm frame [m], shape (3, n).
        which
            Index of the prototype whose hand it is.
        directions
            Unit vectors in the palm frame, shape (d, 3).
        longest
            How far to look [m]; None for the largest stand-off.

        Returns
        -------
        FloatArray
            [m], shape (d,).
        """
        longest = self._config.longest if longest is None else longest
        n_steps = max(1, round(longest / self._config.step))
        steps = np.linspace(0.0, longest, n_steps + 1)[1:]
        offsets = (directions[:, None] * steps[:, None]).reshape(-1, 3, 1)
        index = self._hands.space_index[which]
        first = self._hands.spaces.origin[index][:, None]
        last = first + 2 * (self._hands.spaces.middle[index][:, None] - first)
        swept = (local > first + offsets.min(axis=0)).all(axis=0)
        swept &= (local < last + offsets.max(axis=0)).all(axis=0)
        local = local[:, swept]
        if not local.shape[1]:
            return np.full(len(directions), longest)
        space = np.full(len(offsets), index)
        moved = local[None] - offsets.astype(np.float32)
        flags = self._hands.spaces.at(moved.astype(np.float32), space)
        inside = (flags & (HandSpace.PALM | HandSpace.FINGER)) > 0
        hits = np.count_nonzero(inside, axis=1).reshape(len(directions), n_steps)
        is_blocked = np.cumsum(hits > self._max_hits, axis=1) > 0
        n_free: IntArray = np.count_nonzero(~is_blocked, axis=1)
        length: FloatArray = np.concatenate([[0.0], steps])[n_free]
        return length

    def _around(
        self, T: FloatArray, which: int, reach: float
    ) -> tuple[FloatArray, BoolArray]:
        """Points that the hand may sweep, palm frame (3, n), and which are its own."""
        spaces, index = self._hands.spaces, self._hands.space_index[which]
        middle = T[:3, :3] @ spaces.middle[index] + T[:3, 3]
        half = np.abs(T[:3, :3]) @ spaces.half[index] + reach
        is_near = np.ones(self._points.shape[1], dtype=bool)
        for along, low, high in zip(
            self._points,
            (middle - half).astype(np.float32),
            (middle + half).astype(np.float32),
            strict=True,
        ):
            is_near &= (along >= low) & (along <= high)
        near = np.flatnonzero(is_near)
        offset = self._points[:, near] - T[:3, 3:].astype(np.float32)
        return T[:3, :3].T @ offset, self._scene.is_target[near]
