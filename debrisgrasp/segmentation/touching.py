"""Which cells of a thinned cloud touch a cell of another object."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray

from .surface import LabelledSurface

__all__ = ["touching_cells"]

_MOST_NEARER = 12
"""As many balls of one size can touch another. Of two objects that both have so many
others nearer, some stand between."""


def touching_cells(surface: LabelledSurface, reach: float) -> IntArray:
    """Find pairs of cells of two objects as near as touching ones, shape (k, 2).

    The pairs of each contact stand together, that of the smaller label first. Objects
    that both have a dozen others nearer don't touch: among small ones many are within
    reach, and their contacts would grow with the square of their number.

    Parameters
    ----------
    surface
        The thinned cloud.
    reach
        Largest gap between touching surfaces [m]; the noise of both comes on top.
    """
    if len(surface.points) < 2:
        return np.empty((0, 2), dtype=np.int64)
    near = _beside_others(surface, reach + 2.0 * float(surface.noise.max()))
    points, noise = surface.points[near], surface.noise[near]
    limit = reach + 2.0 * float(noise.max(initial=0.0))
    pairs = cKDTree(points).query_pairs(limit, output_type="ndarray")
    labels = surface.labels[near]
    pairs = pairs[labels[pairs[:, 0]] != labels[pairs[:, 1]]]
    gap = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    touches = gap < reach + noise[pairs].sum(axis=1)
    pairs, gap = pairs[touches], gap[touches]
    # Cells ascend by label, so the smaller index has the smaller label.
    found = near[np.sort(pairs, axis=1)]
    first, second = surface.labels[found].T
    contact = first * (surface.labels[-1] + 1) + second
    order = np.argsort(contact, kind="stable")
    starts = np.flatnonzero(np.diff(contact[order], prepend=0))
    ends = np.stack([first, second], axis=1)[order[starts]]
    is_near = _near_ones(ends, np.minimum.reduceat(gap[order], starts))
    kept: IntArray = found[
        order[np.repeat(is_near, np.diff(starts, append=len(order)))]
    ]
    return kept


def _near_ones(ends: IntArray, gap: FloatArray) -> BoolArray:
    """Which contacts are among the nearest of either of their labels (c, 2), (c,)."""
    label, gap = ends.ravel(), np.repeat(gap, 2)
    order = np.lexsort((gap, label))
    rank = np.empty(len(label), dtype=np.int64)
    rank[order] = np.arange(len(label)) - np.searchsorted(label[order], label[order])
    first, second = rank.reshape(-1, 2).T
    is_near: BoolArray = np.minimum(first, second) < _MOST_NEARER
    return is_near


def _beside_others(surface: LabelledSurface, reach: float) -> IntArray:
    """Cells that may have a cell of another label within reach, ascending.

    A coarse grid is enough, and leaves little for the exact search.
    """
    grid = np.floor(surface.points / reach).astype(np.int64)
    grid -= grid.min(axis=0) - 1
    shape = grid.max(axis=0) + 2
    flat = (grid[:, 0] * shape[1] + grid[:, 1]) * shape[2] + grid[:, 2]
    cells, index = np.unique(flat, return_inverse=True)
    low = np.full(len(cells), np.iinfo(np.int64).max)
    high = np.zeros(len(cells), dtype=np.int64)
    np.minimum.at(low, index, surface.labels)
    np.maximum.at(high, index, surface.labels)
    least, most = low.copy(), high.copy()
    steps = np.arange(-1, 2)
    offsets = (steps[:, None, None] * shape[1] + steps[:, None]) * shape[2] + steps
    # Who is beside whom is mutual: each pair of cells is met once.
    for offset in offsets[offsets > 0]:
        at = np.minimum(np.searchsorted(cells, cells + offset), len(cells) - 1)
        own = np.flatnonzero(cells[at] == cells + offset)
        other = at[own]
        for a, b in ((own, other), (other, own)):
            least[a] = np.minimum(least[a], low[b])
            most[a] = np.maximum(most[a], high[b])
    return np.flatnonzero((least != most)[index])
