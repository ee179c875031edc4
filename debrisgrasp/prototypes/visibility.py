"""Which points of a shape a camera sees from which side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray

from .parts import Body

__all__ = ["GRAZING_ANGLE", "VisibilityTable", "visible_points"]

GRAZING_ANGLE = np.deg2rad(80.0)
"""Surface seen at a larger angle from its normal counts as hidden: depth cameras
return little or nothing from it."""

_LIFT = 1e-4
"""Rays start this far above the surface [m], so that it doesn't hide itself."""


@dataclass(frozen=True, slots=True, eq=False)
class VisibilityTable:
    """Visible points for each of many directions of view."""

    directions: FloatArray
    """Unit vectors from the shape to a distant camera, in the frame of the points,
    shape (d, 3)."""
    is_visible: BoolArray
    """Shape (d, m)."""


def visible_points(
    points: FloatArray,
    normals: FloatArray,
    parts: Sequence[Body],
    directions: FloatArray,
) -> BoolArray:
    """Decide for each direction which points of the body are seen.

    A point is seen if it faces the camera by less than the grazing angle and no part
    of the body stands in between.

    Parameters
    ----------
    points, normals
        Of the surface [m], shapes (m, 3).
    parts
        The body, in the same frame.
    directions
        Unit vectors towards the camera, shape (d, 3).

    Returns
    -------
    BoolArray
        Shape (d, m).
    """
    seen: BoolArray = directions @ normals.T > np.cos(GRAZING_ANGLE)
    # A convex body hides nothing that faces the camera.
    if len(parts) == 1 and parts[0].is_convex:
        return seen
    for part in parts:
        seen &= ~part.blocks(points + _LIFT * normals, directions)
    return seen
