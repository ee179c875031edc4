"""The graph of regions: sums over regions and borders that merging only adds up."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray

__all__ = ["BorderSum", "RegionGraph", "RegionSum"]


class RegionSum:
    """Columns of the sums over a region."""

    CELLS = 0
    """Cells; nine more columns complete the moments of `PlanarPatches`."""
    MOMENTS = slice(0, 10)
    INVERSE = 3
    """1/z [1/m]."""
    CENTER = slice(10, 13)
    """Position in the camera frame times seen area [m^3]."""
    SPREAD = slice(13, 19)
    """Products xx, xy, xz, yy, yz, zz of positions times seen area [m^4]."""
    AREA = 19
    """Area of the surface [m^2]."""
    OUTLINE = 20
    """Pairs of neighbouring cells across the outline."""
    ON_GROUND = 21
    """Of these, pairs that touch what was taken away as ground."""
    UNKNOWN = 22
    """Of these, pairs whose other cell was not measured, or lies off the image."""
    ROW = 23
    COLUMN = 24
    OF_INTEREST = 25
    """Cells that somebody marked."""
    COLOR = slice(26, 29)
    """Red, green, blue in [0, 1]."""
    COUNT = 29


class BorderSum:
    """Columns of the sums over the cell pairs at which regions a and b meet."""

    LENGTH = 0
    """Pairs of neighbouring cells."""
    TOUCHING = 1
    """Of these, pairs at which the surfaces touch; the others are jumps in depth."""
    A_NEARER = 2
    B_NEARER = 3
    JUMP = 4
    """Of depth [m], over the jumps. All that follow are sums over touching pairs."""
    STEP = 5
    """Distance between the planes along the ray [m]."""
    OFFSET = 6
    """Distance between the planes at a right angle to them [m]."""
    OPENING = 7
    """How far the planes bend away from the camera, positive if convex [m]."""
    ANGLE = 8
    """Between the planes [rad]."""
    CONCAVE_ANGLE = 9
    """The same where the planes bend towards the camera, else 0 [rad]."""
    SMOOTH = 10
    """1 where a pair alone would join, -1 where it would not."""
    RISE = 11
    """Sine of the elevation of b over a."""
    PLACE = slice(12, 15)
    """Position in the camera frame [m]."""
    SPREAD = slice(15, 21)
    """Products xx, xy, xz, yy, yz, zz of positions [m^2]."""
    CUT = 21
    """1 where a face was cut between bars that lie flush."""
    COUNT = 22


_SWAPPED = np.arange(BorderSum.COUNT)
_SWAPPED[[BorderSum.A_NEARER, BorderSum.B_NEARER]] = (
    BorderSum.B_NEARER,
    BorderSum.A_NEARER,
)


@dataclass(frozen=True, slots=True, eq=False)
class RegionGraph:
    """Regions of an image of cells and the pairs of them that may be one object."""

    regions: FloatArray
    """Columns of `RegionSum`, shape (r, RegionSum.COUNT)."""
    edges: IntArray
    """Pairs (a, b), a < b, ascending, shape (e, 2)."""
    borders: FloatArray
    """Columns of `BorderSum`, zero for pairs apart, shape (e, BorderSum.COUNT)."""
    labels: IntArray
    """Region of each cell, -1 ground, -2 unknown, shape (h, w)."""

    def __len__(self) -> int:
        return len(self.regions)

    @classmethod
    def of_pairs(
        cls,
        regions: FloatArray,
        ends: IntArray,
        sums: FloatArray,
        labels: IntArray,
    ) -> RegionGraph:
        """Sum what was measured at single pairs (k, 2), whichever way they point."""
        a, b = ends.T
        n = len(regions)
        turned = a > b
        sums[turned] = sums[turned][:, _SWAPPED]
        sums[turned, BorderSum.RISE] *= -1.0
        keys = np.minimum(a, b) * np.int64(n) + np.maximum(a, b)
        order = np.argsort(keys, kind="stable")
        keys = keys[order]
        starts = np.flatnonzero(np.diff(keys, prepend=-1))
        if not len(starts):
            return cls(regions, np.empty((0, 2), np.int64), sums[:0], labels)
        edges = np.stack(np.divmod(keys[starts], n), axis=1)
        borders = np.add.reduceat(sums[order], starts, axis=0)
        return cls(regions, edges, borders, labels)

    def unmarked(self) -> RegionGraph:
        """Graph of the same regions, as if nobody had marked any."""
        regions = self.regions.copy()
        regions[:, RegionSum.OF_INTEREST] = 0.0
        return replace(self, regions=regions)

    def merged(self, into: IntArray) -> RegionGraph:
        """Graph of larger regions, given the one of each region, shape (r,)."""
        order = np.argsort(into, kind="stable")
        starts = np.flatnonzero(np.diff(into[order], prepend=-1))
        regions = np.add.reduceat(self.regions[order], starts, axis=0)
        ends = into[self.edges]
        apart = ends[:, 0] != ends[:, 1]
        # The last places answer for ground and unknown.
        labels = np.append(into, [-2, -1])[self.labels]
        return RegionGraph.of_pairs(regions, ends[apart], self.borders[apart], labels)

    def with_pairs(self, pairs: IntArray) -> tuple[RegionGraph, BoolArray]:
        """Add pairs (k, 2), a < b, that don't meet; also which edges are new, (e,)."""
        n = len(self)
        known = self.edges @ np.array([n, 1])
        added = np.setdiff1d(pairs @ np.array([n, 1]), known)
        keys = np.concatenate([known, added])
        order = np.argsort(keys, kind="stable")
        borders = np.zeros((len(keys), BorderSum.COUNT))
        borders[: len(known)] = self.borders
        graph = RegionGraph(
            regions=self.regions,
            edges=np.stack(np.divmod(keys[order], n), axis=1),
            borders=borders[order],
            labels=self.labels,
        )
        return graph, order >= len(known)
