"""Shape suitability S: does what the camera saw look like the prototype? (Eq. 5).

The paper's Eq. 5 averages a distance between the prototype's visible points and the
cloud, and calls it a similarity. Here each visible point is scored in [0, 1] by a
kernel on its distance to the surface times a kernel on the angle between the normals,
and S is the mean over those visible points about which the camera says anything:

- a point that should be seen but lies in space that was seen to be free scores 0;
- a point right behind a face of the object that was seen scores 0 too;
- a point elsewhere in space that was never seen says nothing, and lowers only the
  coverage;
- a pose none of whose points is visible scores 0.

Where enough was seen of the faces that the fingers touch, S is the geometric mean of
their mean and that of all points: a board's top on a thick pipe won't do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from debrisgrasp._arrays import (
    BoolArray,
    Float32Array,
    FloatArray,
    IntArray,
    finite,
    require_range,
)
from debrisgrasp._checked import checked_fields
from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.geometry import so3

from .matching import Match, match_surface
from .scene import GraspScene
from .surfaces import VisibleSurfaces

__all__ = ["Measure", "ShapeSimilarity", "SimilarityConfig"]

Measure = Callable[[Match, BoolArray, float], FloatArray]
"""Gives S in [0, 1] of k poses, shape (k,): from what was measured next to their points
(k, m), which of these the camera would see, and the width of the kernel [m]."""

_PULL = 2.0
"""Alignment feels the surface from so many times farther away than S does."""
_LONGEST_STEP = 0.03
"""Of one alignment [m]; farther on, other points are nearest."""
_STIFFNESS = 0.05
"""Share of the weight of all points that holds a pose back where nothing guides it."""
_RIGHT_AT = 1.4
"""On a surface that was seen whole, a point is mostly nearer than this [cells]."""
_ARM = 0.05
"""Lever over which a turn is weighed against a shift [m]."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class SimilarityConfig:
    """What counts as a match."""

    sigma: float = 0.008
    """Width of the distance kernel [m]: sensor noise and the step of the dictionary
    (the next diameter is 1-2 cm away). One width for all prototypes, or their scores
    could not be compared."""
    normal_sigma: float = 0.45
    """Width of the kernel on the angle between normals [rad]."""
    tangential_gate: float = 0.018
    """A prototype's point farther than this beside the nearest measured point [m] is
    off the surface even if it lies in its plane; just above the thinning distance."""
    full_coverage: float = 0.5
    """Share of the visible points that must have been seen for full marks."""
    minimum_seen: int = 6
    """Fewer seen points than this can't support a match."""
    measure: Literal["evidence", "distance"] | Measure = "evidence"
    """``"evidence"``: S as in docs/planner.md. ``"distance"``: the paper's (Eq. 5), the
    mean distance d of the visible points to the object, as exp(-d^2 / (2 sigma^2)), to
    compare with: it knows neither normals nor free or unseen space. Or a `Measure` of
    your own. ``score`` is a probability with the first only."""

    def __post_init__(self) -> None:
        if self.measure not in ("evidence", "distance") and not callable(self.measure):
            raise ConfigError(
                "SimilarityConfig.measure",
                got=repr(self.measure),
                expected="evidence or distance, or a function",
            )
        require_range("SimilarityConfig.sigma", self.sigma, 1e-4, 0.1)
        require_range("SimilarityConfig.normal_sigma", self.normal_sigma, 0.01, 10.0)
        require_range(
            "SimilarityConfig.tangential_gate [m]", self.tangential_gate, 0.0, 1.0
        )
        require_range("SimilarityConfig.full_coverage", self.full_coverage, 0.01, 1.0)
        require_range("SimilarityConfig.minimum_seen", self.minimum_seen, 1)


class ShapeSimilarity:
    """S of poses of a dictionary of prototypes in one scene, batched over both."""

    def __init__(
        self, scene: GraspScene, surfaces: VisibleSurfaces, config: SimilarityConfig
    ) -> None:
        self._scene, self._surfaces, self._config = scene, surfaces, config

    def __call__(
        self, Ts_base_hand: FloatArray, prototype: IntArray
    ) -> tuple[Float32Array, Float32Array]:
        """Score poses.

        Parameters
        ----------
        Ts_base_hand
            Homogeneous matrices, shape (k, 4, 4).
        prototype
            Index of the prototype that each pose places, shape (k,).

        Returns
        -------
        similarity, coverage
            S in [0, 1], and the share of the visible points that were seen, (k,).
        """
        S = np.empty(len(prototype), dtype=np.float32)
        coverage = np.empty_like(S)
        # A few poses at a time: their arrays stay in the cache.
        for first in range(0, len(S), _BATCH):
            some = slice(first, first + _BATCH)
            S[some], coverage[some] = self._score(Ts_base_hand[some], prototype[some])
        return S, coverage

    def _score(
        self, Ts_base_hand: FloatArray, prototype: IntArray
    ) -> tuple[Float32Array, Float32Array]:
        look, row = self._look(Ts_base_hand.astype(np.float32), prototype)
        match = self._kernel(look, self._config.sigma)
        # Right behind a face of the object the camera did tell: that face is farther
        # out than the prototype's.
        is_buried = (look.along < 0) & (look.is_target > 0)
        is_buried &= look.beside < np.float32(self._config.tangential_gate)
        is_seen = look.is_known | is_buried | (match > np.float32(0.05))
        is_seen &= self._surfaces.is_used.take(row, axis=0)
        match *= is_seen
        seen, similarity = _mean(match, is_seen)
        is_touched = is_seen & self._surfaces.is_touched.take(row, axis=0)
        seen_touched, touched = _mean(match * is_touched, is_touched)
        least = self._config.minimum_seen
        has_both = seen_touched >= least
        similarity = np.where(has_both, np.sqrt(similarity * touched), similarity)
        coverage = seen / np.maximum(self._surfaces.count[row], 1)
        trust = np.minimum(coverage / self._config.full_coverage, 1.0)
        similarity = np.where(seen >= least, trust * similarity, 0.0)
        measure, sigma = self._config.measure, self._config.sigma
        if measure == "distance":
            similarity = np.exp(-0.5 * (self._mean_distance(look, row) / sigma) ** 2)
        elif callable(measure):
            is_visible = self._surfaces.is_used.take(row, axis=0)
            similarity = _shares(measure(look, is_visible, sigma), len(row))
        return similarity.astype(np.float32), coverage.astype(np.float32)

    def mean_distance(
        self, Ts_base_hand: FloatArray, prototype: IntArray
    ) -> FloatArray:
        """Eq. 5 as the paper prints it: mean distance to the object [m], shape (k,).

        Of the points that the camera could see in that pose, to the nearest measured
        point; at most the truncation of the scene's field, also where the nearest point
        belongs to something else. Smaller is better; it knows neither normals nor free
        space.
        """
        return self._mean_distance(
            *self._look(Ts_base_hand.astype(np.float32), prototype)
        )

    def _mean_distance(self, look: Match, row: IntArray) -> FloatArray:
        farthest = np.float32(self._scene.field.truncation)
        distance = np.sqrt(look.along * look.along + look.beside * look.beside)
        distance = np.where(look.is_target > 0, distance, farthest)
        is_used = self._surfaces.is_used[row]
        total = (np.minimum(distance, farthest) * is_used).sum(axis=1)
        mean: FloatArray = total / np.maximum(self._surfaces.count[row], 1)
        return np.where(self._surfaces.count[row] > 0, mean, farthest)

    def evidence_of_thickness(
        self, Ts_base_hand: FloatArray, prototype: IntArray
    ) -> FloatArray:
        """Share of the surface facing the palm that was seen and matches, shape (k,).

        That surface joins the two sides which the fingers touch. Where it was not seen,
        nothing tells how thick the object is. A face that the camera looks along shows
        a few rows of points, between which a finger finds a way into the object: only
        what lies right at a point was seen.
        """
        look, row = self._look(Ts_base_hand.astype(np.float32), prototype)
        match = self._kernel(look, self._config.sigma)
        match *= look.beside < np.float32(_RIGHT_AT * self._scene.field.spacing)
        faces_palm = self._surfaces.surface[row, 5] < np.float32(-0.7)
        faces_palm &= self._surfaces.is_used[row]
        confirmed = (faces_palm & (match > np.float32(0.3))).sum(axis=1)
        share: FloatArray = confirmed / faces_palm.sum(axis=1).clip(1)
        share *= self._surfaces.palm_share[row]
        share[np.isnan(share)] = 1.0
        return share

    def aligned(self, Ts_base_hand: FloatArray, prototype: IntArray) -> FloatArray:
        """Move each pose (k, 4, 4) one step towards the surface that it resembles.

        One Gauss-Newton step of weighted point-to-plane alignment: every visible point
        is drawn along the normal of the surface next to it. Where the surface leaves
        the pose free to slide it stays put.
        """
        Ts = Ts_base_hand.astype(np.float32)
        look, row = self._look(Ts, prototype)
        weight = self._kernel(look, _PULL * self._config.sigma)
        weight *= self._surfaces.is_used.take(row, axis=0)
        x, y, z = (c - Ts[:, i, 3, None] for i, c in enumerate(look.point))
        nx, ny, nz = look.normal
        J = np.stack(
            [nx, ny, nz, y * nz - z * ny, z * nx - x * nz, x * ny - y * nx], axis=1
        )
        A = (J * weight[:, None]) @ J.transpose(0, 2, 1)
        b = J @ (weight * look.along)[..., None]
        hold = np.diag(np.repeat(np.array([1.0, _ARM**2], dtype=np.float32), 3))
        total = weight.sum(axis=1) + np.float32(1e-3)
        A += np.float32(_STIFFNESS) * total[:, None, None] * hold
        step = -np.linalg.solve(A, b)[..., 0].astype(np.float64)
        length = np.linalg.norm(step[:, :3], axis=1, keepdims=True)
        step *= np.minimum(1.0, _LONGEST_STEP / np.maximum(length, 1e-9))
        moved = Ts_base_hand.copy()
        moved[:, :3, 3] += step[:, :3]
        moved[:, :3, :3] = so3.exp(step[:, 3:]) @ moved[:, :3, :3]
        return moved

    def _look(self, Ts: Float32Array, prototype: IntArray) -> tuple[Match, IntArray]:
        """Match the points that each pose shows, and tell the rows of `surfaces`."""
        R, t = Ts[:, :3, :3], Ts[:, :3, 3]
        row = self._surfaces.rows(R, t, prototype, self._scene.cloud.viewpoint)
        surface = self._surfaces.surface.take(row, axis=0)
        return match_surface(self._scene, surface, R, t), row

    def _kernel(self, look: Match, sigma: float) -> Float32Array:
        config = self._config
        return look.kernel(sigma, config.normal_sigma, config.tangential_gate)


_BATCH = 512
"""Poses scored together."""


def _shares(S: FloatArray, k: int) -> FloatArray:
    """Pass on what a measure of the user's gives of k poses, if it may be S."""
    S = finite(S, "S of the measure", (k,))
    if not ((S >= 0.0) & (S <= 1.0)).all():
        got = f"{S.min():g} to {S.max():g}"
        raise InputError("S of the measure", got=got, expected="numbers in [0, 1]")
    return S


def _mean(match: Float32Array, is_counted: BoolArray) -> tuple[IntArray, FloatArray]:
    """Count of the points that count, and mean of their match, zero elsewhere; (k,)."""
    # Exact as a product of floats, which is several times as fast as a sum of bools.
    ones = np.ones(is_counted.shape[-1], dtype=np.float32)
    count = (is_counted.astype(np.float32) @ ones).astype(np.int64)
    return count, match.sum(axis=-1) / np.maximum(count, 1)
