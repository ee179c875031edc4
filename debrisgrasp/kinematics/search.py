"""One search: descent in single precision, proof and polish in double precision."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, Rng, bounded

from .chain import KinematicChain
from .descent import SINGLE_FLOOR, Descent, Goals
from .formulas import AxisGoals
from .ik_types import IkConfig, IkResult, IkStatus
from .lanes import SeedSource
from .program import LaneKernel
from .reach_map import ReachMap
from .serial import Lanes
from .single import PoseByPose, Posture

__all__ = ["PoseSearch"]

HANDFUL = 12
"""Poses that are brought in sooner one by one than side by side."""
_LAST_FEW = 4
"""As HANDFUL, of those that descents side by side have left over."""
_MOST_AT_ONCE = 30
"""Poses left over of many that are brought in one by one."""
_MIDDLE_ROUNDS = (8, 24)
"""Seeds tried in rounds of descents with the joints between first and last."""
_SHORT = 4.0
"""Length [rad or m] of a last step, in square roots of the weighted tolerance."""
_QUICK_ITERATIONS = 6
"""Iterations with all joints from a posture that is close by."""
_FEW = 50
"""Postures close by that are brought in sooner one by one than side by side."""
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
        self._has_limited_ends = bool(
            ((chain.upper - chain.lower)[[0, -1]] < 2.0 * np.pi - 1e-2).any()
        )
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

    def follow(self, postures: FloatArray, attempts: int) -> None:
        """Go on from postures (targets, d) close by, or from few seeds of the map.

        The latter only where there is no posture, but a row of NaN.
        """
        is_known = ~np.isnan(postures[:, 0])
        known = np.flatnonzero(is_known & ~self.is_far)
        self._go_on(known, postures[known].T, _FEW)
        others = np.flatnonzero(~is_known & ~self.is_far)
        first_rank = np.zeros(len(others), dtype=np.intp)
        seeds = self._middle_seeds(others, first_rank, 1)
        if len(others) <= HANDFUL:
            self._try_one_by_one(others, seeds, attempts)
        else:
            self._improve_middle(others, seeds, attempts)
            near = self._near(others)
            self._go_on(near, self._q[:, near], _FEW)

    def exhaust(self, first_rank: IntArray, step: int = 1) -> None:
        """Try all attempts on what is not solved.

        They take every ``step``th seed from ``first_rank`` (n,) on.
        """
        attempts = self._config.attempts
        if self._chain.has_turning_ends and not self._config.freedom.n_axes:
            attempts -= min(self._descend_middle(first_rank, step), attempts // 2)
        todo = self._open()
        for round_ in range(_ROUNDS):
            if not len(todo):
                break
            rank = first_rank[todo] + round_ * _SEEDS_OF_A_ROUND
            seeds = self._seed_source(self._starts, todo, rank, step)
            if round_ == 0:
                seeds = self._resumed(todo, seeds)
            has_converged = self._improve(todo, seeds, attempts, self._config)
            todo = todo[has_converged & ~self._is_solved[todo]]

    def _descend_middle(self, first_rank: IntArray, step: int) -> int:
        """Solve what needs only the joints between first and last to be found.

        Returns how many seeds were spent on each target.
        """
        n_tried = 0
        # Of seeds side by side the easiest wins, so copies of a target start alone.
        for most in _MIDDLE_ROUNDS if step == 1 else (1, *_MIDDLE_ROUNDS):
            todo, attempts = self._open(), min(most, self._config.attempts - n_tried)
            if len(todo) <= _LAST_FEW or not attempts:
                break
            rank = first_rank[todo] + n_tried * step
            seeds = self._middle_seeds(todo, rank, step)
            self._improve_middle(todo, seeds, attempts)
            self._repair(todo)
            n_tried += attempts
        self._descend_one_by_one(first_rank + n_tried * step, step)
        return n_tried

    def _improve_middle(self, todo: IntArray, seeds: SeedSource, attempts: int) -> None:
        """As `_improve`, with the joints between first and last."""
        enough = self._config.last_step_error
        code = self._formulas.middle_step_of_lanes
        end = Descent(code, self._config, enough, self._is_last_step).run(
            self._axis_goals.rows[:, todo],
            seeds,
            attempts,
            lambda index, q: self._ends_fit(todo[index], q),
        )
        has_come = np.flatnonzero(end.error <= np.float32(enough**2))
        arrived = todo[has_come]
        self._keep(arrived, self._completed(arrived, end.q[:, has_come]))

    def _is_last_step(self, middle: Lanes, step: Lanes) -> BoolArray:
        """Whether such a step (d - 2, n) leaves no more than the tolerance, (n,).

        Long ones, and those that met a limit, leave more than their error tells.
        """
        chain = self._chain
        short = _SHORT * math.sqrt(self._config.weighted_tolerance)
        lower, upper = (
            limits[1:-1, None].astype(np.float32)
            for limits in (chain.lower, chain.upper)
        )
        meets_limit = ((middle <= lower) | (middle >= upper)).any(axis=0)
        length = np.abs(step).max(axis=0)
        return np.asarray(length < np.where(meets_limit, 0.1 * short, short))

    def _near(self, todo: IntArray) -> IntArray:
        """Which of the targets are not solved, but nearly so."""
        is_near = (self._errors[:, todo] < _NEAR).all(axis=0) & ~self._is_solved[todo]
        near: IntArray = todo[is_near]
        return near

    def _ends_fit(self, target: IntArray, middle: Lanes) -> BoolArray:
        """Whether first and last joint, set for the target, keep their limits, (n,)."""
        if not self._has_limited_ends:
            return np.ones(len(target), dtype=bool)
        ends, chain = self._completed(target, middle)[[0, -1]].T, self._chain
        outer = [0, -1]
        away = ends - chain.middle[outer]
        away -= np.round(away / (2.0 * np.pi)) * (2.0 * np.pi)
        half = 0.5 * (chain.upper - chain.lower)[outer]
        return np.asarray((np.abs(away) <= half + _AT_LIMIT).all(axis=1))

    def _repair(self, todo: IntArray) -> None:
        """Go on with all joints where an outer one stood beyond its limit."""
        near = self._near(todo)
        self._go_on(near, self._q[:, near], self._tail)

    def _go_on(self, target: IntArray, q: FloatArray, few: int) -> None:
        """Descend a little from postures (d, n), a few of them one by one."""
        if len(target) > few:
            starts = q.astype(np.float32)
            quick = replace(self._config, max_iterations=_QUICK_ITERATIONS)
            self._improve(target, lambda index, _: starts[:, index], 1, quick)
        elif len(target):
            one = PoseByPose(self._chain, self._config)
            goals = self._goals.rows[:, target].T.tolist()
            for i, goal, start in zip(target, goals, q.T.tolist(), strict=True):
                self._take(i, one.from_posture(goal, start))

    def _take(self, target: int, found: Posture | None) -> None:
        """Take over a posture that solves a target."""
        if found is not None:
            q, *errors = found
            self._q[:, target], self._errors[:, target] = q, errors
            self._is_solved[target] = True

    def _open(self) -> IntArray:
        """Targets neither solved nor out of reach."""
        return np.flatnonzero(~self._is_solved & ~self.is_far)

    def _descend_one_by_one(self, first_rank: IntArray, step: int) -> None:
        todo = self._open()
        if 0 < len(todo) <= _LAST_FEW:
            seeds = self._middle_seeds(todo, first_rank[todo], step)
            n_seeds = min(_ONE_BY_ONE, self._config.attempts)
            self._try_one_by_one(todo, seeds, n_seeds)

    def _try_one_by_one(self, todo: IntArray, seeds: SeedSource, n_seeds: int) -> None:
        if not len(todo):
            return
        one = PoseByPose(self._chain, self._config)
        attempt = np.tile(np.arange(n_seeds), len(todo))
        starts = seeds(np.repeat(np.arange(len(todo)), n_seeds), attempt)
        starts_of = starts.T.reshape(len(todo), n_seeds, -1).tolist()
        goals = self._goals.rows[:, todo].T.tolist()
        for i, goal, starts_of_one in zip(todo, goals, starts_of, strict=True):
            self._take(i, one.from_any(goal, starts_of_one))

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
        within = bounded(chain.wrapped(q.T), chain.lower, chain.upper).T
        errors = self._goals.picked(target).errors(self._formulas, within)
        is_solved = self._is_within_tolerance(errors)
        weights = np.array([1.0, config.rotation_weight])
        before: FloatArray = weights @ np.minimum(self._errors[:, target], 1e9)
        better = np.flatnonzero(is_solved | (weights @ errors < before))
        kept = target[better]
        self._q[:, kept], self._errors[:, kept] = within[:, better], errors[:, better]
        self._is_solved[kept] = is_solved[better]

    def _seed_source(
        self, make: SeedSource, todo: IntArray, first_rank: IntArray, step: int
    ) -> SeedSource:
        """Seeds of the targets ``todo``, from their ``first_rank`` (n,) on."""
        # Those of the first attempt are made beforehand, in one large batch.
        first = make(todo, first_rank)

        def seeds(index: IntArray, attempt: IntArray) -> Lanes:
            out = first[:, index]
            later = np.flatnonzero(attempt)
            if len(later):
                again = index[later]
                rank = first_rank[again] + step * attempt[later]
                out[:, later] = make(todo[again], rank)
            return out

        return seeds

    def _middle_seeds(
        self, todo: IntArray, first_rank: IntArray, step: int
    ) -> SeedSource:
        """As `_seed_source`, for the joints between first and last."""
        reach_map = self._map
        if reach_map is None:
            return lambda index, _: self._random(len(index))[1:-1]
        ranked = reach_map.ranked_seeds(self._axis_goals.picked(todo))

        def seeds(index: IntArray, attempt: IntArray) -> Lanes:
            rank = first_rank[index] + step * attempt
            known = np.flatnonzero(rank < ranked.shape[1])
            if len(known) == len(rank):
                return reach_map.middles_at(ranked[index, rank])
            out = self._random(len(index))[1:-1]
            out[:, known] = reach_map.middles_at(ranked[index[known], rank[known]])
            return out

        return seeds

    def _random(self, n: int) -> Lanes:
        return self._chain.sampled(n, rng=self._rng).T.astype(np.float32)

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
        random = self._random(len(target))
        if self._map is None:
            return random
        known = np.flatnonzero(rank < self._map.config.n_seeds)
        if len(known):
            goals = self._goals.picked(target[known])
            random[:, known] = self._map.starts(self._chain, goals, rank[known])
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
