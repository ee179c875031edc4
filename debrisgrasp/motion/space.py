"""What an arm must keep out of: measured surfaces, the ground, and unknown space.

Three kinds of space are told apart. *Measured* surfaces and the ground are solid.
*Hidden* space lies behind a measured surface as the camera sees it; nobody knows what
it holds, so it is solid too. In all other directions the camera returned nothing:
beside and behind the robot, where most of its arm is at any time. By default that
counts as free, and with `UnknownSpace.ALL` it is solid within the box around all
measured points.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from enum import Enum
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from debrisgrasp._arrays import (
    BoolArray,
    Float32Array,
    FloatArray,
    IntArray,
    finite,
    require_metres,
    require_range,
)
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import (
    Bounds,
    DistanceField,
    LineOfSight,
    PointCloud,
    Space,
    voxel_downsample,
)

__all__ = ["MotionSpace", "UnknownSpace"]

_UNIT = 1e-3
"""The length of a normal may be so far from 1: 2 mm at 2 m."""
_REACH = 7
"""Cells over which distances are told; more than any covering sphere needs."""


class UnknownSpace(Enum):
    """Which space that was not seen counts as an obstacle."""

    IGNORED = "none of it"
    HIDDEN = "what lies behind measured surfaces"
    ALL = "that, and directions in which nothing was measured"


@dataclass(frozen=True, eq=False, kw_only=True)
class MotionSpace:
    """Obstacles of an arm in the base frame."""

    measured: DistanceField | None
    """Distance to the measured points; None if there are none."""
    unknown: DistanceField | None
    """Distance to the centres of the cells that count as unknown."""
    ground_plane: FloatArray | None
    """(a, b, c, d) with a x + b y + c z + d the height over the ground [m]; None where
    there is no evidence of a ground."""
    opened: Float32Array | None = None
    """Balls (b, 4) of centre and radius [m] in which unknown space counts as free."""

    def __post_init__(self) -> None:
        if self.ground_plane is not None:
            plane = _checked_plane(self.ground_plane)
            object.__setattr__(self, "ground_plane", plane)

    @classmethod
    def build(
        cls,
        cloud: PointCloud,
        sight: LineOfSight | None,
        ground_plane: FloatArray | None,
        *,
        unknown: UnknownSpace = UnknownSpace.HIDDEN,
        spacing: float = 0.02,
        radius: float = 2.0,
    ) -> MotionSpace:
        """Collect the obstacles of a capture.

        Parameters
        ----------
        cloud
            Measured points, base frame.
        sight
            Tells free space from hidden; None: nothing is hidden.
        ground_plane
            Plane of the ground (4,), if there is evidence of one.
        unknown
            Which unknown space is an obstacle.
        spacing
            Cell size [m]; points are thinned to half of it.
        radius
            Points farther than this from the base along any axis are left out [m].
        """
        sight = sight or _NothingHidden()
        cloud.require_frame("base")
        require_range("MotionSpace spacing [m]", spacing, 0.002, 0.1)
        near = Bounds(np.full(3, -radius), np.full(3, radius)).contains(cloud.points)
        kept = np.flatnonzero(near)
        if not len(kept):
            return cls(measured=None, unknown=None, ground_plane=ground_plane)
        kept = kept[voxel_downsample(cloud.points[kept], 0.5 * spacing)]
        thinned = cloud.selected(kept)
        reach = _REACH * spacing
        bounds = Bounds.around(thinned.points, reach)

        def field(points: PointCloud) -> DistanceField:
            return DistanceField.build(
                points, bounds, sight, spacing=spacing, truncation=reach
            )

        measured = field(thinned)
        centers = _unknown_cells(measured, sight, ground_plane, unknown)
        if not len(centers):
            return cls(measured=measured, unknown=None, ground_plane=ground_plane)
        hidden = PointCloud(centers, np.full(centers.shape, np.nan), cloud.viewpoint)
        return cls(measured=measured, unknown=field(hidden), ground_plane=ground_plane)

    @classmethod
    def from_points(
        cls,
        points: FloatArray,
        *,
        ground_plane: FloatArray | None = None,
        spacing: float = 0.02,
    ) -> MotionSpace:
        """Take points (n, 3) in the base frame [m] as obstacles; nothing is unknown.

        Raises
        ------
        ShapeError
            If the points are not (n, 3), or the ground is not (4,).
        InputError
            If one of them is not finite, or they can only be in millimetres; so for
            the ground, or if its normal has another length than 1.
        """
        points = finite(points, "points", (None, 3))
        if len(points):  # what lies far away is no obstacle, but not all of it does
            require_metres("points", points[np.abs(points).max(axis=1).argmin()])
        cloud = PointCloud(points, np.full(points.shape, np.nan), np.zeros(3))
        return cls.build(
            cloud,
            _NothingHidden(),
            ground_plane,
            unknown=UnknownSpace.IGNORED,
            spacing=spacing,
        )

    def with_opened(self, balls: FloatArray) -> MotionSpace:
        """Return the same space with balls (b, 4) in which nothing is unknown [m]."""
        opened = replace(self, opened=balls.astype(np.float32))
        # What was worked out before doesn't depend on them.
        own = {field.name for field in fields(self)}
        opened.__dict__.update({k: v for k, v in vars(self).items() if k not in own})
        return opened

    def without_unknown(self) -> MotionSpace:
        """Return the same space with all that was not seen free."""
        return replace(self, unknown=None, opened=None)

    @cached_property
    def measured_points(self) -> FloatArray:
        """Measured points, thinned [m], shape (n, 3)."""
        return _points(self.measured)

    @cached_property
    def unknown_points(self) -> FloatArray:
        """Centres of unknown cells [m], shape (n, 3)."""
        return _points(self.unknown)

    @cached_property
    def measured_tree(self) -> cKDTree:
        """For neighbours among the measured points."""
        return cKDTree(self.measured_points)

    @cached_property
    def unknown_tree(self) -> cKDTree:
        """For neighbours among the unknown cells."""
        return cKDTree(self.unknown_points)

    def hits(
        self,
        centers: Float32Array,
        radii: Float32Array,
        margin: float,
        *,
        is_strict: bool = False,
    ) -> BoolArray:
        """Whether any of s spheres comes nearer to an obstacle than a margin.

        Parameters
        ----------
        centers
            Of the spheres in n postures, base frame [m], shape (3, s, n).
        radii
            Shape (s, 1) [m].
        margin
            [m].
        is_strict
            Whether every point counts, at the cost of a search for neighbours; else the
            one nearest to the middle of each sphere's cell stands for all.

        Returns
        -------
        BoolArray
            Shape (n,).
        """
        x, y, z = centers
        need = radii + np.float32(margin)
        is_hit: BoolArray = np.any(self.height(x, y, z) < need, axis=0)
        if self.coarse is None:
            return is_hit
        grid, gap = self.coarse
        cell = grid.cell(x, y, z)
        # Far by half the diagonal of a cell more is far for certain; the points of
        # cells are the nearest but for a cell.
        doubt = (1.87 if is_strict else 0.87) * grid.spacing
        near = np.flatnonzero(gap[cell] < need + np.float32(doubt))
        if not len(near):
            return is_hit
        lanes = near % x.shape[1]
        points = centers.reshape(3, -1)[:, near]
        cells, reach = cell.ravel()[near], need[near // x.shape[1], 0]
        is_hit[lanes[_within(self.measured, cells, points, reach)]] = True
        if is_strict:
            open_rows = np.flatnonzero(~is_hit[lanes])
            found, _ = self.measured_tree.query(
                points[:, open_rows].T, distance_upper_bound=float(reach.max())
            )
            is_hit[lanes[open_rows[found < reach[open_rows]]]] = True
        unknown = _within(self.unknown, cells, points, reach)
        if self.opened is not None and unknown.any():
            touched = np.flatnonzero(unknown)
            field = self.unknown
            assert field is not None
            nearest = field.table[field.nearest[cells[touched]], :3]
            unknown[touched[self.is_open(nearest)]] = False
        is_hit[lanes[unknown]] = True
        return is_hit

    def is_open(self, points: FloatArray | Float32Array) -> BoolArray:
        """Whether unknown cells at points (n, 3) were opened, shape (n,)."""
        if self.opened is None:
            return np.zeros(len(points), dtype=bool)
        away = points[:, None] - self.opened[:, :3]
        inside = (away * away).sum(axis=-1) <= self.opened[:, 3] ** 2
        return np.asarray(inside.any(axis=1))

    @cached_property
    def coarse(self) -> tuple[DistanceField, Float32Array] | None:
        """Grid, and the least distance of each cell's centre from any obstacle in it.

        One lookup here tells most spheres that they are far from everything.
        """
        if self.measured is None:
            return None
        gap = self.measured.gap
        if self.unknown is not None:
            gap = np.minimum(gap, self.unknown.gap)
        return self.measured, gap

    def height(self, x: Float32Array, y: Float32Array, z: Float32Array) -> Float32Array:
        """Height of points over the ground [m], endless without one."""
        if self.ground_plane is None:
            return np.full(x.shape, np.inf, dtype=np.float32)
        a, b, c, d = (np.float32(value) for value in self.ground_plane)
        found: Float32Array = a * x + b * y + c * z + d
        return found


def _checked_plane(ground_plane: ArrayLike) -> FloatArray:
    """Plane (4,) of which heights over the ground come out in metres."""
    # Of a NaN nothing is above or below: the ground would be none.
    plane = finite(ground_plane, "ground plane", (4,))
    require_metres("ground plane", plane)
    length = float(np.linalg.norm(plane[:3]))
    if not abs(length - 1.0) <= _UNIT:
        raise InputError(
            "length of the ground plane's normal",
            got=f"{length:.6g}",
            expected="1: else heights over the ground are no metres",
            mend="Divide all four numbers by the length of the first three.",
        )
    return plane


def _within(
    field: DistanceField | None,
    cells: IntArray,
    points: Float32Array,
    reach: Float32Array,
) -> BoolArray:
    """Whether points (3, n) in cells (n,) come nearer to a field's than a reach."""
    if field is None:
        return np.zeros(len(cells), dtype=bool)
    gap = points - field.table[field.nearest[cells], :3].T
    near: BoolArray = (gap * gap).sum(axis=0) < reach * reach
    return near


class _NothingHidden:
    """Sight of somebody who sees everything."""

    def clearance(
        self, x: Float32Array, y: Float32Array, z: Float32Array
    ) -> Float32Array:
        """All points lie in front."""
        shape = np.broadcast_shapes(x.shape, y.shape, z.shape)
        return np.ones(shape, dtype=np.float32)


def _points(field: DistanceField | None) -> FloatArray:
    if field is None:
        return np.zeros((0, 3))
    return field.table[:-1, :3].astype(np.float64)


def _unknown_cells(
    field: DistanceField,
    sight: LineOfSight,
    ground_plane: FloatArray | None,
    unknown: UnknownSpace,
) -> FloatArray:
    """Centres of the cells above the ground that count as obstacles, (n, 3)."""
    if unknown is UnknownSpace.IGNORED:
        return np.zeros((0, 3))
    inner: BoolArray = np.zeros(field.shape, dtype=bool)
    inner[1:-1, 1:-1, 1:-1] = True
    cells = np.flatnonzero((field.space == Space.UNKNOWN) & inner.ravel())
    index = np.stack(np.unravel_index(cells, field.shape), axis=-1)
    centers = field.origin + field.spacing * index
    if ground_plane is not None:
        is_above = centers @ ground_plane[:3] + ground_plane[3] > field.spacing
        centers = centers[is_above]
    if unknown is UnknownSpace.HIDDEN:
        ahead = sight.clearance(*centers.T.astype(np.float32))
        # Cells along a grazing ray are beside the surface rather than behind it.
        centers = centers[ahead < -field.spacing]
    return centers
