"""Which way to pull an object out of a pile."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import FloatArray, finite, require_metres, require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import voxel_cells

__all__ = ["PullChoice", "PullConfig", "choose_pull"]

_ASLANT = 3
"""Columns at an angle to the cells reach so many farther."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class PullConfig:
    """What a pull looks like."""

    distance: float = 0.15
    """How far the object is pulled before it counts as out [m]."""
    along_road: tuple[float, float, float] = (-1.0, 0.0, 0.0)
    """In base: back along the road, towards a robot that faces the pile."""
    rise: float = 0.8
    """Share of up in the default pull; 0 drags, large values lift."""
    cell: float = 0.01
    """Size of the cells that overlaps are counted in [m]; about the spacing of the
    points."""
    spread: float = float(np.deg2rad(75.0))
    """Largest angle between a candidate and the default pull [rad]."""
    preference: float = 0.1
    """Cells of overlap, as a share of the object's own, that a candidate 90 degrees off
    the default must save; larger keeps nearer to the default."""

    def __post_init__(self) -> None:
        require_range("PullConfig.distance [m]", self.distance, 1e-3, 10.0)
        require_range("PullConfig.cell [m]", self.cell, 1e-3, 0.5)
        require_range("PullConfig.rise", self.rise, 0.0, 1e3)
        require_range("PullConfig.spread [rad]", self.spread, 0.0, np.pi)
        require_range("PullConfig.preference", self.preference, 0.0, 1e3)


@dataclass(frozen=True, slots=True, eq=False)
class PullChoice:
    """The way chosen, and how the others compare."""

    direction: FloatArray
    """Unit vector in base, shape (3,)."""
    overlap: float
    """Neighbours in the way, as a share of the object's own cells."""
    candidates: FloatArray
    """Unit vectors tried, the default first, shape (c, 3)."""
    overlaps: FloatArray
    """Their overlaps, shape (c,)."""
    reason: str
    """In words."""


def choose_pull(
    object_points: ArrayLike,
    neighbor_points: ArrayLike,
    config: PullConfig | None = None,
    *,
    candidates: ArrayLike | None = None,
) -> PullChoice:
    """Choose the pull that sweeps the object through the fewest of its neighbours.

    What lies on the object is in the way of every upward pull, what lies in front of it
    in the way of a forward one.

    Parameters
    ----------
    object_points, neighbor_points
        Surface points in base [m], shapes (n, 3) and (m, 3); m may be 0. Leave the
        ground out, or no pull along it is free.
    candidates
        Directions to choose from, the preferred first, shape (c, 3); None: a cone
        around the default pull, which is back along the road and up.

    Raises
    ------
    InputError
        If the object has no points, a candidate is zero, or points are not (n, 3), not
        finite, or can only be in millimetres.
    """
    config = config or PullConfig()
    own = _checked_points(object_points, "points of the object")
    others = _checked_points(neighbor_points, "points of the neighbours")
    if len(own) == 0:
        raise InputError("points of the object", got=0, expected="at least one")
    if candidates is None:
        directions = _cone(config)
    else:
        directions = finite(candidates, "candidates", (None, 3))
        lengths = np.linalg.norm(directions, axis=1, keepdims=True)
        if len(directions) == 0 or not np.all(lengths > 1e-9):
            raise InputError(
                "candidates", got=directions.tolist(), expected="directions, not zero"
            )
        directions = directions / lengths
    own = _thinned(own, config.cell)
    others = _thinned(_near(own, others, config), config.cell)
    overlaps = np.array([_swept(own, others, d, config) for d in directions])
    detour = np.arccos(np.clip(directions @ directions[0], -1.0, 1.0)) / (0.5 * np.pi)
    best = int(np.argmin(overlaps + config.preference * detour))
    x, y, z = directions[best]
    words = f"({x:.2f}, {y:.2f}, {z:.2f}) sweeps {100 * overlaps[best]:.0f} % of the "
    words += f"object's size through neighbours; the default {100 * overlaps[0]:.0f} %"
    return PullChoice(
        directions[best], float(overlaps[best]), directions, overlaps, words
    )


def _checked_points(points: ArrayLike, name: str) -> FloatArray:
    """Points from outside, of which some lie where a robot could be."""
    rows = finite(points, name, (None, 3))
    if len(rows):
        require_metres(name, rows[np.abs(rows).max(axis=1).argmin()])
    return rows


def _cone(config: PullConfig) -> FloatArray:
    """Directions around the default pull, none of them downwards."""
    road = np.array(config.along_road, dtype=np.float64)
    default = road / max(float(np.linalg.norm(road)), 1e-9) + [0, 0, config.rise]
    size = float(np.linalg.norm(default))
    if not 1e-9 <= size < np.inf:
        raise InputError(
            "default pull", got=config.along_road, expected="a direction, or a rise"
        )
    default = default / size
    side = np.cross(default, np.eye(3)[np.argmin(np.abs(default))])
    side = side / np.linalg.norm(side)
    up = np.cross(side, default)
    around = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    rim = np.cos(around)[:, None] * side + np.sin(around)[:, None] * up
    angles = config.spread * np.array([1 / 3, 2 / 3, 1.0])
    rings = [np.cos(a) * default + np.sin(a) * rim for a in angles]
    cone = np.concatenate([default[None], [[0.0, 0.0, 1.0]], *rings])
    return np.asarray(cone[np.r_[True, cone[1:, 2] >= -1e-9]])


def _swept(
    own: FloatArray, others: FloatArray, direction: FloatArray, config: PullConfig
) -> float:
    """Cells of neighbours in the way, over cells of the object."""
    if len(others) == 0:
        return 0.0
    side = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    side = side / np.linalg.norm(side)
    across = np.stack([side, np.cross(direction, side)], axis=1)
    cells = np.floor(np.concatenate([own, others]) @ across / config.cell)
    flat = (cells - cells.min(axis=0)).astype(np.int64)
    column = flat[:, 0] * (flat[:, 1].max() + 1) + flat[:, 1]
    columns, index = np.unique(column[: len(own)], return_inverse=True)
    own_height, other_height = own @ direction, others @ direction
    # The way is free behind the object's rear and beyond its front's last place.
    rear = np.full(len(columns), np.inf)
    front = np.full(len(columns), -np.inf)
    np.minimum.at(rear, index, own_height)
    np.maximum.at(front, index, own_height)
    # Neighbours in no column of the object's are not in its way.
    place = np.searchsorted(columns, column[len(own) :]).clip(max=len(columns) - 1)
    is_swept = columns[place] == column[len(own) :]
    is_swept &= other_height > rear[place] + config.cell
    is_swept &= other_height < front[place] + config.distance
    return float(np.count_nonzero(is_swept) / len(own))


def _near(own: FloatArray, others: FloatArray, config: PullConfig) -> FloatArray:
    """Those in cells that the object may sweep, whatever the direction."""
    reach = np.ceil(config.distance / config.cell) + _ASLANT
    low = np.floor(own.min(axis=0) / config.cell) - reach
    high = np.floor(own.max(axis=0) / config.cell) + reach
    is_near = np.ones(len(others), dtype=bool)
    for along, first, last in zip(others.T, low, high, strict=True):
        is_near &= along >= first * config.cell
        is_near &= along < (last + 1.0) * config.cell
    return others[is_near]


def _thinned(points: FloatArray, cell: float) -> FloatArray:
    """One point for each occupied cell: the first."""
    index, _ = voxel_cells(points, cell)
    _, first = np.unique(index, return_index=True)
    return points[np.sort(first)]
