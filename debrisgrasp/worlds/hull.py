"""Convex polytopes, and the builders of those that debris is made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, finite, frozen
from debrisgrasp._checked import checked
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3, Bounds, Box, hull_of

__all__ = ["Hull", "frustum", "prism", "staves"]

_PAIRS_PER_CHUNK = 400_000
_ARC = 48
"""Flat sides of a full turn."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Hull:
    """The convex hull of points; a `debrisgrasp.geometry.Solid`, made by `around`."""

    vertices: FloatArray
    """Corners [m], shape (v, 3)."""
    faces: IntArray
    """Outward-wound triangles, shape (f, 3)."""
    normals: FloatArray
    """Outward unit normals of the flat sides, shape (s, 3)."""
    offsets: FloatArray
    """Distances of the flat sides from the origin along their normals [m], (s,)."""

    def __post_init__(self) -> None:
        for name, trailing, dtype in (
            ("vertices", (None, 3), float),
            ("faces", (None, 3), int),
            ("normals", (None, 3), float),
            ("offsets", (None,), float),
        ):
            array = frozen(getattr(self, name), f"{name} of a hull", trailing, dtype)
            object.__setattr__(self, name, array)

    @classmethod
    def around(cls, points: ArrayLike) -> Hull:
        """Take the smallest convex solid that contains points (n, 3) [m].

        Raises
        ------
        InputError
            If the points aren't finite or span no volume.
        """
        points = finite(points, "points of a hull", (None, 3))
        corners, faces, planes = hull_of(points)
        # Triangles of one flat side share its plane up to rounding.
        _, first = np.unique(planes.round(7), axis=0, return_index=True)
        return cls(corners, faces, planes[first, :3], -planes[first, 3])

    def __repr__(self) -> str:
        """Size and place: all of it would fill a screen."""
        place = self.bounds.lower.round(3).tolist()
        n_corners, n_faces = len(self.vertices), len(self.faces)
        return f"Hull({n_corners} corners, {n_faces} faces, at {place})"

    @property
    def bounds(self) -> Bounds:
        """Smallest axis-aligned box around the solid."""
        return Bounds(self.vertices.min(axis=0), self.vertices.max(axis=0))

    def signed_distance(self, points: ArrayLike) -> FloatArray:
        """Distance of points (..., 3) to the surface [m], negative inside."""
        points = np.asarray(points, dtype=np.float64)
        flat = points.reshape(-1, 3)
        distance: FloatArray = np.max(flat @ self.normals.T - self.offsets, axis=-1)
        outside = np.flatnonzero(distance > 0.0)
        n_parts = 1 + len(outside) * len(self.faces) // _PAIRS_PER_CHUNK
        triangles = self.vertices[self.faces]
        for index in np.array_split(outside, n_parts):
            distance[index] = _distance_to_triangles(flat[index], triangles)
        return distance.reshape(points.shape[:-1])

    def contains(self, points: ArrayLike) -> BoolArray:
        """Which of the points (..., 3) lie inside or on the surface."""
        points = np.asarray(points, dtype=np.float64)
        return np.asarray((points @ self.normals.T <= self.offsets).all(axis=-1))

    def moved(self, T_new_frame: SE3) -> Hull:
        """Express the same solid in another frame, or equally: move it."""
        normals = T_new_frame.rotate(self.normals)
        offsets = self.offsets + normals @ T_new_frame.p
        vertices = T_new_frame.apply(self.vertices)
        return Hull(vertices, self.faces, normals, offsets)

    def mesh(self) -> tuple[FloatArray, IntArray]:
        """Vertices (v, 3) and outward-wound triangles (f, 3)."""
        return self.vertices, self.faces

    def sphere_cover(self, max_radius: float) -> tuple[FloatArray, FloatArray]:
        """Centres (k, 3) and radii (k,) of spheres whose union contains the solid [m].

        None is larger than ``max_radius``.
        """
        low, high = self.bounds.lower, self.bounds.upper
        around = Box((high - low) / 2, SE3.from_parts(p=(high + low) / 2))
        centers, radii = around.sphere_cover(max_radius)
        meets = self.signed_distance(centers) <= radii
        return centers[meets], radii[meets]


@checked
def prism(profile: ArrayLike, length: float) -> Hull:
    """Extrude a convex profile (k, 2) in y and z [m] along x, centred in x."""
    profile = frozen(profile, "profile of a prism", (None, 2))
    ends = [np.insert(profile, 0, side * length / 2, axis=1) for side in (-1, 1)]
    return Hull.around(np.concatenate(ends))


@checked
def frustum(radius_low: float, radius_high: float, low: float, high: float) -> Hull:
    """Return a truncated cone about z between two heights [m]; its sides are flat."""
    ring = _ring(0, _ARC)
    return Hull.around(
        np.concatenate(
            [_at_height(ring * radius_low, low), _at_height(ring * radius_high, high)]
        )
    )


@checked
def staves(
    radii_low: tuple[float, float],
    radii_high: tuple[float, float],
    low: float,
    high: float,
    *,
    count: int = 16,
) -> tuple[Hull, ...]:
    """Build the wall of a hollow truncated cone about z from convex staves.

    The outside has the same sides as `frustum`; inside, every stave is one flat.

    Parameters
    ----------
    radii_low, radii_high
        Inner and outer radius at the lower and at the upper end [m].
    low, high
        Heights of the ends [m].
    count
        Number of staves, a divisor of 48.

    Raises
    ------
    InputError
        If a radius is not above the one inside it, or the number is no divisor.
    """
    for least, most in (radii_low, radii_high):
        if not 0.0 < least < most:
            raise InputError(
                "radii of a wall",
                got=f"{least:g} m inside {most:g} m",
                expected="above 0, and the outer one larger",
            )
    if count < 1 or _ARC % count:
        raise InputError("count of staves", got=count, expected=f"a divisor of {_ARC}")
    parts = []
    for start in range(0, _ARC, _ARC // count):
        outer = _ring(start, start + _ARC // count + 1)
        inner = outer[[0, -1]]
        corners = [
            _at_height(ring * radius, height)
            for radii, height in ((radii_low, low), (radii_high, high))
            for ring, radius in ((inner, radii[0]), (outer, radii[1]))
        ]
        parts.append(Hull.around(np.concatenate(corners)))
    return tuple(parts)


def _ring(start: int, stop: int) -> FloatArray:
    """Points of the unit circle, 48 to the turn, shape (stop - start, 2)."""
    angles = np.arange(start, stop) * (2.0 * np.pi / _ARC)
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def _at_height(ring: FloatArray, height: float) -> FloatArray:
    return np.insert(ring, 2, height, axis=1)


def _distance_to_triangles(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """Distances of points (n, 3) to the nearest of triangles (f, 3, 3), shape (n,)."""
    edges = np.roll(triangles, -1, axis=1) - triangles
    normals = np.cross(edges[:, 0], edges[:, 1])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    offsets = points[:, None, None] - triangles
    along = (offsets * edges).sum(-1) / (edges**2).sum(-1)
    to_edge = np.linalg.norm(
        offsets - np.clip(along, 0.0, 1.0)[..., None] * edges, axis=-1
    ).min(axis=-1)
    inward = np.cross(normals[:, None], edges)
    is_over = ((offsets * inward).sum(-1) >= 0.0).all(axis=-1)
    height = np.abs((offsets[:, :, 0] * normals).sum(-1))
    nearest: FloatArray = np.where(is_over, height, to_edge).min(axis=1)
    return nearest
