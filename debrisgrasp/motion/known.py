"""Ways that an arm has gone before, as a start for the search of another.

What led an arm here leads it back, as long as nothing has moved; a search that begins
from those postures finds a way out of a corner that it would hardly find by chance.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from debrisgrasp._arrays import FloatArray, IntArray

from .edges import EdgeTest

__all__ = ["reached"]

_SHORTEST = 1e-6
"""Length of an edge between two that are the same [rad or m]."""
_NEIGHBOURS = 6
"""Each posture is joined to so many next to it, and to those before and after it."""


def reached(
    roots: FloatArray, known: FloatArray, edges: EdgeTest
) -> tuple[IntArray, IntArray]:
    """Which known postures can be reached by free edges, and from where.

    Parameters
    ----------
    roots
        Postures to begin at, shape (r, d).
    known
        Of a way, in order, shape (k, d).
    edges
        Tells which straight edges are free.

    Returns
    -------
    nodes, parents
        Rows of roots and known postures, one below the other, that were reached, each
        after the one that it is reached from, shape (n,); of that one its row.
    """
    n_roots, nodes = len(roots), np.concatenate([roots, known])
    pairs = _pairs(nodes, n_roots)
    free = edges.are_free(nodes[pairs[:, 0]], nodes[pairs[:, 1]])
    free &= edges.is_free(nodes)[pairs].all(axis=1)
    one, other = pairs[free].T.astype(np.int32)  # older SciPy takes no wider rows
    # Of two that are the same, too, one comes before the other.
    length = np.maximum(np.abs(nodes[one] - nodes[other]).max(axis=1), _SHORTEST)
    graph = coo_array((length, (one, other)), shape=(len(nodes),) * 2)
    away, before, _ = dijkstra(
        graph.tocsr(),
        directed=False,
        indices=np.arange(n_roots),
        min_only=True,
        return_predecessors=True,
    )
    order = np.argsort(away, kind="stable")
    found = order[np.isfinite(away[order]) & (before[order] >= 0)]
    return found.astype(np.intp), before[found].astype(np.intp)


def _pairs(nodes: FloatArray, n_roots: int) -> IntArray:
    """Pairs of rows worth a test, shape (m, 2), no root to another."""
    n = len(nodes)
    gap = np.sqrt(((nodes[:, None] - nodes) ** 2).sum(axis=-1))
    np.fill_diagonal(gap, np.inf)
    gap[:n_roots, :n_roots] = np.inf
    near = np.argsort(gap, axis=1, kind="stable")[:, :_NEIGHBOURS]
    rows = np.repeat(np.arange(n), near.shape[1])
    along = np.arange(n_roots, n - 1)
    pairs = np.concatenate(
        [np.column_stack([rows, near.ravel()]), np.column_stack([along, along + 1])]
    )
    pairs = np.unique(np.sort(pairs, axis=1), axis=0)
    is_worth = np.isfinite(gap[pairs[:, 0], pairs[:, 1]])
    kept: IntArray = pairs[is_worth]
    return kept
