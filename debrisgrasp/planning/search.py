"""From a scene to distinct candidate poses: anneal, thin, refine, inspect."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Protocol

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, Rng
from debrisgrasp.geometry import SE3
from debrisgrasp.prototypes import PrototypeLibrary

from .annealing import Walkers
from .approach import Ways
from .clearance import HandClearance
from .config import PlannerConfig
from .contacts import PadContacts, PadZones
from .exploration import climb, explore, steady
from .hands import PackedHands
from .inspection import Inspector
from .ledger import Ledger
from .modes import count_near, distinct
from .postures import Postures, Settled
from .proposals import GlobalMove
from .quality import GraspQuality
from .reach import Arm
from .robustness import expected_quality
from .scene import GraspScene
from .similarity import ShapeSimilarity
from .states import Candidates, Modes
from .surfaces import VisibleSurfaces

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


class GraspSearch:
    """Searches with one dictionary of prototypes and the hands that carry them."""

    def __init__(self, library: PrototypeLibrary, config: PlannerConfig) -> None:
        self._packed = library.packed()
        self._coarse = VisibleSurfaces.pack(self._packed, config.search_points)
        self._fine = VisibleSurfaces.pack(self._packed, config.final_points)
        self._hands = PackedHands.pack(
            library,
            approach=config.clearance.approach,
            tolerance=config.inspection.tolerance,
        )
        self._zones = PadZones.of(library, config.contact)
        self.gripper_of = np.array([p.gripper for p in library])
        """Name of the hand of each prototype, shape (p,)."""
        self._config = config

    @property
    def hands(self) -> PackedHands:
        """The hand of each prototype."""
        return self._hands

    def similarity(self, scene: GraspScene) -> ShapeSimilarity:
        """S of a scene, with every point that the final score uses."""
        return ShapeSimilarity(scene, self._fine, self._config.similarity)

    def ways(self, scene: GraspScene) -> Ways:
        """Ways to and from grasps in a scene."""
        config = self._config
        return Ways(scene, self._hands, config.approach, config.inspection)

    def run(
        self,
        scene: GraspScene,
        arms: Sequence[Arm],
        watch: Watch,
        ledger: Ledger,
        *,
        rng: Rng,
    ) -> Modes:
        """Find distinct poses whose Q-hat is high enough, best score first.

        Parameters
        ----------
        arms
            Poses that none of them can reach for certain are not looked at.
        ledger
            Takes the poses that each reason rules out.
        """
        with watch.stage("search"):
            quality = self._quality(scene, arms)
            asked = () if self._config.reach == "after" else arms
            postures = Postures(asked, self.gripper_of, rng)
            states = self._explored(scene, quality, postures, watch, rng)
            modes = self._modes(scene, states)
            tops = self._refined(quality, postures, modes, watch, rng)
            tops = self._steadied(scene, postures, tops, watch, rng)
            self._missed(scene, postures, ledger)
            if arms and not len(tops.Ts):
                far = self._too_far(scene, arms, watch, rng)
                every = np.ones(len(far.Ts), dtype=bool)
                ledger.add("no arm gets that far", far.Ts, far.prototype, every)
        with watch.stage("inspection"):
            return self._inspected(scene, tops, states, ledger)

    def _quality(self, scene: GraspScene, arms: Sequence[Arm]) -> GraspQuality:
        """Q-hat of this scene times what makes one grasp better than the next."""
        config = self._config
        return GraspQuality(
            ShapeSimilarity(scene, self._coarse, config.similarity),
            HandClearance(scene, self._hands, config.clearance),
            lambda Ts, prototype: self._may_reach(arms, Ts, prototype),
            lambda Ts, prototype: self._lever_factor(scene, Ts, prototype),
        )

    def _explored(
        self,
        scene: GraspScene,
        quality: GraspQuality,
        postures: Postures,
        watch: Watch,
        rng: Rng,
    ) -> Candidates:
        """Best state of every walker."""

        def on_sweep(index: int, _walkers: Walkers) -> bool:
            watch.report("search", (index + 1) / self._config.schedule.sweeps)
            return not watch.is_late()

        settled, prototype = explore(
            quality,
            postures,
            GlobalMove(scene, self._packed),
            len(self.gripper_of),
            self._config,
            rng=rng,
            on_sweep=on_sweep,
        )
        return Candidates.of(settled, prototype)

    def _too_far(
        self, scene: GraspScene, arms: Sequence[Arm], watch: Watch, rng: Rng
    ) -> Candidates:
        """Distinct poses that would fit if an arm could get there."""
        quality = self._quality(scene, ())
        nobody = Postures((), self.gripper_of, rng)
        states = self._explored(scene, quality, nobody, watch, rng)
        found = self._modes(scene, states)
        return found[~self._may_reach(arms, found.Ts, found.prototype)]

    def _missed(self, scene: GraspScene, postures: Postures, ledger: Ledger) -> None:
        """Note the distinct poses that fit, but that no posture takes."""
        Ts, prototype, value = postures.missed()
        found = Candidates(Ts, prototype, np.exp(value), np.zeros((len(Ts), 0)))
        found = self._modes(scene, found)
        every = np.ones(len(found.Ts), dtype=bool)
        ledger.add("no arm gets there", found.Ts, found.prototype, every)

    def _may_reach(
        self, arms: Sequence[Arm], Ts: FloatArray, prototype: IntArray
    ) -> BoolArray:
        """Which poses an arm with the right hand may reach; all if there is no arm."""
        if not arms or self._config.reach == "after":
            return np.ones(len(Ts), dtype=bool)
        found = np.zeros(len(Ts), dtype=bool)
        for arm in arms:
            mine = np.flatnonzero(self.gripper_of[prototype] == arm.gripper)
            if len(mine):
                found[mine] |= arm.may_reach(SE3(Ts[mine]))
        return found

    def _modes(self, scene: GraspScene, found: Candidates) -> Candidates:
        """Thin the states to distinct poses of each prototype."""
        config = self._config
        quality = found.score / self._lever_factor(scene, found.Ts, found.prototype)
        # Refinement and the exact scores may still lift what is a little too low.
        found = found[quality >= 0.7 * config.minimum_score]
        kept = distinct(
            found.Ts,
            found.prototype,
            found.score,
            distance=config.mode_distance / 2,
            angle=config.mode_angle / 2,
            limit=config.max_refined,
        )
        return found[kept]

    def _refined(
        self,
        quality: GraspQuality,
        postures: Postures,
        found: Candidates,
        watch: Watch,
        rng: Rng,
    ) -> Candidates:
        """Climb from every pose to the top nearby."""
        holds, settled = postures.completed(found.settled(), found.prototype)
        found = found[holds]
        if not len(found.Ts):
            return found
        settled = climb(
            settled[np.flatnonzero(holds)],
            found.prototype,
            quality,
            postures,
            self._config,
            rng=rng,
            on_sweep=lambda _index, _walkers: not watch.is_late(),
        )
        return Candidates.of(settled, found.prototype)

    def _steadied(
        self,
        scene: GraspScene,
        postures: Postures,
        found: Candidates,
        watch: Watch,
        rng: Rng,
    ) -> Candidates:
        """Add, next to the best, poses that lose less when the hand ends up beside."""
        if not len(found.Ts) or watch.is_late():
            return found
        clearance = HandClearance(scene, self._hands, self._config.clearance)

        def score(Ts: FloatArray, prototype: IntArray) -> FloatArray:
            value = self._expected(scene, clearance, Ts, prototype)
            value *= self._lever_factor(scene, Ts, prototype)
            return np.log(np.maximum(value, 1e-9))

        most = self._config.max_steadied
        chosen = found[np.argsort(-found.score, kind="stable")[: 4 * most]]
        value = score(chosen.Ts, chosen.prototype)
        best = np.argsort(-value, kind="stable")[:most]
        chosen = chosen[best]
        steadied = steady(
            Settled(Walkers.at(chosen.Ts, value[best]), chosen.joints),
            chosen.prototype,
            score,
            postures,
            self._config,
            rng=rng,
        )
        return Candidates.together([found, Candidates.of(steadied, chosen.prototype)])

    def _inspected(
        self,
        scene: GraspScene,
        found: Candidates,
        states: Candidates,
        ledger: Ledger,
    ) -> Modes:
        """Score with every point and the exact solids; count what falls out."""
        config = self._config
        if not len(found.Ts):
            return Modes.none()
        similarity = self.similarity(scene)
        S, coverage = (
            term.astype(np.float64) for term in similarity(found.Ts, found.prototype)
        )
        clearance = HandClearance(scene, self._hands, config.clearance)
        C = clearance.exposure(found.Ts, found.prototype)
        look = Inspector(scene, self._hands)(found.Ts, found.prototype)
        look = self.ways(scene).relieved(look, found.Ts, found.prototype)
        ok = np.ones(len(S), dtype=bool)
        for reason, applies in look.reasons(config.inspection).items():
            by = look.amount(reason)
            ledger.add(reason, found.Ts, found.prototype, applies, by)
            ok &= ~applies
        thickness = similarity.evidence_of_thickness(found.Ts, found.prototype)
        is_guess = ok & clearance.is_blind(found.Ts, found.prototype)
        is_guess &= thickness < config.minimum_evidence
        ledger.add(
            "the object may be thicker than what was seen of it",
            found.Ts,
            found.prototype,
            is_guess,
        )
        ok &= ~is_guess
        contact = PadContacts(scene, self._zones, config.contact)(
            found.Ts, found.prototype
        )
        is_slanted = ok & (contact < config.contact.least)
        ledger.add(
            "the faces are too slanted for the fingers",
            found.Ts,
            found.prototype,
            is_slanted,
        )
        ok &= ~is_slanted
        quality = S * C
        is_poor = ok & (quality < config.minimum_score)
        ledger.add(
            "the shape fits too poorly", found.Ts, found.prototype, is_poor, quality
        )
        ok &= ~is_poor
        Ts, prototype = found.Ts[ok], found.prototype[ok]
        expected = self._expected(scene, clearance, Ts, prototype)
        score = expected * contact[ok] * self._lever_factor(scene, Ts, prototype)
        kept = Modes(
            Ts=Ts,
            prototype=prototype,
            S=S[ok],
            C=C[ok],
            coverage=coverage[ok],
            expected=expected,
            contact=contact[ok],
            score=score,
            support=np.zeros(len(Ts), dtype=np.int64),
            effective_samples=_effective_count(states.score),
        )
        best = distinct(
            kept.Ts,
            self.gripper_of[kept.prototype],
            kept.score,
            distance=config.mode_distance,
            angle=config.mode_angle,
            limit=config.max_ranked,
        )
        modes = kept[best]
        support = count_near(
            modes.Ts,
            self.gripper_of[modes.prototype],
            states.Ts,
            self.gripper_of[states.prototype],
            distance=config.mode_distance,
            angle=config.mode_angle,
        )
        return replace(modes, support=support)

    def _expected(
        self,
        scene: GraspScene,
        clearance: HandClearance,
        Ts_base_hand: FloatArray,
        prototype: IntArray,
    ) -> FloatArray:
        """Mean of S C over the errors of the pose, shape (k,)."""
        similarity = ShapeSimilarity(scene, self._coarse, self._config.similarity)

        def quality(Ts: FloatArray, which: IntArray) -> FloatArray:
            return similarity(Ts, which)[0] * clearance(Ts, which, np.zeros(len(Ts)))

        return expected_quality(
            quality, self._config.uncertainty, Ts_base_hand, prototype
        )

    def _lever_factor(
        self, scene: GraspScene, Ts: FloatArray, prototype: IntArray
    ) -> FloatArray:
        """Discount for gripping away from the object's middle, in (0, 1], (k,)."""
        local = self._hands.grip_points[prototype]
        grip = (Ts[:, :2, :3] @ local[..., None])[..., 0] + Ts[:, :2, 3]
        lever2 = np.square(grip - scene.centroid[:2]).sum(axis=1)
        factor: FloatArray = 1.0 / (1.0 + lever2 / self._config.lever_scale**2)
        return factor


def _effective_count(weight: FloatArray) -> float:
    """Kish's effective number of samples of these weights (k,)."""
    return float(weight.sum() ** 2 / max(float((weight**2).sum()), 1e-300))
