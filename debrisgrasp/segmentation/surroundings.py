"""What bounds a scene and is no object in it: walls, and the container it lies in.

Nothing is taken for surroundings by its size alone. A wall is upright, reaches the
border of the view, and nothing is seen behind it; a container has upright sides that
face each other and hold most of the scene, and no ground is seen around it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, frozen, require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import PointCloud

from .gravity import dominant_plane
from .ground import spread_sample
from .height_map import DEEP
from .segmentation import GroundReport, PointKind, Surrounding
from .uprights import UprightPlane, upright_planes

__all__ = ["SurroundingsConfig", "find_surroundings"]

_N_SAMPLES = 6000
"""Points among which planes are sought."""
_MARGIN = 0.05
"""How far faces reach beyond the points that they were found by [m]."""
_BEHIND = 0.08
"""Distance behind a wall from which on points speak against it [m]."""
_BORDER = 0.03
"""Strip of the image, in shares of its size, in which a wall has to end."""
_AMID = 0.75
"""Share of what lies deep that has ground around it where there is a pit."""
_ANGLES = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
_SIDES = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)
"""Directions in plan in which something can lie farther out than something else."""
_FLAT = float(np.cos(np.deg2rad(15)))
"""Cosine of the largest tilt of the floor of a container."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class SurroundingsConfig:
    """What is taken for a wall or a container around the scene."""

    min_wall: tuple[float, float] = (0.8, 0.4)
    """Least width and height of a wall [m]; smaller takes boards that stand on edge for
    walls."""
    max_wall_lean: float = float(np.deg2rad(8))
    """Largest angle between a wall and the vertical [rad]."""
    max_behind: float = 0.02
    """Points seen behind a wall, in shares of its own, that still allow for it."""
    min_side: tuple[float, float] = (0.2, 0.08)
    """Least width and height of a side of a container [m]."""
    max_side_lean: float = float(np.deg2rad(25))
    """Largest angle between such a side and the vertical [rad]."""
    min_held: float = 0.5
    """Least share of what stands that a container holds, its sides included; things
    that are smaller than the scene are objects, whatever lies in them."""

    def __post_init__(self) -> None:
        for name in ("min_wall", "min_side"):
            for value in getattr(self, name):
                require_range(f"{name} [m]", value, 1e-6, 50.0)
        for name in ("max_wall_lean", "max_side_lean"):
            if not 0 < getattr(self, name) < np.pi / 2:
                raise ConfigError(
                    name, got=getattr(self, name), expected="between 0 and pi/2"
                )
        for name in ("max_behind", "min_held"):
            if not 0 <= getattr(self, name) <= 1:
                raise ConfigError(name, got=getattr(self, name), expected="in [0, 1]")


def find_surroundings(
    cloud: PointCloud,
    is_ground: BoolArray,
    report: GroundReport,
    config: SurroundingsConfig,
) -> tuple[BoolArray, GroundReport]:
    """Find which points are left when all that bounds the scene is gone.

    Parameters
    ----------
    cloud
        z up.
    is_ground, report
        As `find_ground` returned them.

    Returns
    -------
    is_standing, report
        What may belong to objects, shape (n,), and the report with all kinds and
        reasons.
    """
    kinds = np.where(is_ground, PointKind.GROUND, PointKind.STANDING).astype(np.uint8)
    found = []
    if report.status == "removed" and report.plane is not None:
        rest = np.flatnonzero(~is_ground)
        over_plane = cloud.points.take(rest, axis=0) @ report.plane[:3]
        is_below = np.zeros(len(cloud), dtype=bool)
        is_below[rest[over_plane + report.plane[3] < -DEEP]] = True
        deep = f"more than {100 * DEEP:.0f} cm below the ground"
        if _is_amid(cloud.points, is_below, is_ground):
            found += _marked(kinds, is_below, PointKind.PIT, f"{deep} around them")
        else:
            found += _marked(kinds, is_below, PointKind.BELOW, deep)
    sample = spread_sample(cloud, _N_SAMPLES)
    points, normals = cloud.points[sample], cloud.normals[sample]
    standing = np.flatnonzero(kinds[sample] == PointKind.STANDING)
    planes = upright_planes(
        points[standing],
        normals[standing],
        max_lean=config.max_side_lean,
        min_area=config.min_side[0] * config.min_side[1],
    )
    walls = []
    for plane in planes:
        if _is_wall(cloud, sample, standing, plane, config):
            walls.append(plane)
            width, height = plane.size
            found += _marked(
                kinds,
                (kinds == PointKind.STANDING) & plane.holds(cloud.points, _MARGIN),
                PointKind.WALL,
                f"upright plane of {width:.1f} x {height:.1f} m at the border of the "
                "view, with nothing seen behind it",
            )
    if report.status == "skipped":
        sides = [plane for plane in planes if plane not in walls]
        found += _container(
            cloud, kinds, points[standing], normals[standing], sides, config
        )
    return kinds == PointKind.STANDING, replace(
        report,
        surroundings=tuple(found),
        kinds=frozen(kinds, "kinds", (None,), np.uint8),
    )


def _is_amid(points: FloatArray, chosen: BoolArray, others: BoolArray) -> bool:
    """Whether, in plan, most of the chosen points (n, 3) lie among the others."""
    if not chosen.any():
        return False
    inner, outer = points[chosen, :2], points[others, :2]
    within = np.ones(len(inner), dtype=bool)
    for side in _SIDES:
        within &= inner @ side < (outer @ side).max(initial=-np.inf)
    return bool(np.mean(within) > _AMID)


def _marked(
    kinds: IntArray, chosen: BoolArray, kind: PointKind, reason: str
) -> list[Surrounding]:
    """Give points that still stand a kind, in place, and report it if there are any."""
    chosen = chosen & (kinds == PointKind.STANDING)
    n_points = int(np.count_nonzero(chosen))
    if not n_points:
        return []
    kinds[chosen] = kind
    return [Surrounding(kind=kind, n_points=n_points, reason=reason)]


def _is_wall(
    cloud: PointCloud,
    sample: IntArray,
    standing: IntArray,
    plane: UprightPlane,
    config: SurroundingsConfig,
) -> bool:
    """Whether an upright plane bounds the scene."""
    if plane.lean > config.max_wall_lean or (plane.size < config.min_wall).any():
        return False
    if plane.area < 0.5 * config.min_wall[0] * config.min_wall[1]:
        return False
    points = cloud.points[sample]
    behind = plane.spans(points, -_MARGIN) & (plane.before(points) < -_BEHIND)
    if np.count_nonzero(behind) > config.max_behind * len(plane.members):
        return False
    if cloud.pixels is None or cloud.image_shape is None:
        return True
    size = np.array(cloud.image_shape)
    place = np.stack(np.divmod(cloud.pixels[sample[standing[plane.members]]], size[1]))
    share = place / size[:, None]
    at_border = (share < _BORDER) | (share > 1 - _BORDER)
    # Things in front reach the lower border first.
    at_border[0] = share[0] < _BORDER
    return bool(np.count_nonzero(at_border.any(axis=0)) >= 0.02 * len(plane.members))


def _container(
    cloud: PointCloud,
    kinds: IntArray,
    points: FloatArray,
    normals: FloatArray,
    planes: list[UprightPlane],
    config: SurroundingsConfig,
) -> list[Surrounding]:
    """Mark the container that holds most of the scene, in place; report what it is."""
    large = [plane for plane in planes if (plane.size >= config.min_side).all()]
    sides = _facing_sides(large, points)
    held = _held(points, sides)
    if len(sides) < 2 or held.mean() < config.min_held:
        return []
    low, high = (np.percentile(points[held, 2], share) for share in (10, 90))
    rim = min(plane.upper[1] for plane in sides)
    if rim < low + 0.5 * (high - low):
        return []
    inside = _held(cloud.points, sides)
    found = _marked(
        kinds,
        ~inside,
        PointKind.OUTSIDE,
        f"outside the container that holds {held.mean():.0%} of the scene",
    )
    on_side = np.zeros(len(cloud), dtype=bool)
    for plane in sides:
        on_side |= plane.holds(cloud.points, _MARGIN)
    found += _marked(
        kinds,
        on_side,
        PointKind.CONTAINER,
        f"{len(sides)} upright sides that face each other",
    )
    floor = _floor(points[held], normals[held])
    if floor is not None:
        over = cloud.points @ floor[:3] + floor[3]
        found += _marked(
            kinds,
            inside & (over < 0.012),
            PointKind.CONTAINER,
            "floor of the container",
        )
    return found


def _facing_sides(planes: list[UprightPlane], points: FloatArray) -> list[UprightPlane]:
    """Planes that each have the others, and most of what they span, before them."""
    sides: list[UprightPlane] = []
    for plane in planes:
        fits = all(
            np.median(other.before(points[plane.members])) > 0
            and np.median(plane.before(points[other.members])) > 0
            and plane.normal @ other.normal < 0.5
            for other in sides
        )
        if fits and np.mean(plane.before(points) > -plane.band) > 0.6:
            sides.append(plane)
    return sides


def _held(points: FloatArray, sides: list[UprightPlane]) -> BoolArray:
    """Which points (n, 3) lie before all sides; open ends bound nothing."""
    held = np.ones(len(points), dtype=bool)
    for plane in sides:
        held &= plane.before(points) > -plane.band
    return held


def _floor(points: FloatArray, normals: FloatArray) -> FloatArray | None:
    """Plane (a, b, c, d) of the floor of a container under points (n, 3), if seen."""
    level = normals[:, 2] > _FLAT
    largest = dominant_plane(points[level], normals[level])
    if largest is None or largest.plane[2] < _FLAT:
        return None
    over = points @ largest.plane[:3] + largest.plane[3]
    n_floor = np.count_nonzero(np.abs(over) < 0.012)
    if n_floor < 0.2 * len(points) or np.mean(over > -0.03) < 0.97:
        return None
    return largest.plane
