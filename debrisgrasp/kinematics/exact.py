"""Contact of two solids, decided exactly."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import SE3, Box, Capsule, Cylinder, Solid, Sphere

from .hull import Hull

__all__ = ["ExactSolids"]


class ExactSolids:
    """Solids as the exact checker holds them."""

    def __init__(self, solids: Sequence[Solid]) -> None:
        import coal  # slow to load

        self._solids, self._coal = tuple(solids), coal
        self._shapes = [_shape(coal, solid) for solid in solids]

    def __reduce__(self) -> tuple[object, ...]:
        # The checker's own shapes stay behind, and are made anew.
        return ExactSolids, (self._solids,)

    def touch(
        self, i: int, T_base_i: FloatArray, j: int, T_base_j: FloatArray, margin: float
    ) -> bool:
        """Whether two solids, in frames posed so (4, 4), come within a margin [m]."""
        coal = self._coal
        request, result = coal.CollisionRequest(), coal.CollisionResult()
        request.security_margin = margin
        one, other = self._placed(i, T_base_i), self._placed(j, T_base_j)
        return bool(coal.collide(*one, *other, request, result))

    def distance(
        self, i: int, T_base_i: FloatArray, j: int, T_base_j: FloatArray
    ) -> float:
        """Distance of two solids [m]; negative where they overlap."""
        coal = self._coal
        one, other = self._placed(i, T_base_i), self._placed(j, T_base_j)
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        return float(coal.distance(*one, *other, request, result))

    def _placed(self, index: int, T_base_frame: FloatArray) -> tuple[Any, Any]:
        shape, T_frame_shape = self._shapes[index]
        T = T_base_frame @ T_frame_shape
        return shape, self._coal.Transform3s(T[:3, :3], T[:3, 3])


def _shape(coal: Any, solid: Solid) -> tuple[Any, FloatArray]:
    """Shape for the exact checker, and its pose in the solid's frame (4, 4)."""
    if isinstance(solid, Sphere):
        return coal.Sphere(solid.radius), SE3.from_parts(p=solid.center).matrix
    if isinstance(solid, Box):
        shape = coal.Box(*(2.0 * solid.half_extents))
    elif isinstance(solid, Cylinder):
        shape = coal.Cylinder(solid.radius, solid.length)
    elif isinstance(solid, Capsule):
        shape = coal.Capsule(solid.radius, solid.length)
    elif isinstance(solid, Hull):
        points, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
        for point in solid.points:
            points.append(point)
        for face in solid.faces:
            faces.append(coal.Triangle(*map(int, face)))
        shape = coal.Convex(points, faces)
    else:
        raise TypeError(f"no exact shape for {type(solid).__name__}")
    return shape, np.asarray(solid.T_frame_solid.matrix)
