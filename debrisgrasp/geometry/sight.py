"""What the sensor saw along each of its lines of sight.

A point in front of the measured surface lies in space that was seen to be free. A
point behind it was not seen, and neither was one where the sensor returned nothing:
unknown is not the same as free.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from debrisgrasp._arrays import Float32Array, FloatArray, IntArray

from .camera import Intrinsics
from .cloud import PointCloud
from .se3 import SE3

__all__ = ["DepthSight", "LineOfSight", "PanoramicSight", "sight_points"]

_HOUSING = 0.10
"""So near to a camera is its own housing [m]."""
_POINTS = 48
"""Looked at on each line of sight."""


class LineOfSight(Protocol):
    """Compares points with what was measured in their direction."""

    def clearance(
        self, x: Float32Array, y: Float32Array, z: Float32Array
    ) -> Float32Array:
        """How far each point lies in front of the surface measured behind it.

        Parameters
        ----------
        x, y, z
            Coordinates in the base frame [m], shapes that broadcast together; those of
            a grid are best given along one axis each.

        Returns
        -------
        Float32Array
            Metres along the optical axis or the ray, in the common shape: positive in
            front of the measured surface, negative behind it, NaN where nothing was
            measured.
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class DepthSight:
    """Lines of sight of a depth image."""

    depth: Float32Array
    """Metres along the optical axis, shape (height, width); NaN = nothing measured."""
    intrinsics: Intrinsics
    T_base_camera: SE3
    _framed: Float32Array = field(init=False, repr=False)
    """Depth inside a border of pixels without measurement, which takes whatever falls
    outside the image; flat."""

    def __post_init__(self) -> None:
        depth = np.asarray(self.depth, np.float32)
        framed = np.pad(depth, 1, constant_values=np.float32(np.nan))
        object.__setattr__(self, "_framed", framed.ravel())

    def clearance(
        self, x: Float32Array, y: Float32Array, z: Float32Array
    ) -> Float32Array:
        """Clearance [m] at points, shapes (n,): see `LineOfSight.clearance`."""
        T = self.T_base_camera.inverse().matrix.astype(np.float32)
        # Summed in this order, the coordinates of a grid meet only in the last step.
        across, down, ahead = (
            (T[i, 0] * x + T[i, 1] * y + T[i, 3]) + T[i, 2] * z for i in range(3)
        )
        camera = self.intrinsics
        scale = np.float32(1.0) / np.maximum(ahead, np.float32(1e-3))
        column = _pixel(across, scale, camera.fx, camera.cx, camera.width)
        row = _pixel(down, scale, camera.fy, camera.cy, camera.height)
        row *= np.int32(camera.width + 2)
        row += column
        clearance: Float32Array = self._framed.take(row)
        clearance -= ahead
        clearance[ahead <= np.float32(1e-3)] = np.nan
        return clearance


def _pixel(
    offset: Float32Array, scale: Float32Array, focal: float, center: float, n: int
) -> IntArray:
    """Pixel along one axis, counted in an image framed by one pixel more."""
    pixel = offset * scale
    pixel *= np.float32(focal)
    pixel += np.float32(center + 1.5)
    np.clip(pixel, 0, n + 1, out=pixel)
    return pixel.astype(np.int32)


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

    def clearance(
        self, x: Float32Array, y: Float32Array, z: Float32Array
    ) -> Float32Array:
        """Clearance [m] at points, shapes (n,): see `LineOfSight.clearance`."""
        points = np.stack(np.broadcast_arrays(x, y, z), axis=-1)
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


def sight_points(
    cameras: FloatArray, points: FloatArray, *, short: float = 0.0
) -> FloatArray:
    """Spread points over the lines of sight from cameras to points.

    Parameters
    ----------
    cameras, points
        Where they are [m], in one frame, shapes (n, 3) or (3,).
    short
        How far before the points they end, where the seat of what is seen would be in
        the way [m]. At the cameras they begin outside their housing.

    Returns
    -------
    FloatArray
        Shape (n, 48, 3), in the same frame.
    """
    way = points - cameras
    length = np.linalg.norm(way, axis=-1)[..., None]
    along = np.linspace(0.0, 1.0, _POINTS)
    reached = _HOUSING + along * (length - _HOUSING - short)
    from_cameras = (reached / length)[..., None] * way[..., None, :]
    return np.asarray(cameras[..., None, :] + from_cameras)
