"""A labelled cloud, thinned to what questions about contact need."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from debrisgrasp._arrays import FloatArray, IntArray
from debrisgrasp.geometry import PointCloud, hull_volume

from .ground import spread_sample

__all__ = ["LabelledSurface", "Shapes", "inside_box", "main_axes", "quantiles"]

_LARGEST_NOISE = 0.02
"""Error that a point is given at most [m]: farther away all would touch all."""

_RANGE = (0.02, 0.98)
"""Quantiles at which a measure starts and ends: the rest may be flying pixels."""
_OVERLAP_MARGIN = 0.01
"""How far outside the outline of an object still counts as over it [m]."""
_LOW = 0.03
"""Height below which a cell is hardly over the ground [m]."""
_GROUND_CELL = 0.05
"""Edge of the cells in which uneven ground is level [m]."""
_GROUND_POINTS = 20_000
"""About how many points of a cloud the ground is told from."""
_GROUND_BAND = 0.1
"""Unlabelled points farther than this from the ground's plane are not ground [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelledSurface:
    """One point for each label in each cell of a grid; the ground is left out."""

    points: FloatArray
    """Mean of the points in each cell [m], shape (c, 3), in memory axis by axis: boxes
    are sought in it."""
    normals: FloatArray
    """Unit normals towards the viewpoint, zero where unknown, shape (c, 3)."""
    labels: IntArray
    """Ascending labels, from 1, shape (c,)."""
    height: FloatArray
    """Height over the ground below [m], shape (c,)."""
    noise: FloatArray
    """Standard deviation of the measured distance [m], shape (c,)."""
    spacing: FloatArray
    """Distance between neighbouring points of the cloud [m], shape (c,)."""
    measured: FloatArray
    """The labelled points themselves [m], cell by cell, shape (n, 3)."""
    starts: IntArray
    """Where the points of each cell start in ``measured``, and the end, (c + 1,)."""
    viewpoint: FloatArray
    """Position of the sensor [m], shape (3,)."""
    size: float
    """Edge of the cells [m]."""

    @classmethod
    def of(
        cls,
        cloud: PointCloud,
        labels: IntArray,
        ground_plane: FloatArray | None,
        *,
        size: float,
        noise: float,
    ) -> LabelledSurface:
        """Thin a cloud in the base frame, z up.

        Parameters
        ----------
        cloud, labels
            Points, and one label for each, shape (n,); 0 is no object.
        ground_plane
            (a, b, c, d) with a x + b y + c z + d the height over the ground; None:
            z = 0. Ground that was seen near an object goes before the plane.
        size
            Edge of the cells [m].
        noise
            s in sigma = s z^2, the error of the sensor at distance z [1/m].
        """
        keep = np.flatnonzero(labels > 0)
        # Small integers are sorted by their digits, in a fraction of the time.
        own = labels[keep].astype(np.int64)
        digits = own.astype(np.int16) if own.max(initial=0) < 2**15 else own
        by_label = np.argsort(digits, kind="stable")
        keep, own = keep[by_label], own[by_label]
        measured = np.take(cloud.points, keep, axis=0)
        order, starts = _cells(measured, size, own)
        measured = measured.take(order, axis=0)
        points = _means(measured, starts)
        facing = np.nan_to_num(np.take(cloud.normals, keep[order], axis=0))
        normals = _means(facing, starts)
        norm = np.linalg.norm(normals, axis=1, keepdims=True)
        # Normals that cancel belong to no single face.
        normals = np.where(norm > 0.5, normals / np.maximum(norm, 1e-9), 0.0)
        distance = np.linalg.norm(points - cloud.viewpoint, axis=1)
        return cls(
            points=points,
            normals=normals,
            labels=own[order[starts[:-1]]],
            height=_height(points, _spread_unlabelled(cloud, labels), ground_plane),
            noise=np.minimum(noise * distance**2, _LARGEST_NOISE),
            spacing=size / np.sqrt(np.diff(starts)),
            measured=measured,
            starts=starts,
            viewpoint=cloud.viewpoint,
            size=size,
        )

    def cells_of(self, label: int) -> slice:
        """Where the cells of a label are."""
        start, stop = np.searchsorted(self.labels, [label, label + 1])
        return slice(int(start), int(stop))

    def points_in(self, cells: IntArray) -> FloatArray:
        """Measured points in cells (k,) [m], shape (n, 3)."""
        start, count = self.starts[cells], self.starts[cells + 1] - self.starts[cells]
        place = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        points: FloatArray = self.measured.take(np.repeat(start, count) + place, axis=0)
        return points


def inside_box(points: FloatArray, low: FloatArray, high: FloatArray) -> IntArray:
    """Which of the points (n, 3) lie in a box, ascending."""
    index = np.flatnonzero((points[:, 0] > low[0]) & (points[:, 0] < high[0]))
    # What the first axis rules out is most of it, and isn't looked at again.
    for axis in (1, 2):
        along = points[index, axis]
        index = index[(along > low[axis]) & (along < high[axis])]
    return index


def quantiles(values: FloatArray, shares: tuple[float, ...]) -> FloatArray:
    """Quantiles of each row (..., n), shape (..., k): those of numpy, at less expense.

    That of numpy checks and copies for longer than it takes to sort a few hundred.
    """
    ordered = np.sort(values, axis=-1)
    place = np.array(shares) * (values.shape[-1] - 1)
    lower = place.astype(np.int64)
    part, first = place - lower, ordered[..., lower]
    found: FloatArray = first + part * (
        ordered[..., np.ceil(place).astype(np.int64)] - first
    )
    return found


def main_axes(points: FloatArray) -> FloatArray:
    """Principal axes of points (n, 3) as columns, longest first, that one upwards."""
    spread = np.cov(points.T, bias=True) + 1e-12 * np.eye(3)
    axes = np.linalg.eigh(spread)[1][:, ::-1]
    turned: FloatArray = axes * np.where(axes[2, 0] < 0.0, [-1.0, 1.0, 1.0], 1.0)
    return turned


def _cells(
    points: FloatArray, size: float, group: IntArray
) -> tuple[IntArray, IntArray]:
    """Order points (n, d) by the cells that each group of them occupies.

    Returns
    -------
    order, starts
        Of the points, shape (n,), and where each cell starts in it, and the end.
    """
    key = group
    for axis in points.T:
        grid = np.floor(axis / size).astype(np.int64)
        grid -= grid.min(initial=np.iinfo(np.int64).max)
        key = key * (grid.max(initial=0) + 1) + grid
    order = np.argsort(key, kind="stable")
    is_next = np.diff(key[order], prepend=-1, append=-2) != 0
    return order, np.flatnonzero(is_next)


def _spread_unlabelled(cloud: PointCloud, labels: IntArray) -> FloatArray:
    """Pick points without a label from all over the cloud [m], shape (k, 3)."""
    chosen = spread_sample(cloud, _GROUND_POINTS)
    points: FloatArray = cloud.points[chosen[labels[chosen] == 0]]
    return points


def _means(values: FloatArray, starts: IntArray) -> FloatArray:
    """Mean of the values (n, d) of each cell, shape (c, d)."""
    count = np.diff(starts)
    cell = np.repeat(np.arange(len(count)), count)
    sums = [np.bincount(cell, axis, len(count)) for axis in values.T]
    means: FloatArray = (np.stack(sums) / count).T
    return means


def _height(
    points: FloatArray, unlabelled: FloatArray, plane: FloatArray | None
) -> FloatArray:
    """Height over the ground that was seen nearest in the plan, or over its plane."""
    plane = np.array([0.0, 0.0, 1.0, 0.0]) if plane is None else plane
    height: FloatArray = points @ plane[:3] + plane[3]
    rise = unlabelled @ plane[:3] + plane[3]
    is_low = np.abs(rise) < _GROUND_BAND
    if not is_low.any():
        return height
    seen, rise = unlabelled[is_low], rise[is_low]
    group = np.zeros(len(seen), dtype=np.int64)
    order, starts = _cells(seen[:, :2], _GROUND_CELL, group)
    middle = _means(np.column_stack([seen[:, :2], rise])[order], starts)
    away, found = cKDTree(middle[:, :2]).query(
        points[:, :2], distance_upper_bound=4 * _GROUND_CELL
    )
    known, nearest = np.isfinite(away), np.asarray(found)
    height[known] -= middle[nearest[known], 2]
    return height


@dataclass(frozen=True, slots=True, eq=False)
class Shapes:
    """Measures of the visible part of each object; row 0, the ground, is empty."""

    middle: FloatArray
    """Middle of the box along the principal axes [m], shape (s + 1, 3)."""
    extents: FloatArray
    """Edges of that box, longest first [m], shape (s + 1, 3)."""
    axis: FloatArray
    """Unit direction of the longest edge, upwards, shape (s + 1, 3)."""
    low_down: FloatArray
    """Share of its cells that are hardly over the ground, shape (s + 1,)."""
    lowest: FloatArray
    """Height of its lowest cells over the ground [m], shape (s + 1,)."""
    highest: FloatArray
    """Height of its highest cells over the ground [m], shape (s + 1,)."""
    n_cells: IntArray
    """How many cells of it were seen, shape (s + 1,)."""
    foot: FloatArray
    """Middle of its lowest cells [m], shape (s + 1, 3)."""
    hull: FloatArray
    """Volume of the convex hull [m^3], shape (s + 1,)."""
    outlines: tuple[FloatArray | None, ...]
    """Half-planes a x + b y + c <= 0 of its convex outline in the plan, shape (k, 3)
    each; None where it has no area."""

    @classmethod
    def of(cls, surface: LabelledSurface, n: int) -> Shapes:
        """Measure the objects with labels 1 to n."""
        middle, extents = np.zeros((n + 1, 3)), np.zeros((n + 1, 3))
        lowest, highest, foot = np.zeros(n + 1), np.zeros(n + 1), np.zeros((n + 1, 3))
        axis, low_down, hull = np.zeros((n + 1, 3)), np.zeros(n + 1), np.zeros(n + 1)
        outlines: list[FloatArray | None] = [None] * (n + 1)
        for label in range(1, n + 1):
            own = surface.cells_of(label)
            points, height = surface.points[own], surface.height[own]
            if not len(points):
                continue
            mean = points.mean(axis=0)
            axes = main_axes(points)
            along = (points - mean) @ axes
            low, high = quantiles(along.T, _RANGE).T
            axis[label] = axes[:, 0]
            middle[label] = mean + axes @ (low + high) / 2
            low_down[label] = (height < _LOW).mean()
            extents[label] = high - low
            inside = ((along >= low) & (along <= high)).all(axis=1)
            hull[label] = hull_volume(points[inside])
            lowest[label], highest[label] = quantiles(height, _RANGE)
            foot[label] = points[height <= lowest[label] + surface.size].mean(axis=0)
            outlines[label] = _outline(points)
        return cls(
            middle=middle,
            extents=extents,
            axis=axis,
            low_down=low_down,
            lowest=lowest,
            highest=highest,
            n_cells=np.bincount(surface.labels, minlength=n + 1),
            foot=foot,
            hull=hull,
            outlines=tuple(outlines),
        )

    def share_over(self, points: FloatArray, label: int) -> float:
        """Share of points (n, 3) over the outline of an object in the plan."""
        outline = self.outlines[label]
        if outline is None:
            return 0.0
        x, y = points[:, 0], points[:, 1]
        # Most of what isn't over it is beyond one of the first few lines already.
        for a, b, c in outline.tolist():
            inside = a * x + b * y < _OVERLAP_MARGIN - c
            x, y = x[inside], y[inside]
            if not len(x):
                break
        return len(x) / max(len(points), 1)


def _outline(points: FloatArray) -> FloatArray | None:
    try:
        return np.asarray(ConvexHull(points[:, :2]).equations)
    except (QhullError, ValueError):
        return None
