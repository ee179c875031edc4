"""Collision term C: is there room for the hand, and for its way in? (section 5.3).

During the search the hand at its open preshape is a set of spheres, looked up in the
distance field at the final pose and along the straight approach. The spheres cover the
hand's solids, so a pose that they clear is clear; poses that they just touch are
settled later (`inspection`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import (
    BoolArray,
    Float32Array,
    FloatArray,
    IntArray,
    bounded,
    require_range,
)
from debrisgrasp._checked import checked_fields
from debrisgrasp.geometry import Space

from .hands import SPHERE_RADIUS, PackedHands
from .scene import GraspScene

__all__ = ["ClearanceConfig", "HandClearance"]

_UNKNOWN = np.uint8(Space.UNKNOWN)


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class ClearanceConfig:
    """How much contact the search tolerates."""

    allowance: float = 0.012
    """Depth that a covering sphere may dip into a measured surface [m]: what the
    spheres stand out over the solids that they cover."""
    softness: float = 0.012
    """Further depth over which C falls from 1 to 0 [m]; gives the search a slope. Both
    together must stay below the radius of the spheres (`SPHERE_RADIUS`)."""
    approach: float = 0.12
    """Length of the straight approach along the palm's axis [m]."""
    approach_steps: int = 3
    """Poses checked along it during the search, besides the final one."""
    unknown_cost: float = 0.3
    """What C loses when the palm, or the fingers of one side, are wholly in space that
    was never seen: there the object may be thicker than its prototype. 0 ignores
    unknown space as the paper does."""

    def __post_init__(self) -> None:
        require_range("ClearanceConfig.allowance", self.allowance, 0.0, SPHERE_RADIUS)
        deepest = SPHERE_RADIUS - self.allowance
        require_range("ClearanceConfig.softness", self.softness, 1e-4, deepest)
        require_range("ClearanceConfig.approach", self.approach, 0.0, 1.0)
        require_range("ClearanceConfig.approach_steps", self.approach_steps, 1, 100)
        require_range("ClearanceConfig.unknown_cost", self.unknown_cost, 0.0, 1.0)


class HandClearance:
    """C of poses, given which prototype's hand each of them carries."""

    def __init__(
        self, scene: GraspScene, hands: PackedHands, config: ClearanceConfig
    ) -> None:
        self._scene, self._hands, self._config = scene, hands, config
        field = scene.field
        steps = np.linspace(0.0, config.approach, config.approach_steps + 1)[1:]
        self._retreats = (-steps / field.spacing).astype(np.float32)
        self._per_cell = np.float32(1.0 / field.spacing)
        self._first = (0.5 - field.origin / field.spacing).astype(np.float32)
        self._last = np.array(field.shape, dtype=np.float32)[:, None] - 1
        is_part = hands.parts[..., None] == np.arange(3)
        of_each = is_part.sum(axis=1, keepdims=True).clip(1)
        self._shares = (is_part / of_each).astype(np.float32)

    def __call__(
        self, Ts_base_hand: FloatArray, prototype: IntArray, needed: FloatArray
    ) -> FloatArray:
        """Score poses by the spheres that cover the hand.

        Parameters
        ----------
        Ts_base_hand
            Homogeneous matrices, shape (k, 4, 4).
        prototype
            Index of the prototype, and so of the preshaped hand, of each, shape (k,).
        needed
            Least C that matters, shape (k,).

        Returns
        -------
        FloatArray
            C in [0, 1], shape (k,); 0 where it is provably below what is needed.
        """
        Ts = Ts_base_hand.astype(np.float32)
        clearance, everyone = np.ones(len(Ts)), np.arange(len(Ts))
        placed = self._placed(Ts, prototype)
        cells = self._cell(placed)
        depth = self._depth(cells, prototype)
        # The way in, several times the work, is looked at only where the hand fits.
        fits = self._passing(clearance, everyone, depth, needed)
        which, placed = prototype[fits], placed[fits]
        depth = np.full(len(fits), -np.inf, dtype=np.float32)
        for step in self._retreats:
            on_the_way = placed + (step * Ts[fits, :3, 2])[..., None]
            met = self._depth(self._cell(on_the_way), which)
            np.maximum(depth, met, out=depth)
        kept = self._passing(clearance, fits, depth, needed)
        alive, which = fits[kept], which[kept]
        unseen = self._unseen(cells[alive], which)
        clearance[alive] *= 1.0 - self._config.unknown_cost * unseen
        return clearance

    def _passing(
        self,
        clearance: FloatArray,
        alive: IntArray,
        depth: Float32Array,
        needed: FloatArray,
    ) -> IntArray:
        """Lower the clearance (n,) of some poses (k,); tell which still matter."""
        config = self._config
        clear = bounded(1.0 - (depth - config.allowance) / config.softness, 0, 1)
        clear = np.minimum(clearance[alive], clear)
        is_lost = (clear <= needed[alive]) | (clear <= 0)
        clearance[alive] = np.where(is_lost, 0.0, clear)
        return np.flatnonzero(~is_lost)

    def unseen(self, Ts_base_hand: FloatArray, prototype: IntArray) -> FloatArray:
        """Share of palm or fingers of a side in space that was never seen, (k,).

        Of the three the largest share; 0 if unseen space costs nothing.
        """
        if self._config.unknown_cost == 0.0:
            return np.zeros(len(prototype))
        placed = self._placed(Ts_base_hand.astype(np.float32), prototype)
        return self._unseen(self._cell(placed), prototype)

    def is_blind(self, Ts_base_hand: FloatArray, prototype: IntArray) -> BoolArray:
        """Whether a finger ends where the camera saw nothing, shape (k,)."""
        ends = self._hands.ends.take(prototype, axis=0)
        placed = self._in_grid(Ts_base_hand.astype(np.float32), ends)
        return np.asarray(self._is_unknown(self._cell(placed)).any(axis=1))

    def _unseen(self, cells: IntArray, prototype: IntArray) -> FloatArray:
        """See `unseen`, for spheres whose cells (k, s) are known."""
        is_unknown = self._is_unknown(cells).astype(np.float32)
        shares = is_unknown[:, None] @ self._shares.take(prototype, axis=0)
        worst: FloatArray = shares[:, 0].max(axis=1).astype(np.float64)
        return worst

    def _is_unknown(self, cells: IntArray) -> BoolArray:
        """Which cells (k, s) lie in space that was never seen."""
        return np.asarray(self._scene.field.space.take(cells) == _UNKNOWN)

    def _placed(self, Ts: Float32Array, prototype: IntArray) -> Float32Array:
        """Centres of spheres as coordinates in the grid [cells], shape (k, 3, s)."""
        return self._in_grid(Ts, self._hands.centers.take(prototype, axis=0))

    def _in_grid(self, Ts: Float32Array, centers: Float32Array) -> Float32Array:
        """Places of the hand (k, 3, s) as coordinates in the grid [cells]."""
        R = np.asarray(Ts[:, :3, :3] * self._per_cell, dtype=np.float32)
        placed: Float32Array = R @ centers
        placed += (Ts[:, :3, 3] * self._per_cell + self._first)[..., None]
        return placed

    def _cell(self, placed: Float32Array) -> IntArray:
        """Flat index of the cell around each place (k, 3, s), shape (k, s)."""
        inside = np.maximum(placed, 0)
        np.minimum(inside, self._last, out=inside)
        cell = inside.astype(np.int32)
        _, ny, nz = self._scene.field.shape
        index: IntArray = cell[:, 0] * np.int32(ny)
        index += cell[:, 1]
        index *= np.int32(nz)
        index += cell[:, 2]
        return index

    def _depth(self, cells: IntArray, prototype: IntArray) -> Float32Array:
        """Deepest intrusion of a sphere, by its cell (k, s), into a point [m], (k,)."""
        depth = self._hands.radii.take(prototype, axis=0)
        depth -= self._scene.clearance.take(cells)
        deepest: Float32Array = depth.max(axis=1)
        return deepest
