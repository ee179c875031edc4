"""Dividing an inverse depth image into planar patches, bottom-up.

Blocks of 2 x 2 cells are merged while one plane explains both as well as two, then
single cells at the borders choose the plane that fits them best. All regions merge at
once in rounds; none waits for another.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from debrisgrasp._arrays import BoolArray, Float32Array, FloatArray, IntArray

from .cells import CellImage

__all__ = [
    "PlanarPatches",
    "fitted_planes",
    "measured_patches",
    "merged_into",
    "neighbours",
    "planar_patches",
    "summed",
]

_CORRELATED = 12.0
"""Pixels that share their noise: stereo matchers blur over 3 to 4 either way."""
_SPECK = 4
"""Cells of the smallest patch that is kept; smaller ones are flying pixels."""


@dataclass(frozen=True, slots=True, eq=False)
class PlanarPatches:
    """Planar patches of an inverse depth image."""

    labels: IntArray
    """Patch of each cell from 0, -1 for none, -2 for specks, shape (h, w)."""
    planes: FloatArray
    """(a, b, c) with 1/z = a x + b y + c as rows, shape (3, p)."""
    moments: FloatArray
    """Sums over the cells of each patch of 1, x, y, d, xx, xy, yy, xd, yd, dd with
    d = 1/z, shape (10, p)."""
    face: IntArray
    """Patches with the same number were cut out of one plane, shape (p,)."""

    def __len__(self) -> int:
        return int(self.planes.shape[1])


def planar_patches(
    cells: CellImage,
    *,
    max_gap: float,
    max_increase: float,
    sweeps: int,
    min_cells: int,
    of_interest: BoolArray | None = None,
) -> PlanarPatches:
    """Divide the standing cells of an image.

    Parameters
    ----------
    of_interest
        Cells whose patches may hold no others, shape (h, w).
    max_gap
        Largest step of 1/z between neighbouring cells of one surface [1/m].
    max_increase
        Largest growth of the squared error, in variances, that a merge may cost.
    sweeps
        Rounds in which border cells choose their patch.
    min_cells
        Smaller patches go, cell by cell, to the neighbours that fit best.
    """
    ridge = _ridge(cells)
    labels = _blocks(cells.values, cells.standing, max_gap)
    row, column = np.nonzero(cells.standing)
    terms = _terms(cells, row, column)
    moments = summed(terms, labels[row, column])
    edges = _touching(cells.values, labels, max_gap, moments.shape[1])
    region = _merged(moments, edges, ridge, max_increase * ridge)
    own = region[labels[row, column]]
    labels[row, column] = own
    planes = fitted_planes(summed(terms, own), ridge)[0]
    for _ in range(sweeps):
        if not _exchange_borders(cells, labels, planes, max_gap):
            break
        planes = fitted_planes(summed(terms, labels[row, column]), ridge)[0]
    _hand_over_crumbs(cells, labels, planes, max_gap, min_cells)
    own = labels[row, column]
    if of_interest is not None:
        own = 2 * own + of_interest[row, column]
    size = np.bincount(own)
    number = np.cumsum(size >= _SPECK) - 1
    own = np.where(size[own] >= _SPECK, number[own], -2)
    labels[row, column] = own
    kept = own >= 0
    moments = summed([t if t is None else t[kept] for t in terms], own[kept])
    return _measured(labels, moments, ridge)


def measured_patches(cells: CellImage, labels: IntArray) -> PlanarPatches:
    """Measure patches given by the label of each cell, shape (h, w)."""
    row, column = np.nonzero(labels >= 0)
    moments = summed(_terms(cells, row, column), labels[row, column])
    return _measured(labels, moments, _ridge(cells))


def _measured(labels: IntArray, moments: FloatArray, ridge: float) -> PlanarPatches:
    planes = fitted_planes(moments, ridge)[0]
    return PlanarPatches(labels, planes, moments, np.arange(planes.shape[1]))


def _ridge(cells: CellImage) -> float:
    """Variance of 1/z that counts as one [1/m^2]."""
    return cells.noise**2 * max(1.0, _CORRELATED / cells.edge**2)


def _terms(cells: CellImage, row: IntArray, column: IntArray) -> list[Any]:
    # Variances are small differences of these sums: single precision loses them.
    d = cells.values[row, column].astype(np.float64)
    x = cells.x[column].astype(np.float64)
    y = cells.y[row].astype(np.float64)
    return [None, x, y, d, x * x, x * y, y * y, x * d, y * d, d * d]


def summed(terms: list[Any], own: IntArray, n: int = 0) -> FloatArray:
    """Sum terms (k,) per region, None standing for ones, shape (terms, n)."""
    sums = [np.bincount(own, term, n) for term in terms]
    return np.stack(sums).astype(np.float64)


def fitted_planes(moments: FloatArray, ridge: float) -> tuple[FloatArray, FloatArray]:
    """Least-squares planes (3, n) and squared errors (n,) of moments (10, n).

    Slopes are drawn towards zero with a standard deviation of 1 per unit of x or y,
    for a noise variance ``ridge``; it matters only to regions too small or thin to tilt
    a plane.
    """
    mx, my, md = moments[1:4] / np.maximum(moments[0], 1e-12)
    sxx = moments[4] - moments[1] * mx
    sxy = moments[5] - moments[1] * my
    syy = moments[6] - moments[2] * my
    sxd, syd, sdd = moments[7:] - moments[1:4] * md
    pxx, pyy = sxx + ridge, syy + ridge
    determinant = pxx * pyy - sxy * sxy
    a = (pyy * sxd - sxy * syd) / determinant
    b = (pxx * syd - sxy * sxd) / determinant
    error = sdd - a * (2 * sxd - a * sxx) - b * (2 * syd - b * syy) + 2 * a * b * sxy
    return np.stack([a, b, md - a * mx - b * my]), np.maximum(error, 0.0)


def neighbours(image: NDArray[Any]) -> Iterator[tuple[NDArray[Any], NDArray[Any]]]:
    """Lay an image over itself, shifted by a column and then by a row."""
    yield image[:, :-1], image[:, 1:]
    yield image[:-1], image[1:]


def _blocks(values: Float32Array, mask: BoolArray, max_gap: float) -> IntArray:
    """Cut a mask into connected parts of 2 x 2 blocks, split at steps; -1 outside."""
    height, width = mask.shape
    pad = ((0, height % 2), (0, width % 2))
    values, mask = np.pad(values, pad), np.pad(mask, pad)
    # The corners of all blocks in a ring, so that each touches the next.
    ring = ((0, 0), (0, 1), (1, 1), (1, 0))
    v = [values[i::2, j::2] for i, j in ring]
    m = [mask[i::2, j::2] for i, j in ring]
    part = [np.full(v[0].shape, k, dtype=np.int32) for k in range(4)]
    joins = [m[k - 1] & m[k] & (np.abs(v[k - 1] - v[k]) < max_gap) for k in range(4)]
    for k in (0, 1, 2, 3, 0, 1, 2):
        lower = np.minimum(part[k - 1], part[k])
        for end in (k - 1, k):
            part[end] = np.where(joins[k], lower, part[end])
    block = 4 * np.arange(v[0].size, dtype=np.int32).reshape(v[0].shape)
    labels = np.empty(values.shape, dtype=np.int32)
    for k, (i, j) in enumerate(ring):
        labels[i::2, j::2] = block + part[k]
    used = np.zeros(4 * block.size, dtype=bool)
    used[labels[mask]] = True
    labels = (np.cumsum(used, dtype=np.int32) - 1)[labels]
    labels[~mask] = -1
    return np.ascontiguousarray(labels[:height, :width])


def _touching(
    values: Float32Array, labels: IntArray, max_gap: float, n: int
) -> IntArray:
    """Pairs of labels with neighbouring cells on one surface, each once, (2, e)."""
    keys = []
    pairs = zip(neighbours(labels), neighbours(values), strict=True)
    for (a, b), (u, v) in pairs:
        crossing = (a != b) & (np.minimum(a, b) >= 0) & (np.abs(u - v) < max_gap)
        keys.append(_keys(a[crossing], b[crossing], n))
    return _distinct(np.concatenate(keys), n)


def _keys(a: IntArray, b: IntArray, n: int) -> IntArray:
    return np.minimum(a, b).astype(np.int64) * n + np.maximum(a, b)


def _distinct(keys: IntArray, n: int) -> IntArray:
    keys = np.sort(keys)
    keys = keys[np.flatnonzero(np.diff(keys, prepend=-1))]
    return np.stack(np.divmod(keys, max(n, 1)))


def _merged(
    moments: FloatArray, edges: IntArray, ridge: float, budget: float
) -> IntArray:
    """Region of each node after merging what one plane explains, shape (nodes,)."""
    region: IntArray = np.arange(moments.shape[1])
    error = fitted_planes(moments, ridge)[1]
    while edges.shape[1]:
        a, b = edges
        both = np.take(moments, a, axis=1)
        both += np.take(moments, b, axis=1)
        increase = fitted_planes(both, ridge)[1] - error[a] - error[b]
        into = merged_into(edges, -increase, moments[0], -budget)
        if into is None:
            break
        region = into[region]
        n = int(into.max()) + 1
        moments = summed(list(moments), into, n)
        error = fitted_planes(moments, ridge)[1]
        a, b = into[edges]
        apart = a != b
        edges = _distinct(_keys(a[apart], b[apart], n), n)
    return region


def merged_into(
    edges: IntArray, gain: FloatArray, size: FloatArray, least: float
) -> IntArray | None:
    """Region that each becomes part of in one round of best-first merging.

    Every region points to the neighbour with the largest gain. Pairs that point at each
    other merge, and regions that point at one at least three times their size.

    Parameters
    ----------
    edges
        Pairs of neighbours, shape (2, e).
    gain
        Of merging along each, shape (e,); only those above ``least`` count.
    size
        Of each region, shape (r,).

    Returns
    -------
    IntArray or None
        Numbers from 0 without gaps in the order of the first members, shape (r,); None
        if nothing merges.
    """
    fits = np.flatnonzero(gain > least)
    # Of several values for one place the last assigned stays: the best.
    a, b = edges[:, fits[np.argsort(gain[fits])]]
    own = np.arange(len(size))
    best = own.copy()
    best[np.stack([a, b], axis=1).ravel()] = np.stack([b, a], axis=1).ravel()
    is_mutual = best[best] == own
    merges = (best != own) & (is_mutual | (3 * size <= size[best]))
    # Of two that point at each other one stays where it is.
    merges &= ~(is_mutual & (own < best))
    if not merges.any():
        return None
    parent = np.where(merges, best, own)
    while True:
        above = parent[parent]
        if np.array_equal(above, parent):
            break
        parent = above
    into: IntArray = (np.cumsum(parent == own) - 1)[parent]
    return into


def _exchange_borders(
    cells: CellImage, labels: IntArray, planes: FloatArray, max_gap: float
) -> int:
    """Move border cells to the neighbouring patch that fits them better, in place."""
    width = labels.shape[1]
    asker, other = [], []
    pairs = zip((1, width), neighbours(labels), neighbours(cells.values), strict=True)
    for shift, (a, b), (u, v) in pairs:
        row, column = np.nonzero(
            (a != b) & (np.minimum(a, b) >= 0) & (np.abs(u - v) < max_gap)
        )
        flat = row * width + column
        asker += [flat, flat + shift]
        other += [b[row, column], a[row, column]]
    cell, patch = np.concatenate(asker), np.concatenate(other)
    row, column = np.divmod(cell, width)
    own = _residual(cells, planes, labels[row, column], row, column)
    offer = _residual(cells, planes, patch, row, column)
    better = offer < own
    cell, patch, offer = cell[better], patch[better], offer[better]
    order = np.argsort(-offer)
    labels.ravel()[cell[order]] = patch[order]
    return len(cell)


def _hand_over_crumbs(
    cells: CellImage,
    labels: IntArray,
    planes: FloatArray,
    max_gap: float,
    min_cells: int,
) -> None:
    """Give the cells of small patches to larger neighbours from outside in, in place.

    Crumbs without a larger neighbour stay.
    """
    values = cells.values
    height, width = values.shape
    size = np.bincount(labels[labels >= 0], minlength=planes.shape[1])
    # The last place answers for label -1, which takes nothing.
    is_host = np.append(size >= min_cells, False)
    row, column = np.nonzero((labels >= 0) & ~is_host[labels])
    while len(row):
        best = np.full(len(row), np.inf)
        choice = np.full(len(row), -1)
        for i, j in ((0, -1), (0, 1), (-1, 0), (1, 0)):
            r = np.clip(row + i, 0, height - 1)
            c = np.clip(column + j, 0, width - 1)
            host = labels[r, c]
            near = np.abs(values[r, c] - values[row, column]) < max_gap
            at = np.flatnonzero(is_host[host] & near)
            offer = _residual(cells, planes, host[at], row[at], column[at])
            better = offer < best[at]
            best[at[better]] = offer[better]
            choice[at[better]] = host[at[better]]
        taken = choice >= 0
        if not taken.any():
            return
        labels[row[taken], column[taken]] = choice[taken]
        row, column = row[~taken], column[~taken]


def _residual(
    cells: CellImage,
    planes: FloatArray,
    patch: IntArray,
    row: IntArray,
    column: IntArray,
) -> FloatArray:
    a, b, c = planes[:, patch]
    fit = a * cells.x[column] + b * cells.y[row] + c
    residual: FloatArray = np.abs(cells.values[row, column] - fit)
    return residual
