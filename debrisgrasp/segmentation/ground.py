"""Finding the ground, and refusing to take it away without evidence.

The ground is expected at z = 0 of the base frame. It is fitted as a plane, then
followed by a smooth map of local heights, so that uneven ground goes too. It is taken
away only if everything speaks for it (see `GroundConfig`); otherwise nothing is, and
the report says why, and whether the scene contradicts the pose of the camera.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, frozen, require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import PointCloud, by_place

from .gravity import dominant_plane, pose_doubt, viewpoint_doubt
from .height_map import DEEP, HeightMap, fitted_height_map, raised_limits
from .segmentation import GroundReport

__all__ = ["GroundConfig", "find_ground", "spread_sample"]

_FIT_BANDS = (0.12, 0.08, 0.05, 0.035, 0.025, 0.02)
"""Half widths of the successive slabs whose points are fitted [m]; the last are thinner
than most things that lie flat, or these would lift the plane."""
_THIN_START = 2
"""Slabs that a second fit leaves out."""
_CLEARLY = 1.1
"""A second fit is taken where it holds so many times the points of the first."""
_FIT_POINTS = 18_000
"""About how many points the surface is fitted to."""
_LOW = 0.06
"""Height over the ground up to which things are looked for by averages [m]."""
_EXACT = 0.25
"""Share of the limits of tilt and height within which a plane is where it should be."""
_EXACT_SHARE = 0.4
"""Share of the points that a plane needs there, of that which it needs elsewhere."""
_MIN_STANDING = 6
"""Points above the ground that make a block of cells part of the region of interest;
fewer are noise."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class GroundConfig:
    """The evidence that removal of the ground needs."""

    max_tilt: float = float(np.deg2rad(10))
    """Largest angle between the fitted plane and the horizontal [rad]."""
    max_height: float = 0.04
    """Largest distance of the fitted plane from z = 0 at its middle [m]."""
    min_inlier_share: float = 0.25
    """Smallest share of all points that must lie on the ground; 0.4 times that where
    it is within a quarter of both limits above of where it is expected."""
    max_removed_share: float = 0.75
    """Largest share of the points in the region of interest that removal may take.

    Unless the caller names a region, it is the ground plan of what stands: the cells of
    4 cm that hold points above the ground. A floor seen around a small pile is outside
    and doesn't count; a plane that eats what stands on it is found out. Where most of
    the floor is seen outside, the share may be larger: a thin rod covers little of the
    cells that it crosses."""
    min_left: int = 500
    """Fewest points that must be left over."""
    clearance: float = 0.012
    """Points up to this height above the local ground belong to it [m]; larger loses
    flat things, smaller leaves patches of ground. Where three times the noise is more
    than that, it counts for single points, and the clearance for averages over a few
    centimetres, so that boards stay whole."""

    def __post_init__(self) -> None:
        require_range("max_tilt [rad]", self.max_tilt, 1e-6, np.pi)
        for name in ("max_height", "clearance"):
            require_range(f"{name} [m]", getattr(self, name), 1e-6, 5.0)
        for name in ("min_inlier_share", "max_removed_share"):
            if not 0 <= getattr(self, name) <= 1:
                raise ConfigError(name, got=getattr(self, name), expected="in [0, 1]")
        if self.min_left < 0:
            raise ConfigError("min_left", got=self.min_left, expected="0 or more")


def find_ground(
    cloud: PointCloud,
    config: GroundConfig,
    *,
    inside: BoolArray | None = None,
    is_cropped: bool = False,
) -> tuple[BoolArray, GroundReport]:
    """Decide which points are ground.

    Parameters
    ----------
    cloud
        In a frame with z up and the ground at z = 0.
    inside
        Which points are in the region of interest, shape (n,); None takes the ground
        plan of what stands.
    is_cropped
        Whether the cloud was cut to a region, so that the share of ground in it means
        nothing; removal is then refused.

    Returns
    -------
    is_ground, report
        ``is_ground`` has shape (n,) and is False everywhere if removal was refused.
    """
    report = GroundReport.skipped("")
    nothing = np.zeros(len(cloud), dtype=bool)
    if is_cropped:
        return nothing, replace(report, reason="the cloud is marked as cropped")
    sample = spread_sample(cloud, _FIT_POINTS)
    points, normals = cloud.points[sample], cloud.normals[sample]
    is_ground, report = _weighed(cloud, points, normals, config, inside, np.zeros(3))
    if report.status == "removed":
        return is_ground, report
    largest = dominant_plane(points, normals)
    # Steep or far from z = 0 at one end, the ground can escape the first slab.
    if largest is not None and largest.plane[2] > np.cos(config.max_tilt):
        a, b, c, d = largest.plane
        slope = np.array([-a, -b, -d]) / c
        is_ground, again = _weighed(cloud, points, normals, config, inside, slope)
        if again.status == "removed":
            return is_ground, again
    doubt = pose_doubt(
        largest,
        cloud.viewpoint,
        max_tilt=config.max_tilt,
        max_height=config.max_height,
        min_share=config.min_inlier_share,
    )
    return nothing, replace(report, pose_doubt=doubt)


def _weighed(
    cloud: PointCloud,
    points: FloatArray,
    normals: FloatArray,
    config: GroundConfig,
    inside: BoolArray | None,
    slope: FloatArray,
) -> tuple[BoolArray, GroundReport]:
    """Fit the ground from a first guess, and hold the evidence against the limits."""
    report = GroundReport.skipped("too few level points near z = 0 to fit a plane")
    plane = _fitted_plane(points, normals, slope)
    if plane is None:
        return np.zeros(len(cloud), dtype=bool), report
    over_plane = points @ plane[:3] + plane[3]
    x, y, _ = points[np.abs(over_plane) < _FIT_BANDS[-1]].mean(axis=0)
    ground = fitted_height_map(points, over_plane, cloud.viewpoint)
    is_ground, inlier_share, plan = _near_ground(cloud, plane, ground, config)
    judged = plan if inside is None else inside
    n_inside = max(int(np.count_nonzero(judged)), 1)
    n_ground = int(np.count_nonzero(is_ground))
    n_under = int(np.count_nonzero(is_ground & judged))
    is_seen_around = inside is None and n_under < 0.5 * n_ground
    report = replace(
        report,
        plane=frozen(plane, "plane", (4,)),
        tilt=float(np.arccos(np.clip(plane[2], -1, 1))),
        height=float(-(plane[0] * x + plane[1] * y + plane[3]) / plane[2]),
        inlier_share=inlier_share,
        removed_share=n_under / n_inside,
    )
    objection = _objection(report, len(cloud) - n_ground, config)
    if not objection and not is_seen_around:
        objection = _appetite(report, config)
    if objection:
        return is_ground, replace(report, reason=objection)
    return is_ground, replace(
        report,
        status="removed",
        pose_doubt=viewpoint_doubt(plane, cloud.viewpoint),
        n_removed=n_ground,
        reason=f"plane {1e3 * report.height:+z.0f} mm from the expected height, tilted "
        f"by {np.degrees(report.tilt):.0f} deg, {inlier_share:.0%} of the points on it",
    )


def _objection(report: GroundReport, n_left: int, config: GroundConfig) -> str:
    """First piece of evidence that is missing, in words; empty if none is."""
    if report.tilt > config.max_tilt:
        return (
            f"the fitted plane tilts {np.degrees(report.tilt):.1f} deg, more than "
            f"{np.degrees(config.max_tilt):.0f}"
        )
    if abs(report.height) > config.max_height:
        return (
            f"the fitted plane lies {1e3 * report.height:z.0f} mm from the expected "
            f"height, more than {1e3 * config.max_height:.0f}"
        )
    is_exact = report.tilt < _EXACT * config.max_tilt
    is_exact &= abs(report.height) < _EXACT * config.max_height
    least = config.min_inlier_share * (_EXACT_SHARE if is_exact else 1.0)
    if report.inlier_share < least:
        return (
            f"only {report.inlier_share:.0%} of the points lie on the ground, less "
            f"than {least:.0%}"
        )
    if n_left < config.min_left:
        return f"only {n_left} points would be left, fewer than {config.min_left}"
    return ""


def _appetite(report: GroundReport, config: GroundConfig) -> str:
    """Whether the plane eats what stands on it, in words; empty if not."""
    if report.removed_share <= config.max_removed_share:
        return ""
    return (
        f"{report.removed_share:.0%} of the points in the region of interest "
        f"would go, more than {config.max_removed_share:.0%}"
    )


def _near_ground(
    cloud: PointCloud, plane: FloatArray, ground: HeightMap, config: GroundConfig
) -> tuple[BoolArray, float, BoolArray]:
    """Which points belong to the ground.

    Returns
    -------
    is_ground
        Shape (n,).
    inlier_share
        Share of the points that lies right on it.
    inside
        Which points lie over cells that hold several standing points, shape (n,).
    """
    x, y, surface = ground.raster_middles()
    offset = np.stack([x, y, np.zeros(len(x))]) - cloud.viewpoint[:, None]
    deviation = ground.noise * np.sqrt(np.square(offset).sum(axis=0))
    limit = np.maximum(config.clearance, 3.0 * deviation)
    cell = ground.raster_cells(cloud.points)
    local = cloud.points @ plane[:3]
    local += plane[3]
    local -= surface.take(cell)
    own_limit = limit.take(cell)
    is_ground = local > np.minimum(-DEEP, -2.0 * limit).take(cell)
    n_inliers = int(np.count_nonzero(np.abs(local) < own_limit))
    low = np.flatnonzero(np.abs(local) < _LOW)
    shape = ground.raster_shape
    cell_low = cell.take(low)
    count = np.bincount(cell_low, minlength=len(x)).astype(np.float64)
    total = np.bincount(cell_low, local.take(low), len(x)).astype(np.float64)
    raised = raised_limits(
        count.reshape(shape),
        total.reshape(shape),
        deviation.reshape(shape),
        config.clearance,
    ).ravel()
    is_ground &= local < np.minimum(limit, raised).take(cell)
    n_standing = np.bincount(
        cell.take(np.flatnonzero(~is_ground)), minlength=len(x)
    ).reshape(shape)
    # Cells of the raster in blocks of two by two; that of a large map may be odd.
    even = np.pad(n_standing, [(0, n % 2) for n in shape])
    blocks = even.reshape(len(even) // 2, 2, -1, 2).sum(axis=(1, 3))
    is_occupied = np.repeat(np.repeat(blocks >= _MIN_STANDING, 2, axis=0), 2, axis=1)
    is_occupied = is_occupied[: shape[0], : shape[1]]
    return is_ground, n_inliers / len(cloud), is_occupied.ravel().take(cell)


def spread_sample(cloud: PointCloud, n_wanted: int) -> IntArray:
    """About ``n_wanted`` points that stand for all: a lattice of pixels of an image.

    Of other clouds every so many-th place: scanners write ring by ring, or in turns.
    """
    if cloud.pixels is None or cloud.image_shape is None:
        order, first = by_place(cloud.points)
        places: IntArray = order[first[order] == order]
        return places[:: max(1, len(places) // n_wanted)]
    step = max(1, round(np.sqrt(len(cloud) / n_wanted)))
    lattice = np.zeros(cloud.image_shape, dtype=bool)
    lattice[::step, ::step] = True
    return np.flatnonzero(lattice.ravel()[cloud.pixels])


def _fitted_plane(
    points: FloatArray, normals: FloatArray, slope: FloatArray
) -> FloatArray | None:
    """Plane near z = slope . (x, y, 1) through level points.

    A second level in the first slabs, as beyond a kerb, tilts the plane across both; a
    thinner start finds one of them, and is taken where it holds clearly more.
    """
    with np.errstate(invalid="ignore"):
        # A point without a normal may be level too.
        tilted = normals[:, 2] < np.cos(np.deg2rad(30))
    x, y, z = points[~tilted].T
    rows = np.stack([x, y, np.ones(len(x))])
    best: FloatArray | None = None
    most = 0.0
    for bands in (_FIT_BANDS, _FIT_BANDS[_THIN_START:]):
        found = _fitted_slope(rows, z, slope, bands)
        if found is None:
            continue
        n_held = np.count_nonzero(np.abs(z - found @ rows) < bands[-1])
        if n_held > most:
            best, most = found, _CLEARLY * n_held
    if best is None:
        return None
    plane = np.array([-best[0], -best[1], 1.0, -best[2]])
    unit: FloatArray = plane / np.linalg.norm(plane[:3])
    return unit


def _fitted_slope(
    rows: FloatArray, z: FloatArray, slope: FloatArray, bands: tuple[float, ...]
) -> FloatArray | None:
    """Fit heights z (n,) over rows (x, y, 1), shape (3, n), in ever thinner slabs."""
    for band in bands:
        near = np.abs(z - slope @ rows) < band
        if near.sum() < 10:
            return None
        A = rows[:, near]
        moments = A @ A.T
        if np.linalg.cond(moments) > 1e10:
            return None
        slope = np.linalg.solve(moments, A @ z[near]).astype(np.float64)
    return slope
