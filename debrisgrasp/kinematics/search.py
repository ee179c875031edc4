"""One search: descent in single precision, proof and polish in double precision."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, Rng

from .chain import KinematicChain
from .descent import Descent, Goals
from .ik_types import IkConfig, IkResult, IkStatus
from .lanes import SeedSource
from .reach_map import ReachMap
from .serial import Lanes

__all__ = ["PoseSearch"]

_ROUNDS = 3
"""Searches made; later ones serve what converged but failed its proof."""
_SEEDS_OF_A_ROUND = 1000
"""More than a map holds, so that later rounds start from random seeds."""
_SINGLE_FLOOR = 2e-5
"""Weighted error [m] that single precision reaches for certain."""
_POLISH_STEPS = 8
"""Most Newton steps in double precision for what missed the tolerance narrowly."""


class PoseSearch:
    """Targets of one call, and the best posture of each so far."""

    def __init__(
        self,
        chain: KinematicChain,
        config: IkConfig,
        targets: FloatArray,
        reach_map: ReachMap | None,
        rng: Rng,
    ) -> None:
        n = len(targets)
        self._chain, self._config, self._map, self._rng = chain, config, reach_map, rng
        self._goals = Goals.from_matrices(chain.form, targets)
        self._single = Goals(self._goals.columns.astype(np.float32))
        self._q = np.zeros((chain.n_joints, n))
        self._errors = np.full((2, n), np.inf)
        self._reason: IntArray = np.full(n, int(IkStatus.BUDGET))
        self._is_solved = np.zeros(n, dtype=bool)
        distance = np.linalg.norm(self._goals.columns[3], axis=0)
        self.is_far: BoolArray = distance > chain.reach + config.position_tolerance
        if reach_map is not None:
            reach_map.require_chain(chain)
            self.is_far |= ~reach_map.may_reach(self._goals)
        turns_freely = np.where(chain.is_cyclic, np.inf, 0.0)
        self._descent = Descent(
            form=chain.single_form,
            lower=chain.lower - turns_freely,
            upper=chain.upper + turns_freely,
            rotation_weight=config.rotation_weight,
            damping=config.damping,
            max_iterations=config.max_iterations,
            width=config.width,
            # Position and rotation errors add up at the tip, so each takes a part.
            tolerance=max(
                _SINGLE_FLOOR,
                min(
                    0.3 * config.position_tolerance,
                    0.3 * config.rotation_tolerance * config.rotation_weight,
                ),
            ),
        )
        self._polish = replace(
            self._descent, form=chain.form, lower=chain.lower, upper=chain.upper
        )

    def exhaust(self, first_rank: IntArray) -> None:
        """Try all attempts on what is not solved; ``first_rank`` seeds are skipped."""
        todo = np.flatnonzero(~self._is_solved & ~self.is_far)
        for round_ in range(_ROUNDS):
            if not len(todo):
                break
            rank = first_rank[todo] + round_ * _SEEDS_OF_A_ROUND
            seeds = self._seed_source(todo, rank)
            has_converged = self.improve(todo, seeds, self._config.attempts)
            todo = todo[has_converged & ~self._is_solved[todo]]

    def _seed_source(self, todo: IntArray, first_rank: IntArray) -> SeedSource:
        """Seeds of the targets ``todo``, which start from their ``first_rank`` (n,)."""
        # Those of the first attempt are made beforehand, in large batches.
        width = self._config.width
        batches = [
            self._seeds(todo[start : start + width], first_rank[start : start + width])
            for start in range(0, len(todo), width)
        ]
        first = np.concatenate(batches, axis=1)

        def seeds(index: IntArray, attempt: IntArray) -> Lanes:
            out = first[:, index]
            later = np.flatnonzero(attempt)
            if len(later):
                again = index[later]
                rank = first_rank[again] + attempt[later]
                out[:, later] = self._seeds(todo[again], rank)
            return out

        return seeds

    def _seeds(self, target: IntArray, rank: IntArray) -> Lanes:
        """Seeds of the map while it has any, then random ones; (d, n)."""
        if self._map is None or rank.min() >= self._map.config.n_seeds:
            return self._chain.sampled(len(target), rng=self._rng).T.astype(np.float32)
        goals = Goals(self._single.columns[:, :, target])
        seeds = self._map.starts(self._chain, goals, rank)
        beyond = np.flatnonzero(rank >= self._map.config.n_seeds)
        seeds[:, beyond] = self._chain.sampled(len(beyond), rng=self._rng).T
        return seeds

    def improve(self, target: IntArray, seeds: SeedSource, attempts: int) -> BoolArray:
        """Work on some targets, keep what is better; return which have converged.

        ``seeds`` counts the targets as they come in ``target``.
        """
        config, picked = self._config, Goals(self._goals.columns[:, :, target])
        single = Goals(self._single.columns[:, :, target])
        end = self._descent.run(single, seeds, attempts)
        q = self._chain.clipped(end.q.T.astype(np.float64)).T
        errors = picked.errors(self._chain.form, q)
        rough = np.flatnonzero(end.is_converged & ~self._is_within_tolerance(errors))
        for _ in range(_POLISH_STEPS):
            if not len(rough):
                break
            goals = Goals(picked.columns[:, :, rough])
            q[:, rough] = self._polish.refined(q[:, rough], goals)
            errors[:, rough] = goals.errors(self._chain.form, q[:, rough])
            rough = rough[~self._is_within_tolerance(errors[:, rough])]
        is_solved = self._is_within_tolerance(errors)
        reason = np.where(
            end.is_at_limit,
            IkStatus.LIMIT,
            np.where(end.has_stalled, IkStatus.STALLED, IkStatus.BUDGET),
        )
        weights = np.array([1.0, config.rotation_weight])
        before = weights @ np.minimum(self._errors[:, target], 1e9)
        better = np.flatnonzero(is_solved | (weights @ errors < before))
        kept = target[better]
        self._q[:, kept], self._errors[:, kept] = q[:, better], errors[:, better]
        self._reason[kept], self._is_solved[kept] = reason[better], is_solved[better]
        return end.is_converged

    def _is_within_tolerance(self, errors: FloatArray) -> BoolArray:
        config = self._config
        tolerance = np.array([config.position_tolerance, config.rotation_tolerance])
        return np.asarray((errors <= tolerance[:, None]).all(axis=0))

    def result(self, batch: tuple[int, ...]) -> IkResult:
        """Collect what was found, with the batch shape of the poses."""
        status = np.where(self._is_solved, IkStatus.SOLVED, self._reason)
        status[self.is_far & ~self._is_solved] = IkStatus.UNREACHABLE
        untried = ~np.isfinite(self._errors[0])
        q = self._q
        if untried.any():
            q = q.copy()
            q[:, untried] = self._chain.clipped(np.zeros(len(q)))[:, None]
            picked = Goals(self._goals.columns[:, :, untried])
            self._errors[:, untried] = picked.errors(self._chain.form, q[:, untried])
        return IkResult(
            q=np.ascontiguousarray(q.T).reshape(*batch, self._chain.n_joints),
            status=status.reshape(batch),
            position_error=self._errors[0].reshape(batch),
            rotation_error=self._errors[1].reshape(batch),
        )
