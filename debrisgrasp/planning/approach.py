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
from debrisgrasp._checked import checked_fields
from debrisgrasp.errors import ConfigError

from .hands import PackedHands
from .inspection import Inspection, InspectionConfig
from .scene import GraspScene

__all__ = ["ApproachConfig", "Ways"]

_MOST_RELIEVED = 30
"""Poses with a blocked approach for which other ways are looked for."""
_ROOM = 0.01
"""A hand that comes to its stand-off may be off by so much [m]."""
_ASIDE = _ROOM * np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
"""In these ways, palm frame, shape (4, 3)."""
_TOGETHER = 150_000
"""Points of all poses that are looked at together: their arrays stay in the cache."""


@checked_fields
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

    def steps(self, longest: float) -> FloatArray:
        """Places on a way that are looked at [m], the last ``longest``, shape (s,)."""
        n_steps = max(1, round(longest / self.step))
        return np.linspace(0.0, longest, n_steps + 1)[1:]


class Ways:
    """Looks for free ways of hands in one scene."""

    def __init__(
        self,
        scene: GraspScene,
        hands: PackedHands,
        config: ApproachConfig,
        inspection: InspectionConfig,
    ) -> None:
        self._hands, self._config, self._inspection = hands, config, inspection
        self._max_hits = inspection.max_hits
        self._points = scene.cloud.points.T.astype(np.float32, order="C")
        self._targets = scene.is_target

    def relieved(
        self, look: Inspection, Ts_base_hand: FloatArray, prototype: IntArray
    ) -> Inspection:
        """Forget a blocked approach wherever another way in is free.

        Poses that fail for other reasons too are not worth the effort.
        """
        is_blocked = look.approach_hits > self._max_hits
        blocked = np.flatnonzero(is_blocked & ~look.is_stuck(self._inspection))
        blocked = blocked[:_MOST_RELIEVED]
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
        directions, least = self._config.directions(), self._config.shortest
        ways = directions @ Ts_base_hand[:, :3, :3].swapaxes(1, 2)
        longest, every = self._config.longest, np.ones(len(self._targets), dtype=bool)
        best = np.zeros(len(ways), dtype=np.int64)
        straight = np.broadcast_to(directions[:1], (len(ways), 1, 3))
        length = self._free(Ts_base_hand, prototype, straight, longest, every)[:, 0]
        rows = np.flatnonzero(length < least)
        if len(rows):
            Ts, which = Ts_base_hand[rows], prototype[rows]
            around = np.broadcast_to(directions, (len(rows), *directions.shape))
            free = self._free(Ts, which, around, least, every) >= least - 1e-9
            # Slanted ways must not lead deeper down than the straight one.
            free &= ways[rows, :, 2] >= np.minimum(0.0, ways[rows, :1, 2]) - 1e-9
            free[:, 0] = False
            best[rows] = free.argmax(axis=1)
            slanted = directions[best[rows], None]
            length[rows] = self._free(Ts, which, slanted, longest, every)[:, 0]
            length[rows[~free.any(axis=1)]] = 0.0
        found: FloatArray = length[:, None] * ways[np.arange(len(ways)), best]
        return found

    def roomy(
        self, Ts_base_hand: FloatArray, prototype: IntArray, offsets: FloatArray
    ) -> FloatArray:
        """Shorten stand-offs to places where the hand has room for an error.

        Parameters
        ----------
        Ts_base_hand, prototype
            Palm poses (k, 4, 4), and whose hand each carries (k,).
        offsets
            Of the palm in base [m], as `approaches` gives them, shape (k, 3).

        Returns
        -------
        FloatArray
            The same or shorter ones, never below the shortest; as they were where no
            place has room. Shape (k, 3).
        """
        length = np.linalg.norm(offsets, axis=1)
        rows = np.flatnonzero(length >= self._config.shortest)
        if not len(rows):
            return offsets
        Ts, which = Ts_base_hand[rows], prototype[rows]
        away = offsets[rows] / length[rows, None]
        ways = away[:, None] @ Ts[:, :3, :3]
        steps = self._config.steps(self._config.longest)
        steps = steps[steps >= self._config.shortest - 1e-6]
        every = np.ones(len(self._targets), dtype=bool)
        ways = np.repeat(ways, len(_ASIDE), axis=1)
        is_blocked = self._blocked(Ts, which, ways, steps, every, _ASIDE)
        has_room = (steps <= length[rows, None] + 1e-6) & ~is_blocked.any(axis=1)
        last = len(steps) - 1 - has_room[:, ::-1].argmax(axis=1)
        found = offsets.copy()
        share = np.where(has_room.any(axis=1), steps[last], length[rows])
        found[rows] = share[:, None] * away
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
        ways = directions @ Ts_base_hand[:, :3, :3]
        return self._free(Ts_base_hand, prototype, ways, distance, ~self._targets)

    def _free(
        self,
        Ts: FloatArray,
        which: IntArray,
        ways: FloatArray,
        longest: float,
        counts: BoolArray,
    ) -> FloatArray:
        """How far hands can be moved back before points get into their solids.

        Parameters
        ----------
        longest
            How far to look [m].

        Returns
        -------
        FloatArray
            [m], shape (k, d).
        """
        steps = self._config.steps(longest)
        is_blocked = self._blocked(Ts, which, ways, steps, counts)
        n_free = np.count_nonzero(np.cumsum(is_blocked, axis=-1) == 0, axis=-1)
        length: FloatArray = np.concatenate([[0.0], steps])[n_free]
        return length

    def _blocked(
        self,
        Ts: FloatArray,
        which: IntArray,
        ways: FloatArray,
        steps: FloatArray,
        counts: BoolArray,
        aside: FloatArray | None = None,
    ) -> BoolArray:
        """Whether points get into the solids of hands that were moved back.

        Parameters
        ----------
        Ts, which
            Palm poses (k, 4, 4), and whose hand each carries (k,).
        ways
            Unit vectors in the palm frames, shape (k, d, 3).
        steps
            How far [m], shape (s,).
        counts
            Which points can be in the way, shape (n,).
        aside
            How far beside the hands each of the ways begins [m], palm frame, (d, 3).

        Returns
        -------
        BoolArray
            Shape (k, d, s).
        """
        aside = np.zeros((ways.shape[1], 3)) if aside is None else aside
        spaces, index = self._hands.spaces, self._hands.space_index[which]
        R = Ts[:, :3, :3]
        middle = (R @ spaces.middle[index][..., None])[..., 0] + Ts[:, :3, 3]
        half = (np.abs(R) @ spaces.half[index][..., None])[..., 0] + spaces.spacing
        begin = middle[:, None] + aside @ R.swapaxes(1, 2)
        end = begin + steps[-1] * ways @ R.swapaxes(1, 2)
        lower = np.minimum(begin, end).min(axis=1) - half
        upper = np.maximum(begin, end).max(axis=1) + half
        near = counts.copy()
        for along, low, high in zip(self._points, lower.T, upper.T, strict=True):
            near &= along >= np.float32(low.min(initial=np.inf))
            near &= along <= np.float32(high.max(initial=-np.inf))
        points = self._points[:, near]
        found = np.empty((*ways.shape[:2], len(steps)), dtype=bool)
        n_poses = max(1, _TOGETHER // max(1, points.shape[1]))
        for first in range(0, len(Ts), n_poses):
            some = slice(first, first + n_poses)
            hits = spaces.hits(points, Ts[some], index[some], ways[some], aside, steps)
            found[some] = hits > self._max_hits
        return found
