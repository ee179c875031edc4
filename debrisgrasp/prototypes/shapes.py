"""The shapes that prototypes are made of, as a hand holds them.

In its own frame every shape lies as in an unturned hand: x across the thickness that
the fingers close on, y along its length, z away from the palm.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import SE3

from .parts import Body, Part, Tube, box_part, rod_part
from .shape_fields import HALF_TURN_Z, face, half_turn_about_z, one_of, span
from .supported import CellShape, HandleShape, RungShape
from .surfaces import Patch, round_plate, round_wall
from .symmetry import SpinAxis, Symmetry, cuboid_turns

__all__ = [
    "SHAPES",
    "BarShape",
    "BoxShape",
    "CellShape",
    "CylinderShape",
    "EdgeShape",
    "HandleShape",
    "RimShape",
    "RungShape",
    "Shape",
]


class Shape(Protocol):
    """A body with the surface that a camera may see of it."""

    def parts(self) -> tuple[Body, ...]:
        """Solid parts whose union is the body."""
        ...

    def patches(self) -> tuple[Patch, ...]:
        """Pieces of its surface; cuts, where the body goes on, aren't among them."""
        ...

    def symmetry(self) -> Symmetry:
        """Motions that leave the surface as it is."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class CylinderShape:
    """Pipe or post about y; the origin is its centre."""

    diameter: float = span(0.005, 0.3)
    length: float = span(0.01, 0.6)
    ends: str = one_of("open", "closed")
    """``open``: the pipe goes on beyond both ends; ``closed``: the ends are faces."""

    def parts(self) -> tuple[Part, ...]:
        """Return the pipe, filled."""
        return (rod_part(*self._axis_ends(), self.diameter / 2),)

    def patches(self) -> tuple[Patch, ...]:
        """Return the round side, and the ends if they are closed."""
        start, end = self._axis_ends()
        radius = self.diameter / 2
        side = round_wall(start, end, radius, reference=(0, 0, -1))
        if self.ends == "open":
            return (side,)
        return (
            side,
            round_plate(start, (0, -1, 0), (0.0, radius), reference=(1, 0, 0)),
            round_plate(end, (0, 1, 0), (0.0, radius), reference=(1, 0, 0)),
        )

    def symmetry(self) -> Symmetry:
        """Free turns about the axis, and end over end."""
        turns = SE3.from_parts(np.stack([np.eye(3), HALF_TURN_Z]))
        return Symmetry(turns, SpinAxis(np.zeros(3), np.array([0.0, 1.0, 0.0])))

    def _axis_ends(self) -> tuple[FloatArray, FloatArray]:
        half = np.array([0.0, self.length / 2, 0.0])
        return -half, half


@dataclass(frozen=True, slots=True, kw_only=True)
class BarShape:
    """Piece of a beam along y, both ends going on; the origin is its centre."""

    width: float = span(0.005, 0.3)
    """Along x, between the fingers."""
    height: float = span(0.005, 0.3)
    """Along z."""
    length: float = span(0.01, 0.6)

    def parts(self) -> tuple[Part, ...]:
        """Return the beam."""
        return (box_part(-self._size() / 2, self._size() / 2),)

    def patches(self) -> tuple[Patch, ...]:
        """Return the four long faces."""
        half = self._size() / 2
        return tuple(face(-half, half, axis, up) for axis in (0, 2) for up in (0, 1))

    def symmetry(self) -> Symmetry:
        """Half turns about the axes; quarter turns about y if it is square."""
        return Symmetry(cuboid_turns(self._size(), keeps_y=True))

    def _size(self) -> FloatArray:
        return np.array([self.width, self.length, self.height])


@dataclass(frozen=True, slots=True, kw_only=True)
class BoxShape:
    """A whole block with all six faces; the origin is its centre."""

    width: float = span(0.005, 0.3)
    """Along x, between the fingers."""
    length: float = span(0.005, 0.6)
    """Along y."""
    height: float = span(0.005, 0.3)
    """Along z."""

    def parts(self) -> tuple[Part, ...]:
        """Return the block."""
        return (box_part(-self._size() / 2, self._size() / 2),)

    def patches(self) -> tuple[Patch, ...]:
        """Return the six faces."""
        half = self._size() / 2
        return tuple(face(-half, half, axis, up) for axis in range(3) for up in (0, 1))

    def symmetry(self) -> Symmetry:
        """Return the turns that map the block onto itself."""
        return Symmetry(cuboid_turns(self._size(), keeps_y=False))

    def _size(self) -> FloatArray:
        return np.array([self.width, self.length, self.height])


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgeShape:
    """Edge of a board that goes on along +z; the origin is the middle of the edge."""

    thickness: float = span(0.003, 0.3)
    """Along x, between the fingers."""
    length: float = span(0.01, 0.6)
    """Of the edge, along y."""
    depth: float = span(0.01, 0.3)
    """How much of the board counts, along z."""
    ends: str = one_of("open", "one", "both")
    """Where the board ends along y: nowhere, at the positive end (a corner), or at
    both (the end of a plank)."""

    def parts(self) -> tuple[Part, ...]:
        """Return the piece of board."""
        return (box_part(*self._corners()),)

    def patches(self) -> tuple[Patch, ...]:
        """Return both broad faces, the edge, and the ends that exist."""
        lower, upper = self._corners()
        faces = [(0, 0), (0, 1), (2, 0)]
        faces += {"open": [], "one": [(1, 1)], "both": [(1, 0), (1, 1)]}[self.ends]
        return tuple(face(lower, upper, axis, up) for axis, up in faces)

    def symmetry(self) -> Symmetry:
        """Return the half turn about z, unless one end alone is closed."""
        return Symmetry() if self.ends == "one" else half_turn_about_z()

    def _corners(self) -> tuple[FloatArray, FloatArray]:
        half_x, half_y = self.thickness / 2, self.length / 2
        return np.array([-half_x, -half_y, 0]), np.array([half_x, half_y, self.depth])


@dataclass(frozen=True, slots=True, kw_only=True)
class RimShape:
    """Rim of a round vessel that goes on along +z and curves towards +x.

    The origin is the middle of the wall, on the rim; the inside lies at positive x.
    """

    thickness: float = span(0.001, 0.1)
    diameter: float = span(0.05, 1.0)
    """Outer diameter of the vessel."""
    length: float = span(0.01, 0.6)
    """Along the rim; at most half the way round."""
    depth: float = span(0.01, 0.3)
    """How much of the wall counts, along z."""

    def parts(self) -> tuple[Part, ...]:
        """Return the piece of wall."""
        center, half = self._center(), self._arc() / 2
        sine, cosine = np.sin(half), np.cos(half)
        planes = np.array(
            [
                [0, 0, -1, 0],
                [0, 0, 1, self.depth],
                [sine, cosine, 0, sine * center[0]],
                [sine, -cosine, 0, sine * center[0]],
            ]
        )
        outer, inner = self._radii()
        axis = np.array([0.0, 0.0, 1.0])
        return (Part(planes, (Tube(center, axis, outer),), Tube(center, axis, inner)),)

    def patches(self) -> tuple[Patch, ...]:
        """Return the outside, the inside and the lip."""
        low = self._center()
        high = low + np.array([0.0, 0.0, self.depth])
        outer, inner = self._radii()
        arc, back = self._arc(), (-1, 0, 0)
        return (
            round_wall(low, high, outer, reference=back, arc=arc),
            round_wall(low, high, inner, reference=back, arc=arc, is_hollow=True),
            round_plate(low, (0, 0, -1), (inner, outer), reference=back, arc=arc),
        )

    def symmetry(self) -> Symmetry:
        """Return none: a mirror plane is no motion."""
        return Symmetry()

    def _arc(self) -> float:
        return min(2 * self.length / self.diameter, np.pi)

    def _radii(self) -> tuple[float, float]:
        return self.diameter / 2, max(self.diameter / 2 - self.thickness, 1e-6)

    def _center(self) -> FloatArray:
        return np.array([(self.diameter - self.thickness) / 2, 0.0, 0.0])


SHAPES: Mapping[str, type[Shape]] = MappingProxyType(
    {
        "bar": BarShape,
        "box": BoxShape,
        "cell": CellShape,
        "cylinder": CylinderShape,
        "edge": EdgeShape,
        "handle": HandleShape,
        "rim": RimShape,
        "rung": RungShape,
    }
)
"""The shapes by the names that files use."""
