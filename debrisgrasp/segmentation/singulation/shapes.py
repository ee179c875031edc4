"""Place, size and direction of regions, from their sums alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray

from .graph import RegionSum
from .patches import fitted_planes

__all__ = ["Shapes", "covariances", "extents_of"]

_ENTRIES = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def covariances(products: FloatArray, mean: FloatArray) -> FloatArray:
    """Covariances (n, 3, 3) from mean products xx, xy, ... (n, 6) and means (n, 3)."""
    matrix = np.empty((len(mean), 3, 3))
    for k, (i, j) in enumerate(_ENTRIES):
        matrix[:, i, j] = matrix[:, j, i] = products[:, k] - mean[:, i] * mean[:, j]
    return matrix


def _spread_of(regions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean position (n, 3) and covariance (n, 3, 3) of the surface of regions."""
    area = np.maximum(regions[:, [RegionSum.AREA]], 1e-12)
    mean = regions[:, RegionSum.CENTER] / area
    return mean, covariances(regions[:, RegionSum.SPREAD] / area, mean)


def extents_of(regions: FloatArray) -> FloatArray:
    """Edges of the even block with the same spread as each region [m], (n, 3).

    Longest first; ``regions`` has the columns of `RegionSum`.
    """
    variance = np.linalg.eigvalsh(_spread_of(regions)[1])[:, ::-1]
    extents: FloatArray = np.sqrt(12.0 * np.maximum(variance, 1e-8))
    return extents


@dataclass(frozen=True, slots=True, eq=False)
class Shapes:
    """What regions look like; one row each."""

    table: FloatArray
    """All columns, shape (r, 28)."""

    @classmethod
    def of(cls, regions: FloatArray, noise: float) -> Shapes:
        """Measure regions with the columns of `RegionSum`."""
        center, covariance = _spread_of(regions)
        variance, axes = np.linalg.eigh(covariance)
        extents = np.sqrt(12.0 * np.maximum(variance[:, ::-1], 1e-8))
        planes, error = fitted_planes(regions[:, RegionSum.MOMENTS].T, 3.0 * noise**2)
        scale = np.sqrt(np.einsum("ir,ir->r", planes, planes))
        cells = regions[:, RegionSum.CELLS]
        outline = np.maximum(regions[:, RegionSum.OUTLINE], 1.0)
        columns = (
            center,
            extents,
            axes[:, :, 2],
            (planes / scale).T,
            1.0 / scale,
            error,
            regions[:, RegionSum.AREA] / (extents[:, 0] * extents[:, 1]),
            outline / np.sqrt(cells),
            regions[:, [RegionSum.ROW, RegionSum.COLUMN]] / cells[:, None],
            regions[:, RegionSum.INVERSE] / cells,
            covariance.reshape(-1, 9),
        )
        return cls(np.column_stack(columns))

    @staticmethod
    def joint_error(regions: FloatArray, noise: float) -> FloatArray:
        """Squared error of the best plane of regions alone [1/m^2], shape (r,)."""
        return fitted_planes(regions[:, RegionSum.MOMENTS].T, 3.0 * noise**2)[1]

    def replaced(self, into: IntArray, grown: BoolArray, new: Shapes) -> Shapes:
        """Shapes after merging: those that grew are measured anew.

        Parameters
        ----------
        into
            New region of each old one, shape (r,).
        grown
            New regions of several old ones, shape (s,).
        new
            Their shapes.
        """
        table = np.empty((len(grown), self.table.shape[1]))
        table[into] = self.table
        table[grown] = new.table
        return Shapes(table)

    @property
    def center(self) -> FloatArray:
        """Mean position in the camera frame [m], shape (r, 3)."""
        return self.table[:, 0:3]

    @property
    def extents(self) -> FloatArray:
        """Edges of the even block with the same spread [m], longest first, (r, 3)."""
        return self.table[:, 3:6]

    @property
    def axis(self) -> FloatArray:
        """Direction of the longest edge, shape (r, 3)."""
        return self.table[:, 6:9]

    @property
    def normal(self) -> FloatArray:
        """Of the best plane, away from the camera, shape (r, 3)."""
        return self.table[:, 9:12]

    @property
    def height(self) -> FloatArray:
        """Distance of the best plane from the camera [m], shape (r,)."""
        return self.table[:, 12]

    @property
    def error(self) -> FloatArray:
        """Squared error of the best plane [1/m^2], shape (r,)."""
        return self.table[:, 13]

    @property
    def fill(self) -> FloatArray:
        """Area over the product of the two longest edges: low for frames, (r,)."""
        return self.table[:, 14]

    @property
    def raggedness(self) -> FloatArray:
        """Outline over the root of the area in the image, shape (r,)."""
        return self.table[:, 15]

    @property
    def pixel(self) -> FloatArray:
        """Mean row and column [cells], shape (r, 2)."""
        return self.table[:, 16:18]

    @property
    def inverse(self) -> FloatArray:
        """Mean 1/z [1/m], shape (r,)."""
        return self.table[:, 18]

    def ends(self, a: IntArray, b: IntArray) -> FloatArray:
        """How far the nearer and the farther two ends are apart, along b [m], (2, e).

        Both are short where two faces begin and end together.
        """
        axis = self.axis[b]
        apart = np.einsum("ek,ek->e", self.center[b] - self.center[a], axis)
        covariance = self.table[a, 19:28].reshape(-1, 3, 3)
        square = np.einsum("ei,eij,ej->e", axis, covariance, axis)
        half = np.sqrt(3.0 * np.maximum(square, 0.0)) - 0.5 * self.extents[b, 0]
        return np.sort(np.abs([apart - half, apart + half]), axis=0)

    def offset(self, a: IntArray, b: IntArray) -> FloatArray:
        """Larger distance of the middle of one from the plane of the other [m]."""
        a_off = np.einsum("ek,ek->e", self.normal[a], self.center[b]) - self.height[a]
        b_off = np.einsum("ek,ek->e", self.normal[b], self.center[a]) - self.height[b]
        offset: FloatArray = np.maximum(np.abs(a_off), np.abs(b_off))
        return offset

    def aside(self, a: IntArray, b: IntArray) -> FloatArray:
        """Smaller distance of the middle of one from the axis of the other [m]."""
        apart = self.center[b] - self.center[a]
        square = np.einsum("ek,ek->e", apart, apart)
        along = np.maximum(
            np.abs(np.einsum("ek,ek->e", apart, self.axis[a])),
            np.abs(np.einsum("ek,ek->e", apart, self.axis[b])),
        )
        aside: FloatArray = np.sqrt(np.maximum(square - along**2, 0.0))
        return aside
