"""Primitive solids: exact distances, meshes to draw, spheres to test in bulk."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import reduce
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import BoolArray, FloatArray, as_floats, frozen
from debrisgrasp.errors import InputError, ShapeError

from ._solid_parts import (
    SphereSet,
    TriangleMesh,
    box_mesh,
    cover_bar,
    cover_box,
    cover_revolved,
    dome_profile,
    revolved_mesh,
)
from .cloud import Bounds
from .se3 import SE3

__all__ = [
    "Box",
    "Capsule",
    "Cylinder",
    "Solid",
    "Sphere",
    "SphereSet",
    "TriangleMesh",
]


class Solid(Protocol):
    """A closed body in some frame; every argument and result is in that frame."""

    @property
    def bounds(self) -> Bounds:
        """Smallest axis-aligned box around the solid."""
        ...

    def signed_distance(self, points: ArrayLike) -> FloatArray:
        """Distance of points (..., 3) to the surface [m], negative inside."""
        ...

    def contains(self, points: ArrayLike) -> BoolArray:
        """Which of the points (..., 3) lie inside or on the surface."""
        ...

    def moved(self, T_new_frame: SE3) -> Solid:
        """Express the same solid in another frame, or equally: move it."""
        ...

    def mesh(self) -> TriangleMesh:
        """Vertices (v, 3) and outward-wound triangles (f, 3); rounds are inscribed."""
        ...

    def sphere_cover(self, max_radius: float) -> SphereSet:
        """Spheres of at most ``max_radius`` [m] whose union contains the solid.

        Returns
        -------
        centers, radii
            Shapes (s, 3) and (s,) [m].
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """A cuboid centred at the origin of its own frame."""

    half_extents: FloatArray
    """Half the edge lengths along x, y and z [m], shape (3,)."""
    T_frame_solid: SE3 = field(default_factory=SE3.identity)

    def __post_init__(self) -> None:
        half = frozen(self.half_extents, "half extents", (3,))
        _require_size("half extents of a box", half)
        _require_single(self.T_frame_solid)
        object.__setattr__(self, "half_extents", half)

    @property
    def bounds(self) -> Bounds:
        """Smallest axis-aligned box around the solid."""
        reach = np.abs(self.T_frame_solid.R) @ self.half_extents
        return Bounds(self.T_frame_solid.p - reach, self.T_frame_solid.p + reach)

    def signed_distance(self, points: ArrayLike) -> FloatArray:
        """Distance of points (..., 3) to the surface [m], negative inside."""
        excess = np.abs(_own(self.T_frame_solid, points)) - self.half_extents
        return _rectangle_distance(excess)

    def contains(self, points: ArrayLike) -> BoolArray:
        """Which of the points (..., 3) lie inside or on the surface."""
        return self.signed_distance(points) <= 0.0

    def moved(self, T_new_frame: SE3) -> Box:
        """Express the same solid in another frame, or equally: move it."""
        return replace(self, T_frame_solid=T_new_frame @ self.T_frame_solid)

    def mesh(self) -> TriangleMesh:
        """Vertices (8, 3) and outward-wound triangles (12, 3)."""
        vertices, faces = box_mesh(self.half_extents)
        return self.T_frame_solid.apply(vertices), faces

    def sphere_cover(self, max_radius: float) -> SphereSet:
        """Spheres of at most ``max_radius`` [m] whose union contains the solid."""
        centers, radii = cover_box(self.half_extents, max_radius)
        return self.T_frame_solid.apply(centers), radii


@dataclass(frozen=True, slots=True, eq=False)
class Sphere:
    """A ball."""

    radius: float
    """Radius [m]."""
    center: FloatArray = field(default_factory=lambda: np.zeros(3))
    """Centre [m], shape (3,)."""

    def __post_init__(self) -> None:
        _require_size("radius of a sphere", (self.radius,))
        object.__setattr__(self, "center", frozen(self.center, "center", (3,)))
        _require_one("center", self.center.shape[:-1])

    @property
    def bounds(self) -> Bounds:
        """Smallest axis-aligned box around the solid."""
        return Bounds(self.center - self.radius, self.center + self.radius)

    def signed_distance(self, points: ArrayLike) -> FloatArray:
        """Distance of points (..., 3) to the surface [m], negative inside."""
        offset = np.asarray(points, dtype=np.float64) - self.center
        distance: FloatArray = np.linalg.norm(offset, axis=-1) - self.radius
        return distance

    def contains(self, points: ArrayLike) -> BoolArray:
        """Which of the points (..., 3) lie inside or on the surface."""
        return self.signed_distance(points) <= 0.0

    def moved(self, T_new_frame: SE3) -> Sphere:
        """Express the same solid in another frame, or equally: move it."""
        return replace(self, center=T_new_frame.apply(self.center))

    def mesh(self) -> TriangleMesh:
        """Vertices (v, 3) and outward-wound triangles (f, 3), inscribed."""
        profile = dome_profile(self.radius, 0.0)
        vertices, faces = revolved_mesh(profile, -self.radius, self.radius)
        return vertices + self.center, faces

    def sphere_cover(self, max_radius: float) -> SphereSet:
        """Spheres of at most ``max_radius`` [m] whose union contains the solid."""
        if self.radius <= max_radius:
            return self.center[None], np.array([self.radius])
        at_origin = Sphere(self.radius)
        centers, radii = cover_revolved(
            at_origin.signed_distance, self.radius, 2 * self.radius, max_radius
        )
        return centers + self.center, radii


@dataclass(frozen=True, slots=True, eq=False)
class Cylinder:
    """A cylinder about z, centred at the origin of its own frame."""

    radius: float
    """Radius [m]."""
    length: float
    """Distance between the flat ends [m]."""
    T_frame_solid: SE3 = field(default_factory=SE3.identity)

    def __post_init__(self) -> None:
        _require_size("radius and length of a cylinder", (self.radius, self.length))
        _require_single(self.T_frame_solid)

    @property
    def bounds(self) -> Bounds:
        """Smallest axis-aligned box around the solid."""
        axis = self.T_frame_solid.R[:, 2]
        across = np.sqrt(np.maximum(1.0 - axis**2, 0.0))
        reach = self.radius * across + self.length / 2 * np.abs(axis)
        return Bounds(self.T_frame_solid.p - reach, self.T_frame_solid.p + reach)

    def signed_distance(self, points: ArrayLike) -> FloatArray:
        """Distance of points (..., 3) to the surface [m], negative inside."""
        return self._own_distance(_own(self.T_frame_solid, points))

    def contains(self, points: ArrayLike) -> BoolArray:
        """Which of the points (..., 3) lie inside or on the surface."""
        return self.signed_distance(points) <= 0.0

    def moved(self, T_new_frame: SE3) -> Cylinder:
        """Express the same solid in another frame, or equally: move it."""
        return replace(self, T_frame_solid=T_new_frame @ self.T_frame_solid)

    def mesh(self) -> TriangleMesh:
        """Vertices (v, 3) and outward-wound triangles (f, 3), inscribed."""
        half = self.length / 2
        profile = np.array([[self.radius, -half], [self.radius, half]])
        vertices, faces = revolved_mesh(profile, -half, half)
        return self.T_frame_solid.apply(vertices), faces

    def sphere_cover(self, max_radius: float) -> SphereSet:
        """Spheres of at most ``max_radius`` [m] whose union contains the solid."""
        row = cover_bar(self.radius, self.length, max_radius)
        centers, radii = row or cover_revolved(
            self._own_distance, self.radius, self.length, max_radius
        )
        return self.T_frame_solid.apply(centers), radii

    def _own_distance(self, points: FloatArray) -> FloatArray:
        rho = np.hypot(points[..., 0], points[..., 1])
        excess = [rho - self.radius, np.abs(points[..., 2]) - self.length / 2]
        return _rectangle_distance(np.stack(excess, axis=-1))


@dataclass(frozen=True, slots=True, eq=False)
class Capsule:
    """All points within ``radius`` of a segment along z, centred at the origin."""

    radius: float
    """Radius [m]."""
    length: float
    """Length of the segment, without the round ends [m]; zero makes a ball."""
    T_frame_solid: SE3 = field(default_factory=SE3.identity)

    def __post_init__(self) -> None:
        _require_size("radius of a capsule", (self.radius,))
        if not (np.isfinite(self.length) and self.length >= 0):
            raise InputError(
                "length of a capsule", got=self.length, expected="a length >= 0 [m]"
            )
        _require_single(self.T_frame_solid)

    @property
    def bounds(self) -> Bounds:
        """Smallest axis-aligned box around the solid."""
        reach = self.radius + self.length / 2 * np.abs(self.T_frame_solid.R[:, 2])
        return Bounds(self.T_frame_solid.p - reach, self.T_frame_solid.p + reach)

    def signed_distance(self, points: ArrayLike) -> FloatArray:
        """Distance of points (..., 3) to the surface [m], negative inside."""
        return self._own_distance(_own(self.T_frame_solid, points))

    def contains(self, points: ArrayLike) -> BoolArray:
        """Which of the points (..., 3) lie inside or on the surface."""
        return self.signed_distance(points) <= 0.0

    def moved(self, T_new_frame: SE3) -> Capsule:
        """Express the same solid in another frame, or equally: move it."""
        return replace(self, T_frame_solid=T_new_frame @ self.T_frame_solid)

    def mesh(self) -> TriangleMesh:
        """Vertices (v, 3) and outward-wound triangles (f, 3), inscribed."""
        half = self.length / 2
        equator = np.array([[self.radius, -half], [self.radius, half]])
        dome = dome_profile(self.radius, self.length)
        dome = dome[np.abs(dome[:, 0] - self.radius) > 1e-9 * self.radius]
        below = dome[:, 1] < 0
        profile = np.concatenate([dome[below], equator[: 1 + (half > 0)], dome[~below]])
        tip = half + self.radius
        vertices, faces = revolved_mesh(profile, -tip, tip)
        return self.T_frame_solid.apply(vertices), faces

    def sphere_cover(self, max_radius: float) -> SphereSet:
        """Spheres of at most ``max_radius`` [m] whose union contains the solid."""
        row = cover_bar(self.radius, self.length, max_radius)
        if row is None:
            total = self.length + 2 * self.radius
            centers, radii = cover_revolved(
                self._own_distance, self.radius, total, max_radius
            )
        else:
            ends = np.zeros((2, 3))
            ends[:, 2] = (-self.length / 2, self.length / 2)
            centers = np.concatenate([row[0], ends])
            radii = np.concatenate([row[1], [self.radius, self.radius]])
        return self.T_frame_solid.apply(centers), radii

    def _own_distance(self, points: FloatArray) -> FloatArray:
        beyond = np.maximum(np.abs(points[..., 2]) - self.length / 2, 0.0)
        rho = np.hypot(points[..., 0], points[..., 1])
        return np.hypot(rho, beyond) - self.radius


def _own(T_frame_solid: SE3, points: ArrayLike) -> FloatArray:
    return T_frame_solid.inverse().apply(points)


def _rectangle_distance(excess: FloatArray) -> FloatArray:
    """Distance from how far each coordinate lies beyond its bound, shape (..., k)."""
    # By columns: reductions over so short an axis are slow.
    columns = [excess[..., i] for i in range(excess.shape[-1])]
    deepest = reduce(np.maximum, columns)
    outside = [np.square(np.maximum(column, 0.0)) for column in columns]
    distance: FloatArray = np.sqrt(reduce(np.add, outside)) + np.minimum(deepest, 0.0)
    return distance


def _require_size(what: str, size: ArrayLike) -> None:
    size = as_floats(size, what, (None,))
    if size.ndim != 1 or not (np.isfinite(size) & (size > 0)).all():
        raise InputError(what, got=size.tolist(), expected="lengths > 0 [m]")


def _require_single(T_frame_solid: SE3) -> None:
    if not isinstance(T_frame_solid, SE3):
        raise InputError(
            "pose of a solid",
            got=type(T_frame_solid).__name__,
            expected="an SE3",
            mend="SE3.from_matrix(matrix) makes one.",
        )
    _require_one("pose", T_frame_solid.batch)


def _require_one(what: str, batch: tuple[int, ...]) -> None:
    if batch:
        raise ShapeError(
            f"{what} of a solid", got=f"a batch of shape {batch}", expected="one"
        )
