"""From features of two regions to the probability that they are one object."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import numpy as np

from debrisgrasp._arrays import Float32Array, FloatArray, IntArray

from .features import FEATURES

__all__ = ["Evidence", "fitted_evidence"]


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """A sum of log-odds, each looked up by a few comparisons of features.

    Each of the k terms asks d questions "is this feature above this threshold?" (NaN is
    not) and adds the log-odds stored for the combination of answers: a boosted ensemble
    of symmetric trees.
    """

    features: IntArray
    """Column of the feature in each question, shape (k, d)."""
    thresholds: Float32Array
    """What it is compared with, shape (k, d)."""
    log_odds: FloatArray
    """What each combination of answers adds, shape (k, 2^d); question i is bit i."""
    prior: float
    """Log-odds before any question."""

    def log_odds_of(self, features: FloatArray) -> FloatArray:
        """Log-odds of pairs with the features (n, f), shape (n,)."""
        known = np.nan_to_num(
            features.astype(np.float32), nan=-np.inf, posinf=np.inf, neginf=-np.inf
        )
        n_terms, n_questions = self.features.shape
        leaf = np.zeros((len(known), n_terms), dtype=np.int64)
        for bit in range(n_questions):
            answers = known[:, self.features[:, bit]] > self.thresholds[:, bit]
            leaf += answers.astype(np.int64) << bit
        total: FloatArray = self.log_odds[np.arange(n_terms), leaf].sum(axis=1)
        return self.prior + total

    def probability(self, features: FloatArray) -> FloatArray:
        """Probability that pairs with the features (n, f) are one object, (n,)."""
        odds: FloatArray = 1.0 / (1.0 + np.exp(-self.log_odds_of(features)))
        return odds

    @classmethod
    def from_terms(cls, prior: float, terms: list[dict[str, Any]]) -> Evidence:
        """Build from terms of ``questions`` (feature, threshold) and ``log_odds``."""
        questions = [term["questions"] for term in terms]
        return cls(
            features=np.array([[FEATURES.index(q[0]) for q in qs] for qs in questions]),
            thresholds=np.array([[q[1] for q in qs] for qs in questions], np.float32),
            log_odds=np.array([term["log_odds"] for term in terms]),
            prior=prior,
        )


@cache
def fitted_evidence() -> Evidence:
    """Evidence fitted to simulated piles; the file says how."""
    path = resources.files(__package__).joinpath("evidence.json")
    content = json.loads(path.read_text("utf-8"))
    return Evidence.from_terms(content["prior"], content["terms"])
