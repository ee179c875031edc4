"""A region of space as a grid: nearest measured point, and what was seen to be free.

The grid answers in a few nanoseconds what a KD-tree answers in most of a microsecond.
Distances saturate after a few centimetres, which is all that matching and collision
checks need, and that keeps it cheap to fill.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np

from debrisgrasp._arrays import Float32Array, FloatArray, IntArray, bounded
from debrisgrasp.errors import InputError

from .cloud import Bounds, PointCloud
from .sight import LineOfSight

__all__ = ["MAX_CELLS", "MAX_REACH", "DistanceField", "Space"]

MAX_CELLS = 40_000_000
"""A grid beyond this takes over 500 MB."""
_INDEX_BITS = 24
"""Bits that hold the index of a point while the grid is filled."""
MAX_REACH = 7
"""Largest truncation in cells: its square, thrice, has to fit in the other 8 bits."""
_FAR = 3 * MAX_REACH**2 + 1
_CHUNK = 1 << 16
"""Cells worked on together, few enough for the cache."""


class Space(IntEnum):
    """What is known about a cell."""

    UNKNOWN = 0
    """Never seen: occluded, out of view, or without a measurement."""
    FREE = 1
    """Seen through."""
    MEASURED = 2
    """Within one cell of a measured surface."""


@dataclass(frozen=True, eq=False)
class DistanceField:
    """Truncated distance to the measured points inside a box, base frame."""

    origin: FloatArray
    """Centre of the first cell [m], shape (3,). The outermost layer of cells is a
    border that counts as far from everything, so that lookups need no test."""
    spacing: float
    """Edge length of a cell [m]."""
    shape: tuple[int, int, int]
    """Number of cells along x, y, z, border included."""
    truncation: float
    """Distances saturate here [m]."""
    nearest: IntArray
    """Index of the point nearest to each cell's centre, shape (cells,) in C order;
    ``n`` (one past the last point) where none is nearer than the truncation."""
    table: Float32Array
    """Position and normal of each point, shape (n + 1, 6) [m]; a NaN normal becomes
    zero, the last row stands for no point and lies far away."""
    sight: LineOfSight
    """Tells free from unknown."""

    @classmethod
    def build(
        cls,
        cloud: PointCloud,
        bounds: Bounds,
        sight: LineOfSight,
        *,
        spacing: float = 0.01,
        truncation: float = 0.05,
    ) -> DistanceField:
        """Fill a grid over ``bounds`` with a cloud in the same frame.

        Parameters
        ----------
        cloud
            Measured points; thinned to about one per cell beforehand, or filling takes
            longer than it need.
        bounds
            What the grid covers; points outside but within reach count too.
        sight
            Tells free from unknown.
        spacing, truncation
            Cell size and the distance at which the field saturates [m].

        Raises
        ------
        InputError
            If the grid would have more than 40 million cells, the truncation is more
            than seven of them, or the cloud has more than 16 million points.
        """
        # Rounded, or 7 cells of 5 mm would come out as a little more than 35 mm.
        reach = int(np.ceil(round(truncation / spacing, 6)))
        if not 1 <= reach <= MAX_REACH:
            raise InputError(
                "truncation",
                got=f"{truncation} m",
                expected=f"1 to {MAX_REACH} cells of {spacing} m",
            )
        if len(cloud) >= 1 << _INDEX_BITS:
            raise InputError(
                "cloud",
                got=f"{len(cloud)} points",
                expected=f"fewer than {1 << _INDEX_BITS}",
                mend="Thin it to about one point a cell first.",
            )
        nx, ny, nz = (int(n) for n in np.ceil(bounds.size / spacing) + 3)
        shape = (nx, ny, nz)
        if np.prod(np.array(shape, dtype=float)) > MAX_CELLS:
            raise InputError(
                "region",
                got=f"{bounds.size.round(2).tolist()} m in cells of {spacing} m",
                expected=f"at most {MAX_CELLS} cells",
                mend="Take a smaller region, less room around it or a coarser spacing.",
            )
        origin = bounds.lower - spacing
        nearest = _nearest_points(cloud.points, origin, spacing, shape, truncation)
        table = np.zeros((len(cloud) + 1, 6), dtype=np.float32)
        table[:-1, :3] = cloud.points
        table[:-1, 3:] = np.nan_to_num(cloud.normals)
        table[-1, :3] = 1e3
        return cls(
            origin=origin,
            spacing=spacing,
            shape=shape,
            truncation=truncation,
            nearest=nearest,
            table=table,
            sight=sight,
        )

    @cached_property
    def gap(self) -> Float32Array:
        """Distance from each cell's centre to its nearest point [m], flat.

        At most the truncation.
        """
        return _gaps(self)

    @cached_property
    def space(self) -> np.ndarray:
        """`Space` of each cell, flat, uint8."""
        return _classify(self)

    def cell(self, x: Float32Array, y: Float32Array, z: Float32Array) -> IntArray:
        """Flat index of the cell around each point (n,); outside it, a border cell."""
        index = np.zeros(x.shape, dtype=np.int32)
        for axis, coordinate in enumerate((x, y, z)):
            scaled = coordinate * np.float32(1.0 / self.spacing)
            scaled += np.float32(0.5 - self.origin[axis] / self.spacing)
            scaled = bounded(scaled, 0, self.shape[axis] - 1)
            index *= np.int32(self.shape[axis])
            index += scaled.astype(np.int32)
        return index

    def nearest_index(self, points: FloatArray | Float32Array) -> IntArray:
        """Index of the measured point near each of (..., 3); ``n`` if none is."""
        x, y, z = np.moveaxis(np.asarray(points, np.float32), -1, 0)
        found: IntArray = self.nearest[self.cell(x, y, z)]
        return found

    def distance(self, points: FloatArray | Float32Array) -> Float32Array:
        """Distance to the measured points [m], shape (...), at most the truncation.

        Never less than the true distance, and at most about one cell diagonal more.
        """
        points = np.asarray(points, np.float32)
        delta = points - self.table.take(self.nearest_index(points), axis=0)[..., :3]
        delta *= delta
        # Sums along rows of three are slow.
        distance = np.sqrt(delta[..., 0] + delta[..., 1] + delta[..., 2])
        capped: Float32Array = np.minimum(distance, np.float32(self.truncation))
        return capped

    def space_at(self, points: FloatArray | Float32Array) -> np.ndarray:
        """`Space` around each of the points (..., 3); unknown outside the grid."""
        x, y, z = np.moveaxis(np.asarray(points, np.float32), -1, 0)
        found: np.ndarray = self.space[self.cell(x, y, z)]
        return found


def _nearest_points(
    points: FloatArray,
    origin: FloatArray,
    spacing: float,
    shape: tuple[int, int, int],
    truncation: float,
) -> IntArray:
    """Index of the point nearest to every cell, to the accuracy of a cell.

    A separable distance transform. Within its plane of constant x, every point is
    written into the disc of cells around it, far rings before near ones; then every
    cell takes the least of its neighbours' squared distances along x plus the squared
    step. Squared distance (high 8 bits) and point index (low 24) travel in one integer,
    so that a single `minimum` moves both.
    """
    reach = int(np.ceil(round(truncation / spacing, 6)))
    grid = np.full(shape, np.uint32(_FAR << _INDEX_BITS), dtype=np.uint32)
    _write_discs(grid, points, origin, spacing, reach)
    # Along x every cell looks at its neighbours, a few rows at a time in the cache.
    target = grid.copy()
    n = max(1, _CHUNK // (shape[1] * shape[2]))
    for first in range(0, shape[0], n):
        for step in range(1, reach + 1):
            cost = np.uint32((step * step) << _INDEX_BITS)
            for shift in (-step, step):
                low = max(first, -shift, 0)
                high = min(first + n, shape[0] - max(shift, 0))
                if low < high:
                    out = target[low:high]
                    np.minimum(out, grid[low + shift : high + shift] + cost, out=out)
    del grid
    nothing = np.uint32((reach * reach + 1) << _INDEX_BITS)
    is_far = target >= nothing
    target &= np.uint32((1 << _INDEX_BITS) - 1)
    np.putmask(target, is_far, np.uint32(len(points)))
    nearest = target.view(np.int32)
    for axis in range(3):
        border = np.moveaxis(nearest, axis, 0)
        border[0] = border[-1] = len(points)
    return nearest.ravel()


def _write_discs(
    grid: np.ndarray, points: FloatArray, origin: FloatArray, spacing: float, reach: int
) -> None:
    """Write each point into the cells (y, z) within reach, nearest written last."""
    _, ny, nz = grid.shape
    inside = np.ones(len(points), dtype=bool)
    cells = []
    for coordinate, first, n in zip(points.T, origin, grid.shape, strict=True):
        cell = np.floor((coordinate - first) / spacing + 0.5).astype(np.int64)
        inside &= (cell >= 0) & (cell < n)
        cells.append(cell)
    # Of several points in a cell the first stays: the assignment runs backwards.
    index = np.flatnonzero(inside)[::-1]
    x, y, z = (cell.take(index) for cell in cells)
    place, index = (x * ny + y) * nz + z, index.astype(np.uint32)
    # Nearly all discs lie within the grid and need no test.
    is_inner = (y >= reach) & (y < ny - reach) & (z >= reach) & (z < nz - reach)
    inner, outer = np.flatnonzero(is_inner), np.flatnonzero(~is_inner)
    place_inner, index_inner = place.take(inner), index.take(inner)
    place_outer, index_outer = place.take(outer), index.take(outer)
    y, z = y.take(outer), z.take(outer)
    flat, steps = grid.reshape(-1), np.arange(-reach, reach + 1)
    squared = steps[:, None] ** 2 + steps**2
    for distance in np.unique(squared[squared <= reach * reach])[::-1].tolist():
        cost = np.uint32(distance << _INDEX_BITS)
        value_inner, value_outer = index_inner | cost, index_outer | cost
        for dy, dz in (np.argwhere(squared == distance) - reach).tolist():
            yy, zz = y + dy, z + dz
            ok = np.flatnonzero((yy >= 0) & (yy < ny) & (zz >= 0) & (zz < nz))
            flat[place_outer[ok] + (dy * nz + dz)] = value_outer[ok]
            flat[place_inner + (dy * nz + dz)] = value_inner


def _classify(field: DistanceField) -> np.ndarray:
    """`Space` of every cell, a few slabs at a time so that memory stays bounded."""
    nx, ny, nz = field.shape
    h = np.float32(field.spacing)
    x, y, z = (
        np.float32(first) + h * np.arange(n, dtype=np.float32)
        for first, n in zip(field.origin, field.shape, strict=True)
    )
    space = np.zeros((nx, ny, nz), dtype=np.uint8)
    n = max(1, _CHUNK // (ny * nz))
    for i in range(0, nx, n):
        slab = x[i : i + n, None, None], y[:, None], z
        space[i : i + n] = field.sight.clearance(*slab) > h
    for axis in range(3):
        border = np.moveaxis(space, axis, 0)
        border[0] = border[-1] = Space.UNKNOWN
    # The measured surface itself is found by distance, because along a grazing ray a
    # cell beside the surface is far from it in depth.
    flat = space.ravel()
    flat[field.gap <= field.spacing] = Space.MEASURED
    return flat


def _gaps(field: DistanceField) -> Float32Array:
    """Distance from each cell's centre to its nearest point, where there is one."""
    gap = np.full(field.nearest.size, field.truncation, dtype=np.float32)
    rest = np.flatnonzero(field.nearest < len(field.table) - 1).astype(np.int32)
    index, point = rest, field.nearest[rest]
    squared = np.zeros(len(rest), dtype=np.float32)
    strides = (field.shape[1] * field.shape[2], field.shape[2], 1)
    for axis, stride in enumerate(strides):
        cell = rest // np.int32(stride)
        rest = rest - cell * np.int32(stride)
        offset = cell.astype(np.float32)
        offset *= np.float32(field.spacing)
        offset += np.float32(field.origin[axis])
        offset -= np.ascontiguousarray(field.table[:, axis]).take(point)
        squared += offset * offset
    gap[index] = np.minimum(np.sqrt(squared), np.float32(field.truncation))
    return gap
