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
from debrisgrasp.prototypes import PackedPrototypes

from .scene import GraspScene

__all__ = ["ShapeSimilarity", "SimilarityConfig"]


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

    def __post_init__(self) -> None:
        require_range("SimilarityConfig.sigma", self.sigma, 1e-4, 0.1)
        require_range("SimilarityConfig.normal_sigma", self.normal_sigma, 0.01, 10.0)
        require_range("SimilarityConfig.tangential_gate", self.tangential_gate, 0.0)
        require_range("SimilarityConfig.full_coverage", self.full_coverage, 0.01, 1.0)
        require_range("SimilarityConfig.minimum_seen", self.minimum_seen, 1)


class ShapeSimilarity:
    """S of poses of a dictionary of prototypes in one scene, batched over both."""

    def __init__(
        self,
        scene: GraspScene,
        prototypes: PackedPrototypes,
        config: SimilarityConfig,
        max_points: int | None = None,
    ) -> None:
        self._scene, self._config = scene, config
        rows, kept, is_used = _evenly(prototypes.mask, max_points)
        self._points = _coordinates_first(prototypes.points[rows, kept])
        self._normals = _coordinates_first(prototypes.normals[rows, kept])
        is_visible = np.take_along_axis(prototypes.is_visible, kept[:, None], axis=2)
        self._is_visible = is_visible & is_used[:, None]
        # The fingers close along x of the hand.
        self._is_touched = np.abs(self._normals[:, 0]) > np.float32(0.7)
        self._directions = prototypes.directions.T.astype(np.float32)
        self._viewpoint = scene.cloud.viewpoint.astype(np.float32)

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
        Ts = Ts_base_hand.astype(np.float32)
        R, t = Ts[:, :3, :3], Ts[:, :3, 3]
        is_visible = self._is_visible[prototype, self._nearest_view(R, t)]
        match, is_known = self._match(R, t, prototype)
        is_seen = is_visible & is_known
        match *= is_seen
        seen, similarity = _mean(match, is_seen)
        is_touched = is_seen & self._is_touched[prototype]
        seen_touched, touched = _mean(match * is_touched, is_touched)
        least = self._config.minimum_seen
        has_both = seen_touched >= least
        similarity = np.where(has_both, np.sqrt(similarity * touched), similarity)
        coverage = seen / np.maximum(np.count_nonzero(is_visible, axis=-1), 1)
        trust = np.minimum(coverage / self._config.full_coverage, 1.0)
        similarity = np.where(seen >= least, trust * similarity, 0.0)
        return similarity.astype(np.float32), coverage.astype(np.float32)

    def evidence_of_thickness(
        self, Ts_base_hand: FloatArray, prototype: IntArray
    ) -> Float32Array:
        """Share of the surface facing the palm that was seen and matches, shape (k,).

        That surface joins the two sides which the fingers touch. Where it was not seen,
        nothing tells how thick the object is.
        """
        Ts = Ts_base_hand.astype(np.float32)
        R, t = Ts[:, :3, :3], Ts[:, :3, 3]
        is_visible = self._is_visible[prototype, self._nearest_view(R, t)]
        match, _ = self._match(R, t, prototype)
        faces_palm = self._normals[prototype, 2] < np.float32(-0.7)
        confirmed = (faces_palm & is_visible & (match > np.float32(0.3))).sum(axis=1)
        total = faces_palm.sum(axis=1)
        share: Float32Array = np.where(total > 0, confirmed / total.clip(1), 1.0)
        return share

    def _nearest_view(self, R: Float32Array, t: Float32Array) -> IntArray:
        """Index of the tabulated view nearest to the camera's, shape (k,)."""
        to_camera = (self._viewpoint - t)[:, None] @ R
        # One small product a pose: a single large one would start threads, which cost
        # more than they save on a machine that has other work.
        nearest: IntArray = np.argmax(to_camera @ self._directions, axis=-1)[:, 0]
        return nearest

    def _match(
        self, R: Float32Array, t: Float32Array, prototype: IntArray
    ) -> tuple[Float32Array, BoolArray]:
        """Kernel value of every point, and whether the camera can tell, (k, m)."""
        x, y, z = np.moveaxis(R @ self._points[prototype] + t[..., None], 1, 0)
        nx, ny, nz = np.moveaxis(R @ self._normals[prototype], 1, 0)
        field, config = self._scene.field, self._config
        cell = field.cell(x, y, z)
        row = self._scene.table[field.nearest[cell]]
        dx, dy, dz = x - row[..., 0], y - row[..., 1], z - row[..., 2]
        along = dx * row[..., 3] + dy * row[..., 4] + dz * row[..., 5]
        beside2 = dx * dx + dy * dy + dz * dz - along * along
        cosine = nx * row[..., 3] + ny * row[..., 4] + nz * row[..., 5]
        excess = np.sqrt(np.maximum(beside2, 0)) - np.float32(config.tangential_gate)
        gap2 = along * along + np.square(np.maximum(excess, 0))
        # 1 - cos approximates half the squared angle, so this is a Gaussian in both.
        exponent = gap2 * np.float32(-0.5 / config.sigma**2)
        exponent -= (1 - cosine) * np.float32(1.0 / config.normal_sigma**2)
        match = np.exp(np.maximum(exponent, np.float32(-20))) * row[..., 6]
        # Right behind a face of the object the camera did tell: that face is farther
        # out than the prototype's.
        is_buried = (along < 0) & (excess < 0) & (row[..., 6] > 0)
        is_known = field.space[cell] != Space.UNKNOWN
        return match, is_known | is_buried | (match > np.float32(0.05))


def _mean(match: Float32Array, is_counted: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Count of the points that count, and mean of their match, zero elsewhere; (k,)."""
    count = np.count_nonzero(is_counted, axis=-1)
    return count, match.sum(axis=-1) / np.maximum(count, 1)


def _evenly(
    mask: BoolArray, max_points: int | None
) -> tuple[IntArray, IntArray, BoolArray]:
    """Pick at most ``max_points`` of each prototype's points, evenly over their order.

    Returns
    -------
    rows, columns, is_used
        Indices that broadcast to (p, m'), and which of the picks are real points.
    """
    counts = mask.sum(axis=1, keepdims=True)
    most = int(counts.max()) if max_points is None else max_points
    slot = np.arange(most)
    taken = np.minimum(counts, most)
    columns = np.minimum(slot * counts // np.maximum(taken, 1), counts - 1)
    return np.arange(len(mask))[:, None], columns, slot < taken


def _coordinates_first(vectors: FloatArray) -> Float32Array:
    """Turn (p, m, 3) into a contiguous float32 (p, 3, m)."""
    return np.ascontiguousarray(np.swapaxes(vectors, 1, 2), dtype=np.float32)
