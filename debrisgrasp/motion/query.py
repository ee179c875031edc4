"""One motion that is sought: path, shortcuts, time, and the final check."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, Rng, require_range
from debrisgrasp._stopwatch import Stopwatch
from debrisgrasp.kinematics import LimitSet, Trajectory

from .config import MotionConfig
from .edges import EdgeTest, FreeTest, sampled_edges
from .exact import Contact, ExactArm, ExactTest
from .result import MotionCounts, MotionPlan, MotionStatus
from .rrt import PathQuery
from .shorten import shortened
from .space import MotionSpace
from .spheres import ArmSpheres, SphereTest
from .timing import timed

__all__ = ["MotionQuery", "samples_of"]

_ESCAPES = 64
"""Postures tried around one that spheres wrongly see in contact."""
_ESCAPE_SPREAD = 0.25
"""How far they spread [rad or m]."""


@dataclass(eq=False)
class MotionQuery:
    """One motion that is sought."""

    spheres_of_arm: ArmSpheres
    discerned: Callable[[], ArmSpheres]
    """Without the pairs of parts that spheres can't tell apart."""
    solids_of_arm: ExactArm
    limits: LimitSet
    config: MotionConfig
    space: MotionSpace
    start: FloatArray
    """Posture now, shape (d,)."""
    rng: Rng
    watch: Stopwatch
    known: FloatArray | None = None
    """Postures of a way that the arm has gone, shape (k, d)."""
    counts: MotionCounts = MotionCounts()

    @cached_property
    def exact(self) -> ExactTest:
        """By the links' solids."""
        return ExactTest(
            arm=self.solids_of_arm,
            space=self.space,
            margin=self.config.margin,
            self_margin=self.config.self_margin,
        )

    @cached_property
    def roomy(self) -> SphereTest:
        """For the search, with something to spare."""
        return replace(
            self.strict,
            margin=self.config.margin + self.config.spare,
            self_margin=self.config.self_margin + self.config.spare,
            is_strict=False,
        )

    @cached_property
    def strict(self) -> SphereTest:
        """For the final check."""
        return SphereTest(
            arm=self.spheres_of_arm,
            space=self.space,
            margin=self.config.margin,
            self_margin=self.config.self_margin,
            is_strict=True,
        )

    def _counted(self, test: SphereTest) -> FreeTest:
        def is_free(q: FloatArray) -> BoolArray:
            self._count(postures=len(q))
            return test(q)

        return is_free

    def is_free(self, q: FloatArray) -> BoolArray:
        """By spheres where these are sure, else by the solids."""
        self._count(postures=len(q))
        found = self.strict(q)
        unsure = np.flatnonzero(~found)
        self._count(exact=len(unsure))
        found[unsure] = self.exact.is_free(q[unsure])
        return found

    def _count(self, **more: int) -> None:
        now = {name: getattr(self.counts, name) + n for name, n in more.items()}
        self.counts = replace(self.counts, **now)

    def failed(
        self, status: MotionStatus, reason: str, contacts: tuple[Contact, ...] = ()
    ) -> MotionPlan:
        """Say why there is no motion."""
        return MotionPlan(
            status=status,
            reason=f"{status.value}: {reason}",
            trajectory=None,
            path=None,
            contacts=contacts,
            counts=self.counts,
        )

    def at_start(self) -> tuple[Contact, ...]:
        """Tell what touches where the arm stands."""
        if self.is_free(self.start[None])[0]:
            return ()
        return self.exact.contacts(self.start)

    def solved(self, goals: FloatArray) -> MotionPlan:
        """Find a way to one of the goals (g, d), time it, and check it."""
        self._count(goals=len(goals))
        is_free = self.is_free(goals)
        self._count(free_goals=int(is_free.sum()))
        if not is_free.any():
            contacts = min(map(self.exact.contacts, goals), key=len)
            reason = f"in the best of {len(goals)} postures "
            reason += "; ".join(map(str, contacts))
            return self.failed(MotionStatus.GOAL_IN_COLLISION, reason, contacts)
        # What leaves no room to spare is then looked at more closely.
        tests = self.roomy, self.strict
        found = self._tried(goals[is_free], tests)
        if found is None and not self.counts.rounds and not self.watch.is_late():
            # By spheres the arm touches itself where it stands, and all around.
            spheres = self.discerned()
            roomy, strict = (replace(test, arm=spheres) for test in tests)
            found = self._tried(goals[is_free], (roomy, strict))
        if found is not None:
            return found
        late = ", the deadline passed" if self.watch.is_late() else ""
        counts = self.counts
        words = f"{counts.rounds} rounds, {counts.nodes} nodes, "
        if not counts.rounds and not late:
            words = "no search began: start, goals or straight way keep no distance; "
        words += f"{counts.postures} postures tested{late}"
        return self.failed(MotionStatus.BUDGET, words)

    def _tried(
        self, goals: FloatArray, tests: tuple[SphereTest, SphereTest]
    ) -> MotionPlan | None:
        """Find a way to one of the goals (g, d), by one test, then by the other."""
        step = self.config.step
        for attempt in range(self.config.attempts):
            edges = EdgeTest(self._counted(tests[min(attempt, 1)]), step)
            step = max(0.5 * step, self.config.exact_step)
            with self.watch.stage("path"):
                path = self._path(goals, edges)
            if path is None:
                if self._rounds_left() <= 0 or self.watch.is_late():
                    break
                continue
            with self.watch.stage("time"):
                trajectory = self._timed(path)
            if trajectory is not None:
                return MotionPlan(
                    status=MotionStatus.SOLVED,
                    reason="",
                    trajectory=trajectory,
                    path=path,
                    counts=self.counts,
                )
        return None

    def _path(self, goals: FloatArray, edges: EdgeTest) -> FloatArray | None:
        """Corners from the start to a goal, shortened."""
        head, start = self._clear_of(self.start[None], edges)
        tails, ends = self._clear_of(goals, edges)
        if not len(start) or not len(ends):
            return None
        direct = edges.are_free(np.repeat(start[:1], len(ends), axis=0), ends)
        if direct.any():
            path = np.stack([start[0], ends[int(direct.argmax())]])
        else:
            search = self._searched(start[0], ends, edges)
            if search is None:
                return None
            path = search
        goal = tails[int(np.abs(ends - path[-1]).max(axis=1).argmin())]
        path = np.concatenate([head[:1], path, goal[None]])
        moved = np.abs(np.diff(path, axis=0)).max(axis=1) > 1e-9
        path = path[np.concatenate([[True], moved])]
        return shortened(
            path,
            self.limits.velocity,
            edges,
            rounds=self.config.shortcut_rounds,
            rng=self.rng,
            is_late=self.watch.is_late,
        )

    def _searched(
        self, start: FloatArray, goals: FloatArray, edges: EdgeTest
    ) -> FloatArray | None:
        limits = self.limits
        ends = np.vstack([start, goals])
        least, most = ends.min(axis=0) - np.pi, ends.max(axis=0) + np.pi
        lower = np.where(np.isfinite(limits.lower), limits.lower, least)
        upper = np.where(np.isfinite(limits.upper), limits.upper, most)
        query = PathQuery(
            q_start=start,
            q_goals=goals,
            lower=lower,
            upper=upper,
            edges=edges,
            max_rounds=self._rounds_left(),
            is_late=self.watch.is_late,
            known=self.known,
        )
        search = self.config.engine(query, rng=self.rng)
        self._count(rounds=search.n_rounds, nodes=search.n_nodes)
        return search.path

    def _rounds_left(self) -> int:
        return self.config.max_rounds - self.counts.rounds

    def _clear_of(
        self, q: FloatArray, edges: EdgeTest
    ) -> tuple[FloatArray, FloatArray]:
        """Postures (n, d) that are free, and of each a clear one nearby.

        Where spheres see contact though the solids have none, the arm first backs off
        by a short edge that the solids keep free.
        """
        clear = edges.is_free(q)
        near = q.copy()
        if clear.any():
            return q[clear], near[clear]
        limits, shape = self.limits, (_ESCAPES, q.shape[1])
        for i in range(len(q)):
            size = _ESCAPE_SPREAD * np.sqrt(self.rng.random((_ESCAPES, 1)))
            aside = q[i] + size * self.rng.normal(size=shape)
            aside = np.clip(aside, limits.lower, limits.upper)
            aside = aside[edges.is_free(aside)]
            aside = aside[np.argsort(np.abs(aside - q[i]).max(axis=1))]
            for other in aside[:6]:
                if self._edge_is_free(q[i], other):
                    return q[i : i + 1], other[None]
        return q[:0], near[:0]

    def _edge_is_free(self, q_from: FloatArray, q_to: FloatArray) -> bool:
        _, share, _ = sampled_edges(q_from[None], q_to[None], self.config.exact_step)
        return bool(self.is_free(q_from + share[:, None] * (q_to - q_from)).all())

    def _timed(self, path: FloatArray) -> Trajectory | None:
        """Trajectory that passes the final check, or None."""
        limits, step = self.limits, self.config.exact_step

        def nothing(q: FloatArray) -> BoolArray:
            return np.zeros(len(q), dtype=bool)

        rounded = self.is_free if len(path) > 2 else nothing
        for test in (rounded, nothing):
            trajectory = timed(path, limits, test, step=self.config.step)
            if not trajectory.violation(limits) and self._is_executable(
                trajectory, step
            ):
                return trajectory
            if test is nothing:
                break
        return None

    def _is_executable(self, trajectory: Trajectory, step: float) -> bool:
        q = samples_of(trajectory, step)
        return bool(self.is_free(q).all())


def samples_of(trajectory: Trajectory, step: float) -> FloatArray:
    """Sample a trajectory so that no joint moves by more than a step; (n, d).

    Raises
    ------
    ConfigError
        If the step is none, or endlessly small.
    """
    require_range("step of samples [rad or m]", step, 1e-6)
    fastest = float(np.abs(trajectory.dq).max(initial=1e-9))
    n = int(np.ceil(trajectory.duration * fastest / step)) + 1
    q, _, _ = trajectory.at(np.linspace(0.0, trajectory.duration, max(n, 2)))
    return q
