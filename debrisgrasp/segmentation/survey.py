"""What is ground, wall or container, whatever the place of the base of the robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from debrisgrasp._arrays import BoolArray, IntArray, frozen
from debrisgrasp.geometry import SE3, Bounds, PointCloud, by_place

from .ground import GroundConfig, find_ground
from .segmentation import GroundReport
from .surroundings import SurroundingsConfig, find_surroundings
from .voxels import grid_axes

__all__ = ["surveyed"]


def surveyed(
    cloud: PointCloud,
    ground: GroundConfig,
    surroundings: SurroundingsConfig,
    *,
    region: Bounds | None = None,
    is_cropped: bool = False,
) -> tuple[BoolArray, GroundReport]:
    """Find what each point is before objects are sought.

    In a frame on the ground under the viewpoint, that looks where the sensor does: the
    grids over ground and walls move with scene and sensor, and so does what is found.

    Parameters
    ----------
    cloud
        In the base frame, z up, at least one point.
    region, is_cropped
        As `segment_cloud` takes them.

    Returns
    -------
    is_standing, report
        As `find_surroundings` returns them; the plane of the report in the base frame.
    """
    R_seen_base = grid_axes(cloud, level=True)
    below = cloud.viewpoint * [1.0, 1.0, 0.0]
    T_seen_base = SE3.from_parts(R_seen_base, -R_seen_base @ below)
    seen = cloud.in_frame(T_seen_base, "seen")
    inside = None if region is None else region.contains(cloud.points)
    order: IntArray | None = None
    if seen.pixels is None:
        # Samples are taken by order, which must not be that of the base frame.
        order = by_place(seen.points)[0]
        seen = seen.selected(order)
        inside = None if inside is None else inside[order]
    is_ground, report = find_ground(seen, ground, inside=inside, is_cropped=is_cropped)
    standing, report = find_surroundings(seen, is_ground, report, surroundings)
    if report.plane is not None:
        plane = frozen(report.plane @ T_seen_base.matrix, "plane", (4,))
        report = replace(report, plane=plane)
    if order is None:
        return standing, report
    assert report.kinds is not None
    back = np.argsort(order)
    kinds = frozen(report.kinds[back], "kinds", (None,), np.uint8)
    return standing[back], replace(report, kinds=kinds)
