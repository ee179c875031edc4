"""Meshes and sphere covers of the primitive solids, in the solid's own frame."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray
from debrisgrasp.errors import InputError

from .lattice import lattice

__all__ = [
    "SphereSet",
    "TriangleMesh",
    "box_mesh",
    "cover_bar",
    "cover_box",
    "cover_revolved",
    "dome_profile",
    "revolved_mesh",
]

TriangleMesh = tuple[FloatArray, IntArray]
"""Vertices (v, 3) [m] and faces (f, 3), counter-clockwise seen from outside."""
SphereSet = tuple[FloatArray, FloatArray]
"""Centres (s, 3) and radii (s,) [m]."""

_SEGMENTS = 24
_BAR_LIMIT = 0.95
"""A row of single spheres covers a round bar up to this share of the largest allowed
radius; closer to it the row needs more spheres than a grid."""


def box_mesh(half_extents: FloatArray) -> TriangleMesh:
    """Twelve triangles of a box centred at the origin."""
    corners = np.array(
        [[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)]
    )
    quads = np.array(
        [
            [0, 1, 3, 2],
            [4, 6, 7, 5],
            [0, 4, 5, 1],
            [2, 3, 7, 6],
            [0, 2, 6, 4],
            [1, 5, 7, 3],
        ]
    )
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return corners * half_extents, faces


def dome_profile(radius: float, height: float) -> FloatArray:
    """Quarter circles from the bottom pole to the top one, ``height`` apart.

    Returns (rho, z) pairs for `revolved_mesh`; both poles are left out.
    """
    angles = np.linspace(-np.pi / 2, np.pi / 2, _SEGMENTS // 2 + 1)[1:-1]
    z = radius * np.sin(angles)
    return np.stack([radius * np.cos(angles), z + np.sign(z) * height / 2], axis=-1)


def revolved_mesh(profile: FloatArray, bottom: float, top: float) -> TriangleMesh:
    """Turn a profile about z and close it at both poles.

    Parameters
    ----------
    profile
        Pairs (rho, z) from the bottom up [m], shape (r, 2), rho > 0.
    bottom, top
        Heights of the poles on the axis [m].
    """
    turn = np.arange(_SEGMENTS) * (2.0 * np.pi / _SEGMENTS)
    rho, z = profile[:, :1], profile[:, 1:]
    rings = np.stack(
        [
            rho * np.cos(turn),
            rho * np.sin(turn),
            np.broadcast_to(z, (len(z), len(turn))),
        ],
        axis=-1,
    ).reshape(-1, 3)
    poles = np.array([[0.0, 0.0, bottom], [0.0, 0.0, top]])
    low = np.arange(_SEGMENTS)
    low_next = np.roll(low, -1)
    start = (np.arange(len(profile) - 1) * _SEGMENTS)[:, None]
    a, b = (start + low).ravel(), (start + low_next).ravel()
    c, d = a + _SEGMENTS, b + _SEGMENTS
    pole_low, pole_high = len(rings), len(rings) + 1
    high, high_next = (low + len(rings) - _SEGMENTS, low_next + len(rings) - _SEGMENTS)
    faces = np.concatenate(
        [
            np.stack([a, b, d], axis=-1),
            np.stack([a, d, c], axis=-1),
            np.stack([low_next, low, np.full_like(low, pole_low)], axis=-1),
            np.stack([high, high_next, np.full_like(low, pole_high)], axis=-1),
        ]
    )
    return np.concatenate([rings, poles]), faces


def cover_box(half_extents: FloatArray, max_radius: float) -> SphereSet:
    """Cover a box by the circumscribed spheres of a grid of equal cells.

    An axis that is thin compared with ``max_radius`` isn't divided, which leaves the
    others a coarser grid.
    """
    _require_radius(max_radius)
    cell = np.array(half_extents, dtype=np.float64)
    budget, remaining = max_radius**2, 3
    for axis in np.argsort(half_extents):
        cell[axis] = min(cell[axis], np.sqrt(budget / remaining))
        budget -= cell[axis] ** 2
        remaining -= 1
    counts = np.ceil(half_extents / cell - 1e-9).astype(int)
    cell = half_extents / counts
    lines = [
        (2 * np.arange(count) + 1 - count) * half
        for count, half in zip(counts, cell, strict=True)
    ]
    centers = lattice(*lines).reshape(-1, 3)
    return centers, np.full(len(centers), np.linalg.norm(cell))


def cover_bar(radius: float, length: float, max_radius: float) -> SphereSet | None:
    """Cover a cylinder about z by one row of spheres; None if it is too thick."""
    _require_radius(max_radius)
    if radius > _BAR_LIMIT * max_radius:
        return None
    reach = np.sqrt(max_radius**2 - radius**2)
    count = max(1, int(np.ceil(length / (2 * reach) - 1e-9)))
    half = length / (2 * count)
    centers = np.zeros((count, 3))
    centers[:, 2] = (2 * np.arange(count) + 1 - count) * half
    return centers, np.full(count, np.hypot(radius, half))


def cover_revolved(
    signed_distance: Callable[[FloatArray], FloatArray],
    radius: float,
    length: float,
    max_radius: float,
) -> SphereSet:
    """Cover a solid inside the cylinder (radius, length) by the cells that it meets."""
    centers, radii = cover_box(np.array([radius, radius, length / 2]), max_radius)
    meets = signed_distance(centers) <= radii
    return centers[meets], radii[meets]


def _require_radius(max_radius: float) -> None:
    if not max_radius > 0:
        raise InputError(
            "max_radius of a sphere cover", got=max_radius, expected="a length > 0"
        )
