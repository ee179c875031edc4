"""Shapes that are gripped between supports: these take away most of their symmetry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import SE3

from .parts import Part, box_part, rod_part
from .shape_fields import face, half_turn_about_z, span
from .surfaces import Patch, round_plate, round_wall
from .symmetry import Symmetry

__all__ = ["CellShape", "HandleShape", "RungShape"]


@dataclass(frozen=True, slots=True, kw_only=True)
class HandleShape:
    """Bar along y on two posts along +z; the origin is the middle of the bar."""

    diameter: float = span(0.005, 0.1)
    """Of the bar and of the posts."""
    length: float = span(0.03, 0.5)
    """Between the axes of the posts."""
    standoff: float = span(0.02, 0.3)
    """From the axis of the bar to what the posts stand on."""
    plate: float = span(0.0, 0.3, 0.0)
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
        return (*patches, face(*self._plate_corners(), 2, 0))

    def symmetry(self) -> Symmetry:
        """Return the half turn about z."""
        return half_turn_about_z()

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


@dataclass(frozen=True, slots=True, kw_only=True)
class RungShape:
    """Rung of a ladder along y between two rails along x; the origin is its centre."""

    diameter: float = span(0.005, 0.1)
    length: float = span(0.05, 0.6)
    """Between the rails."""
    rail_width: float = span(0.005, 0.1, 0.025)
    """Along y."""
    rail_height: float = span(0.005, 0.2, 0.065)
    """Along z; the rung is at half of it."""
    rail_length: float = span(0.02, 0.6, 0.2)
    """How much of the rails counts, along x."""

    def parts(self) -> tuple[Part, ...]:
        """Return the rung and both rails."""
        half = np.array([0.0, self.length / 2, 0.0])
        rung = rod_part(-half, half, self.diameter / 2)
        return (rung, *(box_part(*corners) for corners in self._rails()))

    def patches(self) -> tuple[Patch, ...]:
        """Return the round side, and of each rail all faces but its cuts."""
        half = np.array([0.0, self.length / 2, 0.0])
        side = round_wall(-half, half, self.diameter / 2, reference=(0, 0, -1))
        faces = [(1, 0), (1, 1), (2, 0), (2, 1)]
        return (
            side,
            *(face(*rail, axis, up) for rail in self._rails() for axis, up in faces),
        )

    def symmetry(self) -> Symmetry:
        """Return the half turns about the axes."""
        turns = [np.eye(3), *(2 * np.diag(axis) - np.eye(3) for axis in np.eye(3))]
        return Symmetry(SE3.from_parts(np.stack(turns)))

    def _rails(self) -> tuple[tuple[FloatArray, FloatArray], ...]:
        half = np.array([self.rail_length, self.rail_width, self.rail_height]) / 2
        away = np.array([0.0, (self.length + self.rail_width) / 2, 0.0])
        return ((-away - half, -away + half), (away - half, away + half))


@dataclass(frozen=True, slots=True, kw_only=True)
class CellShape:
    """Wall of a hollow block, and the two webs that bound the cell behind it.

    The wall goes on along +z; the webs go on towards +x, and one finger side goes into
    the cell between them. The origin is the middle of the wall's edge.
    """

    thickness: float = span(0.005, 0.1)
    """Of the wall, along x, between the fingers."""
    length: float = span(0.03, 0.4)
    """Of the cell, along y, between the webs."""
    depth: float = span(0.01, 0.3)
    """How much of the wall counts, along z."""
    web: float = span(0.005, 0.1)
    """Thickness of the webs, along y."""
    reach: float = span(0.01, 0.4)
    """How much of the webs counts, along x from the wall."""

    def parts(self) -> tuple[Part, ...]:
        """Return the wall and both webs."""
        return tuple(box_part(*corners) for corners in self._walls())

    def patches(self) -> tuple[Patch, ...]:
        """Return the edges, the outside, and the inside of the cell."""
        wall, left, right = self._walls()
        inside = (np.array([wall[0][0], left[1][1], 0.0]), wall[1].copy())
        inside[1][1] = right[0][1]
        return (
            face(*wall, 0, 0),
            face(*inside, 0, 1),
            face(*left, 1, 1),
            face(*right, 1, 0),
            *(face(*part, 2, 0) for part in (wall, left, right)),
        )

    def symmetry(self) -> Symmetry:
        """Return none: the webs stand on one side only."""
        return Symmetry()

    def _walls(self) -> tuple[tuple[FloatArray, FloatArray], ...]:
        """Corners of the wall and of the webs at negative and positive y."""
        x, y = self.thickness / 2, self.length / 2
        end, far = y + self.web, x + self.reach
        z = self.depth
        return (
            (np.array([-x, -end, 0.0]), np.array([x, end, z])),
            (np.array([x, -end, 0.0]), np.array([far, -y, z])),
            (np.array([x, y, 0.0]), np.array([far, end, z])),
        )
