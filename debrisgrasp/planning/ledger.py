"""Which poses were ruled out, and why: what a plan says when it says no."""

from __future__ import annotations

from dataclasses import dataclass, field
from difflib import get_close_matches

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray
from debrisgrasp._words import counted
from debrisgrasp.errors import UnknownNameError

__all__ = ["Ledger", "Rejections"]

_NEARLY = 0.85
"""So like each other are words of which one is misspelt."""


@dataclass(frozen=True, slots=True, eq=False)
class Rejections:
    """Poses that were ruled out, one row each."""

    reasons: tuple[str, ...] = ()
    """Those that ruled out poses, then those that were looked for and did not."""
    code: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """Which of them ruled a pose out, shape (n,)."""
    Ts: FloatArray = field(default_factory=lambda: np.zeros((0, 4, 4)))
    """Palm poses, base frame, shape (n, 4, 4)."""
    prototype: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """Index of the prototype of each, shape (n,)."""
    amount: FloatArray = field(default_factory=lambda: np.zeros(0))
    """By how much: points in the way or between the fingers, S C reached, or load over
    limit; NaN where the reason knows no amount; shape (n,)."""

    def __repr__(self) -> str:
        told = ", ".join(f"{reason} ({n})" for reason, n in self.counts().items())
        return f"<Rejections of {counted(len(self), 'pose')}: {told or 'none'}>"

    def __len__(self) -> int:
        return len(self.code)

    def counts(self) -> dict[str, int]:
        """How many poses each reason ruled out."""
        found = np.bincount(self.code, minlength=len(self.reasons))
        return {
            reason: int(n)
            for reason, n in zip(self.reasons, found, strict=True)
            if n > 0
        }

    def because(self, *words: str) -> IntArray:
        """Rows, shape (m,), whose reason contains any of some words.

        Raises
        ------
        UnknownNameError
            If one of them is nearly a part of a reason: then it is misspelt.
        """
        for word in words:
            if meant := self._nearly(word):
                mend = f"Did you mean {meant[0]!r}?"
                raise UnknownNameError("reason", word, self.reasons, mend=mend)
        return self.rows_with(*words)

    def rows_with(self, *words: str) -> IntArray:
        """Find the same rows (m,) for words that are known to be right."""
        codes = [
            i
            for i, reason in enumerate(self.reasons)
            if any(word in reason for word in words)
        ]
        rows: IntArray = np.flatnonzero(np.isin(self.code, codes))
        return rows

    def _nearly(self, word: str) -> list[str]:
        """Part of a reason that is nearly a word which no reason has, or nothing.

        Arms give reasons of their own: what is like none may be another of theirs.
        """
        if any(word in reason for reason in self.reasons):
            return []
        # Before a colon stands the name of an arm, which may be like another's.
        told = [reason.rpartition(": ")[2].split() for reason in self.reasons]
        n = len(word.split())
        parts = [" ".join(t[i : i + n]) for t in told for i in range(len(t) - n + 1)]
        return get_close_matches(word, parts, n=1, cutoff=_NEARLY)


class Ledger:
    """Takes note of the poses that a search rules out."""

    def __init__(self) -> None:
        self._entries: list[tuple[str, FloatArray, IntArray, FloatArray]] = []

    def add(
        self,
        reason: str,
        Ts: FloatArray,
        prototype: IntArray,
        rejected: BoolArray | IntArray,
        amount: FloatArray | IntArray | None = None,
    ) -> None:
        """Note the rejected ones of some poses (k, 4, 4) of prototypes (k,).

        Parameters
        ----------
        amount
            By how much each of them fails, shape (k,); None if that is no number.
        """
        Ts, prototype = Ts[rejected], prototype[rejected]
        by = np.full(len(Ts), np.nan)
        if amount is not None:
            by = np.asarray(amount, dtype=np.float64)[rejected]
        self._entries.append((reason, Ts, prototype, by))

    def closed(self) -> Rejections:
        """Everything noted so far."""
        if not self._entries:
            return Rejections()
        names, Ts, prototype, amount = zip(*self._entries, strict=True)
        given = [name for name, T in zip(names, Ts, strict=True) if len(T)]
        reasons = tuple(dict.fromkeys((*given, *names)))
        return Rejections(
            reasons,
            np.repeat([reasons.index(n) for n in names], [len(T) for T in Ts]),
            np.concatenate(Ts),
            np.concatenate(prototype),
            np.concatenate(amount),
        )
