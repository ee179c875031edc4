"""From a scene to distinct candidate poses: anneal, thin, refine, inspect."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, fields, replace
from typing import Protocol

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, Rng
from debrisgrasp.geometry import SE3
from debrisgrasp.prototypes import PrototypeLibrary

from .annealing import Walkers
from .clearance import HandClearance
from .config import PlannerConfig
from .exploration import climb, explore
from .hands import PackedHands
from .inspection import Inspector
from .modes import count_near, distinct
from .proposals import GlobalMove
from .quality import GraspQuality
from .reach import Arm
from .robustness import expected_quality
from .scene import GraspScene
from .similarity import ShapeSimilarity
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


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Poses that survive a stage of the search, one row each."""

    Ts: FloatArray
    prototype: IntArray
    score: FloatArray
    """Q-hat times the preference."""

    @classmethod
    def scored_by(cls, walkers: Walkers, prototype: IntArray) -> Candidates:
        """Take the best state of every walker."""
        value = np.exp(walkers.best_log_quality)
        return cls(walkers.best_Ts_base_hand, prototype, value)

    def __getitem__(self, keep: BoolArray | IntArray) -> Candidates:
        return Candidates(self.Ts[keep], self.prototype[keep], self.score[keep])


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
    score: FloatArray
    """What the list is sorted by."""
    support: IntArray
    """How many walkers ended at each."""
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
            score=empty,
            support=index,
        )

    def __getitem__(self, keep: BoolArray | IntArray) -> Modes:
        columns = {
            field.name: getattr(self, field.name)[keep]
            for field in fields(self)
            if field.name != "effective_samples"
        }
        return replace(self, **columns)


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
        self.gripper_of = np.array([p.gripper for p in library])
        """Name of the hand of each prototype, shape (p,)."""
        self._config = config

    def run(
        self,
        scene: GraspScene,
        arms: Sequence[Arm],
        watch: Watch,
        ledger: Counter[str],
        *,
        rng: Rng,
    ) -> Modes:
        """Find distinct poses whose Q-hat is high enough, best score first.

        Parameters
        ----------
        arms
            Poses that none of them can reach for certain are not looked at.
        ledger
            Takes the count of poses that each reason rules out.
        """
        with watch.stage("search"):
            quality = self._quality(scene, arms)
            states = self._explored(scene, quality, watch, rng)
            modes = self._solved(arms, self._modes(scene, states), ledger, rng)
            tops = self._refined(quality, modes, watch, rng)
            if arms and not len(tops.Ts):
                ledger["no arm gets that far"] += self._n_too_far(
                    scene, arms, watch, rng
                )
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
        self, scene: GraspScene, quality: GraspQuality, watch: Watch, rng: Rng
    ) -> Candidates:
        """Best state of every walker."""

        def on_sweep(index: int, _walkers: Walkers) -> bool:
            watch.report("search", (index + 1) / self._config.schedule.sweeps)
            return not watch.is_late()

        walkers, prototype = explore(
            quality,
            GlobalMove(scene, self._packed),
            len(self.gripper_of),
            self._config,
            rng=rng,
            on_sweep=on_sweep,
        )
        return Candidates.scored_by(walkers, prototype)

    def _n_too_far(
        self, scene: GraspScene, arms: Sequence[Arm], watch: Watch, rng: Rng
    ) -> int:
        """How many distinct poses would fit if an arm could get there."""
        quality = self._quality(scene, ())
        found = self._modes(scene, self._explored(scene, quality, watch, rng))
        return int((~self._may_reach(arms, found.Ts, found.prototype)).sum())

    def _solved(
        self,
        arms: Sequence[Arm],
        found: Candidates,
        ledger: Counter[str],
        rng: Rng,
    ) -> Candidates:
        """Keep the poses for which an arm with the right hand has a posture.

        The map lets a few through that no posture takes; here each is solved.
        """
        if not arms or self._config.reach == "after" or not len(found.Ts):
            return found
        is_solved = np.zeros(len(found.Ts), dtype=bool)
        for arm in arms:
            mine = np.flatnonzero(self.gripper_of[found.prototype] == arm.gripper)
            if len(mine):
                is_solved[mine] |= arm.solves(SE3(found.Ts[mine]), rng=rng)
        ledger["no arm gets there"] += int((~is_solved).sum())
        return found[is_solved]

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
        self, quality: GraspQuality, found: Candidates, watch: Watch, rng: Rng
    ) -> Candidates:
        """Climb from every pose to the top nearby."""
        if not len(found.Ts):
            return found
        walkers = climb(
            Walkers.at(found.Ts, np.log(found.score)),
            found.prototype,
            quality,
            self._config,
            rng=rng,
            on_sweep=lambda _index, _walkers: not watch.is_late(),
        )
        return Candidates.scored_by(walkers, found.prototype)

    def _inspected(
        self,
        scene: GraspScene,
        found: Candidates,
        states: Candidates,
        ledger: Counter[str],
    ) -> Modes:
        """Score with every point and the exact solids; count what falls out."""
        config = self._config
        if not len(found.Ts):
            return Modes.none()
        similarity = ShapeSimilarity(scene, self._fine, config.similarity)
        S, coverage = (
            term.astype(np.float64) for term in similarity(found.Ts, found.prototype)
        )
        clearance = HandClearance(scene, self._hands, config.clearance)
        C = clearance.exposure(found.Ts, found.prototype)
        look = Inspector(scene, self._hands)(found.Ts, found.prototype)
        ok = np.ones(len(S), dtype=bool)
        for reason, applies in look.reasons(config.inspection).items():
            ledger[reason] += int(applies.sum())
            ok &= ~applies
        thickness = similarity.evidence_of_thickness(found.Ts, found.prototype)
        is_guess = ok & clearance.is_blind(found.Ts, found.prototype)
        is_guess &= thickness < config.minimum_evidence
        ledger["the object may be thicker than what was seen of it"] += int(
            is_guess.sum()
        )
        ok &= ~is_guess
        quality = S * C
        is_poor = ok & (quality < config.minimum_score)
        ledger["the shape fits too poorly"] += int(is_poor.sum())
        ok &= ~is_poor
        Ts, prototype = found.Ts[ok], found.prototype[ok]
        expected = self._expected(scene, clearance, Ts, prototype)
        score = expected * self._lever_factor(scene, Ts, prototype)
        kept = Modes(
            Ts=Ts,
            prototype=prototype,
            S=S[ok],
            C=C[ok],
            coverage=coverage[ok],
            expected=expected,
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
