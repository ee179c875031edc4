"""Finding the ground, and refusing to take it away without evidence.

The ground is expected at z = 0 of the base frame. It is fitted as a plane, then
followed by a smooth map of local heights, so that uneven ground goes too. It is taken
away only if everything speaks for it (see `GroundConfig`); otherwise nothing is, and
the report says why.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, frozen
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import Bounds, PointCloud

from .height_map import DEEP, HeightMap, fitted_height_map
from .segmentation import GroundReport
from .voxels import cell_ids

__all__ = ["GroundConfig", "find_ground"]

_FIT_BANDS = (0.12, 0.08, 0.05, 0.035, 0.025, 0.02)
"""Half widths of the successive slabs whose points are fitted [m]; the last are thinner
than most things that lie flat, or these would lift the plane."""
_FOOTPRINT_CELL = 0.05
"""Edge of the cells that make up the region of interest [m]."""
_MIN_STANDING = 10
"""Points above the ground that make a cell part of it; fewer are noise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundConfig:
    """The evidence that removal of the ground needs."""

    max_tilt: float = float(np.deg2rad(10))
    """Largest angle between the fitted plane and the horizontal [rad]."""
    max_height: float = 0.04
    """Largest distance of the fitted plane from z = 0 at its middle [m]."""
    min_inlier_share: float = 0.25
    """Smallest share of all points that must lie on the ground."""
    max_removed_share: float = 0.6
    """Largest share of the points in the region of interest that removal may take.

    Unless the caller names a region, it is the ground plan of what stands: the cells of
    5 cm that hold points above the ground. A floor seen around a small pile is outside
    and doesn't count; a plane that eats what stands on it is found out."""
    min_left: int = 500
    """Fewest points that must be left over."""
    clearance: float = 0.012
    """Points up to this height above the local ground belong to it [m], or up to three
    times the noise seen at their distance; larger loses flat things, smaller leaves
    patches of ground."""

    def __post_init__(self) -> None:
        for name in ("max_tilt", "max_height", "clearance"):
            if not 0 < getattr(self, name) < np.inf:
                raise ConfigError(name, got=getattr(self, name), expected="above 0")
        for name in ("min_inlier_share", "max_removed_share"):
            if not 0 <= getattr(self, name) <= 1:
                raise ConfigError(name, got=getattr(self, name), expected="in [0, 1]")
        if self.min_left < 0:
            raise ConfigError("min_left", got=self.min_left, expected="0 or more")


def find_ground(
    cloud: PointCloud,
    config: GroundConfig,
    *,
    region: Bounds | None = None,
    is_cropped: bool = False,
) -> tuple[BoolArray, GroundReport]:
    """Decide which points are ground.

    Parameters
    ----------
    cloud
        In a frame with z up and the ground at z = 0.
    region
        Region of interest; None takes the ground plan of what stands.
    is_cropped
        Whether the cloud was cut to a region, so that the share of ground in it means
        nothing; removal is then refused.

    Returns
    -------
    is_ground, report
        ``is_ground`` has shape (n,) and is False everywhere if removal was refused.
    """
    report = GroundReport(
        status="skipped",
        reason="",
        plane=None,
        tilt=np.nan,
        height=np.nan,
        inlier_share=0.0,
        removed_share=np.nan,
        n_removed=0,
    )
    if is_cropped:
        return _refused(cloud, report, "the cloud is marked as cropped")
    sample = _sample(cloud)
    points = cloud.points[sample]
    plane = _fitted_plane(points, cloud.normals[sample])
    if plane is None:
        return _refused(cloud, report, "too few level points near z = 0 to fit a plane")
    over_plane = points @ plane[:3] + plane[3]
    x, y, _ = points[np.abs(over_plane) < _FIT_BANDS[-1]].mean(axis=0)
    report = replace(
        report,
        plane=frozen(plane, "plane", (4,)),
        tilt=float(np.arccos(np.clip(plane[2], -1, 1))),
        height=float(-(plane[0] * x + plane[1] * y + plane[3]) / plane[2]),
    )
    ground = fitted_height_map(points, over_plane, cloud.viewpoint)
    is_ground, inlier_share = _near_ground(cloud, plane, ground, config.clearance)
    report = replace(report, inlier_share=inlier_share)
    inside = (
        _footprint(cloud, ~is_ground)
        if region is None
        else region.contains(cloud.points)
    )
    n_inside = max(int(np.count_nonzero(inside)), 1)
    removed_share = float(np.count_nonzero(is_ground & inside) / n_inside)
    report = replace(report, removed_share=removed_share)
    n_left = len(cloud) - int(np.count_nonzero(is_ground))
    objection = _objection(report, n_left, config)
    if objection:
        return _refused(cloud, report, objection)
    return is_ground, replace(
        report,
        status="removed",
        n_removed=len(cloud) - n_left,
        reason=f"level plane {1e3 * report.height:+.0f} mm from the expected height, "
        f"{inlier_share:.0%} of the points on it",
    )


def _refused(
    cloud: PointCloud, report: GroundReport, reason: str
) -> tuple[BoolArray, GroundReport]:
    return np.zeros(len(cloud), dtype=bool), replace(report, reason=reason)


def _objection(report: GroundReport, n_left: int, config: GroundConfig) -> str:
    """First piece of evidence that is missing, in words; empty if none is."""
    if report.tilt > config.max_tilt:
        return (
            f"the fitted plane tilts {np.degrees(report.tilt):.1f} deg, more than "
            f"{np.degrees(config.max_tilt):.0f}"
        )
    if abs(report.height) > config.max_height:
        return (
            f"the fitted plane lies {1e3 * report.height:.0f} mm from the expected "
            f"height, more than {1e3 * config.max_height:.0f}"
        )
    if report.inlier_share < config.min_inlier_share:
        return (
            f"only {report.inlier_share:.0%} of the points lie on the ground, less "
            f"than {config.min_inlier_share:.0%}"
        )
    if n_left < config.min_left:
        return f"only {n_left} points would be left, fewer than {config.min_left}"
    if report.removed_share > config.max_removed_share:
        return (
            f"{report.removed_share:.0%} of the points in the region of interest "
            f"would go, more than {config.max_removed_share:.0%}"
        )
    return ""


def _near_ground(
    cloud: PointCloud, plane: FloatArray, ground: HeightMap, clearance: float
) -> tuple[BoolArray, float]:
    """Which points belong to the ground, and the share that lies right on it."""
    over_plane = cloud.points @ plane[:3] + plane[3]
    lowest, highest = ground.heights.min(), ground.heights.max()
    # On even ground this decides nearly all of it; the rest is looked at one by one.
    is_ground = (over_plane > highest - clearance) & (over_plane < lowest + clearance)
    n_inliers = np.count_nonzero(is_ground)
    near = np.flatnonzero(~is_ground & (np.abs(over_plane) < 3.0 * DEEP))
    points = cloud.points[near]
    local = over_plane[near] - ground.at(points)
    offset = points - cloud.viewpoint
    reach = np.sqrt(np.einsum("ij,ij->i", offset, offset))
    limit = np.maximum(clearance, 3.0 * ground.noise * reach)
    is_ground[near] = (local < limit) & (local > -np.maximum(DEEP, 2.0 * limit))
    n_inliers += np.count_nonzero(np.abs(local) < limit)
    return is_ground, n_inliers / len(cloud)


def _footprint(cloud: PointCloud, is_standing: BoolArray) -> BoolArray:
    """Which points lie in plan cells that hold several standing points, shape (n,)."""
    keys = np.zeros((3, len(cloud)), dtype=np.int64)
    np.floor(cloud.points[:, :2].T / _FOOTPRINT_CELL, out=keys[:2], casting="unsafe")
    cell, cells = cell_ids(keys)
    count = np.bincount(cell[is_standing], minlength=cells.shape[1])
    inside: BoolArray = count[cell] >= _MIN_STANDING
    return inside


def _sample(cloud: PointCloud) -> IntArray:
    """Points that stand for all in a fit: every other row and column of an image."""
    if cloud.pixels is None or cloud.image_shape is None:
        return np.arange(len(cloud))
    lattice = np.zeros(cloud.image_shape, dtype=bool)
    lattice[::2, ::2] = True
    return np.flatnonzero(lattice.ravel()[cloud.pixels])


def _fitted_plane(points: FloatArray, normals: FloatArray) -> FloatArray | None:
    """Plane near z = 0 through level points, by fits to ever thinner slabs."""
    with np.errstate(invalid="ignore"):
        # A point without a normal may be level too.
        tilted = normals[:, 2] < np.cos(np.deg2rad(30))
    x, y, z = points[~tilted & (np.abs(points[:, 2]) < 3 * _FIT_BANDS[0])].T
    rows = np.stack([x, y, np.ones(len(x))])
    slope = np.zeros(3)
    for band in _FIT_BANDS:
        near = np.abs(z - slope @ rows) < band
        if near.sum() < 10:
            return None
        A = rows[:, near]
        moments = A @ A.T
        if np.linalg.cond(moments) > 1e10:
            return None
        slope = np.linalg.solve(moments, A @ z[near])
    plane = np.array([-slope[0], -slope[1], 1.0, -slope[2]])
    unit: FloatArray = plane / np.linalg.norm(plane[:3])
    return unit
