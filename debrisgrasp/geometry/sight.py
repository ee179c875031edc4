"""What the sensor saw along each of its lines of sight.

A point in front of the measured surface lies in space that was seen to be free. A
point behind it was not seen, and neither was one where the sensor returned nothing:
unknown is not the same as free.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from debrisgrasp._arrays import Float32Array, FloatArray

from .camera import Intrinsics
from .cloud import PointCloud
from .se3 import SE3

__all__ = ["DepthSight", "LineOfSight", "PanoramicSight"]


class LineOfSight(Protocol):
    """Compares points with what was measured in their direction."""

    def clearance(self, points: FloatArray | Float32Array) -> Float32Array:
        """How far each point lies in front of the surface measured behind it.

        Parameters
        ----------
        points
            Positions in the base frame [m], shape (..., 3).

        Returns
        -------
        Float32Array
            Metres along the optical axis or the ray, shape (...): positive in front of
            the measured surface, negative behind it, NaN where nothing was measured.
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class DepthSight:
    """Lines of sight of a depth image."""

    depth: Float32Array
    """Metres along the optical axis, shape (height, width); NaN = nothing measured."""
    intrinsics: Intrinsics
    T_base_camera: SE3

    def clearance(self, points: FloatArray | Float32Array) -> Float32Array:
        """See `LineOfSight.clearance`."""
        inverse = self.T_base_camera.inverse().matrix.astype(np.float32)
        local = np.asarray(points, np.float32) @ inverse[:3, :3].T + inverse[:3, 3]
        z = local[..., 2]
        camera = self.intrinsics
        is_ahead = z > np.float32(1e-3)
        safe = np.where(is_ahead, z, np.float32(1.0))
        # Far outside the image the product overflows int32, so it is clipped first.
        u = np.clip(camera.fx * local[..., 0] / safe + camera.cx, -2, camera.width + 1)
        v = np.clip(camera.fy * local[..., 1] / safe + camera.cy, -2, camera.height + 1)
        column, row = np.rint(u).astype(np.int32), np.rint(v).astype(np.int32)
        is_seen = (
            is_ahead
            & (column >= 0)
            & (column < camera.width)
            & (row >= 0)
            & (row < camera.height)
        )
        flat = np.where(is_seen, row * np.int32(camera.width) + column, 0)
        measured = np.asarray(self.depth, np.float32).ravel()[flat]
        return np.where(is_seen, measured - z, np.float32(np.nan))


@dataclass(frozen=True, slots=True, eq=False)
class PanoramicSight:
    """Lines of sight of an unorganised cloud, as a range image around its viewpoint."""

    ranges: Float32Array
    """Smallest range measured per direction [m], shape (rows, columns) in elevation and
    azimuth; NaN = nothing measured."""
    viewpoint: FloatArray
    """Position of the sensor in the base frame [m], shape (3,)."""

    @classmethod
    def from_cloud(cls, cloud: PointCloud, resolution: float = 0.01) -> PanoramicSight:
        """Bin the cloud by direction, ``resolution`` [rad] wide.

        Wider bins close the gaps between beams; they also let near edges hide more of
        what is behind them.
        """
        rows = max(2, round(np.pi / resolution))
        ranges = np.full((rows, 2 * rows), np.inf, dtype=np.float32)
        flat, distance = _directions(cloud.points, cloud.viewpoint, ranges.shape)
        np.minimum.at(ranges.ravel(), flat, distance)
        ranges[np.isinf(ranges)] = np.nan
        return cls(ranges, cloud.viewpoint)

    def clearance(self, points: FloatArray | Float32Array) -> Float32Array:
        """See `LineOfSight.clearance`."""
        flat, distance = _directions(points, self.viewpoint, self.ranges.shape)
        clearance: Float32Array = self.ranges.ravel()[flat] - distance
        return clearance


def _directions(
    points: FloatArray | Float32Array, viewpoint: FloatArray, shape: tuple[int, ...]
) -> tuple[np.ndarray, Float32Array]:
    """Flat bin index and range [m] of points as seen from the viewpoint."""
    ray = np.asarray(points, np.float32) - viewpoint.astype(np.float32)
    distance = np.sqrt((ray * ray).sum(axis=-1))
    sine = ray[..., 2] / np.maximum(distance, np.float32(1e-6))
    elevation = np.arcsin(np.clip(sine, -1.0, 1.0))
    azimuth = np.arctan2(ray[..., 1], ray[..., 0])
    rows, columns = shape
    row = np.clip((elevation / np.pi + 0.5) * rows, 0, rows - 1).astype(np.int64)
    column = ((azimuth / (2 * np.pi) + 0.5) * columns).astype(np.int64) % columns
    return row * columns + column, distance
