"""Upright planes in a cloud: faces that may be walls or the sides of a container."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation, label, uniform_filter

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray

__all__ = ["UprightPlane", "upright_planes"]

_TURNS = 120
"""Bins of the direction that planes face."""
_BIN = 0.04
"""Bins of the distance of planes from the origin [m]."""
_BAND = 0.04
"""Distance from a plane up to which points are tried for it [m]."""
_MAX_TURN = float(np.cos(np.deg2rad(18)))
"""Cosine of the largest angle between the normals of a plane and of a point on it."""
_CELL = 0.05
"""Edge of the cells in which the face of a plane is drawn [m]."""
_MIN_POINTS = 20
"""Fewer points don't make a face."""
_MOST_PLANES = 12
_MAX_BINS = 1e6
"""Beyond so many bins a scene is too wide to look for walls."""


@dataclass(frozen=True, slots=True, eq=False)
class UprightPlane:
    """A connected upright face, in coordinates along it (t) and up (z)."""

    normal: FloatArray
    """Unit normal towards the viewpoint, shape (3,)."""
    offset: float
    """normal . p of the points p on the plane [m]."""
    members: IntArray
    """Which of the searched points lie on it, ascending."""
    band: float
    """Distance up to which points lie on it [m]."""
    lower: FloatArray
    """Least t and z of the face [m], shape (2,)."""
    upper: FloatArray
    """Largest t and z of the face [m], shape (2,)."""
    area: float
    """Of the cells of the face in which points lie [m^2]."""

    @property
    def lean(self) -> float:
        """Angle between the plane and the vertical [rad]."""
        return float(np.arcsin(min(abs(self.normal[2]), 1.0)))

    @property
    def size(self) -> FloatArray:
        """Width and height [m], shape (2,)."""
        return self.upper - self.lower

    def along(self, points: FloatArray) -> FloatArray:
        """Horizontal coordinate t of points (n, 3) along the face [m], shape (n,)."""
        x, y, _ = self.normal
        t: FloatArray = points[:, :2] @ (np.array([-y, x]) / np.hypot(x, y))
        return t

    def before(self, points: FloatArray) -> FloatArray:
        """Distance of points (n, 3) on the side of the viewpoint [m], shape (n,)."""
        distance: FloatArray = points @ self.normal - self.offset
        return distance

    def spans(self, points: FloatArray, margin: float) -> BoolArray:
        """Which points (n, 3) have a t within the face grown by ``margin`` [m]."""
        t = self.along(points)
        inside: BoolArray = (t > self.lower[0] - margin) & (t < self.upper[0] + margin)
        return inside

    def holds(self, points: FloatArray, margin: float) -> BoolArray:
        """Which points (n, 3) lie on the face grown by ``margin`` [m]."""
        z = points[:, 2]
        on_face: BoolArray = np.abs(self.before(points)) < self.band
        on_face &= (z > self.lower[1] - margin) & (z < self.upper[1] + margin)
        on_face[on_face] = self.spans(points[on_face], margin)
        return on_face


def upright_planes(
    points: FloatArray,
    normals: FloatArray,
    *,
    max_lean: float,
    min_area: float,
) -> tuple[UprightPlane, ...]:
    """Find connected upright faces, those with most points first.

    Directions and distances of the points' own tangent planes are counted; the fullest
    bin is fitted, its points are taken out, and so on.

    Parameters
    ----------
    points, normals
        Positions [m] and unit normals towards the viewpoint, shapes (n, 3), z up.
    max_lean
        Largest angle between a face and the vertical [rad].
    min_area
        Of the smallest face [m^2].
    """
    with np.errstate(invalid="ignore"):
        is_upright = np.abs(normals[:, 2]) < np.sin(max_lean)
    free = np.flatnonzero(is_upright)
    found: list[UprightPlane] = []
    for _ in range(2 * _MOST_PLANES):
        if len(free) < _MIN_POINTS or len(found) == _MOST_PLANES:
            break
        seed = _fullest_bin(points[free], normals[free])
        if seed is None or np.count_nonzero(seed) < _MIN_POINTS:
            break
        plane = _fitted(points, normals, free, free[seed])
        if plane is None:
            free = free[~seed]
            continue
        free = np.setdiff1d(free, plane.members, assume_unique=True)
        if plane.area >= min_area and plane.lean < max_lean:
            found.append(plane)
    return tuple(found)


def _fullest_bin(points: FloatArray, normals: FloatArray) -> BoolArray | None:
    """Points whose tangent planes agree with the largest number of others, (n,)."""
    x, y, _ = normals.T
    turn = (np.arctan2(y, x) / (2 * np.pi) * _TURNS).astype(np.int64) % _TURNS
    middle = (np.arange(_TURNS) + 0.5) * (2 * np.pi / _TURNS)
    offset = points[:, 0] * np.cos(middle)[turn] + points[:, 1] * np.sin(middle)[turn]
    place = np.floor(offset / _BIN).astype(np.int64)
    place -= place.min()
    width = int(place.max()) + 1
    if width * _TURNS > _MAX_BINS:
        return None
    count = np.bincount(turn * width + place, minlength=_TURNS * width)
    votes = uniform_filter(
        count.reshape(_TURNS, width).astype(np.float64), 3, mode=("wrap", "constant")
    )
    best_turn, best_place = np.unravel_index(votes.argmax(), votes.shape)
    near = np.abs((turn - best_turn + _TURNS // 2) % _TURNS - _TURNS // 2) <= 1
    agrees: BoolArray = near & (np.abs(place - best_place) <= 1)
    return agrees


def _fitted(
    points: FloatArray, normals: FloatArray, free: IntArray, seed: IntArray
) -> UprightPlane | None:
    """Largest connected face on the plane through the points ``seed``."""
    members, towards = seed, normals[seed].mean(axis=0)
    for _ in range(3):
        center = points[members].mean(axis=0)
        away = points[members] - center
        normal = np.linalg.eigh(away.T @ away)[1][:, 0]
        normal *= np.copysign(1.0, normal @ towards)
        distance = (points[free] - center) @ normal
        on_plane = (np.abs(distance) < _BAND) & (normals[free] @ normal > _MAX_TURN)
        members = free[on_plane]
        if len(members) < _MIN_POINTS or np.hypot(*normal[:2]) < 0.5:
            return None
    spread = 1.4826 * float(np.median(np.abs((points[members] - center) @ normal)))
    tangent = np.array([-normal[1], normal[0]]) / np.hypot(*normal[:2])
    face = np.stack([points[members, :2] @ tangent, points[members, 2]])
    inside, area = _largest_part(face)
    members, face = members[inside], face[:, inside]
    if len(members) < _MIN_POINTS:
        return None
    lower, upper = np.percentile(face, (1, 99), axis=1)
    return UprightPlane(
        normal=normal,
        offset=float(normal @ center),
        members=members,
        band=float(np.clip(3.5 * spread, 0.012, _BAND)),
        lower=lower,
        upper=upper,
        area=area,
    )


def _largest_part(face: FloatArray) -> tuple[BoolArray, float]:
    """Points (2, n) of the largest connected part of a face, and its area [m^2]."""
    row, column = np.floor(face / _CELL).astype(np.int64)
    row, column = row - row.min(), column - column.min()
    shape = int(row.max()) + 1, int(column.max()) + 1
    if shape[0] * shape[1] > _MAX_BINS:
        return np.zeros(face.shape[1], dtype=bool), 0.0
    filled = np.zeros(shape, dtype=bool)
    filled[row, column] = True
    # Sparse scans leave single cells empty.
    part, _ = label(binary_dilation(filled, np.ones((3, 3), dtype=bool)))
    own = part[row, column]
    largest = np.bincount(own).argmax()
    area = np.count_nonzero(filled & (part == largest)) * _CELL**2
    return own == largest, float(area)
