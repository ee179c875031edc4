"""Search the modes of Q-hat by annealing, then rank them by reachability (Eq. 2-4)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from debrisgrasp._arrays import Rng
from debrisgrasp.geometry import SE3
from debrisgrasp.prototypes import PrototypeLibrary

from .config import PlannerConfig
from .plan import Grasp
from .reach import Arm, Distance
from .scene import GraspScene
from .search import GraspSearch, Modes, Watch

__all__ = ["GraspPlanner", "SearchResult"]


@dataclass(frozen=True, slots=True, eq=False)
class SearchResult:
    """Grasps of one search, best first, and what was ruled out."""

    grasps: tuple[Grasp, ...]
    rejections: Mapping[str, int] = field(default_factory=dict)
    """How many distinct poses each reason ruled out."""
    effective_samples: float = 0.0
    """See `GraspPlan.effective_samples`."""

    def why_empty(self) -> str | None:
        """One sentence that says why there is no grasp, or None if there is one."""
        if self.grasps:
            return None
        if not self.rejections:
            return "no pose of any prototype resembles what the camera saw"
        ordered = sorted(self.rejections.items(), key=lambda item: -item[1])
        causes = "; ".join(f"{count} because {reason}" for reason, count in ordered)
        return f"of {sum(self.rejections.values())} candidate poses: {causes}"


class GraspPlanner:
    """Plans with one dictionary of prototypes and the hands that carry them."""

    def __init__(self, library: PrototypeLibrary, config: PlannerConfig) -> None:
        self._prototypes = tuple(library)
        self._search = GraspSearch(library, config)
        self._config = config

    def plan(
        self,
        scene: GraspScene,
        arms: Sequence[Arm],
        distance: Distance,
        *,
        rng: Rng,
        watch: Watch,
    ) -> SearchResult:
        """Search the scene.

        Parameters
        ----------
        scene
            What to grip, and what is around it.
        arms
            Which arms may take a grasp; none plans for a floating hand (R = 1).
        distance
            Obstacles for the links of the arms, in the base frame.
        rng
            The same generator state gives the same result.
        watch
            Told of the progress, and asked whether the search has to end early.
        """
        if not len(scene.target):
            return SearchResult((), {"the object's surface has no normals": 1})
        search_rng, arm_rng = rng.spawn(2)
        ledger: Counter[str] = Counter()
        found = self._search.run(scene, arms, watch, ledger, rng=search_rng)
        with watch.stage("reachability"):
            grasps = self._ranked(found, arms, distance, arm_rng, ledger)
        return SearchResult(grasps, +ledger, found.effective_samples)

    def _ranked(
        self,
        found: Modes,
        arms: Sequence[Arm],
        distance: Distance,
        rng: Rng,
        ledger: Counter[str],
    ) -> tuple[Grasp, ...]:
        """Best grasps that an arm takes, or all if there is no arm."""
        config = self._config
        order = np.argsort(-found.score, kind="stable")
        if not arms:
            return tuple(self._grasp(found, i) for i in order[: config.n_best])
        grasps = []
        for arm, arm_rng in zip(arms, rng.spawn(len(arms)), strict=True):
            mine = order[self._search.gripper_of[found.prototype[order]] == arm.gripper]
            if not len(mine):
                continue
            answer = arm.reach(SE3(found.Ts[mine]), distance, rng=arm_rng)
            ledger.update(
                f"{arm.name} arm: {reason}" for reason in answer.reasons if reason
            )
            for row in np.flatnonzero(answer.is_reached):
                q = dict(zip(arm.joint_names, answer.joints[row].tolist(), strict=True))
                grasps.append(
                    replace(self._grasp(found, mine[row]), arm=arm.name, joints=q)
                )
        grasps.sort(key=lambda grasp: -grasp.score)
        return tuple(grasps[: config.n_best])

    def _grasp(self, found: Modes, index: int) -> Grasp:
        prototype = self._prototypes[found.prototype[index]]
        T_base_hand = SE3(found.Ts[index])
        retreat = SE3.from_parts(p=(0.0, 0.0, -self._config.clearance.approach))
        return Grasp(
            T_base_hand=T_base_hand,
            T_base_pregrasp=T_base_hand @ retreat,
            gripper=prototype.gripper,
            preshape=prototype.preshape,
            opening=prototype.opening,
            width=prototype.width,
            prototype=prototype.name,
            S=float(found.S[index]),
            C=float(found.C[index]),
            R=1.0,
            expected=float(found.expected[index]),
            coverage=float(found.coverage[index]),
            support=int(found.support[index]),
            score=float(found.score[index]),
        )
