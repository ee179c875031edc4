"""Dividing an inverse depth image into planar patches, bottom-up.

Blocks of a few pixels are merged while one plane explains both as well as two, then
single pixels at the borders choose the plane that fits them best. All regions merge at
once in rounds; none waits for another.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import BoolArray, Float32Array, FloatArray, IntArray

from .camera import InverseDepthImage
from .regions import SHIFTS, linked, mutual_choices, neighbours

__all__ = ["PlanarPatches", "noise_of", "planar_patches"]

_CORRELATED = 12.0
"""Pixels that share their noise: stereo matchers blur over 3 to 4 either way."""


@dataclass(frozen=True, slots=True, eq=False)
class PlanarPatches:
    """Planar patches of an inverse depth image."""

    labels: IntArray
    """Patch of each pixel from 0, -1 for none, shape (height, width)."""
    planes: FloatArray
    """(a, b, c) with 1/z = a x + b y + c, shape (p, 3)."""
    moments: FloatArray
    """Sums over the pixels of each patch of 1, x, y, d, xx, xy, yy, xd, yd, dd with
    d = 1/z, shape (p, 10)."""
    noise: float
    """Standard deviation of 1/z [1/m]."""

    def __len__(self) -> int:
        return len(self.planes)


def planar_patches(
    image: InverseDepthImage,
    mask: BoolArray,
    *,
    block: int,
    max_step: float,
    max_increase: float,
    sweeps: int,
    min_pixels: int,
) -> PlanarPatches:
    """Divide the pixels of a mask.

    Parameters
    ----------
    mask
        Pixels to divide, all measured, shape (height, width).
    block
        Edge of the blocks to start from [pixels].
    max_step
        Largest step of 1/z between neighbouring pixels of one surface [1/m].
    max_increase
        Largest growth of the squared error, in variances, that a merge may cost.
    sweeps
        Rounds in which border pixels choose their patch.
    min_pixels
        Smaller patches go, pixel by pixel, to the neighbours that fit best.
    """
    noise = noise_of(image.values)
    nodes = _blocks(image.values, mask, block, max_step)
    labels = np.full(mask.shape, -1, dtype=np.int32)
    labels[mask] = nodes
    moments = _summed(image, mask, nodes)
    edges = _touching(image.values, labels, max_step)
    merged = _merged(moments, edges, noise, max_increase)
    labels[mask] = merged[nodes]
    for _ in range(sweeps):
        planes = _fitted(_summed(image, mask, labels[mask]), noise)[0]
        if not _exchange_borders(image, labels, planes, max_step):
            break
    _hand_over_crumbs(image, labels, planes, max_step, min_pixels)
    number = np.unique(labels[mask], return_inverse=True)[1]
    labels[mask] = number
    moments = _summed(image, mask, number)
    return PlanarPatches(labels, _fitted(moments, noise)[0], moments, noise)


def noise_of(values: Float32Array, floor: float = 4e-4) -> float:
    """Estimate the standard deviation of 1/z over smooth places [1/m].

    From second differences four pixels apart, since noise of neighbouring pixels is
    correlated. The floor, about 1 mm at 1.5 m, stands for the roughness of surfaces.
    """
    left, middle, right = values[:, :-8], values[:, 4:-4], values[:, 8:]
    known = (left > 0) & (middle > 0) & (right > 0)
    if not known.any():
        return floor
    second = (left - 2 * middle + right)[known]
    return max(floor, 1.4826 * float(np.median(np.abs(second))) / 6**0.5)


def _blocks(
    values: Float32Array, mask: BoolArray, block: int, max_step: float
) -> IntArray:
    """Cut the mask into connected parts of square blocks, split at steps.

    Returns the part of each pixel of the mask.
    """
    number = np.full(mask.shape, -1, dtype=np.int32)
    number[mask] = np.arange(np.count_nonzero(mask), dtype=np.int32)
    pairs = []
    for shift in SHIFTS:
        one, two = neighbours(number, shift)
        joins = mask[one] & mask[two] & (np.abs(values[one] - values[two]) < max_step)
        # Rows and columns at the end of a block have no partner in it.
        if shift[0]:
            joins[block - 1 :: block] = False
        else:
            joins[:, block - 1 :: block] = False
        pairs.append(np.stack([number[one][joins], number[two][joins]], axis=1))
    return linked(np.concatenate(pairs), int(np.count_nonzero(mask)))


def _summed(image: InverseDepthImage, mask: BoolArray, nodes: IntArray) -> FloatArray:
    """Moments of each node over its pixels, shape (nodes, 10)."""
    # Variances are small differences of these sums: single precision loses them.
    x, y, d = (
        values[mask].astype(np.float64) for values in (image.x, image.y, image.values)
    )
    terms = (x, y, d, x * x, x * y, y * y, x * d, y * d, d * d)
    sums = [np.bincount(nodes, term) for term in (np.ones(len(x)), *terms)]
    return np.stack(sums, axis=1).astype(np.float64)


def _fitted(moments: FloatArray, noise: float) -> tuple[FloatArray, FloatArray]:
    """Least-squares planes (..., 3) and squared errors (...) of moments (..., 10).

    Slopes are drawn towards zero with a standard deviation of 1 per unit of x or y,
    which matters only to regions too small or thin to tilt a plane.
    """
    n = np.maximum(moments[..., 0], 1e-12)
    mx, my, md = (moments[..., i] / n for i in (1, 2, 3))
    sxx = moments[..., 4] - n * mx * mx
    sxy = moments[..., 5] - n * mx * my
    syy = moments[..., 6] - n * my * my
    sxd = moments[..., 7] - n * mx * md
    syd = moments[..., 8] - n * my * md
    sdd = moments[..., 9] - n * md * md
    ridge = _CORRELATED * noise**2
    pxx, pyy = sxx + ridge, syy + ridge
    determinant = pxx * pyy - sxy * sxy
    a = (pyy * sxd - sxy * syd) / determinant
    b = (pxx * syd - sxy * sxd) / determinant
    error = (
        sdd - 2 * (a * sxd + b * syd) + (a * a * sxx + 2 * a * b * sxy + b * b * syy)
    )
    planes = np.stack([a, b, md - a * mx - b * my], axis=-1)
    return planes, np.maximum(error, 0.0)


def _touching(values: Float32Array, labels: IntArray, max_step: float) -> IntArray:
    """Pairs of labels with neighbouring pixels on one surface, each once, (e, 2)."""
    keys = []
    n = int(labels.max()) + 1
    for shift in SHIFTS:
        one, two = neighbours(labels, shift)
        a, b = labels[one], labels[two]
        crossing = (a != b) & (a >= 0) & (b >= 0)
        crossing &= np.abs(values[one] - values[two]) < max_step
        low, high = np.minimum(a, b)[crossing], np.maximum(a, b)[crossing]
        keys.append(low.astype(np.int64) * n + high)
    unique = np.unique(np.concatenate(keys))
    return np.stack(np.divmod(unique, n), axis=1)


def _merged(
    moments: FloatArray, edges: IntArray, noise: float, max_increase: float
) -> IntArray:
    """Region of each node after merging what one plane explains, shape (nodes,)."""
    budget = max_increase * _CORRELATED * noise**2
    region: IntArray = np.arange(len(moments))
    error = _fitted(moments, noise)[1]
    for _ in range(40):
        if not len(edges):
            break
        a, b = edges.T
        increase = _fitted(moments[a] + moments[b], noise)[1] - error[a] - error[b]
        chosen = mutual_choices(edges, increase, moments[:, 0], budget)
        if not len(chosen):
            break
        joined = linked(chosen, len(moments))
        region = joined[region]
        n = int(joined.max()) + 1
        moments = np.stack(
            [np.bincount(joined, weights=x, minlength=n) for x in moments.T], axis=1
        )
        error = _fitted(moments, noise)[1]
        edges = np.sort(joined[edges], axis=1)
        keys = np.unique(
            (edges[:, 0] * np.int64(n) + edges[:, 1])[edges[:, 0] != edges[:, 1]]
        )
        edges = np.stack(np.divmod(keys, n), axis=1)
    return region


def _exchange_borders(
    image: InverseDepthImage, labels: IntArray, planes: FloatArray, max_step: float
) -> int:
    """Move border pixels to the neighbouring patch that fits them better, in place."""
    values = image.values
    best = np.full(labels.shape, np.inf, dtype=np.float32)
    choice = labels.copy()
    for shift in SHIFTS:
        one, two = neighbours(labels, shift)
        crossing = (
            (labels[one] != labels[two]) & (labels[one] >= 0) & (labels[two] >= 0)
        )
        crossing &= np.abs(values[one] - values[two]) < max_step
        row, column = np.nonzero(crossing)
        i, j = row + shift[0], column + shift[1]
        for (r, c), (other_r, other_c) in (
            ((row, column), (i, j)),
            ((i, j), (row, column)),
        ):
            own = _residual(image, planes, labels[r, c], r, c)
            other = labels[other_r, other_c]
            offer = _residual(image, planes, other, r, c)
            better = (offer < own) & (offer < best[r, c])
            best[r[better], c[better]] = offer[better]
            choice[r[better], c[better]] = other[better]
    n_moved = int(np.count_nonzero(choice != labels))
    labels[:] = choice
    return n_moved


def _hand_over_crumbs(
    image: InverseDepthImage,
    labels: IntArray,
    planes: FloatArray,
    max_step: float,
    min_pixels: int,
) -> None:
    """Give the pixels of small patches to larger neighbours from outside in, in place.

    Crumbs without a larger neighbour stay.
    """
    values = image.values
    height, width = values.shape
    size = np.bincount(labels[labels >= 0], minlength=len(planes))
    # The last place answers for label -1, which takes nothing.
    is_host = np.append(size >= min_pixels, False)
    row, column = np.nonzero((labels >= 0) & ~is_host[labels])
    while len(row):
        best = np.full(len(row), np.inf)
        choice = np.full(len(row), -1)
        for i, j in ((0, -1), (0, 1), (-1, 0), (1, 0)):
            r = np.clip(row + i, 0, height - 1)
            c = np.clip(column + j, 0, width - 1)
            host = labels[r, c]
            offers = is_host[host]
            offers &= np.abs(values[r, c] - values[row, column]) < max_step
            at = np.flatnonzero(offers)
            offer = _residual(image, planes, host[at], row[at], column[at])
            better = offer < best[at]
            best[at[better]] = offer[better]
            choice[at[better]] = host[at[better]]
        taken = choice >= 0
        if not taken.any():
            return
        labels[row[taken], column[taken]] = choice[taken]
        row, column = row[~taken], column[~taken]


def _residual(
    image: InverseDepthImage,
    planes: FloatArray,
    patch: IntArray,
    row: IntArray,
    column: IntArray,
) -> FloatArray:
    a, b, c = planes[patch].T
    fit = a * image.x[row, column] + b * image.y[row, column] + c
    residual: FloatArray = np.abs(image.values[row, column] - fit)
    return residual
