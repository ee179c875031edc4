"""A shape that was measured or meshed: points with normals instead of primitives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, frozen
from debrisgrasp.errors import InputError, ShapeError
from debrisgrasp.geometry import SE3, Bounds, voxel_cells
from debrisgrasp.geometry.neighbors import cell_means

from .surfaces import Patch
from .symmetry import Symmetry

__all__ = ["SIDES", "SPACING", "SurfaceBody", "SurfaceShape"]

SIDES = ("all", "seen")

SPACING = 0.005
"""Distance between the stored points of a surface [m]: finer than a finger is thick, so
that none slips between them."""
_LAYER = SPACING / np.sqrt(2.0)
"""Faces that look the same way and are farther apart than this keep points of their own
[m]: no round measure, so that steps and fins of round ones don't lie on the verge."""
_EQUAL = 1e-5
"""Distances in steps of this [m]: of points equally far away the first is kept."""
_MIN_POINTS = 30
"""With fewer points than this nothing can be told from anything else."""
_MAX_SIZE = 4.0
"""Longest surface [m]; above it, it is millimetres. Meshes of 2 m are within it however
they are turned."""
_CELL = 2.0
"""Cells in which a view is looked at, in spacings of the points: none is empty."""
_KNOWN_DEPTH = 0.03
"""So far behind a surface that was seen from one side it is taken to be solid [m]."""
_AHEAD = 0.5
"""Cosine within which a place behind the surface is taken for inside; farther from
straight behind it, the place may lie beside a border of the surface."""


@dataclass(frozen=True, eq=False)
class SurfaceShape:
    """Surface around a grip, given by points about 5 mm apart."""

    points: FloatArray
    """[m], shape (n, 3)."""
    normals: FloatArray
    """Outward unit normals, shape (n, 3)."""
    sides: str = "seen"
    """``all`` if the surface goes all round the piece, ``seen`` if it is what one
    camera saw of it."""

    def __repr__(self) -> str:
        return f"<SurfaceShape of {len(self.points)} points, sides {self.sides}>"

    def __post_init__(self) -> None:
        for name in ("points", "normals"):
            object.__setattr__(self, name, frozen(getattr(self, name), name, (3,)))
        if self.points.ndim != 2 or self.points.shape != self.normals.shape:
            raise ShapeError(
                "points and normals of a surface",
                got=f"{self.points.shape} and {self.normals.shape}",
                expected="both (n, 3)",
            )
        if len(self.points) < _MIN_POINTS:
            raise InputError(
                "surface",
                got=f"{len(self.points)} points",
                expected=f"at least {_MIN_POINTS}",
                mend="Take a larger piece, or a closer look.",
            )
        if not (np.isfinite(self.points).all() and np.isfinite(self.normals).all()):
            raise InputError(
                "surface", got="values that are not finite", expected="finite numbers"
            )
        size = float(np.ptp(self.points, axis=0).max())
        if not 0.005 <= size <= _MAX_SIZE:
            raise InputError(
                "surface",
                got=f"a size of {size:.4g}",
                expected=f"0.005 to {_MAX_SIZE:g} m",
                mend="Lengths are in metres: 50 mm is 0.05."
                if size > _MAX_SIZE
                else "",
            )
        length = np.linalg.norm(self.normals, axis=1)
        if np.abs(length - 1.0).max() > 0.01:
            raise InputError(
                "normals of a surface",
                got=f"a length of {length[np.abs(length - 1).argmax()]:.3g}",
                expected="unit vectors",
            )
        if self.sides not in SIDES:
            raise InputError(
                "sides of a surface", got=repr(self.sides), expected="all or seen"
            )

    @classmethod
    def thinned(
        cls, points: FloatArray, normals: FloatArray, sides: str = "seen"
    ) -> SurfaceShape:
        """Keep one point for each square of 5 mm, on each side of a thin piece.

        Squares lie across the axis that a normal is closest to. How far along it a face
        lies doesn't matter: in cells, float noise would spread a face on their border
        over two of them, and count it twice.

        Parameters
        ----------
        points, normals
            [m], shapes (n, 3); points without a finite normal are left out.
        """
        usable = np.isfinite(normals).all(axis=1) & np.isfinite(points).all(axis=1)
        points, normals = points[usable], normals[usable]
        axis: IntArray = np.argmax(np.abs(normals), axis=1).astype(np.int64)
        side = 2 * axis + (np.take_along_axis(normals, axis[:, None], 1)[:, 0] > 0)
        groups = [np.flatnonzero(side == number) for number in range(6)]
        kept = [
            group[_chosen(points[group], number // 2)]
            for number, group in enumerate(groups)
        ]
        chosen = np.sort(np.concatenate(kept))
        return cls(points[chosen], normals[chosen], sides)

    def moved(self, T_new_frame: SE3) -> SurfaceShape:
        """Express the surface in another frame."""
        return SurfaceShape(
            T_new_frame.apply(self.points), T_new_frame.rotate(self.normals), self.sides
        )

    def cropped(self, bounds: Bounds) -> SurfaceShape:
        """Keep what lies in a box in its own frame."""
        inside = bounds.contains(self.points)
        return SurfaceShape(self.points[inside], self.normals[inside], self.sides)

    @cached_property
    def body(self) -> SurfaceBody:
        """What lies behind the surface."""
        thickness = np.inf if self.sides == "all" else _KNOWN_DEPTH
        return SurfaceBody(self.points, self.normals, thickness=thickness)

    def parts(self) -> tuple[SurfaceBody, ...]:
        """Return the one body behind the surface."""
        return (self.body,)

    def patches(self) -> tuple[Patch, ...]:
        """Return the surface as one patch that hands out its own points."""

        def at(uv: FloatArray) -> tuple[FloatArray, FloatArray]:
            # Close to the stored density, leaving out some only makes holes.
            few = 1.5 * len(uv) < len(self.points)
            chosen = (
                _spread(self.points, len(uv)) if few else np.arange(len(self.points))
            )
            return self.points[chosen], self.normals[chosen]

        return (Patch(len(self.points) * self.body.spacing**2, at),)

    def symmetry(self) -> Symmetry:
        """Return none: a measured surface isn't taken for more than it is."""
        return Symmetry()


@dataclass(frozen=True, eq=False)
class SurfaceBody:
    """The solid behind a surface, as far as the surface tells."""

    points: FloatArray
    normals: FloatArray
    thickness: float = np.inf
    """How far behind the surface it is taken to be solid [m]."""

    @property
    def is_convex(self) -> bool:
        """False: a measured surface may hide parts of itself."""
        return False

    @cached_property
    def spacing(self) -> float:
        """Distance between neighbouring points [m], from the area that each owns."""
        k = min(7, len(self.points))
        distance = np.asarray(self._tree.query(self.points, k=k)[0])
        owned = np.pi * distance[:, -1] ** 2 / (k - 0.5)
        return max(float(np.sqrt(np.median(owned))), 1e-4)

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.points)

    def signed_distance(self, points: ArrayLike) -> FloatArray:
        """Distance of points (..., 3) to the nearest measured one [m], < 0 behind it.

        Only what is about straight behind the surface counts as behind: beside its
        borders nothing is known.
        """
        points = np.asarray(points, dtype=np.float64)
        distance, nearest = self._tree.query(points)
        offset = points - self.points[nearest]
        along = np.einsum("...i,...i->...", offset, self.normals[nearest])
        is_behind = (along < -_AHEAD * distance) & (distance < self.thickness)
        signed: FloatArray = np.where(is_behind, -distance, distance)
        return signed

    def blocks(self, origins: FloatArray, directions: FloatArray) -> BoolArray:
        """Where rays (d, m) from points of the surface meet other parts of it.

        The surface is drawn into a grid square to each direction, which keeps the point
        farthest ahead in each cell. It hides what it stands ahead of, unless it only
        lies farther up the same slope.
        """
        view = np.arange(len(directions))[:, None]
        u, v = _square_to(directions)
        cell = _CELL * self.spacing
        offset = self.points - self.points.mean(axis=0)
        reach = float(np.linalg.norm(offset, axis=1).max()) + 2 * cell
        n = int(np.ceil(2 * reach / cell)) + 1

        def cells(points: FloatArray) -> IntArray:
            own = points - self.points.mean(axis=0)
            i = np.floor((own * u[view]).sum(-1) / cell + n / 2)
            j = np.floor((own * v[view]).sum(-1) / cell + n / 2)
            flat = np.clip(i, 0, n - 1) * n + np.clip(j, 0, n - 1)
            found: IntArray = flat.astype(np.int64) + n * n * view
            return found

        index = cells(self.points)
        height = directions @ self.points.T
        # Written from the lowest to the highest, so that the highest stays.
        order = np.argsort(height, axis=1)
        top = np.full(len(directions) * n * n, -1)
        top[np.take_along_axis(index, order, axis=1).ravel()] = order.ravel()
        ahead = top[cells(origins)]
        _, nearest = self._tree.query(origins)
        rise = (self.points[ahead] - origins) * self.normals[nearest]
        blocked: BoolArray = (ahead >= 0) & (rise.sum(axis=-1) > self.spacing)
        return blocked


def _chosen(points: FloatArray, axis: int) -> IntArray:
    """Choose the point nearest to the mean of each layer in each column along an axis.

    Parameters
    ----------
    points
        Of surfaces that lie more across the axis than along it [m], shape (n, 3).
    """
    flat, height = points.copy(), points[:, axis]
    flat[:, axis] = 0.0
    column, _ = voxel_cells(flat, SPACING)
    order = np.lexsort((height, column))
    is_next = np.diff(column[order], prepend=-1) > 0
    is_next |= np.diff(height[order], prepend=0.0) > _LAYER
    layer = np.empty(len(points), dtype=np.int64)
    layer[order] = np.cumsum(is_next) - 1
    means = cell_means(points, layer, int(np.count_nonzero(is_next)))
    away = np.linalg.norm(points - means[layer], axis=1)
    # Two alone are equally far from their mean, whatever float noise says.
    order = np.lexsort((np.round(away / _EQUAL), layer))
    found: IntArray = order[np.diff(layer[order], prepend=-1) > 0]
    return found


def _square_to(directions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors square to each direction (d, 3) and to each other."""
    other = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    u = np.cross(directions, other)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    return u, np.cross(directions, u)


def _spread(points: FloatArray, n: int) -> IntArray:
    """Choose n points, each as far from those before as can be; ascending indices."""
    chosen = np.empty(n, dtype=np.int64)
    # From the middle outwards, so that equal surfaces give equal choices.
    away = np.linalg.norm(points - points.mean(axis=0), axis=1)
    chosen[0] = int(np.argmin(away))
    nearest = np.full(len(points), np.inf)
    for i in range(1, n):
        step = points - points[chosen[i - 1]]
        np.minimum(nearest, np.einsum("ij,ij->i", step, step), out=nearest)
        chosen[i] = int(np.argmax(nearest))
    return np.sort(chosen)
