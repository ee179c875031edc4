"""From features to a probability: a sum of log-odds fitted to known answers."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any

import numpy as np
from scipy.special import expit

from debrisgrasp._arrays import Float32Array, FloatArray, IntArray

__all__ = ["Evidence"]


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """A sum of log-odds, each looked up by a few comparisons of features.

    Each of the k terms asks d questions "is this feature above this threshold?" (NaN is
    not) and adds the log-odds stored for the combination of answers: a boosted ensemble
    of symmetric trees.
    """

    features: IntArray
    """Column of the feature in each question, shape (k, d), d at most 8."""
    thresholds: Float32Array
    """What it is compared with, shape (k, d)."""
    log_odds: FloatArray
    """What each combination of answers adds, shape (k, 2^d); question i is bit i."""
    prior: float
    """Log-odds before any question."""

    def log_odds_of(self, features: FloatArray) -> FloatArray:
        """Log-odds of cases with the features (n, f), shape (n,)."""
        known = np.nan_to_num(
            features.T.astype(np.float32), nan=-np.inf, posinf=np.inf, neginf=-np.inf
        )
        # Row by row: gathering columns would take five times as long.
        leaf = np.zeros((len(self.features), len(features)), dtype=np.uint8)
        questions = zip(self.features.T, self.thresholds.T, strict=True)
        for bit, (column, threshold) in enumerate(questions):
            answers = np.take(known, column, axis=0) > threshold[:, None]
            leaf |= answers.view(np.uint8) << np.uint8(bit)
        n_terms, n_leaves = self.log_odds.shape
        first = n_leaves * np.arange(n_terms)
        worth = np.take(self.log_odds, leaf + first[:, None])
        total: FloatArray = worth.sum(axis=0)
        return self.prior + total

    def probability(self, features: FloatArray) -> FloatArray:
        """Probability of cases with the features (n, f), shape (n,)."""
        probability: FloatArray = expit(self.log_odds_of(features))
        return probability

    @classmethod
    def from_terms(
        cls, names: Sequence[str], prior: float, terms: list[dict[str, Any]]
    ) -> Evidence:
        """Build from terms of ``questions`` (feature, threshold) and ``log_odds``.

        Parameters
        ----------
        names
            Of the columns of features.
        """
        column = {name: k for k, name in enumerate(names)}
        questions = [term["questions"] for term in terms]
        return cls(
            features=np.array([[column[q[0]] for q in qs] for qs in questions]),
            thresholds=np.array([[q[1] for q in qs] for qs in questions], np.float32),
            log_odds=np.array([term["log_odds"] for term in terms]),
            prior=prior,
        )

    @classmethod
    def shipped(cls, package: str, file: str, names: Sequence[str]) -> Evidence:
        """Read what lies beside the modules of a package."""
        text = resources.files(package).joinpath(file).read_text("utf-8")
        content = json.loads(text)
        return cls.from_terms(names, content["prior"], content["terms"])
