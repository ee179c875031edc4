"""Bodies and hands as planes and points, which is all that contact springs need.

A convex part is the intersection of half-spaces, a surface a cloud of points on it. How
deep a point lies in a part is then one matrix product.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray
from debrisgrasp.geometry import Box, Cylinder, Solid
from debrisgrasp.prototypes import GripperModel
from debrisgrasp.worlds import Body, Hull
from debrisgrasp.worlds.rest import edge_points, largest_in_rows

__all__ = ["BodyShape", "HandShape", "planes_of", "ways_out"]

_SIDES = 24
"""Flat sides of a cylinder."""
_PITCH = 0.014
"""Distance of the points on fingers [m]."""
_PALM_PITCH = 0.02
_EDGE_PITCH = 0.02
_HARDLY = 0.1
"""A link that moves by less per change of the opening hardly moves."""
_MANY = 600
"""More points than this on the edges of a body are thinned out."""
_FLAT = 1e-6
"""Corners so near to a plane lie in it [m]."""
_OPPOSITE = -0.9999
"""Cosine between sides that lie against each other."""
_INSET, _AHEAD = 0.85, 5e-4
"""A part covers a side if the corners of that, drawn in to this share, are inside it so
far ahead [m]."""
_GRID = 0.0015
"""Openings between which the places of points on fingers are interpolated [m]."""


def planes_of(part: Solid) -> tuple[FloatArray, FloatArray]:
    """Outward normals (s, 3) of a convex solid's sides, and their offsets (s,) [m]."""
    if isinstance(part, Hull):
        return part.normals, part.offsets
    if isinstance(part, Box):
        own = np.concatenate([np.eye(3), -np.eye(3)])
        reach = np.tile(part.half_extents, 2)
        pose = part.T_frame_solid
    elif isinstance(part, Cylinder):
        turn = (np.arange(_SIDES) + 0.5) * (2.0 * np.pi / _SIDES)
        around = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=-1)
        own = np.concatenate([around, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
        reach = np.append(np.full(_SIDES, part.radius), [part.length / 2] * 2)
        pose = part.T_frame_solid
    else:
        hull = Hull.around(part.mesh()[0])
        return hull.normals, hull.offsets
    normals = own @ pose.R.T
    return normals, reach + normals @ pose.p


class BodyShape:
    """Planes and points of one body where it is now."""

    def __init__(self, body: Body) -> None:
        planes = [planes_of(part) for part in body.parts]
        self._own_parts = body.parts
        self._own_normals = np.concatenate([normals for normals, _ in planes])
        self._own_offsets = np.concatenate([offsets for _, offsets in planes])
        counts = [len(offsets) for _, offsets in planes]
        self.starts = np.cumsum([0, *counts[:-1]])
        """First plane of each part."""
        self.parts = tuple(
            slice(start, start + count)
            for start, count in zip(self.starts.tolist(), counts, strict=True)
        )
        points = edge_points(body, _EDGE_PITCH)
        if len(points) > _MANY:
            cells = np.unique((points / _EDGE_PITCH).round(), axis=0, return_index=True)
            points = points[cells[1]]
        self._own_points = points
        self.mass = body.mass
        self._own_com = body.center_of_mass
        self._own_middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        self.radius = float(np.linalg.norm(points - self._own_middle, axis=1).max())
        """[m]."""
        self.place(body.T_base_body.R, body.T_base_body.p)

    def place(self, R: FloatArray, p: FloatArray) -> None:
        """Put the body at a pose."""
        self.R, self.p = R.copy(), p.copy()
        self.middle = R @ self._own_middle + p
        """Of a sphere of `radius` that contains the body, shape (3,)."""
        self.com = R @ self._own_com + p
        """Centre of mass, shape (3,)."""
        self._now: tuple[FloatArray, FloatArray, FloatArray] | None = None
        self._box: tuple[FloatArray, FloatArray] | None = None

    @cached_property
    def is_covered(self) -> BoolArray:
        """Sides with which two parts lie against each other all over, shape (s,).

        They lead out of a part, but not out of the body. Where a side is larger than
        what lies against it, both count: a push must not jump from part to part.
        """
        normals, offsets = self._own_normals, self._own_offsets
        by = np.zeros((len(offsets), len(self.parts)), dtype=bool)
        for part, rows in zip(self._own_parts, self.parts, strict=True):
            corners = part.mesh()[0]
            for i in range(rows.start, rows.stop):
                own = corners[np.abs(corners @ normals[i] - offsets[i]) < _FLAT]
                if len(own) < 3:
                    continue
                middle = own.mean(axis=0)
                ahead = middle + _INSET * (own - middle) + _AHEAD * normals[i]
                beyond = ahead @ normals.T - offsets
                gaps = np.maximum.reduceat(beyond, self.starts, axis=1)
                by[i] = (gaps < 0.0).all(axis=0)
        part_of = np.repeat(
            np.arange(len(self.parts)), np.diff([*self.starts, len(by)])
        )
        one, other = np.nonzero(by[:, part_of] & by[:, part_of].T)
        is_opposite = (normals[one] * normals[other]).sum(axis=1) < _OPPOSITE
        found = np.zeros(len(offsets), dtype=bool)
        found[one[is_opposite]] = True
        return found

    @cached_property
    def part_of_points(self) -> IntArray:
        """Number of the part on whose edges each point is, shape (n,)."""
        beyond = self._own_points @ self._own_normals.T - self._own_offsets
        gaps = np.maximum.reduceat(beyond, self.starts, axis=1)
        return np.asarray(np.abs(gaps).argmin(axis=1))

    @property
    def box(self) -> tuple[FloatArray, FloatArray]:
        """Corners of the box around it [m], each (3,)."""
        if self._box is None:
            along = np.ascontiguousarray(self.points.T)
            self._box = along.min(axis=1), along.max(axis=1)
        return self._box

    @property
    def normals(self) -> FloatArray:
        """Outward normals of all planes, shape (s, 3)."""
        return self._placed()[0]

    @property
    def offsets(self) -> FloatArray:
        """Distances of the planes from the origin [m], shape (s,)."""
        return self._placed()[1]

    @property
    def points(self) -> FloatArray:
        """Points on the edges [m], shape (n, 3)."""
        return self._placed()[2]

    def _placed(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        if self._now is None:
            self._now = self.seen(self.R, self.p)
        return self._now

    def seen(
        self, R: FloatArray, p: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Give normals, offsets and points in a frame where its pose is (R, p)."""
        normals = self._own_normals @ R.T
        return normals, self._own_offsets + normals @ p, self._own_points @ R.T + p

    def shift(self, way: FloatArray) -> None:
        """Move the body without turning it."""
        normals, offsets, points = self._placed()
        self.place(self.R, self.p + way)
        self._now = normals, offsets + normals @ way, points + way

    def deepest(self, points: FloatArray) -> tuple[float, FloatArray]:
        """How deep one of the points (n, 3) is in the body [m], and the way out (3,).

        Negative if none is: at most the distance.
        """
        found, way = -np.inf, np.zeros(3)
        for part in self.parts:
            beyond = points @ self.normals[part].T - self.offsets[part]
            gaps = largest_in_rows(beyond)
            i = int(gaps.argmin())
            if -gaps[i] > found:
                found = -float(gaps[i])
                way = self.normals[part][int(beyond[i].argmax())]
        return found, way

    def depths(self, points: FloatArray) -> FloatArray:
        """Give lower bounds of distances of points (n, 3) from parts, (n, parts)."""
        beyond = points @ self.normals.T - self.offsets
        return np.maximum.reduceat(beyond, self.starts, axis=1)


def ways_out(beyond: FloatArray, is_covered: BoolArray) -> FloatArray:
    """Leave out for points inside a part the sides that lead into another one.

    Parameters
    ----------
    beyond
        Of points, from each side of the part [m], shape (n, s); negative inside.
    is_covered
        See `BodyShape`, shape (s,).
    """
    if not is_covered.any():
        return beyond
    is_inside = beyond.max(axis=1, keepdims=True) < 0.0
    return np.asarray(np.where(is_inside & is_covered, -np.inf, beyond))


class HandShape:
    """Points on palm and fingers for every preshape and opening."""

    def __init__(self, model: GripperModel) -> None:
        self.model = model
        self.palm = np.concatenate(
            [_surface(solid, _PALM_PITCH) for solid in model.palm]
        )
        self.palm_planes = [planes_of(solid) for solid in model.palm]
        self._links = [
            [
                np.concatenate([_surface(solid, _PITCH) for solid in link.solids])
                if link.solids
                else np.zeros((0, 3))
                for link in finger.links
            ]
            for finger in model.fingers
        ]
        counts = [sum(len(points) for points in links) for links in self._links]
        ends = np.cumsum([len(self.palm), *counts]).tolist()
        self.owned = [
            slice(start, end) for start, end in zip([0, *ends], ends, strict=False)
        ]
        """Rows of the points of the palm and of each finger."""
        self.radius = float(np.linalg.norm(self.palm, axis=1).max()) + 0.15
        self.gain = 1.0
        """How far a point moves per change of its finger's opening, at most."""
        self._tables: dict[str, tuple[float, float, list[FloatArray]]] = {}

    def points(self, preshape: str, openings: Sequence[float]) -> FloatArray:
        """Points on the hand in its own frame [m], shape (n, 3)."""
        low, spacing, tables = self._table(preshape)
        found = [self.palm]
        for table, opening in zip(tables, openings, strict=True):
            row = (opening - low) / spacing
            i = min(max(int(row), 0), len(table) - 2)
            share = min(max(row - i, 0.0), 1.0)
            found.append((1.0 - share) * table[i] + share * table[i + 1])
        return np.concatenate(found)

    def way_of(
        self, preshape: str, openings: Sequence[float], finger: int, point: FloatArray
    ) -> FloatArray:
        """Direction in which a finger moves near a point when it opens, shape (3,).

        Frame of the hand, as the point (3,) [m] is; a link that hardly moves has that
        of a pad.
        """
        low, spacing, tables = self._table(preshape)
        table = tables[finger]
        i = min(max(int((openings[finger] - low) / spacing), 0), len(table) - 2)
        gaps = table[i] - point
        nearest = int(np.einsum("ij,ij->i", gaps, gaps).argmin())
        way: FloatArray = table[i + 1, nearest] - table[i, nearest]
        size = float(way @ way) ** 0.5
        if size < _HARDLY * spacing:
            return np.array([float(self.model.fingers[finger].side), 0.0, 0.0])
        return np.asarray(way / size)

    def _table(self, preshape: str) -> tuple[float, float, list[FloatArray]]:
        if preshape not in self._tables:
            shape = self.model.preshape(preshape)
            low, high = shape.narrowest, shape.widest
            grid = np.linspace(
                low, high, max(int(np.ceil((high - low) / _GRID)), 1) + 1
            )
            spacing = float(grid[1] - grid[0])
            fingers = self.model.link_poses(preshape, grid)
            tables = []
            for poses, links in zip(fingers, self._links, strict=True):
                moved = [
                    pose.matrix[:, None, :3, 3] + points @ np.swapaxes(pose.R, -1, -2)
                    for pose, points in zip(poses, links, strict=True)
                ]
                tables.append(np.concatenate(moved, axis=1))
            for table in tables:
                rate = np.linalg.norm(np.diff(table, axis=0), axis=2).max() / spacing
                self.gain = max(self.gain, float(rate))
                reach = float(np.linalg.norm(table, axis=2).max())
                self.radius = max(self.radius, reach)
            self._tables[preshape] = low, spacing, tables
        return self._tables[preshape]


def _surface(solid: Solid, pitch: float) -> FloatArray:
    """Points on a solid's surface, about a pitch apart [m], shape (n, 3)."""
    vertices, faces = solid.mesh()
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    longest = np.linalg.norm([b - a, c - a], axis=-1).max(axis=0)
    counts = np.ceil(longest / pitch).astype(int)
    found = [vertices]
    for n in np.unique(counts):
        u, v = _triangle(int(n))
        start, first, second = (corner[counts == n, None] for corner in (a, b, c))
        steps = u[:, None] * (first - start) + v[:, None] * (second - start)
        found.append((start + steps).reshape(-1, 3))
    points = np.concatenate(found)
    cells = np.unique((points / (0.7 * pitch)).round(), axis=0, return_index=True)[1]
    return np.asarray(points[np.sort(cells)])


def _triangle(n: int) -> tuple[FloatArray, FloatArray]:
    """Barycentric coordinates of the corners of n^2 equal triangles."""
    rows: IntArray = np.arange(n + 1)
    u, v = np.meshgrid(rows, rows)
    inside = u + v <= n
    return u[inside] / max(n, 1), v[inside] / max(n, 1)
