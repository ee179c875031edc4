"""From a scene to distinct candidate poses: anneal, thin, refine, inspect."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Protocol

import numpy as np
from scipy.special import log_expit, logit

from debrisgrasp._arrays import FloatArray, IntArray, Rng
from debrisgrasp._memo import Memo
from debrisgrasp.geometry import SE3
from debrisgrasp.prototypes import PrototypeLibrary

from .annealing import Walkers
from .approach import Ways
from .config import SETTLED, PlannerConfig
from .easing import lifted
from .exploration import exchanged, explore, refine
from .ledger import Ledger
from .load import LoadModel
from .merit import Looks, Merit
from .modes import count_near, distinct
from .postures import Postures, Settled
from .proposals import GlobalMove, own_frames
from .quality import STIFF
from .reach import Arm
from .scene import GraspScene
from .similarity import ShapeSimilarity
from .states import Candidates, Modes
from .tools import Burden, Tools

__all__ = ["Candidates", "GraspSearch", "Modes", "Watch"]


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
_HOPELESS = 0.005
"""No search comes from below this score to a chance."""
_CLIMB = 3.0
"""A refinement brings a pose no farther up than this [log-odds]."""
_MISSED = 0.3
"""Poses that no arm gets to are told of down to this share of the best."""


class GraspSearch:
    """Searches with one dictionary of prototypes and the hands that carry them."""

    def __init__(self, library: PrototypeLibrary, config: PlannerConfig) -> None:
        self._packed = library.packed()
        self._frames = own_frames(self._packed)
        self.tools = Tools.of(library, config)
        self._config, self._wider = config, config.wider()
        self._looks: Memo[GraspScene, Looks] = Memo()

    def similarity(self, scene: GraspScene) -> ShapeSimilarity:
        """S of a scene, with every point that the final score uses."""
        return ShapeSimilarity(scene, self.tools.fine, self._config.similarity)

    def ways(self, scene: GraspScene) -> Ways:
        """Ways to and from grasps in a scene."""
        return self._looks_into(scene).ways

    def _looks_into(self, scene: GraspScene) -> Looks:
        """Close looks into a scene, kept as long as the scene itself."""
        kept = self._looks.get(scene)
        if kept is None:
            kept = self._looks[scene] = Looks.into(scene, self.tools)
        return kept

    def run(
        self,
        scene: GraspScene,
        load: LoadModel,
        arms: Sequence[Arm],
        watch: Watch,
        ledger: Ledger,
        *,
        rng: Rng,
        beyond: float = 0.0,
    ) -> Modes:
        """Find distinct poses whose Q-hat is high enough, best score first.

        Parameters
        ----------
        load
            What the object weighs.
        arms
            Poses that none of them can reach for certain are not looked at.
        ledger
            Takes the poses that each reason rules out.
        beyond
            A score that is of no use: what can hardly come to more is left early.
        """
        with watch.stage("search"):
            asked = () if self._config.reach == "after" else arms
            burden = Burden.on(arms, load, self.tools)
            merit = self._merit(scene, burden, asked)
            postures = Postures(asked, self.tools.gripper_of, rng)
            states, tops = self._sought(scene, merit, postures, watch, rng, beyond)
            self._missed(postures, ledger)
            is_asked_why = bool(asked) and not beyond and not len(tops.Ts)
            if is_asked_why and not watch.is_late():
                far = self._too_far(scene, burden, arms, watch, rng)
                every = np.ones(len(far.Ts), dtype=bool)
                ledger.add("no arm gets that far", far.Ts, far.prototype, every)
        with watch.stage("inspection"):
            return self._inspected(merit, tops, states, ledger)

    def _merit(self, scene: GraspScene, burden: Burden, arms: Sequence[Arm]) -> Merit:
        return Merit(
            scene,
            self.tools,
            burden,
            self._looks_into(scene),
            lambda Ts, prototype: self._reach(arms, Ts, prototype),
        )

    def _sought(
        self,
        scene: GraspScene,
        merit: Merit,
        postures: Postures,
        watch: Watch,
        rng: Rng,
        beyond: float,
    ) -> tuple[Candidates, Candidates]:
        """States of all walkers, and the tops that were climbed from the best.

        Where the best of these is doubtful, and yet of use, more walkers set out, and
        the best of all climb on. Where it is hopeless nothing more is tried: of 44
        objects of 22 piles none came from there to more than 0.02.
        """
        states, tops = [], []
        for config, name in ((self._config, "search"), (self._wider, "wider search")):
            states.append(
                self._explored(scene, merit, postures, watch, rng, config, name)
            )
            found = self._promising(merit, states[-1], watch, beyond)
            tops.append(self._refined(merit, postures, found, watch, rng, beyond))
            best = tops[-1].score.max(initial=0.0)
            if len(tops) == 1 and best < _HOPELESS:
                return states[0], tops[0]
            if not beyond <= best < SETTLED or watch.is_late():
                break
        found = Candidates.together(tops)
        start, last = found.settled(), self._config.last_sweeps
        top = self._climbed(start, found.prototype, merit, postures, last, watch, rng)
        return Candidates.together(states), top

    def _promising(
        self, merit: Merit, states: Candidates, watch: Watch, beyond: float
    ) -> Candidates:
        """Distinct poses to climb from, other prototypes at the best places too."""
        least = merit.least(beyond)
        found = self._modes(states, merit.worth, least)
        if watch.is_late():
            return found
        found = self._exchanged(merit, found)
        return self._modes(found, merit.worth, least)

    def _explored(
        self,
        scene: GraspScene,
        merit: Merit,
        postures: Postures,
        watch: Watch,
        rng: Rng,
        config: PlannerConfig,
        name: str,
    ) -> Candidates:
        """Best state of every walker; progress is told under a name."""

        def on_sweep(index: int, _walkers: Walkers) -> bool:
            watch.report(name, (index + 1) / config.schedule.sweeps)
            return not watch.is_late()

        settled, prototype = explore(
            merit.quick,
            postures,
            GlobalMove(scene, self._packed, self._frames),
            self.tools.gripper_of,
            config,
            rng=rng,
            on_sweep=on_sweep,
        )
        return Candidates.of(settled, prototype)

    def _exchanged(self, merit: Merit, found: Candidates) -> Candidates:
        """Add other prototypes of the same hands at the best poses."""
        config = self._config
        best = distinct(
            found.Ts,
            self.tools.gripper_of[found.prototype],
            found.score,
            distance=config.mode_distance,
            angle=config.mode_angle,
            limit=config.exchanged,
        )
        settled, prototype = exchanged(
            found[best].settled(),
            found.prototype[best],
            merit.quick,
            self.tools.gripper_of,
        )
        return Candidates.together([found, Candidates.of(settled, prototype)])

    def _too_far(
        self,
        scene: GraspScene,
        burden: Burden,
        arms: Sequence[Arm],
        watch: Watch,
        rng: Rng,
    ) -> Candidates:
        """Distinct poses that would fit if an arm could get there."""
        merit = self._merit(scene, burden, ())
        nobody = Postures((), self.tools.gripper_of, rng)
        states = self._explored(
            scene, merit, nobody, watch, rng, self._config, "search out of reach"
        )
        found = self._modes(states, merit.worth)
        return found[self._reach(arms, found.Ts, found.prototype) == 0.0]

    def _missed(self, postures: Postures, ledger: Ledger) -> None:
        """Note the distinct poses that fit, but that no posture takes."""
        Ts, prototype, value = postures.missed()
        found = Candidates(Ts, prototype, np.exp(value), np.zeros((len(Ts), 0)))
        found = self._modes(found, _MISSED)
        every = np.ones(len(found.Ts), dtype=bool)
        ledger.add("no arm gets there", found.Ts, found.prototype, every)

    def _reach(
        self, arms: Sequence[Arm], Ts: FloatArray, prototype: IntArray
    ) -> FloatArray:
        """See `Reach`; 1 everywhere if there is no arm."""
        if not arms:
            return np.ones(len(Ts))
        found = np.zeros(len(Ts))
        for arm in arms:
            mine = np.flatnonzero(self.tools.gripper_of[prototype] == arm.gripper)
            if len(mine):
                # Once the object is lifted there mostly is less room than before.
                room = arm.may_yield(SE3(lifted(Ts[mine]))).astype(np.float64)
                stiff = np.flatnonzero(room == 0.0)
                if len(stiff):
                    room[stiff] = STIFF * arm.may_reach(SE3(Ts[mine[stiff]]))
                found[mine] = np.maximum(found[mine], room)
        return found

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

    def _refined(
        self,
        merit: Merit,
        postures: Postures,
        found: Candidates,
        watch: Watch,
        rng: Rng,
        beyond: float,
    ) -> Candidates:
        """Climb from every pose to the top nearby, on what the list is sorted by."""
        holds, settled = postures.completed(found.settled(), found.prototype)
        rows = np.flatnonzero(holds)
        settled, prototype = settled[rows], found.prototype[rows]
        Ts = settled.walkers.best_Ts_base_hand
        foot = log_expit(logit(beyond) - _CLIMB)
        value = merit(Ts, prototype, np.full(len(Ts), foot))
        rows = np.flatnonzero(value > foot)
        prototype = prototype[rows]
        start = Settled(Walkers.at(Ts[rows], value[rows]), settled.joints[rows])
        first = self._config.first_sweeps
        return self._climbed(start, prototype, merit, postures, first, watch, rng)

    def _climbed(
        self,
        start: Settled,
        prototype: IntArray,
        merit: Merit,
        postures: Postures,
        sweeps: range,
        watch: Watch,
        rng: Rng,
    ) -> Candidates:
        """Take states uphill for some sweeps of the refinement."""
        settled = refine(
            start,
            prototype,
            merit,
            postures,
            self._config,
            sweeps=sweeps,
            rng=rng,
            is_late=watch.is_late,
        )
        return Candidates.of(settled, prototype)

    def _inspected(
        self,
        merit: Merit,
        found: Candidates,
        states: Candidates,
        ledger: Ledger,
    ) -> Modes:
        """Score with every point and the exact solids; count what falls out."""
        config = self._config
        if not len(found.Ts):
            return Modes.none()
        gripper = self.tools.gripper_of
        best = distinct(
            found.Ts,
            gripper[found.prototype],
            found.score,
            distance=config.mode_distance,
            angle=config.mode_angle,
            limit=config.max_ranked,
        )
        found = found[best]
        modes, ok = merit.judged(found.Ts, found.prototype, ledger)
        modes = replace(modes, joints=found.joints)[ok]
        modes = modes[np.argsort(-modes.score, kind="stable")]
        support = count_near(
            modes.Ts,
            gripper[modes.prototype],
            states.Ts,
            gripper[states.prototype],
            distance=config.mode_distance,
            angle=config.mode_angle,
        )
        effective = _effective_count(states.score)
        return replace(modes, support=support, effective_samples=effective)


def _effective_count(weight: FloatArray) -> float:
    """Kish's effective number of samples of these weights (k,)."""
    return float(weight.sum() ** 2 / max(float((weight**2).sum()), 1e-300))
