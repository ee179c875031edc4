"""From a scene to distinct candidate poses: anneal, thin, refine, inspect."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial
from typing import Protocol

import numpy as np
from scipy.special import log_expit, logit

from debrisgrasp._arrays import FloatArray, IntArray, Rng
from debrisgrasp.geometry import SE3

from .annealing import Walkers
from .config import SETTLED, PlannerConfig
from .easing import lifted
from .exploration import exchanged, explore, refine
from .ledger import Ledger
from .merit import Looks, Merit
from .modes import count_near, distinct
from .postures import Postures, Settled
from .proposals import GlobalMove
from .quality import STIFF
from .reach import Arm
from .scene import GraspScene
from .states import Candidates, Modes
from .tools import Burden, Tools

__all__ = ["SceneSearch", "Watch"]


class Watch(Protocol):
    """Keeps the time of a search; what the time is, its owner decides."""

    def stage(self, name: str) -> AbstractContextManager[None]:
        """Surround one stage of the work."""
        ...

    def report(self, name: str, share: float) -> None:
        """Take note that a share of a stage is done."""
        ...

    def is_late(self) -> bool:
        """Whether the search has to end with what it has."""
        ...


_FLOOR = 1e-3
_CLIMB = 3.0
"""A refinement brings a pose no farther up than this [log-odds]."""
_MISSED = 0.3
"""Poses that no arm gets to are told of down to this share of the best."""


class SceneSearch:
    """Search of one scene, which goes on from where it ended.

    Parameters
    ----------
    looks
        Into the scene.
    jump
        Proposes poses in the scene.
    burden
        What the object weighs on the arms.
    arms
        Poses that none of them can reach for certain are not looked at.
    """

    def __init__(
        self,
        scene: GraspScene,
        looks: Looks,
        jump: GlobalMove,
        burden: Burden,
        arms: Sequence[Arm],
        tools: Tools,
        watch: Watch,
        *,
        rng: Rng,
    ) -> None:
        self._scene, self._looks, self._jump = scene, looks, jump
        self._burden, self._arms, self._tools = burden, arms, tools
        self._watch, self._rng, self._config = watch, rng, tools.config
        asked = () if tools.config.reach == "after" else arms
        self._merit = self._merit_for(asked)
        self._postures = Postures(asked, tools.gripper_of, rng)
        self._states: list[Candidates] = []
        self._tops: list[Candidates] = []
        self._far: Candidates | None = None

    @property
    def promise(self) -> float:
        """Best score that was come to, before any inspection."""
        return max((tops.score.max(initial=0.0) for tops in self._tops), default=0.0)

    @property
    def is_over(self) -> bool:
        """Whether to search on is needless, or has been tried."""
        return len(self._tops) > 1 or self.promise >= SETTLED

    def first(self, beyond: float, ledger: Ledger) -> Modes:
        """Find distinct poses whose Q-hat is high enough, best score first.

        Parameters
        ----------
        beyond
            A score that is of no use: what can hardly come to more is left early.
        ledger
            Takes the poses that each reason rules out.
        """
        with self._watch.stage("search"):
            self._seek(self._config, "search", beyond)
            tops = self._tops[-1]
            is_asked_why = self._config.reach != "after" and len(self._arms)
            is_asked_why = is_asked_why and not beyond and not len(tops.Ts)
            if is_asked_why and not self._watch.is_late():
                self._far = self._too_far()
            self._missed(ledger)
        with self._watch.stage("inspection"):
            return self._inspected(tops, ledger)

    def further(self, beyond: float, ledger: Ledger) -> Modes:
        """Send out more walkers, and have the best of all climb on.

        Parameters
        ----------
        beyond, ledger
            See `first`; the ledger is told of all that is ruled out, then or now.
        """
        with self._watch.stage("wider search"):
            self._seek(self._config.wider(), "wider search", beyond)
            found = Candidates.together(self._tops)
            last = self._config.last_sweeps
            tops = self._climbed(found.settled(), found.prototype, last)
            self._missed(ledger)
        with self._watch.stage("inspection"):
            return self._inspected(tops, ledger)

    def _merit_for(self, arms: Sequence[Arm]) -> Merit:
        return Merit(
            self._scene,
            self._tools,
            self._burden,
            self._looks,
            partial(_reach, arms, self._tools.gripper_of),
        )

    def _seek(self, config: PlannerConfig, name: str, beyond: float) -> None:
        """Let walkers set out, and climb from the best places that they find."""
        states = self._explored(self._merit, self._postures, config, name)
        found = self._promising(states, beyond)
        self._states.append(states)
        self._tops.append(self._refined(found, beyond))

    def _promising(self, states: Candidates, beyond: float) -> Candidates:
        """Distinct poses to climb from, other prototypes at the best places too."""
        worth, least = self._merit.worth, self._merit.least(beyond)
        found = self._modes(states, worth, least)
        if self._watch.is_late():
            return found
        return self._modes(self._exchanged(found), worth, least)

    def _explored(
        self, merit: Merit, postures: Postures, config: PlannerConfig, name: str
    ) -> Candidates:
        """Best state of every walker; progress is told under a name."""

        def on_sweep(index: int, _walkers: Walkers) -> bool:
            self._watch.report(name, (index + 1) / config.schedule.sweeps)
            return not self._watch.is_late()

        settled, prototype = explore(
            merit.quick,
            postures,
            self._jump,
            self._tools.gripper_of,
            config,
            rng=self._rng,
            on_sweep=on_sweep,
        )
        return Candidates.of(settled, prototype)

    def _exchanged(self, found: Candidates) -> Candidates:
        """Add other prototypes of the same hands at the best poses."""
        config, gripper_of = self._config, self._tools.gripper_of
        best = distinct(
            found.Ts,
            gripper_of[found.prototype],
            found.score,
            distance=config.mode_distance,
            angle=config.mode_angle,
            limit=config.exchanged,
        )
        settled, prototype = exchanged(
            found[best].settled(), found.prototype[best], self._merit.quick, gripper_of
        )
        return Candidates.together([found, Candidates.of(settled, prototype)])

    def _too_far(self) -> Candidates:
        """Distinct poses that would fit if an arm could get there."""
        merit = self._merit_for(())
        nobody = Postures((), self._tools.gripper_of, self._rng)
        states = self._explored(merit, nobody, self._config, "search out of reach")
        found = self._modes(states, merit.worth)
        gripper_of = self._tools.gripper_of
        return found[_reach(self._arms, gripper_of, found.Ts, found.prototype) == 0.0]

    def _missed(self, ledger: Ledger) -> None:
        """Note the distinct poses that fit, but that no posture takes, near or far."""
        Ts, prototype, value = self._postures.missed()
        found = Candidates(Ts, prototype, np.exp(value), np.zeros((len(Ts), 0)))
        found = self._modes(found, _MISSED)
        every = np.ones(len(found.Ts), dtype=bool)
        ledger.add("no arm gets there", found.Ts, found.prototype, every)
        if self._far is not None:
            every = np.ones(len(self._far.Ts), dtype=bool)
            ledger.add("no arm gets that far", self._far.Ts, self._far.prototype, every)

    def _modes(self, found: Candidates, worth: float, least: float = 0.0) -> Candidates:
        """Thin the states to distinct poses of each prototype.

        Those below a share of the best one, or below the least, have little chance.
        """
        config = self._config
        least = max(least, worth * found.score.max(initial=_FLOOR))
        found = found[found.score >= least]
        kept = distinct(
            found.Ts,
            found.prototype,
            found.score,
            distance=config.mode_distance * (2 / 3),
            angle=config.mode_angle * (2 / 3),
            limit=config.max_refined,
        )
        return found[kept]

    def _refined(self, found: Candidates, beyond: float) -> Candidates:
        """Climb from every pose to the top nearby, on what the list is sorted by."""
        holds, settled = self._postures.completed(found.settled(), found.prototype)
        rows = np.flatnonzero(holds)
        settled, prototype = settled[rows], found.prototype[rows]
        Ts = settled.walkers.best_Ts_base_hand
        foot = log_expit(logit(beyond) - _CLIMB)
        value = self._merit(Ts, prototype, np.full(len(Ts), foot))
        rows = np.flatnonzero(value > foot)
        start = Settled(Walkers.at(Ts[rows], value[rows]), settled.joints[rows])
        return self._climbed(start, prototype[rows], self._config.first_sweeps)

    def _climbed(
        self, start: Settled, prototype: IntArray, sweeps: range
    ) -> Candidates:
        """Take states uphill for some sweeps of the refinement."""
        settled = refine(
            start,
            prototype,
            self._merit,
            self._postures,
            self._config,
            sweeps=sweeps,
            rng=self._rng,
            is_late=self._watch.is_late,
        )
        return Candidates.of(settled, prototype)

    def _inspected(self, found: Candidates, ledger: Ledger) -> Modes:
        """Score with every point and the exact solids; count what falls out."""
        config, gripper_of = self._config, self._tools.gripper_of
        if not len(found.Ts):
            return Modes.none()
        best = distinct(
            found.Ts,
            gripper_of[found.prototype],
            found.score,
            distance=config.mode_distance,
            angle=config.mode_angle,
            limit=config.max_ranked,
        )
        found = found[best]
        modes, ok = self._merit.judged(found.Ts, found.prototype, ledger)
        modes = replace(modes, joints=found.joints)[ok]
        modes = modes[np.argsort(-modes.score, kind="stable")]
        states = Candidates.together(self._states)
        support = count_near(
            modes.Ts,
            gripper_of[modes.prototype],
            states.Ts,
            gripper_of[states.prototype],
            distance=config.mode_distance,
            angle=config.mode_angle,
        )
        effective = _effective_count(states.score)
        return replace(modes, support=support, effective_samples=effective)


def _effective_count(weight: FloatArray) -> float:
    """Kish's effective number of samples of these weights (k,)."""
    return float(weight.sum() ** 2 / max(float((weight**2).sum()), 1e-300))


def _reach(
    arms: Sequence[Arm], gripper_of: IntArray, Ts: FloatArray, prototype: IntArray
) -> FloatArray:
    """See `Reach`; 1 everywhere if there is no arm."""
    if not arms:
        return np.ones(len(Ts))
    found, gripper = np.zeros(len(Ts)), gripper_of[prototype]
    for arm in arms:
        mine = np.flatnonzero(gripper == arm.gripper)
        if len(mine):
            # Once the object is lifted there mostly is less room than before.
            room = arm.may_yield(SE3(lifted(Ts[mine]))).astype(np.float64)
            stiff = np.flatnonzero(room == 0.0)
            if len(stiff):
                room[stiff] = STIFF * arm.may_reach(SE3(Ts[mine[stiff]]))
            found[mine] = np.maximum(found[mine], room)
    return found
