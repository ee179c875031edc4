"""Joining a cone to the plate that it stands on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray

from .joining import Borders
from .pieces import Shapes
from .regions import Crossings

__all__ = ["TaperConfig", "tapered_ends"]


@dataclass(frozen=True, slots=True, kw_only=True)
class TaperConfig:
    """When a region is a round taper, and its wide end has a foot."""

    min_taper: float = 1.35
    """Least ratio of the areas of the middle and the narrow third of the length."""
    min_slenderness: float = 2.5
    """Least ratio of length and mean width."""
    max_crease: float = 0.3
    """Longest sharp crease inside, in roots of the area; corners of boxes taper too."""
    min_share: float = 0.6
    """Least share of the contact of the wide third that is with the foot."""
    min_pixels: int = 1500
    """Smaller regions are no tapers."""


def tapered_ends(
    borders: Borders,
    ends: IntArray,
    patch_size: FloatArray,
    shapes: Shapes,
    touching: Crossings,
    config: TaperConfig,
) -> IntArray:
    """Pairs (taper, foot) where the wide end of a tapering piece meets another, (k, 2).

    Parameters
    ----------
    borders
        Borders of patches.
    ends
        The two pieces whose patches meet at each border, shape (e, 2).
    patch_size
        Pixels of each patch, shape (p,).
    shapes
        Shapes of the pieces.
    touching
        Borders at which pieces touch in depth.
    """
    n = len(shapes.size)
    row, column = np.nonzero(touching.labels >= 0)
    region = touching.labels[row, column]
    third = _third_of(shapes, region, row, column)
    area = np.bincount(3 * region + third, minlength=3 * n).reshape(n, 3)
    first, middle, last = np.maximum(area, 1).T
    falling = (first > middle) & (middle > config.min_taper * last)
    rising = (last > middle) & (middle > config.min_taper * first)
    sharp = (ends[:, 0] == ends[:, 1]) & (borders.angle > np.deg2rad(45))
    # Crumbs have no reliable angle.
    sharp &= (patch_size[borders.edges] >= 100).all(axis=1)
    crease = np.bincount(ends[sharp, 0], weights=borders.length[sharp], minlength=n)
    is_taper = (falling | rising) & (shapes.size >= config.min_pixels)
    is_taper &= shapes.length > config.min_slenderness * shapes.width
    is_taper &= crease < config.max_crease * np.sqrt(shapes.size)
    wide = np.where(falling, 0, 2)
    mine = touching.first
    at_foot = is_taper[mine] & (
        _third_of(shapes, mine, touching.row, touching.column) == wide[mine]
    )
    keys, length = np.unique(
        mine[at_foot] * n + touching.second[at_foot], return_counts=True
    )
    taper, foot = np.divmod(keys, n)
    contact = np.bincount(taper, weights=length, minlength=n)
    width = shapes.size / shapes.pixel_length
    fits = (length > config.min_share * contact[taper]) & (length > 0.6 * width[taper])
    return np.stack([taper[fits], foot[fits]], axis=1)


def _third_of(
    shapes: Shapes, region: IntArray, row: IntArray, column: IntArray
) -> IntArray:
    """Third of the length of its region in which each pixel lies: 0, 1 or 2."""
    start = shapes.end_pixels[region, 0]
    along = (row - start[:, 0]) * shapes.direction[region, 0]
    along += (column - start[:, 1]) * shapes.direction[region, 1]
    third = (3 * along / shapes.pixel_length[region]).astype(np.int64)
    clipped: IntArray = np.clip(third, 0, 2)
    return clipped
