"""Fitting `Evidence`: boosted symmetric trees, by Newton steps on the logistic loss.

Friedman, "Greedy function approximation: a gradient boosting machine", 2001; trees that
ask the same question at every node of a level as in Prokhorenkova et al., "CatBoost",
2018. The same cases and the same generator give the same file.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from debrisgrasp.segmentation.evidence import Evidence

__all__ = ["Boosting", "Cases", "write_evidence"]

BINS = 48
UNKNOWN = -1e9
"""Threshold that only unknown values do not reach."""


@dataclass
class Cases:
    """Features (n, f), whether it is so (n,), and how much each counts (n,)."""

    features: np.ndarray
    is_so: np.ndarray
    weight: np.ndarray

    def __len__(self) -> int:
        return len(self.is_so)

    @classmethod
    def joined(cls, parts: Iterable[Cases]) -> Cases:
        columns = zip(*((p.features, p.is_so, p.weight) for p in parts), strict=True)
        return cls(*(np.concatenate(column) for column in columns))


@dataclass(frozen=True, kw_only=True)
class Boosting:
    """How many trees, how deep, and how much each is held back."""

    n_terms: int = 200
    depth: int = 4
    rate: float = 0.12
    ridge: float = 30.0
    row_share: float = 0.4
    column_share: float = 0.5

    def fitted(
        self, cases: Cases, names: Sequence[str], rng: np.random.Generator
    ) -> tuple[float, list[dict[str, Any]]]:
        """Prior log-odds and the terms of `Evidence`."""
        X = np.where(np.isnan(cases.features), -np.inf, cases.features)
        X = X.astype(np.float32).T.copy()
        y, w = cases.is_so.astype(float), cases.weight / cases.weight.mean()
        cuts = [_thresholds(column) for column in X]
        # A value is above threshold j exactly if its bin is above j.
        bins = np.stack([np.searchsorted(c, x) for c, x in zip(cuts, X, strict=True)])
        bins = bins.astype(np.uint8)
        share = np.average(y, weights=w)
        prior = float(f"{np.log(share / (1 - share)):.5g}")
        z = np.full(len(y), prior)
        terms = []
        for _ in range(self.n_terms):
            p = 1.0 / (1.0 + np.exp(-z))
            slope, bend = w * (y - p), w * p * (1 - p)
            rows = np.flatnonzero(rng.random(len(y)) < self.row_share)
            columns = rng.permutation(len(X))[: max(1, int(self.column_share * len(X)))]
            questions = self._questions(bins, cuts, rows, columns, slope, bend)
            leaf = np.zeros(len(y), dtype=np.int64)
            for bit, (k, j) in enumerate(questions):
                leaf += (bins[k] > j).astype(np.int64) << bit
            sums = [
                np.bincount(leaf[rows], v[rows], 1 << self.depth) for v in (slope, bend)
            ]
            value = self.rate * sums[0] / (sums[1] + self.ridge)
            z += value[leaf]
            terms.append(
                {
                    "questions": [
                        [names[k], float(f"{cuts[k][j]:.5g}")] for k, j in questions
                    ],
                    "log_odds": [float(f"{v:.4g}") for v in value],
                }
            )
        return prior, terms

    def evidence(
        self, cases: Cases, names: Sequence[str], rng: np.random.Generator
    ) -> Evidence:
        """Fit what will be used at once."""
        return Evidence.from_terms(names, *self.fitted(cases, names, rng))

    def _questions(
        self,
        bins: np.ndarray,
        cuts: list[np.ndarray],
        rows: np.ndarray,
        columns: np.ndarray,
        slope: np.ndarray,
        bend: np.ndarray,
    ) -> list[tuple[int, int]]:
        """Column and threshold of each level of one tree."""
        slope, bend = slope[rows], bend[rows]
        mine = {k: bins[k, rows].astype(np.int32) for k in columns}
        leaf = np.zeros(len(rows), dtype=np.int32)
        questions = []
        for bit in range(self.depth):
            best = (-np.inf, 0, 0)
            for k in columns:
                gain = _split_gains(leaf, mine[k], slope, bend, 1 << bit, self.ridge)
                j = int(gain[: len(cuts[k])].argmax())
                best = max(best, (float(gain[j]), int(k), j))
            _, k, j = best
            questions.append((k, j))
            leaf += (mine[k] > j).astype(np.int32) << bit
        return questions


def write_evidence(
    path: Path, about: str, prior: float, terms: list[dict[str, Any]]
) -> None:
    """Write the file that `Evidence.shipped` reads."""
    rows = ",\n".join(f"    {json.dumps(term)}" for term in terms)
    path.write_text(
        f'{{\n  "about": {json.dumps(about)},\n  "prior": {prior:.5g},\n'
        f'  "terms": [\n{rows}\n  ]\n}}\n',
        encoding="utf-8",
    )


def _thresholds(column: np.ndarray) -> np.ndarray:
    """Quantiles of the known values, and one threshold that only unknown ones miss."""
    known = column[np.isfinite(column)]
    cuts = np.quantile(known, np.linspace(0, 1, BINS + 1)[1:-1]) if len(known) else []
    return np.unique(np.append(cuts, UNKNOWN)).astype(np.float32)


def _split_gains(leaf, bins, slope, bend, n_leaves, ridge):
    """Gain of splitting all leaves after each bin, shape (bins,)."""
    n_bins = BINS + 2
    key = leaf * n_bins + bins
    g, h = (
        np.bincount(key, v, n_leaves * n_bins).reshape(n_leaves, n_bins).cumsum(axis=1)
        for v in (slope, bend)
    )
    above_g, above_h = g[:, -1:] - g, h[:, -1:] - h
    return (g**2 / (h + ridge) + above_g**2 / (above_h + ridge)).sum(axis=0)
