"""Poses that survive the stages of the search, one row each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray

from .annealing import Walkers
from .postures import Settled

__all__ = ["Candidates", "Modes"]


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Poses that survive a stage of the search, one row each."""

    Ts: FloatArray
    prototype: IntArray
    score: FloatArray
    """Q-hat times the preference."""
    joints: FloatArray
    """See `Postures`."""

    @classmethod
    def of(cls, settled: Settled, prototype: IntArray) -> Candidates:
        """Take the best state of every walker."""
        best = settled.walkers.best_Ts_base_hand
        value = np.exp(settled.walkers.best_log_quality)
        return cls(best, prototype, value, settled.joints)

    def settled(self) -> Settled:
        """Start walkers here."""
        return Settled(Walkers.at(self.Ts, np.log(self.score)), self.joints)

    @classmethod
    def together(cls, parts: Sequence[Candidates]) -> Candidates:
        """Put several sets of poses behind each other."""
        columns = [
            np.concatenate([getattr(part, field.name) for part in parts])
            for field in fields(cls)
        ]
        return cls(*columns)

    def __getitem__(self, keep: BoolArray | IntArray) -> Candidates:
        return Candidates(
            self.Ts[keep], self.prototype[keep], self.score[keep], self.joints[keep]
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Modes:
    """Distinct poses that passed the inspection, best score first, one row each."""

    Ts: FloatArray
    prototype: IntArray
    S: FloatArray
    C: FloatArray
    coverage: FloatArray
    """Share of the prototype's visible surface that was seen."""
    expected: FloatArray
    """Mean of S C over the errors of the pose."""
    contact: FloatArray
    """Probability that both sides press within their friction cones."""
    squeezed: FloatArray
    """Probability that the fingers squeeze what they close on."""
    margin: FloatArray
    """How far the hand may be off before it touches something [m]."""
    unseen: FloatArray
    """Share of palm or fingers of a side in space that was never seen."""
    missing: FloatArray
    """How much of the object may not have been seen [m]."""
    sight: FloatArray
    """How much tells that the object lies between the fingers, and no farther, in
    [0, 1]."""
    score: FloatArray
    """What the list is sorted by."""
    support: IntArray
    """How many walkers ended at each."""
    joints: FloatArray
    """See `Postures`; no column where the arms were not asked."""
    effective_samples: float = 0.0
    """Walkers weighted by what they found; few of many is one lucky find."""

    @classmethod
    def none(cls) -> Modes:
        """No mode at all."""
        empty, index = np.zeros(0), np.zeros(0, dtype=np.int64)
        return cls(
            Ts=np.zeros((0, 4, 4)),
            prototype=index,
            S=empty,
            C=empty,
            coverage=empty,
            expected=empty,
            contact=empty,
            squeezed=empty,
            margin=empty,
            unseen=empty,
            missing=empty,
            sight=empty,
            score=empty,
            support=index,
            joints=np.zeros((0, 0)),
        )

    def __getitem__(self, keep: BoolArray | IntArray) -> Modes:
        columns = {
            field.name: getattr(self, field.name)[keep]
            for field in fields(self)
            if field.name != "effective_samples"
        }
        return replace(self, **columns)
