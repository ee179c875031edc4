"""Search the modes of Q-hat by annealing, then rank them by reachability (Eq. 2-4)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray, Rng
from debrisgrasp._memo import Memo
from debrisgrasp._words import arm_called
from debrisgrasp.geometry import SE3
from debrisgrasp.prototypes import PrototypeLibrary

from .advice import Advice, Advisor, Situation
from .choice import choose, is_half_turn_symmetric, turns
from .config import PlannerConfig
from .easing import Easing
from .flat import lies_flat
from .ledger import Ledger, Rejections
from .load import LoadModel, Loads
from .mass import ObjectMass, likely_objects
from .offers import Offers
from .plan import Grasp
from .postures import joint_columns
from .reach import Arm, Distance
from .scene import GraspScene
from .search import GraspSearch, Modes, Watch
from .success import success_terms

__all__ = ["GraspPlanner", "SearchResult"]

_SPARE = 10
"""So many more poses than grasps are wanted are tried on the arms at once."""
_STIFF = "no room to give way to a push"
_LEAST_CHANCE = 0.1
"""What is less likely to hold is no grasp: another object, or a no, serves better."""


@dataclass(frozen=True, slots=True, eq=False)
class SearchResult:
    """Grasps of one search, best first, and what was ruled out."""

    grasps: tuple[Grasp, ...]
    rejections: Mapping[str, int] = field(default_factory=dict)
    """How many distinct poses each reason ruled out."""
    ruled_out: Rejections = field(default_factory=Rejections)
    """Those poses."""
    least_mass: float = 0.0
    """Lower bound on the mass of the object [kg]."""
    effective_samples: float = 0.0
    """See `GraspPlan.effective_samples`."""
    obstacle: str | None = None
    """What of the object itself rules out every grasp, if that is known."""

    def why_empty(self) -> str | None:
        """One sentence that says why there is no grasp, or None if there is one."""
        if self.grasps:
            return None
        if not self.rejections:
            return "no pose of any prototype resembles what the camera saw"
        ordered = sorted(self.rejections.items(), key=lambda item: -item[1])
        causes = "; ".join(f"{count} because {reason}" for reason, count in ordered)
        told = f"of {sum(self.rejections.values())} candidate poses: {causes}"
        return f"{self.obstacle}; {told}" if self.obstacle else told


class GraspPlanner:
    """Plans with one dictionary of prototypes and the hands that carry them."""

    def __init__(self, library: PrototypeLibrary, config: PlannerConfig) -> None:
        self.prototypes = tuple(library)
        self._search = GraspSearch(library, config)
        self._advisor = Advisor(library, self._search.tools.hands, config)
        self._is_symmetric = np.array(
            [
                is_half_turn_symmetric(library.grippers[p.gripper], p.preshape)
                for p in library
            ]
        )
        self._widest = max(
            float(shape.openings[0])
            for p in library
            for shape in library.grippers[p.gripper].preshapes.values()
        )
        self._config = config
        self._likely: Memo[GraspScene, tuple[ObjectMass, ...]] = Memo()

    def plan(
        self,
        scene: GraspScene,
        arms: Sequence[Arm],
        distance: Distance,
        *,
        rng: Rng,
        watch: Watch,
        mass: float | None = None,
        beyond: float = 0.0,
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
        mass
            What the object weighs [kg], if that is known.
        beyond
            Where no grasp scores more than this, none is of use.
        """
        if not len(scene.target):
            return SearchResult((), {"the object's surface has no normals": 1})
        search_rng, arm_rng, leeway_rng, easing_rng = rng.spawn(4)
        ledger = Ledger()
        model = LoadModel(self._weighed(scene, mass), self._config.load)
        found = self._search.run(
            scene, model, arms, watch, ledger, rng=search_rng, beyond=beyond
        )
        if not (found.score > beyond).any():
            found = Modes.none()
        with watch.stage("reachability"):
            loads = model(found.Ts, found.prototype, self._search.tools.levers)
            offers = Offers(
                arms,
                self._chosen,
                lambda grasps: self._approached(scene, grasps),
                Easing(
                    arms,
                    distance,
                    lambda grasps: self._weigh(model, grasps),
                    rng=easing_rng,
                ),
                rng=leeway_rng,
            )
            self._rank(found, loads, arms, distance, offers, arm_rng, ledger)
            grasps = offers.offered
            self._note_stiff(offers.left_out, ledger)
        ruled_out = ledger.closed()
        return SearchResult(
            grasps,
            ruled_out.counts(),
            ruled_out,
            float(loads.mass[0]),
            found.effective_samples,
            None if grasps else lies_flat(scene, self._widest),
        )

    def advise(self, situation: Situation, *, rng: Rng) -> tuple[Advice, ...]:
        """Find what would have to change for the poses that a search ruled out."""
        similarity = self._search.similarity(situation.scene)
        return self._advisor(situation, similarity, rng=rng)

    def _weighed(self, scene: GraspScene, mass: float | None) -> tuple[ObjectMass, ...]:
        """Estimate what the object may weigh, and where its middle may be."""
        config, kept = self._config, self._likely.get(scene)
        if kept is None or mass is not None:
            kept = likely_objects(
                scene.surface,
                scene.cloud.viewpoint,
                config.load,
                spacing=config.scene.spacing,
                mass=mass,
            )
            if mass is None:
                self._likely[scene] = kept
        return kept

    def retreats(
        self,
        scene: GraspScene,
        grasps: Sequence[Grasp],
        directions: FloatArray,
        distance: float,
    ) -> FloatArray:
        """How far each hand gets along directions before it touches a neighbour.

        Parameters
        ----------
        directions
            Unit vectors in base, shape (d, 3).
        distance
            How far to look [m].

        Returns
        -------
        FloatArray
            [m], shape (k, d) for k grasps.
        """
        Ts, which = self._placed(grasps)
        return self._search.ways(scene).retreats(Ts, which, directions, distance)

    def _weigh(self, model: LoadModel, grasps: Sequence[Grasp]) -> Loads:
        """Forecast the loads of grasps, the torque of joints aside."""
        return model(*self._placed(grasps), self._search.tools.levers)

    def _placed(self, grasps: Sequence[Grasp]) -> tuple[FloatArray, IntArray]:
        """Poses (k, 4, 4) of grasps, and their prototypes (k,)."""
        place = {prototype.name: i for i, prototype in enumerate(self.prototypes)}
        Ts = [grasp.T_base_hand.matrix for grasp in grasps]
        which = np.array([place[grasp.prototype] for grasp in grasps], dtype=np.int64)
        return np.reshape(Ts, (-1, 4, 4)), which

    def _approached(
        self, scene: GraspScene, grasps: Sequence[Grasp]
    ) -> tuple[Grasp, ...]:
        """Choose for each grasp from where the hand comes."""
        if not grasps:
            return ()
        Ts, which = self._placed(grasps)
        ways = self._search.ways(scene)
        offsets = ways.roomy(Ts, which, ways.approaches(Ts, which))
        return tuple(
            replace(
                grasp,
                T_base_pregrasp=SE3.from_parts(p=offset) @ grasp.T_base_hand,
            )
            if offset.any()
            else grasp
            for grasp, offset in zip(grasps, offsets, strict=True)
        )

    def _note_stiff(self, grasps: Sequence[Grasp], ledger: Ledger) -> None:
        """Note grasps in which the arm can't give way."""
        for name in dict.fromkeys(grasp.arm for grasp in grasps if grasp.arm):
            stiff = [grasp for grasp in grasps if grasp.arm == name]
            every = np.ones(len(stiff), dtype=bool)
            ledger.add(f"{arm_called(name)}: {_STIFF}", *self._placed(stiff), every)

    def _rank(
        self,
        found: Modes,
        loads: Loads,
        arms: Sequence[Arm],
        distance: Distance,
        offers: Offers,
        rng: Rng,
        ledger: Ledger,
    ) -> None:
        """Offer the best grasps that an arm takes, or all if there is no arm."""
        heavy = loads.is_too_heavy
        ledger.add(
            "too heavy for the grip",
            found.Ts,
            found.prototype,
            heavy,
            loads.demand[:, 0],
        )
        poor = ~heavy & (found.score < _LEAST_CHANCE)
        ledger.add("it would hardly hold", found.Ts, found.prototype, poor, found.score)
        rows = np.flatnonzero(~heavy & ~poor)
        if not arms:
            offers.take([self._grasp(found, loads, i) for i in rows.tolist()])
            return
        rngs = rng.spawn(len(arms))
        rows = rows[self._turns(found[rows])]
        # The arms are asked for as many as are wanted, and some that may fail.
        step = self._config.n_best + _SPARE
        for some in np.split(rows, range(step, len(rows), step)):
            carried, grasps = self._search.tools.gripper_of[found.prototype[some]], []
            for arm, own, arm_rng in zip(arms, joint_columns(arms), rngs, strict=True):
                mine = some[carried == arm.gripper]
                if len(mine):
                    modes = found[mine]
                    modes = replace(modes, joints=modes.joints[:, own])
                    grasps += self._taken(
                        modes, loads[mine], arm, distance, arm_rng, ledger
                    )
            offers.take(grasps)
            if len(offers.yielding) == self._config.n_best:
                return

    def _turns(self, found: Modes) -> IntArray:
        """Order in which modes are offered if all can be taken."""
        tools = self._search.tools
        places = SE3(found.Ts).apply(tools.hands.grip_points[found.prototype])
        return np.argsort(turns(places, self._config.region_size), kind="stable")

    def _chosen(self, grasps: Sequence[Grasp]) -> IntArray:
        """Rows of distinct grasps, spread over the object, best first."""
        Ts, which = self._placed(grasps)
        places = SE3(Ts).apply(self._search.tools.hands.grip_points[which])
        return choose(
            Ts,
            places,
            [grasp.gripper for grasp in grasps],
            [grasp.prototype for grasp in grasps],
            self._is_symmetric[which],
            np.array([grasp.rank for grasp in grasps]),
            self._config,
        )

    def _taken(
        self,
        found: Modes,
        loads: Loads,
        arm: Arm,
        distance: Distance,
        rng: Rng,
        ledger: Ledger,
    ) -> list[Grasp]:
        """Grasps that an arm takes, and can carry the object in."""
        force, torque = arm.wrench_limits
        loads = loads.limited(loads.weight, force, "wrist force")
        loads = loads.limited(loads.torque, torque, "wrist torque")
        found, loads = self._carried(found, loads, arm, ledger)
        if not len(found.Ts):
            return []
        known = found.joints if found.joints.shape[1] else None
        answer = arm.reach(SE3(found.Ts), distance, q_known=known, rng=rng)
        reasons = np.array(answer.reasons, dtype=object)
        for reason in dict.fromkeys(r for r in answer.reasons if r):
            ledger.add(
                f"{arm_called(arm.name)}: {reason}",
                found.Ts,
                found.prototype,
                reasons == reason,
            )
        rows = np.flatnonzero(answer.is_reached)
        found, loads, joints = found[rows], loads[rows], answer.joints[rows]
        share = arm.effort(joints, loads.wrench)[:, None]
        loads = loads.limited(share * loads.mass / loads.mass[1], 1.0, "joint torque")
        kept = ~loads.is_too_heavy
        found, loads = self._carried(found, loads, arm, ledger)
        return [
            replace(
                self._grasp(found, loads, row),
                arm=arm.name,
                joints=dict(zip(arm.joint_names, q.tolist(), strict=True)),
            )
            for row, q in enumerate(joints[kept])
        ]

    @staticmethod
    def _carried(
        found: Modes, loads: Loads, arm: Arm, ledger: Ledger
    ) -> tuple[Modes, Loads]:
        """Leave out what an arm can't carry."""
        heavy = loads.is_too_heavy
        by = loads.demand[:, 0]
        ledger.add(
            f"{arm_called(arm.name)}: too heavy", found.Ts, found.prototype, heavy, by
        )
        return found[~heavy], loads[~heavy]

    def _grasp(self, found: Modes, loads: Loads, index: int) -> Grasp:
        """Record of one mode."""
        prototype = self.prototypes[found.prototype[index]]
        T_base_hand = SE3(found.Ts[index])
        retreat = SE3.from_parts(p=(0.0, 0.0, -self._config.clearance.approach))
        success = self._search.tools.success.forecast(
            success_terms(
                expected=found.expected[index],
                contact=found.contact[index],
                demand=loads.demand[index, 1],
                lever=loads.lever[index],
                margin=found.margin[index],
                slack=self._search.tools.hands.slack[found.prototype[index]],
                sight=found.sight[index],
                unseen=found.unseen[index],
                missing=found.missing[index],
            ),
            float(found.squeezed[index]),
        )
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
            score=success.probability,
            load=loads.forecast(index),
            success=success,
        )
