"""Measuring regions and the borders between them, cell by cell."""

from __future__ import annotations

import numpy as np

from debrisgrasp._arrays import BoolArray, Float32Array, FloatArray, IntArray

from .cells import CellImage
from .graph import BorderSum, RegionGraph, RegionSum
from .patches import PlanarPatches, neighbours, summed

__all__ = ["patch_graph"]

_INSIDE = 2
"""How far inside a patch its bend against a neighbour is measured [cells]."""
_BRIDGE = 2
"""Depth to which unmeasured cells are filled from either side: stereo cameras lose
pixels along edges, and parts that touch there would seem apart."""
_MAX_STEP = 0.02
"""Step between two planes up to which a pair of cells is smooth [m]."""
_MAX_CONCAVITY = float(np.deg2rad(24))
"""Angle up to which a concave pair of cells is smooth [rad]."""


def patch_graph(
    cells: CellImage,
    patches: PlanarPatches,
    max_gap: float,
    *,
    of_interest: BoolArray | None = None,
    colors: FloatArray | None = None,
) -> RegionGraph:
    """Measure patches and their borders.

    Parameters
    ----------
    max_gap
        Largest step of 1/z between neighbouring cells that touch [1/m].
    of_interest
        Marked cells, shape (h, w).
    colors
        Mean colour of each cell in [0, 1], shape (h, w, 3).
    """
    labels = np.where(cells.values == 0, -2, patches.labels)
    values, labels = _bridged(cells.values, labels)
    n = len(patches)
    scale = np.sqrt(np.einsum("ip,ip->p", patches.planes, patches.planes))
    regions = _measured(cells, patches, scale)
    row, column = np.nonzero(patches.labels >= 0)
    own = patches.labels[row, column]
    if of_interest is not None:
        marked = of_interest[row, column].astype(np.float64)
        regions[:, RegionSum.OF_INTEREST] = np.bincount(own, marked, n)
    if colors is not None:
        terms = list(colors[row, column].T.astype(np.float64))
        regions[:, RegionSum.COLOR] = summed(terms, own, n).T
    first, second = _crossings(labels)
    _measure_outlines(regions, labels, values, first, second, max_gap)
    flat = labels.ravel()
    between = (flat[first] >= 0) & (flat[second] >= 0)
    first, second = first[between], second[between]
    ends = np.stack([flat[first], flat[second]], axis=1).astype(np.int64)
    near, far = (values.ravel()[cell].astype(np.float64) for cell in (first, second))
    touches = np.abs(near - far) < max_gap
    sums = np.zeros((len(ends), BorderSum.COUNT))
    sums[:, BorderSum.LENGTH] = 1.0
    sums[:, BorderSum.TOUCHING] = touches
    sums[:, BorderSum.A_NEARER] = ~touches & (near > far)
    sums[:, BorderSum.B_NEARER] = ~touches & (near < far)
    sums[:, BorderSum.CUT] = touches & (np.diff(patches.face[ends], axis=1)[:, 0] == 0)
    sums[:, BorderSum.JUMP] = np.where(touches, 0.0, np.abs(1.0 / near - 1.0 / far))
    at = np.flatnonzero(touches)
    sums[at, BorderSum.STEP : BorderSum.CUT] = _contacts(
        cells,
        patches.planes,
        scale,
        labels,
        ends[at].T,
        (first[at], second[at]),
        0.5 * (near + far)[at],
    )
    cut = _cut_pairs(patches.face)
    apart = np.zeros((len(cut), BorderSum.COUNT))
    apart[:, BorderSum.CUT] = 1.0
    return RegionGraph.of_pairs(
        regions, np.concatenate([ends, cut]), np.concatenate([sums, apart]), labels
    )


def _cut_pairs(face: IntArray) -> IntArray:
    """Pairs of patches that were cut from one face, touching or not, (k, 2)."""
    order = np.argsort(face, kind="stable")
    pairs = [
        np.stack(np.triu_indices(count, 1), axis=1) + start
        for start, count in zip(
            *np.unique(face[order], return_index=True, return_counts=True)[1:],
            strict=True,
        )
        if count > 1
    ]
    cut: IntArray = order[np.concatenate([np.empty((0, 2), dtype=np.int64), *pairs])]
    return cut


def _bridged(values: Float32Array, labels: IntArray) -> tuple[Float32Array, IntArray]:
    values, labels = values.copy(), labels.copy()
    row, column = np.nonzero(values == 0)
    height, width = values.shape
    for _ in range(_BRIDGE):
        source = np.full(len(row), -1)
        for i, j in ((0, -1), (0, 1), (-1, 0), (1, 0)):
            r = np.clip(row + i, 0, height - 1)
            c = np.clip(column + j, 0, width - 1)
            usable = (source < 0) & (values[r, c] > 0)
            source[usable] = (r * width + c)[usable]
        got = source >= 0
        new_values, new_labels = (a.ravel()[source[got]] for a in (values, labels))
        values[row[got], column[got]] = new_values
        labels[row[got], column[got]] = new_labels
        row, column = row[~got], column[~got]
    return values, labels


def _measured(
    cells: CellImage, patches: PlanarPatches, scale: FloatArray
) -> FloatArray:
    """Sum over the cells of patches, shape (p, RegionSum.COUNT)."""
    row, column = np.nonzero(patches.labels >= 0)
    own = patches.labels[row, column]
    n = len(patches)
    x, y = cells.x[column].astype(np.float64), cells.y[row].astype(np.float64)
    z = 1.0 / cells.values[row, column]
    a, b, c = (patches.planes / scale)[:, own]
    # Grazing surfaces are larger than they look, but how much is uncertain.
    cosine = np.maximum(np.abs(a * x + b * y + c), 0.15)
    area = (z / cells.focal) ** 2 / cosine
    x, y = x * z, y * z
    terms = [x, y, z, x * x, x * y, x * z, y * y, y * z, z * z]
    regions = np.zeros((n, RegionSum.COUNT))
    regions[:, RegionSum.MOMENTS] = patches.moments.T
    regions[:, 10:20] = summed([*(t * area for t in terms), area], own, n).T
    regions[:, RegionSum.ROW] = np.bincount(own, row, n)
    regions[:, RegionSum.COLUMN] = np.bincount(own, column, n)
    return regions


def _crossings(labels: IntArray) -> tuple[IntArray, IntArray]:
    """Flat indices of neighbouring cells with different labels, shape (k,) each."""
    width = labels.shape[1]
    firsts, seconds = [], []
    for shift, (a, b) in zip((1, width), neighbours(labels), strict=True):
        row, column = np.nonzero((a != b) & (np.maximum(a, b) >= 0))
        firsts.append(row * width + column)
        seconds.append(row * width + column + shift)
    return np.concatenate(firsts), np.concatenate(seconds)


def _measure_outlines(
    regions: FloatArray,
    labels: IntArray,
    values: Float32Array,
    first: IntArray,
    second: IntArray,
    max_gap: float,
) -> None:
    """Count what lies on the other side of outlines, in place."""
    n = len(regions)
    flat, depth = labels.ravel(), values.ravel()
    near = np.abs(depth[first] - depth[second]) < max_gap
    for inside, outside in ((first, second), (second, first)):
        own, other = flat[inside], flat[outside]
        for column, chosen in (
            (RegionSum.OUTLINE, own >= 0),
            (RegionSum.ON_GROUND, (own >= 0) & (other == -1) & near),
            (RegionSum.UNKNOWN, (own >= 0) & (other == -2)),
        ):
            regions[:, column] += np.bincount(own[chosen], minlength=n)
    for rim in (labels[0], labels[-1], labels[:, 0], labels[:, -1]):
        regions[:, RegionSum.UNKNOWN] += np.bincount(rim[rim >= 0], minlength=n)


def _contacts(
    cells: CellImage,
    planes: FloatArray,
    scale: FloatArray,
    labels: IntArray,
    ends: IntArray,
    pair: tuple[IntArray, IntArray],
    inverse: FloatArray,
) -> FloatArray:
    """Columns from `BorderSum.STEP` on for pairs of cells that touch, shape (k, 16).

    Parameters
    ----------
    scale
        Inverse distance of each plane from the camera [1/m], shape (p,).
    ends
        Patches of the two cells, shape (2, k).
    pair
        Flat indices of the two cells.
    inverse
        1/z between them [1/m], shape (k,).
    """
    height, width = labels.shape
    a, b = ends
    row, column = np.divmod(pair[0], width)
    down, right = np.divmod(pair[1] - pair[0], width)
    x, y = cells.x.astype(np.float64), cells.y.astype(np.float64)

    def at(plane: FloatArray, i: IntArray, j: IntArray) -> FloatArray:
        value: FloatArray = plane[0] * x[j] + plane[1] * y[i] + plane[2]
        return value

    gap = planes[:, a] - planes[:, b]
    between, beyond = at(gap, row, column), at(gap, row + down, column + right)
    # Planes that cross between the two cells meet there, however steep they are.
    crosses = between * beyond <= 0
    apart = np.where(crosses, 0.0, np.minimum(np.abs(between), np.abs(beyond)))
    opening, sides = np.zeros(len(a)), np.zeros(len(a))
    places = []
    # A little inside each patch the plane of the other passes in front if convex.
    for own, other, reach, sign in ((a, b, -_INSIDE, -1), (b, a, _INSIDE + 1, 1)):
        i = np.clip(row + reach * down, 0, height - 1)
        j = np.clip(column + reach * right, 0, width - 1)
        inside = labels[i, j] == own
        bend = at(planes[:, other] - planes[:, own], i, j)
        opening += np.where(inside, bend - sign * between, 0.0)
        sides += inside
        fit = np.where(inside, at(planes[:, own], i, j), inverse)
        fit = np.clip(fit, 0.5 * inverse, 2.0 * inverse)
        places.append(np.stack([x[j], y[i], np.ones(len(i))]) / fit)
    upwards = places[1] - places[0]
    upwards /= np.maximum(np.sqrt(np.einsum("ik,ik->k", upwards, upwards)), 1e-9)
    opening /= inverse**2 * np.maximum(sides, 1.0)
    cosine = np.einsum("ik,ik->k", planes[:, a], planes[:, b]) / (scale[a] * scale[b])
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))
    step = apart / inverse**2
    is_rough = step > _MAX_STEP + cells.noise / inverse**2
    is_rough |= (opening < 0) & (angle > _MAX_CONCAVITY)
    px, py, pz = x[column] / inverse, y[row] / inverse, 1.0 / inverse
    return np.stack(
        [
            step,
            apart / inverse / np.maximum(scale[a], scale[b]),
            opening,
            angle,
            np.where(opening < 0, angle, 0.0),
            np.where(is_rough, -1.0, 1.0),
            cells.up @ upwards,
            *(px, py, pz, px * px, px * py, px * pz, py * py, py * pz, pz * pz),
        ],
        axis=1,
    )
