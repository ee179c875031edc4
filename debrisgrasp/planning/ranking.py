"""From poses to grasps: on which arms, how likely each holds, and which to offer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray, Rng
from debrisgrasp._words import arm_called
from debrisgrasp.geometry import SE3
from debrisgrasp.prototypes import PrototypeLibrary

from .choice import choose, is_half_turn_symmetric, turns
from .config import PlannerConfig
from .easing import Easing
from .flat import lies_flat
from .ledger import Ledger
from .load import LoadModel, Loads
from .offers import Offers
from .plan import Grasp
from .postures import joint_columns
from .reach import Arm, Distance
from .scene import GraspScene
from .search import GraspSearch
from .search_result import SearchResult
from .states import Modes
from .success import success_terms

__all__ = ["Ranking"]

_SPARE = 10
"""So many more poses than grasps are wanted are tried on the arms at once."""
_STIFF = "no room to give way to a push"
_LEAST_CHANCE = 0.1
"""What is less likely to hold is no grasp: another object, or a no, serves better."""


class Ranking:
    """Ranks what searches with one dictionary find."""

    def __init__(
        self, library: PrototypeLibrary, search: GraspSearch, config: PlannerConfig
    ) -> None:
        self._prototypes = tuple(library)
        self._place = {p.name: i for i, p in enumerate(self._prototypes)}
        self._search, self._tools, self._config = search, search.tools, config
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

    def __call__(
        self,
        found: Modes,
        scene: GraspScene,
        model: LoadModel,
        arms: Sequence[Arm],
        distance: Distance,
        ledger: Ledger,
        *,
        rngs: Sequence[Rng],
    ) -> SearchResult:
        """Offer the best of what was found, as far as arms take it.

        Parameters
        ----------
        model
            What the object weighs.
        arms, distance
            See `GraspPlanner.first_look`.
        rngs
            For the arms' solver, and for how they give way, and in which posture.
        """
        arm_rng, leeway_rng, easing_rng = rngs
        loads = model(found.Ts, found.prototype, self._tools.levers)
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

    def _weigh(self, model: LoadModel, grasps: Sequence[Grasp]) -> Loads:
        """Forecast the loads of grasps, the torque of joints aside."""
        return model(*self.placed(grasps), self._tools.levers)

    def placed(self, grasps: Sequence[Grasp]) -> tuple[FloatArray, IntArray]:
        """Poses (k, 4, 4) of grasps, and their prototypes (k,)."""
        Ts = [grasp.T_base_hand.matrix for grasp in grasps]
        which = np.array(
            [self._place[grasp.prototype] for grasp in grasps], dtype=np.int64
        )
        return np.reshape(Ts, (-1, 4, 4)), which

    def _approached(
        self, scene: GraspScene, grasps: Sequence[Grasp]
    ) -> tuple[Grasp, ...]:
        """Choose for each grasp from where the hand comes."""
        if not grasps:
            return ()
        Ts, which = self.placed(grasps)
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
            ledger.add(f"{arm_called(name)}: {_STIFF}", *self.placed(stiff), every)

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
            carried, grasps = self._tools.gripper_of[found.prototype[some]], []
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
        tools = self._tools
        places = SE3(found.Ts).apply(tools.hands.grip_points[found.prototype])
        return np.argsort(turns(places, self._config.region_size), kind="stable")

    def _chosen(self, grasps: Sequence[Grasp]) -> IntArray:
        """Rows of distinct grasps, spread over the object, best first."""
        Ts, which = self.placed(grasps)
        places = SE3(Ts).apply(self._tools.hands.grip_points[which])
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
        prototype = self._prototypes[found.prototype[index]]
        T_base_hand = SE3(found.Ts[index])
        retreat = SE3.from_parts(p=(0.0, 0.0, -self._config.clearance.approach))
        success = self._tools.success.forecast(
            success_terms(
                expected=found.expected[index],
                contact=found.contact[index],
                demand=loads.demand[index, 1],
                lever=loads.lever[index],
                margin=found.margin[index],
                slack=self._tools.hands.slack[found.prototype[index]],
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
