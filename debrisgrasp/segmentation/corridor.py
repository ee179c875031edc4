"""Whether an object can be pulled out without pushing through its neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray

from .surface import LabelledSurface, inside_box

__all__ = ["Corridor", "freest_corridor"]

_LENGTH = 0.6
"""How far an object is followed on its way out [m]."""
_CLEARANCE = 0.02
"""What stands out less than this beside an object doesn't block it [m]."""
_WAYS = (("upwards", 0.0), ("upwards and towards the robot", 1.0))
"""How to pull, and metres towards the robot for each metre up."""


@dataclass(frozen=True, slots=True, eq=False)
class Corridor:
    """The volume that the visible part of an object sweeps on its way out."""

    way: str
    """Direction of the pull in words."""
    blocked: float
    """Share of the object's outline across the pull that others fill, in [0, 1]."""
    blockers: IntArray
    """Labels of the others, ascending."""


def freest_corridor(surface: LabelledSurface, label: int) -> Corridor:
    """Find the way out that others fill least; the first of equals.

    The robot stands at the origin of the base frame.
    """
    middle = surface.points[surface.cells_of(label)].mean(axis=0)
    towards = -middle[:2] / max(float(np.linalg.norm(middle[:2])), 1e-3)
    found = []
    for way, slant in _WAYS:
        pull = np.array([*(slant * towards), 1.0])
        share, blockers = _blocked(surface, label, pull / np.linalg.norm(pull))
        found.append(Corridor(way, share, blockers))
    return min(found, key=lambda corridor: corridor.blocked)


def _blocked(
    surface: LabelledSurface, label: int, pull: FloatArray
) -> tuple[float, IntArray]:
    """Share of the outline across a pull (3,) that is filled, and by which labels."""
    own = surface.points[surface.cells_of(label)]
    across = np.linalg.svd(pull[None])[2][1:]
    # Cells a little larger than those of the surface leave no holes in the outline.
    size = 1.5 * surface.size
    plan = np.floor(across @ own.T / size).astype(np.int64)
    corner = plan.min(axis=1)[:, None]
    plan -= corner
    height, width = plan.max(axis=1) + 1
    cell = plan[0] * width + plan[1]
    front = np.full(height * width, -np.inf)
    np.maximum.at(front, cell, pull @ own.T)
    is_own = np.isfinite(front)
    # Nothing outside of the box that the outline sweeps can be in the way.
    ends = own.min(axis=0) - 2 * size, own.max(axis=0) + 2 * size
    way = _LENGTH * pull
    swept = ends[0] + np.minimum(way, 0.0), ends[1] + np.maximum(way, 0.0)
    index = inside_box(surface.points, *swept)
    index = index[surface.labels[index] != label]
    others = surface.points[index]
    plan = np.floor(across @ others.T / size).astype(np.int64) - corner
    met = (plan[0] >= 0) & (plan[0] < height) & (plan[1] >= 0) & (plan[1] < width)
    index, cell = index[met], plan[0, met] * width + plan[1, met]
    ahead = pull @ others[met].T - front[cell]
    is_ahead = is_own[cell] & (ahead > _CLEARANCE) & (ahead < _LENGTH)
    n_filled = len(np.unique(cell[is_ahead]))
    share = n_filled / max(int(np.count_nonzero(is_own)), 1)
    return share, np.unique(surface.labels[index[is_ahead]])
