"""The convex hull of a mesh, as a solid."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, frozen
from debrisgrasp.geometry import SE3, Bounds, hull_of

from .spheres import covering_spheres

__all__ = ["Hull"]

_MOST_PLANES = 64
"""Hulls with more faces than this are bounded by planes in fixed directions."""
_SAME_PLANE = 1e-6


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Hull:
    """All points between the given ones.

    Distances are taken to at most 64 planes that enclose the hull: those of its faces,
    or of fixed directions if it has more faces. So they are never more than the true
    distance, and a test made with them never misses a contact.
    """

    points: FloatArray
    """Corners in the solid's own frame [m], shape (v, 3)."""
    T_frame_solid: SE3 = field(default_factory=SE3.identity)
    faces: IntArray = field(init=False)
    """Triangles, wound so that their normals point outwards; shape (f, 3)."""
    planes: FloatArray = field(init=False)
    """Outward unit normals and offsets in the own frame: ``n . x <= d`` inside; shape
    (p, 4)."""
    is_exact: bool = field(init=False)
    """Whether the planes enclose nothing but the hull."""

    def __post_init__(self) -> None:
        points = frozen(self.points, "points of a hull", (None, 3))
        corners, faces, planes = hull_of(points)
        planes = planes * np.array([1.0, 1.0, 1.0, -1.0])
        rounded = np.round(planes / _SAME_PLANE)
        planes = planes[np.unique(rounded, axis=0, return_index=True)[1]]
        is_exact = len(planes) <= _MOST_PLANES
        if not is_exact:
            normals = _directions(_MOST_PLANES)
            offsets = (normals @ corners.T).max(axis=1)
            planes = np.column_stack([normals, offsets])
        for name, value in (
            ("points", corners),
            ("faces", faces),
            ("planes", planes),
            ("is_exact", is_exact),
        ):
            object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        """Size and place: all of it would fill a screen."""
        place = self.T_frame_solid.p.round(3).tolist()
        return f"Hull({len(self.points)} corners, {len(self.faces)} faces, at {place})"

    @property
    def bounds(self) -> Bounds:
        """Smallest axis-aligned box around the solid."""
        corners = self.T_frame_solid.apply(self.points)
        return Bounds(corners.min(axis=0), corners.max(axis=0))

    def signed_distance(self, points: ArrayLike) -> FloatArray:
        """Distance of points (..., 3) to the planes [m]: no more than to the hull."""
        own = self.T_frame_solid.inverse().apply(points)
        normals, offsets = self.planes[:, :3], self.planes[:, 3]
        distance: FloatArray = (own @ normals.T - offsets).max(axis=-1)
        return distance

    def contains(self, points: ArrayLike) -> BoolArray:
        """Which of the points (..., 3) lie behind all planes."""
        return self.signed_distance(points) <= 0.0

    def moved(self, T_new_frame: SE3) -> Hull:
        """Express the same solid in another frame, or equally: move it."""
        other = copy(self)  # the same hull, which need not be found again
        object.__setattr__(other, "T_frame_solid", T_new_frame @ self.T_frame_solid)
        return other

    def mesh(self) -> tuple[FloatArray, IntArray]:
        """Vertices (v, 3) and outward-wound triangles (f, 3)."""
        return self.T_frame_solid.apply(self.points), self.faces

    def sphere_cover(self, max_radius: float) -> tuple[FloatArray, FloatArray]:
        """Spheres of at most ``max_radius`` [m] whose union contains the solid."""
        return covering_spheres(self, np.inf, max_radius)


def _directions(n: int) -> FloatArray:
    """Spread n unit vectors evenly over the sphere, in opposite pairs; (n, 3).

    Six of them are those of the coordinate axes.
    """
    half = n // 2 - 3
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(half)
    z = (np.arange(half) + 0.5) / half
    rho = np.sqrt(1.0 - z * z)
    spiral = np.column_stack([rho * np.cos(turn), rho * np.sin(turn), z])
    some = np.concatenate([np.eye(3), spiral])
    return np.concatenate([some, -some])
