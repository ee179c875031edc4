"""Obstacles for the links of an arm: everything measured, and the ground itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import (
    Bounds,
    DistanceField,
    LineOfSight,
    PointCloud,
    voxel_downsample,
)

__all__ = ["ObstacleMap"]


@dataclass(frozen=True, slots=True, eq=False)
class ObstacleMap:
    """Distance to the nearest obstacle, truncated; coarser than a `GraspScene`."""

    field: DistanceField | None
    """None if nothing was measured within the workspace."""
    ground_plane: FloatArray | None
    """(a, b, c, d) with a x + b y + c z + d the height over the ground [m]; None where
    there is no evidence of a ground."""
    truncation: float
    """Largest distance returned [m]."""

    @classmethod
    def build(
        cls,
        cloud: PointCloud,
        sight: LineOfSight,
        ground_plane: FloatArray | None,
        *,
        spacing: float = 0.02,
        truncation: float = 0.10,
        radius: float = 2.5,
    ) -> ObstacleMap:
        """Collect the obstacles of a capture in the base frame.

        Parameters
        ----------
        spacing, truncation
            Cell size, and the distance at which the map saturates [m].
        radius
            Points farther than this from the base in any axis are out of every arm's
            way [m].
        """
        cloud.require_frame("base")
        workspace = Bounds(np.full(3, -radius), np.full(3, radius))
        near = np.flatnonzero(workspace.contains(cloud.points))
        if not len(near):
            return cls(None, ground_plane, truncation)
        thinned = near[voxel_downsample(cloud.points.take(near, axis=0), spacing)]
        field = DistanceField.build(
            cloud.selected(thinned),
            Bounds.around(cloud.points[thinned], truncation),
            sight,
            spacing=spacing,
            truncation=truncation,
        )
        return cls(field, ground_plane, truncation)

    def __call__(self, points: FloatArray) -> FloatArray:
        """Distance of points (..., 3), base frame, to the nearest obstacle [m]."""
        distance = np.full(points.shape[:-1], self.truncation)
        if self.field is not None:
            distance = np.minimum(distance, self.field.distance(points))
        if self.ground_plane is not None:
            height = points @ self.ground_plane[:3] + self.ground_plane[3]
            distance = np.minimum(distance, height)
        return distance
