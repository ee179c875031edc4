"""How alike prototypes are: the distance between the surfaces inside their hands."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree

from debrisgrasp._arrays import FloatArray

from .prototype import GraspPrototype
from .surface_shape import SurfaceShape

__all__ = [
    "Likeness",
    "duplicates",
    "half_turns",
    "mean_distance",
    "shape_distance",
    "surface_points",
]

DUPLICATE = 0.0055
"""Surfaces nearer than this are matched by the same things [m]: at a point a square
centimetre, two samples of one surface are 4 mm apart."""
_TURN = 0.02
"""A normal turned by one radian is as far off as a point moved by this much [m]."""
_FARTHEST = 0.03
"""Points farther away than this are all equally missing [m]."""
_WIDTH_STEP = 0.005
"""Openings so close are the same to a hand [m]."""
_SYMMETRIC = 0.0055
"""A measured surface that is so near to its own turned copy has the symmetry [m]."""


@dataclass(frozen=True, slots=True)
class Likeness:
    """Two prototypes that do the same."""

    names: tuple[str, str]
    distance: float
    """`shape_distance` between them [m]."""

    def __str__(self) -> str:
        return f"like {self.names[1]}: {1e3 * self.distance:.1f} mm apart on average"


def shape_distance(
    points_a: FloatArray,
    normals_a: FloatArray,
    points_b: FloatArray,
    normals_b: FloatArray,
) -> float:
    """Mean distance between two surfaces in one frame [m].

    Of each point to the nearest of the other surface, with the turn between the normals
    counted at 20 mm per radian (chord), cut off at 30 mm, both ways. A metric in all
    but the triangle inequality; 0 for equal surfaces, about 4 mm for two samples of one
    surface at one point per square centimetre.

    Parameters
    ----------
    points_a, normals_a, points_b, normals_b
        [m], palm frame, shapes (n, 3) and (m, 3), at least one point each.
    """
    a, b = surface_points(points_a, normals_a), surface_points(points_b, normals_b)
    return (mean_distance(a, cKDTree(b)) + mean_distance(b, cKDTree(a))) / 2


def surface_points(points: FloatArray, normals: FloatArray) -> FloatArray:
    """Positions and turns as points in one space [m], shape (n, 6)."""
    return np.hstack([points, _TURN * normals])


def mean_distance(surface: FloatArray, tree: cKDTree) -> float:
    """Mean distance [m] of `surface_points` to the nearest ones of another surface."""
    distance = np.asarray(tree.query(surface)[0])
    return float(np.minimum(distance, _FARTHEST).mean())


def duplicates(
    prototypes: Sequence[GraspPrototype], others: Iterable[GraspPrototype] = ()
) -> tuple[Likeness, ...]:
    """Pairs that the same surface would match for the same hand, nearest first.

    Parameters
    ----------
    prototypes
        Compared with one another, and each with all of ``others``.
    """
    known = {p.name for p in prototypes}
    pairs = [*combinations(prototypes, 2)]
    pairs += [(p, q) for p in prototypes for q in others if q.name not in known]
    found = []
    for a, b in pairs:
        is_same_hand = (a.gripper, a.preshape) == (b.gripper, b.preshape)
        if not is_same_hand or abs(a.width - b.width) > _WIDTH_STEP:
            continue
        distance = shape_distance(a.points, a.normals, b.points, b.normals)
        if distance < DUPLICATE:
            found.append(Likeness((a.name, b.name), distance))
    return tuple(sorted(found, key=lambda pair: pair.distance))


def half_turns(prototype: GraspPrototype) -> tuple[str, ...]:
    """Axes along those of the palm about which a half turn changes nothing.

    About ``z`` the hand may come turned about its approach: thumb and pair change
    sides. About ``y`` it may come from the opposite side, about ``x`` from there too
    with the sides kept. Of a measured surface, turned about its middle, this is an
    estimate.
    """
    if not isinstance(prototype.definition.shape, SurfaceShape):
        turns = prototype.symmetry.elements(n_spins=4).R
        return tuple(
            name
            for axis, name in enumerate("xyz")
            if np.any(np.abs(turns - _half_turn(axis)).max(axis=(1, 2)) < 1e-6)
        )
    middle = (prototype.bounds.lower + prototype.bounds.upper) / 2
    offset, normals = prototype.points - middle, prototype.normals
    found = []
    for axis, name in enumerate("xyz"):
        turn = np.diag(_half_turn(axis))
        distance = shape_distance(offset, normals, turn * offset, turn * normals)
        if distance < _SYMMETRIC:
            found.append(name)
    return tuple(found)


def _half_turn(axis: int) -> FloatArray:
    """Rotation (3, 3) by 180 degrees about an axis of the palm frame."""
    turn = -np.eye(3)
    turn[axis, axis] = 1.0
    return turn
