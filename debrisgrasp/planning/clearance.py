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
    require_range,
)
from debrisgrasp.geometry import Space

from .hands import SPHERE_RADIUS, PackedHands
from .scene import GraspScene

__all__ = ["ClearanceConfig", "HandClearance"]


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
        require_range("ClearanceConfig.approach_steps", self.approach_steps, 1)
        require_range("ClearanceConfig.unknown_cost", self.unknown_cost, 0.0, 1.0)


class HandClearance:
    """C of poses, given which prototype's hand each of them carries."""

    def __init__(
        self, scene: GraspScene, hands: PackedHands, config: ClearanceConfig
    ) -> None:
        self._scene, self._hands, self._config = scene, hands, config
        steps = np.linspace(0.0, config.approach, config.approach_steps + 1)
        at_rest = np.zeros(1, dtype=np.float32)
        # A few spheres find most collisions; every further stage sees fewer poses.
        self._stages = (
            (slice(None, None, 4), at_rest),
            (slice(None), at_rest),
            (slice(None), -steps[1:].astype(np.float32)),
        )

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
        config = self._config
        clearance = np.ones(len(Ts_base_hand))
        alive = np.arange(len(Ts_base_hand))
        for spheres, retreats in self._stages:
            Ts, which = Ts_base_hand[alive].astype(np.float32), prototype[alive]
            depth = self._depth(Ts, which, spheres, retreats)
            clear = np.clip(1.0 - (depth - config.allowance) / config.softness, 0, 1)
            clearance[alive] = np.minimum(clearance[alive], clear)
            is_lost = (clearance[alive] <= needed[alive]) | (clearance[alive] <= 0)
            clearance[alive[is_lost]] = 0.0
            alive = alive[~is_lost]
        clearance[alive] *= self.exposure(Ts_base_hand[alive], prototype[alive])
        return clearance

    def exposure(self, Ts_base_hand: FloatArray, prototype: IntArray) -> FloatArray:
        """C of poses known to be clear: the cost of unseen space alone, (k,)."""
        is_unknown = self._is_unknown(Ts_base_hand, prototype)
        parts = self._hands.parts[prototype]
        worst = np.zeros(len(parts))
        for part in range(3):
            is_part = parts == part
            share = (is_unknown & is_part).sum(axis=1) / is_part.sum(axis=1).clip(1)
            np.maximum(worst, share, out=worst)
        cost: FloatArray = 1.0 - self._config.unknown_cost * worst
        return cost

    def is_blind(self, Ts_base_hand: FloatArray, prototype: IntArray) -> BoolArray:
        """Whether a finger ends where the camera saw nothing, shape (k,)."""
        is_finger = self._hands.parts[prototype] > 0
        is_unknown = self._is_unknown(Ts_base_hand, prototype)
        return np.asarray((is_unknown & is_finger).any(axis=1))

    def _is_unknown(self, Ts_base_hand: FloatArray, prototype: IntArray) -> BoolArray:
        """Which spheres' centres lie in space that was never seen, shape (k, s)."""
        x, y, z, _ = self._placed(
            Ts_base_hand.astype(np.float32), prototype, slice(None)
        )
        field = self._scene.field
        return np.asarray(field.space.take(field.cell(x, y, z)) == Space.UNKNOWN)

    def _placed(
        self, Ts: Float32Array, prototype: IntArray, spheres: slice
    ) -> tuple[Float32Array, Float32Array, Float32Array, Float32Array]:
        """Coordinates of the sphere centres, base frame, and radii, each (k, s)."""
        centers = self._hands.centers[:, :, spheres][prototype]
        placed = Ts[:, :3, :3] @ centers + Ts[:, :3, 3:]
        radii = self._hands.radii[:, spheres][prototype]
        return placed[:, 0], placed[:, 1], placed[:, 2], radii

    def _depth(
        self,
        Ts: Float32Array,
        prototype: IntArray,
        spheres: slice,
        retreats: Float32Array,
    ) -> Float32Array:
        """Deepest intrusion of any sphere, at any retreat, into a point [m], (k,)."""
        x, y, z, radii = self._placed(Ts, prototype, spheres)
        ax, ay, az = (Ts[:, i, 2, None] for i in range(3))
        deepest = np.full(len(Ts), -np.inf, dtype=np.float32)
        for retreat in retreats:
            cell = self._scene.field.cell(
                x + retreat * ax, y + retreat * ay, z + retreat * az
            )
            depth = radii - self._scene.clearance.take(cell)
            np.maximum(deepest, depth.max(axis=1), out=deepest)
        return deepest
