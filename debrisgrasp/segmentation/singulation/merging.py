"""Merging regions best-first, and how sure every join is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray

from .cells import CellImage
from .features import distant_pairs, pair_features
from .graph import BorderSum, RegionGraph, RegionSum
from .patches import merged_into
from .shapes import Shapes

__all__ = ["Merged", "merged_regions"]

_LEVELS = (0.97, 0.93, 0.88, 0.82, 0.75)
"""Scores above which regions merge first, so that sure joins shape the doubtful."""
_CLEAR_COLOR = 0.15
"""Difference in the shares of red and green that tells two paints apart."""
_SURE = 600.0
"""Log-odds beyond which nothing is surer; their exponential is finite."""
_CUT_SCORE = 0.4
"""Most that speaks for bars being one object whose common face was cut."""
_SLIVER, _SLIVER_SCORE = 0.003, 0.6
"""What shows less surface [m^2] is mostly a part of what it touches, for which a lower
score is enough."""
_NOTABLE = 0.05
"""Share of an object from which a part of it is worth a doubt."""

Score = Callable[[FloatArray], FloatArray]
"""Probability that pairs with the features (k, f) are one object, shape (k,)."""
Observer = Callable[[IntArray, IntArray, FloatArray], None]
"""Told the region of each patch, the pairs that were looked at and their features."""


@dataclass(frozen=True, slots=True, eq=False)
class Merged:
    """Objects made of patches."""

    region: IntArray
    """Object of each patch from 0, shape (p,)."""
    scores: FloatArray
    """How much speaks for the two patches of each edge of the first graph being one
    object, in [0, 1]: when they were joined, or at last if they weren't, shape (e,)."""
    certainty: FloatArray
    """Score of the weakest join of notable parts of each object, shape (o,)."""
    pairs: IntArray
    """Pairs of objects that were compared, touching or not, shape (k, 2)."""
    pair_scores: FloatArray
    """Probability that each pair is one object all the same, shape (k,)."""


def merged_regions(
    graph: RegionGraph,
    cells: CellImage,
    score: Score,
    min_score: float,
    *,
    color_weight: float = 0.0,
    observe: Observer | None = None,
) -> Merged:
    """Merge regions while something speaks for it.

    Features are computed anew for regions that grew. What merges is what scores best;
    regions that don't meet in the image are compared once the surest joins are made. At
    last slivers become parts of what they touch.

    Parameters
    ----------
    min_score
        Pairs below are kept apart, unless one is a sliver.
    color_weight
        Log-odds that a clear difference in colour takes away, if colours are known.
    """
    state = _State(graph, cells)

    def settle(gain: Callable[[], FloatArray], least: float) -> None:
        while len(state.graph.edges):
            stale = np.flatnonzero(np.isnan(state.score))
            if len(stale):
                features = pair_features(state.graph, state.shapes, cells, stale)
                if observe is not None:
                    observe(state.region, state.graph.edges[stale], features)
                state.score[stale] = _marked(
                    state.graph, stale, score(features), color_weight
                )
            size = state.graph.regions[:, RegionSum.CELLS]
            into = merged_into(state.graph.edges.T, gain(), size, least)
            if into is None:
                break
            state.merge(into)

    levels = [level for level in _LEVELS if level > min_score]
    for number, level in enumerate((*levels, min_score)):
        if number:
            state.look_afar()
        settle(lambda: state.score, level)
    settle(state.of_slivers, _SLIVER_SCORE)
    # What a mark keeps apart may be one object all the same, of which it is a part.
    apart = np.flatnonzero(_marks(state.graph, slice(None)) == 1)
    if len(apart):
        features = pair_features(state.graph, state.shapes, cells, apart)
        state.score[apart] = _heard(state.graph, apart, score(features), color_weight)
    return state.result()


def _marked(
    graph: RegionGraph, which: IntArray, score: FloatArray, color_weight: float
) -> FloatArray:
    """Scores after hearing what cuts, colours, and a mark on an object say."""
    score = _heard(graph, which, score, color_weight)
    # What is marked is one object, and nothing else is part of it.
    n_marked = _marks(graph, which)
    return np.where(n_marked == 2, 1.0, np.where(n_marked == 1, 0.0, score))


def _marks(graph: RegionGraph, which: IntArray | slice) -> IntArray:
    """How many ends of each edge are marked, shape (k,)."""
    of_interest = graph.regions[:, RegionSum.OF_INTEREST] > 0
    n_marked: IntArray = of_interest[graph.edges[which]].sum(axis=1)
    return n_marked


def _heard(
    graph: RegionGraph, which: IntArray, score: FloatArray, color_weight: float
) -> FloatArray:
    """Scores after hearing what cuts and colours say."""
    a, b = graph.edges[which].T
    border = graph.borders[which]
    is_cut = border[:, BorderSum.CUT] > 0.5 * border[:, BorderSum.TOUCHING]
    score = np.where(is_cut, np.minimum(score, _CUT_SCORE), score)
    if color_weight:
        color = graph.regions[:, RegionSum.COLOR]
        # Shares of red and green stay nearly the same in the shade.
        total = np.maximum(color.sum(axis=1), 1e-9)
        share = np.where(total[:, None] > 1e-6, color[:, :2] / total[:, None], 1 / 3)
        differs = np.abs(share[a] - share[b]).sum(axis=1) / _CLEAR_COLOR
        odds = score / np.maximum(1.0 - score, 1e-9)
        gain = -color_weight * np.clip(differs - 0.2, -0.2, 1.0)
        odds *= np.exp(np.minimum(gain, _SURE))
        score = odds / (1.0 + odds)
    return score


class _State:
    """Where merging has come to; lives inside `merged_regions` only."""

    def __init__(self, graph: RegionGraph, cells: CellImage) -> None:
        self.graph, self.cells = graph, cells
        self.shapes = Shapes.of(graph.regions, cells.noise)
        self.score = np.full(len(graph.edges), np.nan)
        self.region: IntArray = np.arange(len(graph))
        self.patch_edges = graph.edges
        self.patch_scores = np.full(len(graph.edges), np.nan)
        # Regions that became part of a larger one: the one they are in now, their
        # cells, and the score of the join.
        self.joined: IntArray = np.empty(0, dtype=np.int64)
        self.joins = np.empty((0, 2))

    def look_afar(self) -> None:
        """Take regions that don't meet into account."""
        pairs = distant_pairs(self.graph, self.shapes, self.cells)
        self.graph, is_new = self.graph.with_pairs(pairs)
        score = np.full(len(is_new), np.nan)
        score[~is_new] = self.score
        self.score = score

    def of_slivers(self) -> FloatArray:
        """Scores of what touches, zero but where one of both is a sliver, (e,)."""
        area = self.graph.regions[:, RegionSum.AREA]
        is_sliver = area[self.graph.edges].min(axis=1) < _SLIVER
        is_sliver &= self.graph.borders[:, BorderSum.TOUCHING] > 0
        return np.where(is_sliver, self.score, 0.0)

    def merge(self, into: IntArray) -> None:
        """Make regions parts of larger ones."""
        self._note_joins(into)
        ends = into[self.region][self.patch_edges]
        self._note_scores(np.flatnonzero(ends[:, 0] == ends[:, 1]))
        grown = np.bincount(into) > 1
        kept = ~grown[into[self.graph.edges]].any(axis=1)
        score = self.score[kept]
        self.graph = self.graph.merged(into)
        self.region = into[self.region]
        new = Shapes.of(self.graph.regions[grown], self.cells.noise)
        self.shapes = self.shapes.replaced(into, grown, new)
        # Numbers keep their order, so the other edges keep theirs.
        self.score = np.full(len(self.graph.edges), np.nan)
        self.score[~grown[self.graph.edges].any(axis=1)] = score

    def _note_joins(self, into: IntArray) -> None:
        size = self.graph.regions[:, RegionSum.CELLS]
        a, b = self.graph.edges.T
        inner = into[a] == into[b]
        best = np.zeros(len(into))
        for end in (a[inner], b[inner]):
            np.maximum.at(best, end, self.score[inner])
        order = np.lexsort((size, into))
        is_host = np.ones(len(into), dtype=bool)
        is_host[order[:-1]] = np.diff(into[order]) > 0
        part = np.flatnonzero(~is_host)
        self.joined = into[np.concatenate([self.joined, part])]
        self.joins = np.concatenate(
            [self.joins, np.stack([size[part], best[part]], axis=1)]
        )

    def _note_scores(self, which: IntArray) -> None:
        """Write down the scores of regions at edges of patches not yet joined."""
        which = which[np.isnan(self.patch_scores[which])]
        n = len(self.graph)
        low, high = np.sort(self.region[self.patch_edges[which]], axis=1).T
        known = self.graph.edges @ np.array([n, 1])
        at = np.searchsorted(known, low * np.int64(n) + high)
        self.patch_scores[which] = self.score[at]

    def result(self) -> Merged:
        """Objects as they are now."""
        self._note_scores(np.arange(len(self.patch_edges)))
        certainty = np.ones(len(self.graph))
        size = self.graph.regions[self.joined, RegionSum.CELLS]
        notable = self.joins[:, 0] >= _NOTABLE * size
        np.minimum.at(certainty, self.joined[notable], self.joins[notable, 1])
        return Merged(
            self.region, self.patch_scores, certainty, self.graph.edges, self.score
        )
