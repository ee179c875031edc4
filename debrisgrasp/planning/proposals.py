"""Moves of the Markov chain: small ones around a pose, and jumps led by the data."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray, Rng, require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp.geometry import so3
from debrisgrasp.prototypes import PackedPrototypes

from .annealing import Walkers
from .scene import GraspScene

__all__ = ["Anchors", "GlobalMove", "LocalMove", "MixtureMove"]


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class LocalMove:
    """A Gaussian step in position and rotation, symmetric by construction.

    Both widths shrink linearly over the run, from a coarse look around to the accuracy
    at which a grasp is executed.
    """

    position: tuple[float, float] = (0.02, 0.003)
    """Standard deviation per axis at the start and the end [m]."""
    rotation: tuple[float, float] = (0.15, 0.02)
    """Standard deviation per axis at the start and the end [rad]."""

    def __post_init__(self) -> None:
        for sigma in self.position:
            require_range("LocalMove.position [m]", sigma, 0.0, 1.0)
        for sigma in self.rotation:
            require_range("LocalMove.rotation [rad]", sigma, 0.0, np.pi)

    def moved(self, Ts: FloatArray, progress: float, rng: Rng) -> FloatArray:
        """Step from each pose (k, 4, 4) at ``progress`` in [0, 1] of the run."""
        sigma_p, sigma_r = (
            start + (end - start) * progress
            for start, end in (self.position, self.rotation)
        )
        stepped = Ts.copy()
        stepped[:, :3, 3] += sigma_p * rng.standard_normal((len(Ts), 3))
        turn = so3.exp(sigma_r * rng.standard_normal((len(Ts), 3)))
        stepped[:, :3, :3] = Ts[:, :3, :3] @ turn
        return stepped


@dataclass(frozen=True, slots=True, eq=False)
class Anchors:
    """Points of prototypes that jumps put on points of an object."""

    points: FloatArray
    """In the palm frame [m], shape (p, n, 3)."""
    n_points: IntArray
    """How many of them each prototype has, shape (p,)."""
    frames: FloatArray
    """At each point, shape (p, n, 3, 3): the normal is x, and y is as near to the long
    axis of the prototype (y of the hand) as can be."""
    even: IntArray
    """Rows of points among which all directions of the normal are alike often, shape
    (p, e)."""

    @classmethod
    def of(cls, prototypes: PackedPrototypes) -> Anchors:
        """Prepare those of a dictionary."""
        along = np.broadcast_to(np.array([0.0, 1.0, 0.0]), prototypes.points.shape)
        normals = zip(prototypes.normals, prototypes.mask, strict=True)
        return cls(
            points=prototypes.points,
            n_points=prototypes.mask.sum(axis=1),
            frames=_frame(prototypes.normals, along),
            even=np.array([_evenly_turned(own[mask]) for own, mask in normals]),
        )


class GlobalMove:
    """Put a random point of the prototype on a random point of the object.

    The normals are aligned; half of the time the prototype's long axis (y of the hand)
    is aligned too with the direction in which the object runs there, otherwise the spin
    is uniform. Where the object gives a good match such poses are likely, so the
    density of the proposals grows with the quality; as in the matcher behind the paper
    it is taken to be proportional to it.

    Two of five are drawn so that all directions of the normal are alike often
    (normal-space sampling: Rusinkiewicz and Levoy, "Efficient variants of the ICP
    algorithm", 3DIM 2001): the ends of a bar and the rim of a pipe are few points of
    many, and hold it in place along its length.
    """

    def __init__(
        self,
        scene: GraspScene,
        anchors: Anchors,
        *,
        aligned_share: float = 0.5,
        even_share: float = 0.4,
        spin_sigma: float = 0.15,
        steepest_ascent: float = 0.3,
        tries: int = 3,
    ) -> None:
        normals = scene.cloud.normals[scene.target]
        self._points = scene.cloud.points[scene.target]
        self._frames = _frame(normals, scene.tangents)
        self._even = _evenly_turned(normals)
        self._anchors = anchors
        self._aligned_share, self._spin_sigma = aligned_share, spin_sigma
        self._even_share = even_share
        self._steepest_ascent, self._tries = steepest_ascent, tries

    def sample(self, prototype: IntArray, rng: Rng) -> FloatArray:
        """Draw one pose for each of the prototypes (k,), shape (k, 4, 4).

        Those whose palm faces upwards are drawn again, a few times: a hand that comes
        from below the object meets the ground.
        """
        Ts = self._draw(prototype, rng)
        for _ in range(self._tries - 1):
            upwards = np.flatnonzero(Ts[:, 2, 2] > self._steepest_ascent)
            if not len(upwards):
                break
            Ts[upwards] = self._draw(prototype[upwards], rng)
        return Ts

    def _draw(self, prototype: IntArray, rng: Rng) -> FloatArray:
        k, anchors = len(prototype), self._anchors
        there = rng.integers(len(self._points), size=k)
        index = rng.integers(anchors.n_points[prototype])
        rows = np.flatnonzero(rng.random(k) < self._even_share)
        there[rows] = rng.choice(self._even, len(rows))
        column = rng.integers(anchors.even.shape[1], size=len(rows))
        index[rows] = anchors.even[prototype[rows], column]
        own_frame = anchors.frames[prototype, index]
        R = self._target_frames(there, rng) @ np.swapaxes(own_frame, -1, -2)
        Ts = np.zeros((k, 4, 4))
        Ts[:, 3, 3] = 1.0
        Ts[:, :3, :3] = R
        Ts[:, :3, 3] = (
            self._points[there]
            - (R @ anchors.points[prototype, index, :, None])[..., 0]
        )
        return Ts

    def _target_frames(self, index: IntArray, rng: Rng) -> FloatArray:
        """Frames (normal, tangent, binormal) on the object, spun about the normal."""
        is_aligned = rng.random(index.shape) < self._aligned_share
        flip = np.pi * rng.integers(2, size=index.shape)
        spin = np.where(
            is_aligned,
            flip + self._spin_sigma * rng.standard_normal(index.shape),
            rng.uniform(0.0, 2 * np.pi, index.shape),
        )
        cos, sin = np.cos(spin)[:, None], np.sin(spin)[:, None]
        frames = self._frames[index]
        y, z = frames[..., 1], frames[..., 2]
        frames[..., 1], frames[..., 2] = cos * y + sin * z, cos * z - sin * y
        return frames


@dataclass(frozen=True, slots=True, eq=False)
class MixtureMove:
    """Each walker takes a global move with a falling probability, else a local one."""

    local: LocalMove
    jump: GlobalMove
    prototype: IntArray
    """Which prototype each walker places, shape (k,)."""
    global_share: tuple[float, float]
    """Probability of a global move at the start and at the end of the run."""

    def __call__(
        self, walkers: Walkers, progress: float, rng: Rng
    ) -> tuple[FloatArray, FloatArray]:
        """See `annealing.Proposal`."""
        start, end = self.global_share
        share = start + (end - start) * progress
        is_global = rng.random(walkers.log_quality.shape) < share
        candidates = self.local.moved(walkers.Ts_base_hand, progress, rng)
        candidates[is_global] = self.jump.sample(self.prototype[is_global], rng)
        # A step around the pose is symmetric; jumps find good poses in proportion.
        return candidates, is_global.astype(np.float64)


_DRAWS = 1024
"""Rows of a table to draw points from."""
_DIRECTIONS = np.array(
    [d for d in product((-1.0, 0.0, 1.0), repeat=3) if any(d)], dtype=np.float64
)
_DIRECTIONS /= np.linalg.norm(_DIRECTIONS, axis=1, keepdims=True)
"""To faces, edges and corners of a cube, shape (26, 3): normals next to the same one
have the same direction."""


def _evenly_turned(normals: FloatArray) -> IntArray:
    """Rows of normals (n, 3), each of the directions that there are alike often."""
    direction = np.argmax(normals @ _DIRECTIONS.T, axis=1)
    weight = 1.0 / np.bincount(direction)[direction]
    passed = np.cumsum(weight) / weight.sum()
    rows = np.searchsorted(passed, (np.arange(_DRAWS) + 0.5) / _DRAWS)
    return np.minimum(rows, len(normals) - 1)


def _frame(axis: FloatArray, hint: FloatArray) -> FloatArray:
    """Right-handed frames (..., 3, 3): x along ``axis``, y near ``hint``."""
    y = hint - (hint * axis).sum(-1, keepdims=True) * axis
    length = np.linalg.norm(y, axis=-1, keepdims=True)
    spare = np.where(np.abs(axis[..., :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    other = np.cross(axis, spare)
    other = other / np.maximum(np.linalg.norm(other, axis=-1, keepdims=True), 1e-9)
    y = np.where(length > 1e-3, y / np.maximum(length, 1e-3), other)
    return np.stack([axis, y, np.cross(axis, y)], axis=-1)
