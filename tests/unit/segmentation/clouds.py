"""Small clouds with known answers."""

from __future__ import annotations

from functools import cache

import numpy as np

from debrisgrasp.geometry import SE3, Box, PointCloud, Solid, so3
from debrisgrasp.segmentation import GroundReport, Segmentation, SegmentEdges
from debrisgrasp.segmentation.segmentation import measured_segments
from tests.scenes import capture_of

VIEWPOINT = np.array([0.0, 0.0, 1.5])


def cloud_of(points: np.ndarray, normals: np.ndarray | None = None) -> PointCloud:
    """Return an unorganised cloud; without normals they are all unknown."""
    points = np.asarray(points, dtype=np.float64)
    if normals is None:
        normals = np.full_like(points, np.nan)
    return PointCloud(
        points=points,
        normals=np.broadcast_to(normals, points.shape),
        viewpoint=VIEWPOINT,
    )


def plate(
    x: tuple[float, float],
    y: tuple[float, float],
    z: float = 0.3,
    spacing: float = 0.004,
) -> np.ndarray:
    """Points of a level rectangle."""
    grid = np.meshgrid(np.arange(*x, spacing), np.arange(*y, spacing), indexing="ij")
    flat = np.stack([axis.ravel() for axis in grid], axis=1)
    return np.column_stack([flat, np.full(len(flat), z)])


def box_at(
    x: float, y: float, z: float, size: tuple[float, float, float], yaw: float = 0.0
) -> Box:
    """Box with its centre at (x, y, z) and full edge lengths ``size``."""
    R = so3.from_rpy(np.array([0.0, 0.0, yaw]))
    return Box(np.asarray(size) / 2, SE3.from_parts(R, [x, y, z]))


TWO_BOXES = (
    box_at(0.95, 0.18, 0.1, (0.2, 0.2, 0.2), yaw=0.5),
    box_at(1.0, -0.18, 0.15, (0.18, 0.18, 0.3), yaw=0.2),
)
STACK = (
    box_at(1.0, 0.0, 0.1, (0.3, 0.3, 0.2), yaw=0.6),
    box_at(1.0, 0.0, 0.27, (0.14, 0.14, 0.14), yaw=0.2),
)


@cache
def scene_cloud(solids: tuple[Solid, ...], *, has_floor: bool = True) -> PointCloud:
    """Organised cloud of solids on the floor, seen from ahead and above."""
    return capture_of(solids, has_floor=has_floor).cloud()


def truth_of(cloud: PointCloud, solids: tuple[Solid, ...]) -> np.ndarray:
    """Number of the solid each point lies on, from 1; 0 for none."""
    distance = np.stack([np.abs(s.signed_distance(cloud.points)) for s in solids])
    return np.where(distance.min(axis=0) < 2e-3, distance.argmin(axis=0) + 1, 0)


def labelled(cloud: PointCloud, labels: np.ndarray) -> Segmentation:
    """Return a segmentation with given labels, and no doubt about its borders."""
    labels = np.asarray(labels, dtype=np.int32)
    edges = SegmentEdges(
        labels=np.zeros((0, 2), dtype=np.int32),
        convexity=np.zeros(0),
        contact_length=np.zeros(0),
        upper=np.zeros(0, dtype=np.int32),
        score=np.zeros(0),
    )
    certainty = np.ones(int(labels.max(initial=0)) + 1)
    segments = measured_segments(cloud.points, labels, certainty)
    ground = GroundReport.skipped("labels are given")
    return Segmentation(
        labels=labels,
        segments=segments,
        edges=edges,
        patches=labels,
        ground=ground,
        method="lccp",
    )


def same_partition(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether two labellings agree up to the names of labels other than 0."""
    pairs = np.unique(np.stack([a, b], axis=1), axis=0)
    one_to_one = (
        len(np.unique(pairs[:, 0])) == len(pairs) == len(np.unique(pairs[:, 1]))
    )
    return bool(one_to_one and np.array_equal(a == 0, b == 0))
