"""Whether an object can be pulled out without pushing through its neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray

from .surface import LabelledSurface

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
    own = surface.cells_of(label)
    across = np.linalg.svd(pull[None])[2][1:]
    # Cells a little larger than those of the surface leave no holes in the outline.
    plan = np.floor(across @ surface.points.T / (1.5 * surface.size)).astype(np.int64)
    plan -= plan[:, own].min(axis=1)[:, None]
    height, width = plan[:, own].max(axis=1) + 1
    along = pull @ surface.points.T
    cell = plan[0] * width + plan[1]
    front = np.full(height * width, np.inf)
    is_own = np.zeros(height * width, dtype=np.bool_)
    is_own[cell[own]] = True
    front[is_own] = -np.inf
    np.maximum.at(front, cell[own], along[own])
    met = (plan[0] >= 0) & (plan[0] < height) & (plan[1] >= 0) & (plan[1] < width)
    index = np.flatnonzero(met & (surface.labels != label))
    ahead = along[index] - front[cell[index]]
    index = index[(ahead > _CLEARANCE) & (ahead < _LENGTH)]
    is_filled = np.zeros(height * width, dtype=np.bool_)
    is_filled[cell[index]] = True
    share = float(is_filled.sum()) / max(float(is_own.sum()), 1.0)
    return share, np.unique(surface.labels[index])
