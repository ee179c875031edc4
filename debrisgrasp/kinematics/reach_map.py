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

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from debrisgrasp._arrays import BoolArray, IntArray
from debrisgrasp.errors import ConfigError

from .chain import KinematicChain
from .descent import Goals
from .serial import Lanes

__all__ = ["ReachMap", "ReachMapConfig"]


_SEED = 4_198_273_651
"""An unusual number: poses drawn elsewhere from a usual seed must not coincide with the
map's own samples, which would flatter every measurement."""
_CHUNK = 4096
"""Postures evaluated at once while building; keeps the lanes in cache."""


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
            if getattr(self, name) < 1:
                raise ConfigError(
                    f"ReachMapConfig.{name}",
                    got=getattr(self, name),
                    expected="1 or more",
                )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ReachMap:
    """What a chain can reach; depends on the chain only, not on chance."""

    chain_hash: str
    config: ReachMapConfig
    radius: float
    """Largest radius of the map [m]."""
    lowest: float
    highest: float
    """Smallest and largest height of the map [m]."""
    may_reach_cell: BoolArray
    """Cells met by a sample or next to one, shape (cells,)."""
    seed_cell: IntArray
    """Nearest cell that holds seeds, shape (cells,)."""
    seeds: NDArray[np.float32]
    """Azimuth of the point reached, then the joints between first and last [rad or m],
    shape (cells, n_seeds, d - 1); cells with fewer seeds repeat them."""

    @classmethod
    def build(
        cls, chain: KinematicChain, config: ReachMapConfig | None = None
    ) -> ReachMap:
        """Sample the chain's postures and sort them into cells.

        Raises
        ------
        ConfigError
            If the first or last joint is prismatic: then the map needs more numbers.
        """
        config = config or ReachMapConfig()
        if not (chain.is_revolute[0] and chain.is_revolute[-1]):
            raise ConfigError(
                "reachability map",
                got="a chain whose first or last joint is prismatic",
                expected="revolute or continuous joints at both ends",
                mend="Solve without a map.",
            )
        # The map is a property of the chain, so its generator is a constant.
        rng = np.random.default_rng(_SEED)
        q = chain.sampled(config.n_samples, rng=rng).T.astype(np.float32)
        q[0] = q[-1] = 0.0
        four, azimuth = [], []
        for start in range(0, config.n_samples, _CHUNK):
            frames = chain.single_form.frames(q[:, start : start + _CHUNK])
            part, angle = _invariants(frames.p, frames.z)
            four.append(part)
            azimuth.append(angle)
        invariants = np.concatenate(four, axis=1)
        radius, height = invariants[:2]
        # One cell of margin, so that growing the map never meets its border.
        step_r = radius.max() / max(config.n_radius - 1, 1)
        step_z = np.ptp(height) / max(config.n_height - 2, 1)
        bare = cls(
            chain_hash=chain.hash,
            config=config,
            radius=float(radius.max() + step_r),
            lowest=float(height.min() - step_z),
            highest=float(height.max() + step_z),
            may_reach_cell=np.zeros(0, dtype=bool),
            seed_cell=np.zeros(0, dtype=np.intp),
            seeds=np.zeros((0, config.n_seeds, len(q) - 1), dtype=np.float32),
        )
        q[0] = np.concatenate(azimuth)
        return bare._filled(bare._cells(invariants), q[:-1])

    def _filled(self, cell: IntArray, values: Lanes) -> ReachMap:
        shape, n_seeds = self._shape, self.config.n_seeds
        order = np.argsort(cell, kind="stable")
        cells, first, count = np.unique(
            cell[order], return_index=True, return_counts=True
        )
        pick = first[:, None] + np.arange(n_seeds) % np.minimum(count, n_seeds)[:, None]
        seeds = np.zeros((int(np.prod(shape)), n_seeds, len(values)), dtype=np.float32)
        seeds[cells] = values.T[order[pick]]
        is_met = np.zeros(shape, dtype=bool)
        is_met.reshape(-1)[cells] = True
        nearest = ndimage.distance_transform_edt(
            ~is_met, return_distances=False, return_indices=True
        )
        return ReachMap(
            chain_hash=self.chain_hash,
            config=self.config,
            radius=self.radius,
            lowest=self.lowest,
            highest=self.highest,
            may_reach_cell=_grown(is_met).reshape(-1),
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
        invariants, _ = _invariants(goals.columns[3], goals.columns[2])
        radius, height = invariants[:2]
        is_inside = radius < self.radius
        is_inside &= (height > self.lowest) & (height < self.highest)
        is_inside &= self.may_reach_cell[self._cells(invariants)]
        return np.asarray(is_inside)

    def starts(self, chain: KinematicChain, goals: Goals, rank: IntArray) -> Lanes:
        """Joint values (d, targets) to start from, the ``rank``-th best of each goal.

        The first joint turns to the azimuth of the goal; seeds for which its limits
        allow that come first. The last joint takes the turn that fits best.
        """
        invariants, azimuth = _invariants(goals.columns[3], goals.columns[2])
        rows = self.seed_cell[self._cells(invariants)]
        choice = rank % self.config.n_seeds
        if not chain.is_cyclic[0]:
            first = _wrapped(azimuth[:, None] - self.seeds[rows, :, 0])
            excess = np.maximum(chain.lower[0] - first, first - chain.upper[0])
            excess = excess.clip(min=0.0)
            order = np.argsort(excess, axis=1, kind="stable")
            choice = order[np.arange(len(rows)), choice]
        q = np.empty((chain.n_joints, len(rows)), dtype=np.float32)
        picked = self.seeds[rows, choice].T
        q[0] = _wrapped(azimuth - picked[0])
        q[1:-1] = picked[1:]
        q[-1] = 0.0
        frames = chain.single_form.frames(q)
        # Maximise the trace of the remaining rotation over a turn about the last axis.
        want_x, want_y = goals.columns[0], goals.columns[1]
        sine = (want_x * frames.y).sum(axis=0) - (want_y * frames.x).sum(axis=0)
        cosine = (want_x * frames.x).sum(axis=0) + (want_y * frames.y).sum(axis=0)
        q[-1] = np.arctan2(sine, cosine)
        for i in (0, -1):
            if not chain.is_cyclic[i]:
                q[i] = q[i].clip(chain.lower[i], chain.upper[i])
        return q

    def _cells(self, invariants: Lanes) -> IntArray:
        """Flat cell index of invariants (4, n), shape (n,)."""
        lower = np.array([0.0, self.lowest, -1.0, -np.pi])
        upper = np.array([self.radius, self.highest, 1.0, np.pi])
        scale = np.array(self._shape) / (upper - lower)
        cell = np.zeros(invariants.shape[1], dtype=np.intp)
        for k, size in enumerate(self._shape):
            place = ((invariants[k] - lower[k]) * scale[k]).astype(np.intp)
            cell = cell * size + place.clip(0, size - 1)
        return cell


def _invariants(p: Lanes, axis: Lanes) -> tuple[Lanes, Lanes]:
    """Radius, height, rise and heading (4, n) of last axes, and azimuth (n,) [rad].

    ``p`` and ``axis`` (3, n) are in the frame of the first joint, z along its axis.
    """
    radius, azimuth = np.hypot(p[0], p[1]), np.arctan2(p[1], p[0])
    safe = np.maximum(radius, 1e-9)
    c, s = p[0] / safe, p[1] / safe
    outwards = axis[0] * c + axis[1] * s
    sideways = axis[1] * c - axis[0] * s
    heading = np.arctan2(sideways, outwards)
    return np.stack([radius, p[2], axis[2], heading]), azimuth


def _grown(is_met: BoolArray) -> BoolArray:
    """Cells met or next to one that is; shape (radius, height, rise, heading)."""
    met = is_met.copy()
    for ambiguous in (met[0], met[:, :, 0], met[:, :, -1]):
        # At radius zero and straight up or down the heading means nothing.
        ambiguous |= ambiguous.any(axis=-1, keepdims=True)
    ring = np.concatenate([met[..., -1:], met, met[..., :1]], axis=-1)
    grown: BoolArray = ndimage.binary_dilation(
        ring, structure=np.ones((3,) * 4, dtype=bool)
    )
    return grown[..., 1:-1]


def _wrapped(angle: Lanes) -> Lanes:
    turns = np.round(angle / np.float32(2.0 * np.pi))
    return angle - np.float32(2.0 * np.pi) * turns
