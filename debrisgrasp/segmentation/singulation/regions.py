"""Regions of a label image, the graph of those that touch, and merging along it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from debrisgrasp._arrays import BoolArray, Float32Array, FloatArray, IntArray

__all__ = [
    "SHIFTS",
    "Crossings",
    "linked",
    "mutual_choices",
    "neighbours",
    "no_pairs",
]

SHIFTS = ((0, 1), (1, 0))
"""Offsets (row, column) to the right and the lower neighbour of a pixel."""
_BRIDGE = 3
"""Depth to which unmeasured pixels are filled from either side [pixels]."""


def no_pairs() -> IntArray:
    """Return an empty list of pairs, shape (0, 2)."""
    return np.empty((0, 2), dtype=np.int64)


def linked(edges: IntArray, n_nodes: int) -> IntArray:
    """Find the connected component of each node, shape (n_nodes,)."""
    graph = coo_array(
        (np.ones(len(edges), dtype=bool), (edges[:, 0], edges[:, 1])),
        shape=(n_nodes, n_nodes),
    )
    components: IntArray = connected_components(graph, directed=False)[1]
    return components


def mutual_choices(
    edges: IntArray, cost: FloatArray, size: FloatArray, budget: float
) -> IntArray:
    """Edges along which regions merge in one round, shape (k, 2).

    Every region points to the neighbour that costs least. Pairs that point at each
    other merge, and regions that point at one at least three times their size.

    Parameters
    ----------
    edges
        Pairs of touching regions, each once, shape (e, 2).
    cost
        Of merging along each, shape (e,).
    size
        Of each region, shape (r,).
    budget
        Edges that cost as much or more don't count.
    """
    affordable = cost < budget
    edges, cost = edges[affordable], cost[affordable]
    # Of several values for one place the last assigned stays: the cheapest.
    edges = edges[np.argsort(-cost, kind="stable")]
    best = np.full(len(size), -1)
    best[edges.ravel()] = edges[:, ::-1].ravel()
    asker = np.flatnonzero(best >= 0)
    asked = best[asker]
    merges = (best[asked] == asker) | (3 * size[asker] <= size[asked])
    return np.stack([asker[merges], asked[merges]], axis=1)


def neighbours(
    labels: IntArray, shift: tuple[int, int]
) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Slices that lay an image over itself, shifted by one of `SHIFTS`."""
    height, width = labels.shape
    i, j = shift
    first = (slice(0, height - i), slice(0, width - j))
    second = (slice(i, height), slice(j, width))
    return first, second


@dataclass(frozen=True, slots=True, eq=False)
class Crossings:
    """Pairs of neighbouring pixels with different labels, each in both directions.

    Pixels without a measurement are first filled from their neighbours: stereo cameras
    lose pixels along edges, and parts that touch there would seem apart.
    """

    row: IntArray
    """Row of the first pixel, shape (k,)."""
    column: IntArray
    """Column of the first pixel, shape (k,)."""
    step: IntArray
    """Offset (row, column) to the second pixel, shape (k, 2)."""
    first: IntArray
    """Label of the first pixel, never -1, shape (k,)."""
    second: IntArray
    """Label of the second pixel, -1 for none, shape (k,)."""
    near: Float32Array
    """1/z at the first pixel [1/m], shape (k,)."""
    far: Float32Array
    """1/z at the second pixel [1/m], 0 if unknown, shape (k,)."""
    labels: IntArray
    """The filled labels, shape (height, width)."""

    @classmethod
    def of(cls, values: Float32Array, labels: IntArray) -> Crossings:
        """Find the crossings of a label image (-1: none) over 1/z (0: unknown)."""
        values, labels = _bridged(values, labels)
        firsts, seconds = [], []
        for shift in SHIFTS:
            one, two = neighbours(labels, shift)
            place = np.stack(np.nonzero(labels[one] != labels[two]), axis=1)
            firsts += [place, place + shift]
            seconds += [place + shift, place]
        first, second = np.concatenate(firsts), np.concatenate(seconds)
        known = labels[first[:, 0], first[:, 1]] >= 0
        first, second = first[known], second[known]
        return cls(
            row=first[:, 0],
            column=first[:, 1],
            step=second - first,
            first=labels[first[:, 0], first[:, 1]].astype(np.int64),
            second=labels[second[:, 0], second[:, 1]].astype(np.int64),
            near=values[first[:, 0], first[:, 1]],
            far=values[second[:, 0], second[:, 1]],
            labels=labels,
        )

    def selected(self, index: BoolArray) -> Crossings:
        """Keep some of the crossings."""
        return Crossings(
            row=self.row[index],
            column=self.column[index],
            step=self.step[index],
            first=self.first[index],
            second=self.second[index],
            near=self.near[index],
            far=self.far[index],
            labels=self.labels,
        )

    def merged(self, region: IntArray) -> Crossings:
        """Crossings between larger regions, given the one of each label, shape (r,)."""
        # The last place answers for label -1.
        lookup = np.append(region, -1)
        first, second = lookup[self.first], lookup[self.second]
        apart = first != second
        kept = self.selected(apart)
        return Crossings(
            row=kept.row,
            column=kept.column,
            step=kept.step,
            first=first[apart],
            second=second[apart],
            near=kept.near,
            far=kept.far,
            labels=lookup[self.labels],
        )

    def touching(self, max_gap: float) -> Crossings:
        """Keep those between two labels that are at most ``max_gap`` [1/m] apart."""
        return self.selected(
            (self.second >= 0) & (np.abs(self.near - self.far) < max_gap)
        )


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
        filled = source >= 0
        new_values = values.ravel()[source[filled]]
        new_labels = labels.ravel()[source[filled]]
        values[row[filled], column[filled]] = new_values
        labels[row[filled], column[filled]] = new_labels
        row, column = row[~filled], column[~filled]
    return values, labels
