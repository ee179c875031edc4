"""One search: descent in single precision, proof and polish in double precision."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, Rng

from .chain import KinematicChain
from .descent import SINGLE_FLOOR, Descent, Goals
from .formulas import AxisGoals
from .ik_types import IkConfig, IkResult, IkStatus
from .lanes import SeedSource
from .program import LaneKernel
from .reach_map import ReachMap
from .serial import Lanes
from .single import PoseByPose

__all__ = ["PoseSearch"]

HANDFUL = 12
"""Poses that are brought in sooner one by one than side by side."""
_MOST_AT_ONCE = 30
"""Poses left over of many that are brought in one by one."""
_MIDDLE_ROUNDS = (1, 3)
"""Seeds tried in rounds of descents with the joints between first and last."""
_REPAIR_ITERATIONS = 6
"""Iterations with all joints from a posture whose outer joints exceed their limits."""
_ONE_BY_ONE = 8
"""Seeds tried for the last poses, before all attempts are spent on lanes."""
_ROUNDS = 3
"""Searches made; later ones serve what converged but failed its proof."""
_SEEDS_OF_A_ROUND = 1000
"""More than a map holds, so that later rounds start from random seeds."""
_NEAR = 1.0
"""Distance [m] and angle [rad] from which a posture is worth going on from."""
_AT_LIMIT = 1e-5
"""Distance [rad or m] from a limit at which a joint counts as standing there."""
_POLISH_STEPS = 4
"""Steps in double precision for what missed the tolerance narrowly."""


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
        self._formulas = chain.formulas(config.freedom)
        self._goals = Goals.from_matrices(chain.form, targets)
        self._q = np.zeros((chain.n_joints, n))
        self._errors = np.full((2, n), np.inf)
        self._reason: IntArray = np.full(n, int(IkStatus.BUDGET))
        self._is_solved = np.zeros(n, dtype=bool)
        self._tail = max(HANDFUL, min(_MOST_AT_ONCE, n // 8))
        distance = np.sqrt((self._goals.columns[3] ** 2).sum(axis=0))
        reach = chain.reach + config.position_tolerance
        if config.freedom.n_axes:
            # The last joint may be anywhere around the tip.
            reach += 2.0 * float(np.linalg.norm(chain.form.T_last_tip[:3, 3]))
        self.is_far: BoolArray = distance > reach
        if reach_map is not None:
            reach_map.require_chain(chain)
            if not config.freedom.n_axes:
                self.is_far |= ~reach_map.admits(self._axis_goals)

    @cached_property
    def _axis_goals(self) -> AxisGoals:
        return AxisGoals.from_columns(self._goals.columns)

    def try_from(self, postures: FloatArray) -> None:
        """Descend from one posture for each target, shape (targets, d)."""
        starts = postures.T.astype(np.float32)
        todo = self._open()
        self._improve(todo, lambda index, _: starts[:, todo[index]], 1, self._config)

    def exhaust(self, first_rank: IntArray) -> None:
        """Try all attempts on what is not solved; ``first_rank`` seeds are skipped."""
        if self._chain.has_turning_ends and not self._config.freedom.n_axes:
            self._descend_middle(first_rank)
        todo = self._open()
        for round_ in range(_ROUNDS):
            if not len(todo):
                break
            rank = first_rank[todo] + round_ * _SEEDS_OF_A_ROUND
            seeds = self._seed_source(self._starts, todo, rank)
            if round_ == 0:
                seeds = self._resumed(todo, seeds)
            has_converged = self._improve(
                todo, seeds, self._config.attempts, self._config
            )
            todo = todo[has_converged & ~self._is_solved[todo]]

    def _descend_middle(self, first_rank: IntArray) -> None:
        """Solve what needs only the joints between first and last to be found."""
        config, formulas = self._config, self._formulas
        middle = Descent(formulas.middle_step_of_lanes, config, config.last_step_error)
        rank, n_left_to_try = first_rank, config.attempts
        for most in _MIDDLE_ROUNDS:
            todo, attempts = self._open(), min(most, n_left_to_try)
            if len(todo) <= self._tail or not attempts:
                break
            n_left_to_try -= attempts
            seeds = self._seed_source(self._middles, todo, rank[todo])
            n_left = max(self._tail // 2, len(todo) // 50)
            end = middle.run(self._axis_goals.rows[:, todo], seeds, attempts, n_left)
            rank = rank + attempts
            has_come = np.flatnonzero(end.has_converged)
            arrived = todo[has_come]
            self._keep(arrived, self._completed(arrived, end.q[:, has_come]))
            self._repair(todo)
        self._descend_one_by_one(first_rank)

    def _repair(self, todo: IntArray) -> None:
        """Go on with all joints where an outer one stood beyond its limit."""
        is_near = (self._errors[:, todo] < _NEAR).all(axis=0) & ~self._is_solved[todo]
        near = todo[is_near]
        if len(near) > self._tail:
            reached = self._q[:, near].astype(np.float32)
            quick = replace(self._config, max_iterations=_REPAIR_ITERATIONS)
            self._improve(near, lambda index, _: reached[:, index], 1, quick)

    def _open(self) -> IntArray:
        """Targets neither solved nor out of reach."""
        return np.flatnonzero(~self._is_solved & ~self.is_far)

    def _descend_one_by_one(self, first_rank: IntArray) -> None:
        todo = self._open()
        if not 0 < len(todo) <= self._tail:
            return
        one = PoseByPose(self._chain, self._config)
        n_seeds = min(_ONE_BY_ONE, self._config.attempts)
        ranks = first_rank[todo, None] + np.arange(n_seeds)
        starts = self._middles(np.repeat(todo, n_seeds), ranks.ravel())
        starts_of = starts.T.reshape(len(todo), n_seeds, -1).tolist()
        goals = self._goals.rows[:, todo].T.tolist()
        for i, goal, starts_of_one in zip(todo, goals, starts_of, strict=True):
            found = None
            if (self._errors[:, i] < _NEAR).all():
                found = one.from_posture(goal, self._q[:, i].tolist())
            if found is None:
                found = one.from_any(goal, starts_of_one)
            if found is not None:
                q, *errors = found
                self._q[:, i], self._errors[:, i] = q, errors
                self._is_solved[i] = True

    def _completed(self, target: IntArray, middle: Lanes) -> FloatArray:
        """Postures (d, n) from values of the joints between first and last."""
        goal = self._goals.rows[:, target].astype(np.float32)
        ends = LaneKernel(self._formulas.ends_of_lanes, np.float32)
        first_sine, first_cosine, sine, cosine = ends(*middle, *goal)
        first = np.arctan2(first_sine, first_cosine)
        last = np.arctan2(sine, cosine) - self._chain.form.offsets[-1]
        return np.concatenate([first[None], middle, last[None]])

    def _keep(self, target: IntArray, q: Lanes) -> None:
        """Bring postures (d, n) within the limits, and take over what is better."""
        chain, config = self._chain, self._config
        within = chain.clipped(chain.wrapped(q.T)).T
        errors = self._goals.picked(target).errors(self._formulas, within)
        is_solved = self._is_within_tolerance(errors)
        weights = np.array([1.0, config.rotation_weight])
        before: FloatArray = weights @ np.minimum(self._errors[:, target], 1e9)
        better = np.flatnonzero(is_solved | (weights @ errors < before))
        kept = target[better]
        self._q[:, kept], self._errors[:, kept] = within[:, better], errors[:, better]
        self._is_solved[kept] = is_solved[better]

    def _seed_source(
        self, make: SeedSource, todo: IntArray, first_rank: IntArray
    ) -> SeedSource:
        """Seeds of the targets ``todo``, which start from their ``first_rank`` (n,)."""
        # Those of the first attempt are made beforehand, in one large batch.
        first = make(todo, first_rank)

        def seeds(index: IntArray, attempt: IntArray) -> Lanes:
            out = first[:, index]
            later = np.flatnonzero(attempt)
            if len(later):
                again = index[later]
                out[:, later] = make(todo[again], first_rank[again] + attempt[later])
            return out

        return seeds

    def _resumed(self, todo: IntArray, seeds: SeedSource) -> SeedSource:
        """Seeds that go on first from where a target nearly came in."""
        is_near: BoolArray = np.asarray((self._errors[:, todo] < _NEAR).all(axis=0))
        reached = self._q[:, todo]

        def resumed(index: IntArray, attempt: IntArray) -> Lanes:
            out = seeds(index, attempt)
            again = np.flatnonzero((attempt == 0) & is_near[index])
            out[:, again] = reached[:, index[again]]
            return out

        return resumed

    def _starts(self, target: IntArray, rank: IntArray) -> Lanes:
        """Seeds of the map while it has any, then random ones; (d, n)."""
        random = self._chain.sampled(len(target), rng=self._rng).T.astype(np.float32)
        if self._map is None:
            return random
        known = np.flatnonzero(rank < self._map.config.n_seeds)
        if len(known):
            goals = self._goals.picked(target[known])
            random[:, known] = self._map.starts(self._chain, goals, rank[known])
        return random

    def _middles(self, target: IntArray, rank: IntArray) -> Lanes:
        """As `_starts`, of the joints between first and last; (d - 2, n)."""
        if self._map is not None and rank.max(initial=0) < self._map.config.n_seeds:
            return self._map.middles(self._axis_goals.picked(target), rank)
        random = self._chain.sampled(len(target), rng=self._rng).T.astype(np.float32)
        random = random[1:-1]
        if self._map is not None:
            known = np.flatnonzero(rank < self._map.config.n_seeds)
            goals = self._axis_goals.picked(target[known])
            random[:, known] = self._map.middles(goals, rank[known])
        return random

    def _improve(
        self,
        target: IntArray,
        seeds: SeedSource,
        attempts: int,
        config: IkConfig,
    ) -> BoolArray:
        """Work on some targets, keep what is better; return which have converged.

        ``seeds`` counts the targets as they come in ``target``.
        """
        goals = self._goals.rows[:, target]
        enough = max(SINGLE_FLOOR, config.weighted_tolerance)
        descent = Descent(self._formulas.step_of_lanes, config, enough)
        end = descent.run(goals, seeds, attempts)
        self._keep(target, end.q)
        self._polish(target[end.has_converged & ~self._is_solved[target]])
        q = self._q[:, target].T
        lower, upper = self._chain.lower + _AT_LIMIT, self._chain.upper - _AT_LIMIT
        at_limit = ((q <= lower) | (q >= upper)).any(axis=1)
        self._reason[target] = np.where(
            at_limit,
            IkStatus.LIMIT,
            np.where(end.has_stalled, IkStatus.STALLED, IkStatus.BUDGET),
        )
        return end.has_converged

    def _polish(self, rough: IntArray) -> None:
        """Bring in, in double precision, what missed the tolerance narrowly."""
        if not len(rough):
            return
        config = self._config
        step = LaneKernel(self._formulas.exact_step_of_lanes, np.float64)
        weights = [
            np.array(value) for value in (config.rotation_weight, config.damping)
        ]
        q = self._q[:, rough]
        goals = self._goals.rows[:, rough]
        for _ in range(_POLISH_STEPS):
            q = step(*q, *goals, *weights)[1:].copy()
        self._keep(rough, q)

    def _is_within_tolerance(self, errors: FloatArray) -> BoolArray:
        config = self._config
        tolerance = np.array([config.position_tolerance, config.rotation_tolerance])
        return np.asarray((errors <= tolerance[:, None]).all(axis=0))

    def result(self) -> IkResult:
        """Collect what was found, one row for each pose."""
        status = np.where(self._is_solved, IkStatus.SOLVED, self._reason)
        status[self.is_far & ~self._is_solved] = IkStatus.UNREACHABLE
        q = self._q
        untried = np.flatnonzero(~np.isfinite(self._errors[0]))
        if len(untried):
            self._q[:, untried] = self._chain.clipped(np.zeros(len(q)))[:, None]
            goals = self._goals.picked(untried)
            self._errors[:, untried] = goals.errors(self._formulas, q[:, untried])
        return IkResult(
            q=np.ascontiguousarray(q.T),
            status=status,
            position_error=self._errors[0],
            rotation_error=self._errors[1],
        )
