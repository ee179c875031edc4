"""Distances of points to solids in single precision, lanes last."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3, Box, Capsule, Cylinder, Solid, Sphere

from .hull import Hull
from .serial import Lanes

__all__ = ["SolidGap"]


@dataclass(frozen=True, slots=True, eq=False)
class SolidGap:
    """One solid, ready to be asked for the distance of many points."""

    kind: type
    R: Lanes
    """Rows that take a point to the solid's own frame, or normals of planes; (k, 3)."""
    p: Lanes
    """Added after that, shape (k, 1) [m]."""
    size: tuple[np.float32, ...]
    is_exact: bool
    """Points with a distance below zero lie inside for certain."""

    @classmethod
    def of(cls, solid: Solid) -> SolidGap:
        """Take the constants out of a solid."""
        size: tuple[float, ...]
        T = SE3.identity()
        if isinstance(solid, Sphere):
            T, size = SE3.from_parts(p=solid.center), (solid.radius,)
        elif isinstance(solid, Box):
            T, size = solid.T_frame_solid, tuple(solid.half_extents)
        elif isinstance(solid, Cylinder | Capsule):
            T, size = solid.T_frame_solid, (solid.radius, 0.5 * solid.length)
        elif isinstance(solid, Hull):
            to_own = solid.T_frame_solid.inverse()
            normals = solid.planes[:, :3]
            offset = normals @ to_own.p - solid.planes[:, 3]
            return cls(
                Hull,
                _single(normals @ to_own.R),
                _single(offset[:, None]),
                (),
                solid.is_exact,
            )
        else:
            raise InputError(
                "solid of a link",
                got=type(solid).__name__,
                expected="a Box, Sphere, Cylinder, Capsule or Hull",
            )
        to_own = T.inverse()
        return cls(
            type(solid),
            _single(to_own.R),
            _single(to_own.p[:, None]),
            tuple(map(np.float32, size)),
            is_exact=True,
        )

    def __call__(self, points: Lanes) -> Lanes:
        """Signed distance [m] of points (3, ...), shape (...), to 1e-6 m.

        It is never more than the true distance to the solid.
        """
        own = self.R @ points.reshape(3, -1)
        own += self.p
        if self.kind is Hull:
            gap: Lanes = own.max(axis=0)
        elif self.kind is Sphere:
            gap = np.sqrt((own * own).sum(axis=0)) - self.size[0]
        elif self.kind is Box:
            np.abs(own, out=own)
            for axis, half in enumerate(self.size):
                own[axis] -= half
            gap = _beyond(*own)
        else:
            radius, half = self.size
            rho = np.sqrt(own[0] * own[0] + own[1] * own[1])
            along = np.abs(own[2]) - half
            if self.kind is Capsule:
                np.maximum(along, 0.0, out=along)
                gap = np.sqrt(rho * rho + along * along) - radius
            else:
                gap = _beyond(rho - radius, along)
        return gap.reshape(points.shape[1:])


def _beyond(*excess: Lanes) -> Lanes:
    """Distance from how far each coordinate lies beyond its bound."""
    inside = excess[0]
    for other in excess[1:]:
        inside = np.maximum(inside, other)
    squared = np.zeros_like(inside)
    for each in excess:
        outside = np.maximum(each, 0.0)
        outside *= outside
        squared += outside
    np.sqrt(squared, out=squared)
    squared += np.minimum(inside, 0.0)
    return squared


def _single(array: FloatArray) -> Lanes:
    return np.ascontiguousarray(array, dtype=np.float32)
