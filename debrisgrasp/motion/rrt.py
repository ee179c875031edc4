"""Two trees that grow towards each other, many branches at a time (RRT-Connect).

J. Kuffner and S. LaValle, "RRT-Connect: an efficient approach to single-query path
planning", ICRA 2000. Here every round grows a batch of branches, so that one array
holds the samples of all their edges.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray, Rng

from .edges import EdgeTest
from .known import reached

__all__ = ["PathQuery", "PathSearch", "connect"]

_BATCH = 16
"""Branches grown in a round."""
_BRANCH = 1.0
"""Longest branch [rad or m]."""
_TWIG = 0.08
"""Branches shorter than this are not kept [rad or m]."""
_UNIFORM = 0.3
"""Share of the samples drawn from all postures; the others lie about the straight way
from a start to a goal."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PathQuery:
    """Find a way from a posture to any one of several."""

    q_start: FloatArray
    """Shape (d,)."""
    q_goals: FloatArray
    """Shape (g, d), g at least 1."""
    lower: FloatArray
    """Least joint values of the postures sampled, shape (d,); finite."""
    upper: FloatArray
    """Greatest joint values of the postures sampled, shape (d,); finite."""
    edges: EdgeTest
    max_rounds: int
    is_late: Callable[[], bool]
    known: FloatArray | None = None
    """Postures of a way that the arm has gone, from which to search, too, (k, d)."""


@dataclass(frozen=True, slots=True, eq=False)
class PathSearch:
    """What a search found."""

    path: FloatArray | None
    """Postures (m, d) from start to a goal, with free straight edges; None if none was
    found."""
    n_rounds: int
    n_nodes: int


@dataclass(eq=False)
class _Tree:
    """Postures, each with the index of the one that it grew from."""

    q: FloatArray
    parent: list[int] = field(default_factory=list)

    def nearest(self, q: FloatArray) -> tuple[IntArray, FloatArray]:
        """Index of the node next to each of (k, d), and its distance."""
        gap = q[:, None] - self.q
        distance = np.sqrt((gap * gap).sum(axis=-1))
        index = distance.argmin(axis=1)
        return index, distance[np.arange(len(q)), index]

    def grown(self, q: FloatArray, parent: IntArray) -> IntArray:
        """Add nodes; return their indices."""
        first = len(self.q)
        self.q = np.concatenate([self.q, q])
        self.parent.extend(parent.tolist())
        return np.arange(first, len(self.q))

    def rooted(self, known: FloatArray, edges: EdgeTest) -> dict[int, int]:
        """Add known postures (k, d) that its roots reach; their rows, and own index."""
        n_roots = len(self.q)
        index = {row: row for row in range(n_roots)}
        for row, before in zip(*reached(self.q, known, edges), strict=True):
            q = known[row - n_roots][None]
            index[int(row)] = int(self.grown(q, np.array([index[int(before)]]))[0])
        return {row - n_roots: i for row, i in index.items() if row >= n_roots}

    def way_to(self, index: int) -> list[FloatArray]:
        """Postures from the root to a node."""
        way = []
        while index >= 0:
            way.append(self.q[index])
            index = self.parent[index]
        return way[::-1]


def connect(query: PathQuery, *, rng: Rng) -> PathSearch:
    """Search by two trees; the same state of ``rng`` gives the same path."""
    start = _Tree(query.q_start[None], [-1])
    goals = _Tree(query.q_goals, [-1] * len(query.q_goals))
    rounds = 0
    path = _known_way(start, goals, query)
    if path is not None:
        return PathSearch(path, rounds, len(start.q) + len(goals.q))
    while rounds < query.max_rounds and not query.is_late():
        # The smaller one, that is in a corner, needs it more.
        is_mine = len(start.q) <= len(goals.q)
        mine, other = (start, goals) if is_mine else (goals, start)
        rounds += 1
        new = _extended(mine, _targets(query, rounds, rng), query.edges)
        if not len(new):
            continue
        near, _ = other.nearest(mine.q[new])
        share = query.edges.free_share(other.q[near], mine.q[new])
        met = np.flatnonzero(share >= 1.0)
        if len(met):
            length = np.abs(other.q[near[met]] - mine.q[new[met]]).max(axis=1)
            best = met[int(length.argmin())]
            ways = mine.way_to(int(new[best])), other.way_to(int(near[best]))
            first, second = ways if mine is start else ways[::-1]
            path = np.array(first + second[::-1])
            return PathSearch(path, rounds, len(start.q) + len(goals.q))
        tips = other.q[near] + share[:, None] * (mine.q[new] - other.q[near])
        far = np.abs(tips - other.q[near]).max(axis=1) >= _TWIG
        other.grown(tips[far], near[far])
    return PathSearch(None, rounds, len(start.q) + len(goals.q))


def _known_way(start: _Tree, goals: _Tree, query: PathQuery) -> FloatArray | None:
    """Let trees begin with what was gone before; the way, if that joins them."""
    if query.known is None or not len(query.known):
        return None
    one = start.rooted(query.known, query.edges)
    other = goals.rooted(query.known, query.edges)
    ways = [
        np.array(start.way_to(one[row]) + goals.way_to(other[row])[-2::-1])
        for row in sorted(one.keys() & other.keys())
    ]
    return min(ways, key=_length, default=None)


def _length(way: FloatArray) -> float:
    return float(np.abs(np.diff(way, axis=0)).max(axis=1).sum())


def _extended(tree: _Tree, targets: FloatArray, edges: EdgeTest) -> IntArray:
    """Grow towards targets (k, d) as far as is free; indices of the new nodes."""
    near, _ = tree.nearest(targets)
    root = tree.q[near]
    way = targets - root
    length = np.abs(way).max(axis=1, keepdims=True)
    way *= np.minimum(1.0, _BRANCH / np.maximum(length, 1e-9))
    share = edges.free_share(root, root + way)
    way *= share[:, None]
    kept = np.abs(way).max(axis=1) >= _TWIG
    return tree.grown(root[kept] + way[kept], near[kept])


def _targets(query: PathQuery, n_rounds: int, rng: Rng) -> FloatArray:
    """Postures to grow towards, (k, d); they spread more from round to round."""
    d = len(query.q_start)
    anywhere = rng.uniform(query.lower, query.upper, (_BATCH, d))
    goals = query.q_goals[rng.integers(len(query.q_goals), size=_BATCH)]
    along = query.q_start + rng.random((_BATCH, 1)) * (goals - query.q_start)
    spread = min(1.2, 0.3 + 0.1 * n_rounds) * rng.random((_BATCH, 1))
    beside = along + spread * rng.normal(size=(_BATCH, d))
    is_anywhere = rng.random((_BATCH, 1)) < _UNIFORM
    drawn = np.where(is_anywhere, anywhere, beside)
    return np.clip(drawn, query.lower, query.upper)
