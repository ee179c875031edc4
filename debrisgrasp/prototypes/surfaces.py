"""Patches of surface, sampled evenly at a given density."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import FloatArray

from .parts import Body

__all__ = ["Patch", "flat", "round_plate", "round_wall", "sample"]

_GOLDEN = (5**0.5 - 1) / 2


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """A piece of surface with an area-preserving map from the unit square."""

    area: float
    """[m^2]."""
    at: Callable[[FloatArray], tuple[FloatArray, FloatArray]]
    """Points [m] and outward unit normals, (n, 3) each, for parameters (n, 2)."""


def flat(corner: ArrayLike, edge_u: ArrayLike, edge_v: ArrayLike) -> Patch:
    """Rectangle with the normal along ``edge_u`` x ``edge_v``.

    Parameters
    ----------
    corner, edge_u, edge_v
        One corner and the two edges from it [m], shape (3,).
    """
    corner, u, v = (np.asarray(item, dtype=float) for item in (corner, edge_u, edge_v))
    cross = np.cross(u, v)
    area = float(np.linalg.norm(cross))

    def at(uv: FloatArray) -> tuple[FloatArray, FloatArray]:
        points = corner + uv[:, :1] * u + uv[:, 1:] * v
        return points, np.broadcast_to(cross / area, points.shape)

    return Patch(area, at)


def round_wall(
    start: ArrayLike,
    end: ArrayLike,
    radius: float,
    *,
    reference: ArrayLike,
    arc: float = 2 * np.pi,
    is_hollow: bool = False,
) -> Patch:
    """Side of a round bar from ``start`` to ``end`` [m].

    Parameters
    ----------
    reference
        Direction, square to the axis, about which the arc is centred, shape (3,).
    arc
        How far round the patch reaches [rad].
    is_hollow
        The wall of a bore: the normals point to the axis.
    """
    start, end = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    length = float(np.linalg.norm(end - start))
    axis = (end - start) / length
    side = np.asarray(reference, dtype=float)
    up = np.cross(axis, side)
    sign = -1.0 if is_hollow else 1.0

    def at(uv: FloatArray) -> tuple[FloatArray, FloatArray]:
        angle = ((uv[:, 1] - 0.5) * arc)[:, None]
        radial = np.cos(angle) * side + np.sin(angle) * up
        return start + uv[:, :1] * (end - start) + radius * radial, sign * radial

    return Patch(length * radius * arc, at)


def round_plate(
    center: ArrayLike,
    normal: ArrayLike,
    radii: tuple[float, float],
    *,
    reference: ArrayLike,
    arc: float = 2 * np.pi,
) -> Patch:
    """Flat disc or piece of a ring between two radii [m], centred about an angle."""
    center, normal = np.asarray(center, dtype=float), np.asarray(normal, dtype=float)
    side = np.asarray(reference, dtype=float)
    up = np.cross(normal, side)
    inner, outer = radii

    def at(uv: FloatArray) -> tuple[FloatArray, FloatArray]:
        angle = ((uv[:, :1]) - 0.5) * arc
        radius = np.sqrt(inner**2 + uv[:, 1:] * (outer**2 - inner**2))
        points = center + radius * (np.cos(angle) * side + np.sin(angle) * up)
        return points, np.broadcast_to(normal, points.shape)

    return Patch((outer**2 - inner**2) * arc / 2, at)


def sample(
    patches: Sequence[Patch], parts: Sequence[Body], density: float
) -> tuple[FloatArray, FloatArray]:
    """Points and outward normals at one density, without those inside a part.

    Every patch gets its area times the density in points, on a golden-ratio lattice,
    so that thin and wide faces come out equally dense.

    Parameters
    ----------
    density
        Points per square metre.

    Returns
    -------
    points, normals
        Shapes (n, 3) [m].
    """
    points, normals = [], []
    for patch in patches:
        n = max(1, round(patch.area * density))
        index = np.arange(n)
        uv = np.column_stack([(index + 0.5) / n, (index * _GOLDEN + 0.5) % 1.0])
        patch_points, patch_normals = patch.at(uv)
        points.append(patch_points)
        normals.append(patch_normals)
    all_points, all_normals = np.concatenate(points), np.concatenate(normals)
    depth = np.min([part.signed_distance(all_points) for part in parts], axis=0)
    is_bare = depth > -1e-6
    return all_points[is_bare], all_normals[is_bare]
