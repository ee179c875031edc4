"""Which target runs in which lane of a descent, and who takes the lane after it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from debrisgrasp._arrays import BoolArray, IntArray

from .serial import Lanes

__all__ = ["LanePool", "SeedSource"]

SeedSource = Callable[[IntArray, IntArray], Lanes]
"""Maps targets (n,) and which attempt each makes (n,) to seeds (d, n) [rad or m]."""

_FEW_LANES = 1024
"""Below this number of lanes the overhead of array calls sets the time, so that further
seeds of the same targets cost almost nothing."""


class _Queue:
    """Hands out targets with their attempts: all once, then the unsolved again."""

    def __init__(self, n_targets: int, attempts: int) -> None:
        self._attempts, self._attempt = attempts, 0
        self._pending: IntArray = np.arange(n_targets)

    def take(self, n: int, is_solved: BoolArray) -> tuple[IntArray, IntArray]:
        """Up to ``n`` targets still unsolved, and which attempt each makes."""
        if self._attempt:
            self._pending = self._pending[~is_solved[self._pending]]
        targets, attempts = [self._pending[:0]], [self._pending[:0]]
        while n > 0 and self._attempt < self._attempts:
            chunk, self._pending = self._pending[:n], self._pending[n:]
            targets.append(chunk)
            attempts.append(np.full(len(chunk), self._attempt))
            n -= len(chunk)
            if not len(self._pending):
                self._attempt += 1
                self._pending = np.flatnonzero(~is_solved)
                if not len(self._pending):
                    break
        return np.concatenate(targets), np.concatenate(attempts)


class LanePool:
    """The lanes that run, each with its target, posture and age.

    Parameters
    ----------
    goals
        Goals, any shape (..., targets).
    seeds
        Where an attempt starts.
    attempts
        Lanes that a target may have, one after the other or side by side.
    width
        Most lanes that run at once.
    """

    def __init__(
        self, goals: Lanes, seeds: SeedSource, attempts: int, width: int
    ) -> None:
        n_targets = goals.shape[-1]
        self._goals, self._seeds, self._attempts = goals, seeds, attempts
        self._queue = _Queue(n_targets, attempts)
        n_lanes = min(width, max(n_targets, min(attempts * n_targets, _FEW_LANES)))
        none_solved = np.zeros(n_targets, dtype=bool)
        self.target, attempt = self._queue.take(n_lanes, none_solved)
        """Target of each lane, shape (lanes,)."""
        self.q = seeds(self.target, attempt)
        """Posture of each lane, shape (d, lanes)."""
        self.goal = goals[..., self.target]
        """Goal of each lane, shape (..., lanes)."""
        self.age: IntArray = np.zeros(len(self.target), dtype=np.intp)
        """Iterations each lane has made, shape (lanes,)."""
        self._reference = np.full(len(self.target), np.inf, dtype=goals.dtype)

    @property
    def n_lanes(self) -> int:
        """Number of lanes that run."""
        return len(self.target)

    def has_stalled(self, error: Lanes, ratio: float, interval: int) -> BoolArray:
        """Lanes whose error is above ``ratio`` times what it was a while ago."""
        is_due = self.age % interval == 0
        is_slow: BoolArray = is_due & (error > ratio * self._reference)
        self._reference = np.where(is_due, error, self._reference)
        return is_slow

    def advance(self, q: Lanes) -> None:
        """Take the postures after one more iteration."""
        self.q = q
        self.age += 1

    def refill(self, is_free: BoolArray, is_solved: BoolArray) -> None:
        """Give free lanes to waiting targets, and close those that nobody needs."""
        free = np.flatnonzero(is_free)
        n_busy = self.n_lanes - len(free)
        # A few seeds of a target side by side are welcome, dozens are waste.
        n_unsolved = len(is_solved) - int(np.count_nonzero(is_solved))
        n_useful = max(n_unsolved, min(self._attempts * n_unsolved, _FEW_LANES))
        fresh, attempt = self._queue.take(min(len(free), n_useful - n_busy), is_solved)
        slots = free[: len(fresh)]
        if len(fresh):
            self.target[slots] = fresh
            self.q[:, slots] = self._seeds(fresh, attempt)
            self.goal[..., slots] = self._goals[..., fresh]
            self.age[slots], self._reference[slots] = 0, np.inf
        if len(slots) < len(free):
            is_kept = np.ones(self.n_lanes, dtype=bool)
            is_kept[free[len(slots) :]] = False
            kept = np.flatnonzero(is_kept)
            self.target, self.q = self.target[kept], self.q[:, kept]
            self.goal, self.age = self.goal[..., kept], self.age[kept]
            self._reference = self._reference[kept]
