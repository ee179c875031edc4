"""The surface of every prototype as each direction of view shows it, in arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import BoolArray, Float32Array, FloatArray, IntArray
from debrisgrasp.prototypes import PackedPrototypes

__all__ = ["VisibleSurfaces"]

_TOUCHED = 0.7
"""Cosine of the angle to the closing axis up to which a finger touches a face."""


@dataclass(frozen=True, slots=True, eq=False)
class VisibleSurfaces:
    """At most m visible points of p prototypes for each of d views, palm frame.

    One row for each prototype and view, so that a pose needs a single lookup and no
    time goes into points that the camera could not see.
    """

    surface: Float32Array
    """Coordinates [m], then normals, of the points of each row, shape (p d, 6, m)."""
    is_used: BoolArray
    """Which entries are points, shape (p d, m)."""
    is_touched: BoolArray
    """Which of them lie on faces that the fingers touch, shape (p d, m)."""
    count: Float32Array
    """How many points each row has, shape (p d,)."""
    palm_share: FloatArray
    """How much of the surface that faces the palm each view shows, shape (p d,); NaN
    for a prototype that has none."""
    directions: Float32Array
    """The views: unit vectors towards the camera, shape (3, d)."""

    @classmethod
    def pack(cls, prototypes: PackedPrototypes, max_points: int) -> VisibleSurfaces:
        """Pick the points of each view evenly over the surface."""
        views = [prototype.visible.is_visible for prototype in prototypes.prototypes]
        p, d = len(views), len(prototypes.directions)
        most = max(int(np.count_nonzero(seen, axis=1).max()) for seen in views)
        m = min(max_points, max(1, most))
        table = np.empty((p, d, 6, m), dtype=np.float32)
        is_used = np.empty((p, d, m), dtype=bool)
        surface = np.concatenate([prototypes.points, prototypes.normals], axis=2)
        columns = np.moveaxis(surface, 1, 2).astype(np.float32)
        for row, is_visible in enumerate(views):
            kept, is_used[row] = _evenly(is_visible, m)
            for column, values in enumerate(columns[row]):
                table[row, :, column] = values.take(kept)
        # The fingers close along x of the hand.
        is_touched = is_used & (np.abs(table[:, :, 3]) > _TOUCHED)
        return cls(
            surface=table.reshape(p * d, 6, m),
            is_used=is_used.reshape(p * d, m),
            is_touched=is_touched.reshape(p * d, m),
            count=is_used.sum(axis=-1, dtype=np.float32).ravel(),
            palm_share=_palm_share(prototypes),
            directions=np.ascontiguousarray(prototypes.directions.T, np.float32),
        )

    def rows(
        self,
        R: Float32Array,
        t: Float32Array,
        prototype: IntArray,
        viewpoint: FloatArray,
    ) -> IntArray:
        """Row for each pose: its prototype in the view nearest to the camera's, (k,).

        Parameters
        ----------
        R, t
            Rotations (k, 3, 3) and positions [m] (k, 3) of the hand.
        viewpoint
            Of the camera [m], in the same frame, shape (3,).
        """
        to_camera = (viewpoint.astype(np.float32) - t)[:, None] @ R
        # One small product a pose: a single large one would start threads, which cost
        # more than they save on a machine that has other work.
        nearest = np.argmax(to_camera @ self.directions, axis=-1)[:, 0]
        row: IntArray = prototype * self.directions.shape[1] + nearest
        return row


def _palm_share(prototypes: PackedPrototypes) -> FloatArray:
    """See `VisibleSurfaces.palm_share`."""
    faces_palm = prototypes.mask & (prototypes.normals[..., 2] < -_TOUCHED)
    total = faces_palm.sum(axis=1).astype(np.float64)
    total[total == 0] = np.nan
    share = []
    for prototype, faces, n in zip(
        prototypes.prototypes, faces_palm, total, strict=True
    ):
        is_visible = prototype.visible.is_visible
        seen = is_visible[:, faces[: is_visible.shape[1]]]
        share.append(np.count_nonzero(seen, axis=1) / n)
    return np.concatenate(share)


def _evenly(is_visible: BoolArray, m: int) -> tuple[IntArray, BoolArray]:
    """Pick at most m visible points of each view (d, n), evenly over their order.

    Returns
    -------
    columns, is_used
        Indices into the n points, and which of the picks are real ones, both (d, m).
    """
    counts = np.count_nonzero(is_visible, axis=1)[:, None]
    taken, slot = np.minimum(counts, m), np.arange(m)
    rank = np.minimum(slot * counts // np.maximum(taken, 1), np.maximum(counts - 1, 0))
    seen = np.append(np.flatnonzero(is_visible) % is_visible.shape[1], 0)
    first = np.cumsum(counts)[:, None] - counts
    columns = np.where(counts > 0, seen.take(first + rank), 0)
    return columns, slot < taken
