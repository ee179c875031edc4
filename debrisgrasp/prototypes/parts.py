"""Solid parts of shapes: where they are, and which lines of sight they block."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import BoolArray, FloatArray

__all__ = ["Body", "Part", "Tube", "box_part", "rod_part"]


class Body(Protocol):
    """What is solid, and what it hides."""

    @property
    def is_convex(self) -> bool:
        """Whether it hides nothing of itself that faces the camera."""
        ...

    def signed_distance(self, points: ArrayLike) -> FloatArray:
        """Distance of points (..., 3) [m], negative inside."""
        ...

    def blocks(self, origins: FloatArray, directions: FloatArray) -> BoolArray:
        """Where rays of each direction (d, 3) from each origin (m, 3) meet the body.

        Only what is ahead of the origins counts; shape (d, m).
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Tube:
    """An infinite round bar."""

    point: FloatArray
    """Some point of the axis [m], shape (3,)."""
    axis: FloatArray
    """Unit direction of the axis, shape (3,)."""
    radius: float

    def signed_distance(self, points: FloatArray) -> FloatArray:
        """Distance of points (..., 3) to the surface [m], negative inside."""
        offset = points - self.point
        across = offset - (offset @ self.axis)[..., None] * self.axis
        distance: FloatArray = np.linalg.norm(across, axis=-1) - self.radius
        return distance

    def interval(
        self, origins: FloatArray, directions: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Lengths (d, m) at which rays enter and leave; entry > exit where they miss.

        They have each of the directions (d, 3) and each of the origins (m, 3).
        """
        u = directions - (directions @ self.axis)[:, None] * self.axis
        w = origins - self.point
        w = w - (w @ self.axis)[:, None] * self.axis
        a = (u * u).sum(-1)[:, None]
        b = u @ w.T
        c = (w * w).sum(-1) - self.radius**2
        is_along = a < 1e-12
        root = b * b - a * c
        half = np.sqrt(np.maximum(root, 0.0))
        a_safe = np.where(is_along, 1.0, a)
        misses = np.where(is_along, c > 0, root < 0)
        enter = np.where(is_along, -np.inf, (-b - half) / a_safe)
        leave = np.where(is_along, np.inf, (-b + half) / a_safe)
        return np.where(misses, np.inf, enter), np.where(misses, -np.inf, leave)


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A convex body bounded by planes and round bars, with or without a round bore."""

    planes: FloatArray = field(default_factory=lambda: np.zeros((0, 4)))
    """Outward unit normals and offsets of half-spaces n.x <= d, shape (h, 4)."""
    tubes: tuple[Tube, ...] = ()
    """Round bars that contain the body."""
    bore: Tube | None = None
    """A round hole; what is in it isn't part of the body."""

    @property
    def is_convex(self) -> bool:
        """Whether there is no hole."""
        return self.bore is None

    def signed_distance(self, points: ArrayLike) -> FloatArray:
        """Distance of points (..., 3) [m]: exact inside, a lower bound outside."""
        points = np.asarray(points, dtype=np.float64)
        bounds = [points @ plane[:3] - plane[3] for plane in self.planes]
        bounds += [tube.signed_distance(points) for tube in self.tubes]
        if self.bore is not None:
            bounds.append(-self.bore.signed_distance(points))
        distance: FloatArray = np.max(bounds, axis=0)
        return distance

    def blocks(self, origins: FloatArray, directions: FloatArray) -> BoolArray:
        """Where rays (d, m) pass through the body ahead of their origins."""
        shape = (len(directions), len(origins))
        enter, leave = np.zeros(shape), np.full(shape, np.inf)
        for plane in self.planes:
            speed = directions @ plane[:3]
            gap = plane[3] - origins @ plane[:3]
            is_in, is_out = speed < -1e-12, speed > 1e-12
            enter[is_in] = np.maximum(enter[is_in], gap / speed[is_in, None])
            leave[is_out] = np.minimum(leave[is_out], gap / speed[is_out, None])
            leave[np.ix_(~is_in & ~is_out, gap < 0)] = -np.inf
        for tube in self.tubes:
            tube_enter, tube_leave = tube.interval(origins, directions)
            enter = np.maximum(enter, tube_enter)
            leave = np.minimum(leave, tube_leave)
        if self.bore is None:
            return enter < leave
        # A ray meets the body unless all of its way through it lies in the bore.
        bore_enter, bore_leave = self.bore.interval(origins, directions)
        return (enter < leave) & ~((bore_enter <= enter) & (bore_leave >= leave))


def box_part(lower: ArrayLike, upper: ArrayLike) -> Part:
    """Box with its edges along the axes, between two corners (3,) [m]."""
    normals = np.concatenate([-np.eye(3), np.eye(3)])
    offsets = np.concatenate([-np.asarray(lower), np.asarray(upper)])
    return Part(np.column_stack([normals, offsets]))


def rod_part(start: ArrayLike, end: ArrayLike, radius: float) -> Part:
    """Round bar with flat ends between two points (3,) [m]."""
    start, end = np.asarray(start, dtype=np.float64), np.asarray(end)
    axis = (end - start) / np.linalg.norm(end - start)
    planes = [[*-axis, -axis @ start], [*axis, axis @ end]]
    return Part(np.array(planes), (Tube(start, axis, radius),))
