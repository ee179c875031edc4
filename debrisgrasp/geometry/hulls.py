"""Convex hulls of points."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from debrisgrasp._arrays import FloatArray, IntArray, as_rows, require_finite
from debrisgrasp.errors import InputError

__all__ = ["hull_of", "hull_volume"]


def hull_of(points: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
    """Corners, outward-wound triangles and their planes, of points (n, 3) [m].

    A plane is an outward unit normal and an offset: ``n . x + d <= 0`` inside.

    Raises
    ------
    ShapeError
        If the points are not (n, 3).
    InputError
        If they span no volume, or one of them is not finite.
    """
    points = _finite(points)
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError) as error:
        raise InputError(
            "points of a hull",
            got=f"{len(points)} that span no volume",
            expected="at least four that do not lie in one plane",
        ) from error
    faces = np.searchsorted(hull.vertices, hull.simplices)
    a, b, c = (points[hull.simplices[:, k]] for k in range(3))
    outwards = (np.cross(b - a, c - a) * hull.equations[:, :3]).sum(axis=1)
    faces[outwards < 0] = faces[outwards < 0][:, ::-1]
    return points[hull.vertices], faces, hull.equations


def hull_volume(points: FloatArray) -> float:
    """Volume between points (n, 3) [m^3]; 0 if they are flat.

    Raises
    ------
    InputError
        As `hull_of`, but for flat points.
    """
    points = _finite(points)
    try:
        return float(ConvexHull(points).volume)
    except (QhullError, ValueError):
        return 0.0


def _finite(points: FloatArray) -> FloatArray:
    """Give points as (n, 3): Qhull ends the process at those of another shape."""
    points = as_rows(points, "points of a hull")
    require_finite(points, "points of a hull")
    return points
