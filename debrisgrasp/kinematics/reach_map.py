r"""A map of what an arm can reach, with seeds for the solver in every cell.

If the first joint turns about its axis and the last about its own, both drop out of the
question whether a pose can be reached. What remains of the pose are four numbers:
radius and height, about the first axis, of a point on the last axis, and the direction
of the last axis in that radial plane. This is the map of RM4D (ICRA 2025); here every
cell also keeps values of the joints in between that lead there, so that a descent
starts a few steps from its end.

A cell that no sample has met, nor any cell next to it, counts as unreachable.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, bounded, require_range
from debrisgrasp._checked import checked, checked_fields
from debrisgrasp.errors import ConfigError

from .chain import KinematicChain
from .descent import Goals
from .formulas import AxisGoals
from .serial import Lanes
from .sixteenths import ALL_AROUND, excess_turn, fitting_bits, has_gap, sixteenth

__all__ = ["ReachMap", "ReachMapConfig"]

_SEED = 4_198_273_651
"""An unusual number: poses drawn elsewhere from a usual seed must not coincide with the
map's own samples, which would flatter every measurement."""
_GOLDEN = 0.6180339887498949
"""Multiples of it fill the unit interval evenly, however many there are."""
_INWARDS = -0.7
"""Outward component of the last axis below which its turn is not to be relied on."""
_THIN = np.float32(1e-3)
"""Least radius and height that the cells divide [m]."""
_CHUNK = 4096
"""Postures evaluated at once while building; keeps the lanes in cache."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class ReachMapConfig:
    """Size of a map; the defaults take half a second and eight megabytes."""

    n_radius: int = 14
    """Cells along the radius."""
    n_height: int = 20
    """Cells along the first axis."""
    n_rise: int = 8
    """Cells of equal area from straight down to straight up for the last axis."""
    n_heading: int = 16
    """Cells around the compass for the last axis."""
    n_seeds: int = 8
    """Seeds kept in a cell."""
    n_samples: int = 400_000
    """Postures drawn to fill the map."""

    def __post_init__(self) -> None:
        for name in self.__slots__:
            require_range(f"ReachMapConfig.{name}", getattr(self, name), 1)


@dataclass(frozen=True, eq=False, kw_only=True)
class ReachMap:
    """What a chain can reach; depends on the chain only, not on chance."""

    chain_hash: str
    config: ReachMapConfig
    radius: float
    """Largest radius of the map [m]."""
    lowest: float
    highest: float
    """Smallest and largest height of the map [m]."""
    azimuths: NDArray[np.uint16]
    """Azimuths of the points met in a cell or next to it while the first joint stands
    at zero, one bit for each sixteenth of a turn. Zero: no reach. Shape (cells,)."""
    turns: NDArray[np.uint16]
    """The same of the last frame's turns about its axis, the last joint at zero; shape
    (cells,)."""
    outer_limits: FloatArray
    """Lower and upper limits of the first and of the last joint, shape (2, 2)."""
    fitting: NDArray[np.uint16]
    """For each sixteenth of azimuths and of turns that may be wanted, the bits of what
    is met that the limits of first and last joint allow for; shape (2, 16)."""
    seed_cell: IntArray
    """Nearest cell that holds seeds, shape (cells,)."""
    seeds: NDArray[np.float16]
    """Azimuth of the point reached while the first joint stands at zero, the joints
    between first and last, and the last frame's turn while the last joint stands at
    zero [rad or m]; shape (cells, n_seeds, d). Cells with fewer seeds repeat them."""

    def __repr__(self) -> str:
        return f"<ReachMap of chain {self.chain_hash}: {len(self.azimuths)} cells>"

    @staticmethod
    def suits(chain: KinematicChain) -> bool:
        """Whether a map can tell of a chain: two joints of it turn at its ends."""
        return bool(chain.n_joints > 1 and chain.is_revolute[[0, -1]].all())

    @classmethod
    @checked
    def build(
        cls, chain: KinematicChain, config: ReachMapConfig | None = None
    ) -> ReachMap:
        """Sample the chain's postures and sort them into cells.

        Raises
        ------
        ConfigError
            If the chain doesn't suit: then the map needs more numbers.
        """
        config = config or ReachMapConfig()
        if not cls.suits(chain):
            raise ConfigError(
                "reachability map",
                got=", ".join(np.where(chain.is_revolute, "revolute", "prismatic")),
                expected="two joints or more, revolute or continuous at both ends",
                mend="Solve without a map.",
            )
        # The map is a property of the chain, so its generator is a constant.
        rng = np.random.default_rng(_SEED)
        q = chain.sampled(config.n_samples, rng=rng).T.astype(np.float32)
        q[0] = q[-1] = 0.0
        parts = []
        for start in range(0, config.n_samples, _CHUNK):
            frames = chain.single_form.frames(q[:, start : start + _CHUNK])
            columns = np.stack([frames.x, frames.y, frames.z, frames.p])
            parts.append(AxisGoals.from_columns(columns))
        rows = np.concatenate([part.rows for part in parts], axis=1)
        q[0] = np.concatenate([part.azimuth for part in parts])
        q[-1] = np.concatenate([part.turn for part in parts])
        radius, height = rows[:2]
        # One cell of margin, so that growing the map never meets its border.
        # Arms that move in a plane, or about a point, still fill a cell.
        step_r = max(radius.max(), _THIN) / max(config.n_radius - 1, 1)
        step_z = max(np.ptp(height), _THIN) / max(config.n_height - 2, 1)
        outer_limits = np.array([chain.lower, chain.upper])[:, [0, -1]].T
        bare = cls(
            chain_hash=chain.hash,
            config=config,
            radius=float(radius.max() + step_r),
            lowest=float(height.min() - step_z),
            highest=float(height.max() + step_z),
            azimuths=np.zeros(0, dtype=np.uint16),
            turns=np.zeros(0, dtype=np.uint16),
            outer_limits=outer_limits,
            fitting=np.stack([fitting_bits(*limits) for limits in outer_limits]),
            seed_cell=np.zeros(0, dtype=np.intp),
            seeds=np.zeros((0, config.n_seeds, len(q)), dtype=np.float16),
        )
        return bare._filled(bare._cells(rows), q)

    def _filled(self, cell: IntArray, values: Lanes) -> ReachMap:
        shape, n_seeds = self._shape, self.config.n_seeds
        n_cells = int(np.prod(shape))
        order = np.lexsort((values[0], cell))
        cells, first, count = np.unique(
            cell[order], return_index=True, return_counts=True
        )
        # Seeds of a cell are spread over the azimuths met, so that one suits the limits
        # of the first joint, and consecutive ones differ.
        share = (np.arange(n_seeds) * _GOLDEN) % 1.0
        pick = first[:, None] + (share * count[:, None]).astype(np.intp)
        seeds = np.zeros((n_cells, n_seeds, len(values)), dtype=np.float16)
        seeds[cells] = values.T[order[pick]]
        is_met = np.zeros(shape, dtype=bool)
        is_met.reshape(-1)[cells] = True
        nearest = ndimage.distance_transform_edt(
            ~is_met, return_distances=False, return_indices=True
        )
        masks = []
        for angle in (values[0], values[-1]):
            bits = np.left_shift(np.uint16(1), sixteenth(angle).astype(np.uint16))
            mask = np.bitwise_or.reduceat(bits[order], first)
            met = np.zeros(n_cells, dtype=np.uint16)
            met[cells] = mask
            masks.append(met.reshape(shape))
        azimuths, turns = masks
        # Close to the first axis the azimuth means nothing; the turn does not where
        # the last axis points inwards.
        azimuths[0] = np.where(is_met[0], ALL_AROUND, azimuths[0])
        rise = (np.arange(shape[2]) + 0.5) * 2.0 / shape[2] - 1.0
        heading = (np.arange(shape[3]) + 0.5) * 2.0 * np.pi / shape[3] - np.pi
        outward = np.sqrt(1.0 - rise * rise)[:, None] * np.cos(heading)
        turns[is_met & (outward < _INWARDS)] = ALL_AROUND
        return replace(
            self,
            azimuths=_grown(azimuths).reshape(-1),
            turns=_grown(turns).reshape(-1),
            seed_cell=np.ravel_multi_index(tuple(nearest), shape).reshape(-1),
            seeds=seeds,
        )

    def require_chain(self, chain: KinematicChain) -> None:
        """Raise `ConfigError` unless the map was built for this chain and limits."""
        if self.chain_hash != chain.hash:
            raise ConfigError(
                "reachability map",
                got=f"one of chain {self.chain_hash}",
                expected=f"chain {chain.hash}",
                mend="Geometry or limits have changed: build it again.",
            )

    @property
    def _shape(self) -> tuple[int, int, int, int]:
        config = self.config
        return (config.n_radius, config.n_height, config.n_rise, config.n_heading)

    def may_reach(self, goals: Goals) -> BoolArray:
        """Which goals (targets) are not ruled out, shape (targets,)."""
        return self.admits(AxisGoals.from_columns(goals.columns))

    def admits(self, goals: AxisGoals) -> BoolArray:
        """As `may_reach`, of goals (k,) already in the radial frame."""
        radius, height = goals.rows[:2]
        cell, is_open = self._cells(goals.rows), radius < self.radius
        is_open &= (height > self.lowest) & (height < self.highest)
        angles = (goals.azimuth, goals.turn)
        for masks, angle, fitting in zip(
            (self.azimuths, self.turns), angles, self.fitting, strict=True
        ):
            is_open &= (masks[cell] & fitting[sixteenth(angle)]) != 0
        return np.asarray(is_open)

    def middles(self, goals: AxisGoals, rank: IntArray) -> Lanes:
        """Values of the joints between first and last to start from.

        Parameters
        ----------
        goals
            Targets (targets).
        rank
            Which of the seeds of each target, the best first; shape (targets,). Best
            are those for which the limits of first and last joint allow.

        Returns
        -------
        Lanes
            Shape (d - 2, targets).
        """
        return self.middles_at(
            self.ranked_seeds(goals)[np.arange(len(rank)), rank % self.config.n_seeds]
        )

    def middles_at(self, seed: IntArray) -> Lanes:
        """Values of the joints between first and last of seeds (n,), (d - 2, n)."""
        flat = self.seeds.reshape(-1, self.seeds.shape[-1])
        picked = flat.take(seed, axis=0)[:, 1:-1]
        return np.ascontiguousarray(picked.T, dtype=np.float32)

    def ranked_seeds(self, goals: AxisGoals) -> IntArray:
        """Which of all seeds suit each target, the best first; (targets, n_seeds)."""
        cell = self.seed_cell[self._cells(goals.rows)]
        first = cell[:, None] * self.config.n_seeds
        wanted = np.stack([goals.azimuth, goals.turn]).astype(np.float32)
        excess = self._outer_excess(wanted, self._seed_ends[:, cell])
        if excess is None:
            return first + np.arange(self.config.n_seeds)
        return first + np.argsort(excess, axis=1, kind="stable")

    @cached_property
    def _seed_ends(self) -> Lanes:
        """First and last joint of all seeds, shape (2, seed cells, n_seeds)."""
        ends = self.seeds[..., [0, -1]].astype(np.float32)
        return np.ascontiguousarray(np.moveaxis(ends, -1, 0))

    def middles_of_one(
        self, rows: Sequence[float], azimuth: float, turn: float
    ) -> list[list[float]]:
        """All seeds of one target, the best first; none if it is ruled out.

        Parameters
        ----------
        rows, azimuth, turn
            What `AxisGoals.of_one` returns.
        """
        radius, height, out, side, up = rows
        if not (radius < self.radius and self.lowest < height < self.highest):
            return []
        cell = 0
        for number, low, high, size in (
            (radius, 0.0, self.radius, self.config.n_radius),
            (height, self.lowest, self.highest, self.config.n_height),
            (up, -1.0, 1.0, self.config.n_rise),
            (math.atan2(side, out), -math.pi, math.pi, self.config.n_heading),
        ):
            place = int((number - low) * (size / (high - low)))
            cell = cell * size + min(max(place, 0), size - 1)
        angles = (azimuth, turn)
        for masks, angle, fitting in zip(
            (self.azimuths, self.turns), angles, self.fitting, strict=True
        ):
            sixteenth = math.floor(angle * (8.0 / math.pi)) % 16
            if not int(masks[cell]) & int(fitting[sixteenth]):
                return []
        seeds = self.seeds[self.seed_cell[cell]].astype(np.float64)
        ends = [seeds[None, :, k] for k in (0, -1)]
        excess = self._outer_excess(np.array([angles]).T, ends)
        if excess is not None:
            seeds = seeds[np.argsort(excess[0], kind="stable")]
        middles: list[list[float]] = seeds[:, 1:-1].tolist()
        return middles

    def _outer_excess(self, wanted: Lanes, ends: Iterable[Lanes]) -> Lanes | None:
        """How far seeds lead the outer joints beyond their limits, (n, n_seeds).

        ``wanted`` are azimuth and turn of the goals, shape (2, n), ``ends`` those of
        the seeds, twice (n, n_seeds). None if the limits keep these joints from no
        direction.
        """
        total: Lanes | None = None
        for angle, seeds, limits in zip(wanted, ends, self.outer_limits, strict=True):
            if has_gap(*limits):
                excess = excess_turn(angle[:, None] - seeds, *limits)
                total = excess if total is None else total + excess
        return total

    def starts(self, chain: KinematicChain, goals: Goals, rank: IntArray) -> Lanes:
        """Whole postures (d, targets) to start from, the outer joints set as well.

        ``rank`` is that of `middles`.
        """
        axis_goals = AxisGoals.from_columns(goals.columns)
        middle = self.middles(axis_goals, rank)
        rows = np.zeros((1, middle.shape[1]), dtype=np.float32)
        q = np.concatenate([rows, middle, rows])
        frames = chain.single_form.frames(q)
        columns = np.stack([frames.x, frames.y, frames.z, frames.p])
        reached = AxisGoals.from_columns(columns)
        q[0] = axis_goals.azimuth - reached.azimuth
        q[-1] = axis_goals.turn - reached.turn
        return chain.clipped(chain.wrapped(q.T)).T.astype(np.float32)

    def _cells(self, rows: Lanes) -> IntArray:
        """Flat cell index of goals (5, n), shape (n,)."""
        radius, height, out, side, up = rows
        numbers = (radius, height, up, np.arctan2(side, out))
        lower = (0.0, self.lowest, -1.0, -np.pi)
        upper = (self.radius, self.highest, 1.0, np.pi)
        cell = np.zeros(rows.shape[1], dtype=np.intp)
        for number, low, high, size in zip(
            numbers, lower, upper, self._shape, strict=True
        ):
            place = ((number - low) * (size / (high - low))).astype(np.intp)
            cell = cell * size + bounded(place, 0, size - 1)
        return cell


def _grown(bits: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Bits of a cell and its neighbours; shape (radius, height, rise, heading)."""
    grown = bits.copy()
    for ambiguous in (grown[0], grown[:, :, 0], grown[:, :, -1]):
        # At radius zero and straight up or down the heading means nothing.
        ambiguous |= np.bitwise_or.reduce(ambiguous, axis=-1, keepdims=True)
    for axis in range(3):
        at = np.moveaxis(grown, axis, 0)
        before = at.copy()
        at[1:] |= before[:-1]
        at[:-1] |= before[1:]
    return grown | np.roll(grown, 1, axis=-1) | np.roll(grown, -1, axis=-1)
