"""The shapes that prototypes are made of, as a hand holds them.

In its own frame every shape lies as in an unturned hand: x across the thickness that
the fingers close on, y along its length, z away from the palm.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import SE3

from .parts import Part, Tube, box_part, rod_part
from .surfaces import Patch, flat, round_plate, round_wall
from .symmetry import SpinAxis, Symmetry, cuboid_turns

__all__ = [
    "SHAPES",
    "BarShape",
    "BoxShape",
    "CylinderShape",
    "EdgeShape",
    "HandleShape",
    "RimShape",
    "Shape",
]

_HALF_TURN_Z = np.diag([-1.0, -1.0, 1.0])


class Shape(Protocol):
    """A body with the surface that a camera may see of it."""

    def parts(self) -> tuple[Part, ...]:
        """Solid parts whose union is the body."""
        ...

    def patches(self) -> tuple[Patch, ...]:
        """Pieces of its surface; cuts, where the body goes on, aren't among them."""
        ...

    def symmetry(self) -> Symmetry:
        """Motions that leave the surface as it is."""
        ...


def _length(low: float, high: float, default: float | None = None) -> Any:
    """Declare a length [m] with the range that a file may give."""
    metadata = {"low": low, "high": high}
    if default is None:
        return field(metadata=metadata)
    return field(default=default, metadata=metadata)


def _choice(default: str, *others: str) -> Any:
    """Declare a word with the alternatives that a file may give."""
    return field(default=default, metadata={"known": (default, *others)})


@dataclass(frozen=True, slots=True, kw_only=True)
class CylinderShape:
    """Pipe or post about y; the origin is its centre."""

    diameter: float = _length(0.005, 0.3)
    length: float = _length(0.01, 0.6)
    ends: str = _choice("open", "closed")
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
        turns = SE3.from_parts(np.stack([np.eye(3), _HALF_TURN_Z]))
        return Symmetry(turns, SpinAxis(np.zeros(3), np.array([0.0, 1.0, 0.0])))

    def _axis_ends(self) -> tuple[FloatArray, FloatArray]:
        half = np.array([0.0, self.length / 2, 0.0])
        return -half, half


@dataclass(frozen=True, slots=True, kw_only=True)
class BarShape:
    """Piece of a beam along y, both ends going on; the origin is its centre."""

    width: float = _length(0.005, 0.3)
    """Along x, between the fingers."""
    height: float = _length(0.005, 0.3)
    """Along z."""
    length: float = _length(0.01, 0.6)

    def parts(self) -> tuple[Part, ...]:
        """Return the beam."""
        return (box_part(-self._size() / 2, self._size() / 2),)

    def patches(self) -> tuple[Patch, ...]:
        """Return the four long faces."""
        half = self._size() / 2
        return tuple(_face(-half, half, axis, up) for axis in (0, 2) for up in (0, 1))

    def symmetry(self) -> Symmetry:
        """Half turns about the axes; quarter turns about y if it is square."""
        return Symmetry(cuboid_turns(self._size(), keeps_y=True))

    def _size(self) -> FloatArray:
        return np.array([self.width, self.length, self.height])


@dataclass(frozen=True, slots=True, kw_only=True)
class BoxShape:
    """A whole block with all six faces; the origin is its centre."""

    width: float = _length(0.005, 0.3)
    """Along x, between the fingers."""
    length: float = _length(0.005, 0.6)
    """Along y."""
    height: float = _length(0.005, 0.3)
    """Along z."""

    def parts(self) -> tuple[Part, ...]:
        """Return the block."""
        return (box_part(-self._size() / 2, self._size() / 2),)

    def patches(self) -> tuple[Patch, ...]:
        """Return the six faces."""
        half = self._size() / 2
        return tuple(_face(-half, half, axis, up) for axis in range(3) for up in (0, 1))

    def symmetry(self) -> Symmetry:
        """Return the turns that map the block onto itself."""
        return Symmetry(cuboid_turns(self._size(), keeps_y=False))

    def _size(self) -> FloatArray:
        return np.array([self.width, self.length, self.height])


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgeShape:
    """Edge of a board that goes on along +z; the origin is the middle of the edge."""

    thickness: float = _length(0.003, 0.3)
    """Along x, between the fingers."""
    length: float = _length(0.01, 0.6)
    """Of the edge, along y."""
    depth: float = _length(0.01, 0.3)
    """How much of the board counts, along z."""
    ends: str = _choice("open", "one", "both")
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
        return tuple(_face(lower, upper, axis, up) for axis, up in faces)

    def symmetry(self) -> Symmetry:
        """Return the half turn about z, unless one end alone is closed."""
        return Symmetry() if self.ends == "one" else _half_turn_about_z()

    def _corners(self) -> tuple[FloatArray, FloatArray]:
        half_x, half_y = self.thickness / 2, self.length / 2
        return np.array([-half_x, -half_y, 0]), np.array([half_x, half_y, self.depth])


@dataclass(frozen=True, slots=True, kw_only=True)
class RimShape:
    """Rim of a round vessel that goes on along +z and curves towards +x.

    The origin is the middle of the wall, on the rim; the inside lies at positive x.
    """

    thickness: float = _length(0.001, 0.1)
    diameter: float = _length(0.05, 1.0)
    """Outer diameter of the vessel."""
    length: float = _length(0.01, 0.6)
    """Along the rim; at most half the way round."""
    depth: float = _length(0.01, 0.3)
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


@dataclass(frozen=True, slots=True, kw_only=True)
class HandleShape:
    """Bar along y on two posts along +z; the origin is the middle of the bar."""

    diameter: float = _length(0.005, 0.1)
    """Of the bar and of the posts."""
    length: float = _length(0.03, 0.5)
    """Between the axes of the posts."""
    standoff: float = _length(0.02, 0.3)
    """From the axis of the bar to what the posts stand on."""
    plate: float = _length(0.0, 0.3, 0.0)
    """Width along x of the plate that they stand on; 0 for none."""

    def parts(self) -> tuple[Part, ...]:
        """Return the bar, two posts and perhaps the plate."""
        radius = self.diameter / 2
        left, right = self._post_tops()
        foot = np.array([0.0, 0.0, self.standoff])
        parts = (
            rod_part(*self._bar_ends(), radius),
            rod_part(left, left + foot, radius),
            rod_part(right, right + foot, radius),
        )
        return (*parts, box_part(*self._plate_corners())) if self.plate else parts

    def patches(self) -> tuple[Patch, ...]:
        """Return all round sides, the ends of the bar and the top of the plate."""
        radius = self.diameter / 2
        left, right = self._post_tops()
        foot = np.array([0.0, 0.0, self.standoff])
        start, end = self._bar_ends()
        patches = (
            round_wall(start, end, radius, reference=(0, 0, -1)),
            round_plate(start, (0, -1, 0), (0.0, radius), reference=(1, 0, 0)),
            round_plate(end, (0, 1, 0), (0.0, radius), reference=(1, 0, 0)),
            round_wall(left, left + foot, radius, reference=(1, 0, 0)),
            round_wall(right, right + foot, radius, reference=(1, 0, 0)),
        )
        if not self.plate:
            return patches
        return (*patches, _face(*self._plate_corners(), 2, 0))

    def symmetry(self) -> Symmetry:
        """Return the half turn about z."""
        return _half_turn_about_z()

    def _post_tops(self) -> tuple[FloatArray, FloatArray]:
        half = np.array([0.0, self.length / 2, 0.0])
        return -half, half

    def _bar_ends(self) -> tuple[FloatArray, FloatArray]:
        half = np.array([0.0, (self.length + self.diameter) / 2, 0.0])
        return -half, half

    def _plate_corners(self) -> tuple[FloatArray, FloatArray]:
        half_x, half_y = self.plate / 2, self.length / 2 + self.diameter
        lower = np.array([-half_x, -half_y, self.standoff])
        return lower, np.array([half_x, half_y, self.standoff + 0.02])


def _face(lower: FloatArray, upper: FloatArray, axis: int, up: int) -> Patch:
    """Face of a box square to an axis: the upper one, or the lower one."""
    edges = np.diag(upper - lower)
    u, v = edges[(axis + 1) % 3], edges[(axis + 2) % 3]
    if up:
        return flat(lower + edges[axis], u, v)
    return flat(lower, v, u)


def _half_turn_about_z() -> Symmetry:
    return Symmetry(SE3.from_parts(np.stack([np.eye(3), _HALF_TURN_Z])))


SHAPES: Mapping[str, type[Shape]] = MappingProxyType(
    {
        "bar": BarShape,
        "box": BoxShape,
        "cylinder": CylinderShape,
        "edge": EdgeShape,
        "handle": HandleShape,
        "rim": RimShape,
    }
)
"""The shapes by the names that files use."""
