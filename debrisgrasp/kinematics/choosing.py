"""Choose, for each pose of a palm, a posture that touches nothing."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, Rng
from debrisgrasp.geometry import SE3, so3

from .chain import KinematicChain
from .collision import ArmCollision, Distance
from .following import follow
from .ik import solve, solve_distinct
from .ik_types import IkStatus
from .posture import PostureCost, self_motions
from .reach_map import ReachMap
from .reach_types import HITS_ITSELF, HITS_SCENE, WORDS, ReachConfig, ReachResult

__all__ = ["PostureChoice"]


@dataclass(frozen=True, eq=False, kw_only=True)
class PostureChoice:
    """What one arm chooses from, and by what."""

    chain: KinematicChain
    reach_map: ReachMap | None
    collision: ArmCollision
    q_present: FloatArray
    """Posture that solutions should be near, shape (d,)."""
    config: ReachConfig

    def reach(
        self,
        T_base_hand: SE3,
        distance: Distance,
        q_known: FloatArray | None,
        rng: Rng,
    ) -> ReachResult:
        """Find a collision-free posture for each palm pose; see `ArmReach.reach`."""
        found = self._look(*self._first(T_base_hand, q_known, rng), distance)
        for round_ in range(1, self.config.rounds):
            # What collides may have another posture that doesn't; what can't be
            # reached at all has none.
            open_poses = [
                i
                for i, reason in enumerate(found.reasons)
                if reason in (HITS_SCENE, HITS_ITSELF)
            ]
            if not open_poses:
                break
            again = self._look(
                *self.others(T_base_hand[open_poses], round_, rng), distance
            )
            found = found.improved(np.array(open_poses), again)
        for step in range(self.config.slides if self.chain.n_joints > 6 else 0):
            found = self._slid(found, T_base_hand, distance, 0.4 * 0.5**step, rng)
        return found

    def _slid(
        self,
        found: ReachResult,
        T_base_hand: SE3,
        distance: Distance,
        length: float,
        rng: Rng,
    ) -> ReachResult:
        """Move within the nullspace by steps [rad] of which only cheaper ones stay."""
        rows = np.flatnonzero(found.is_reached)
        if not len(rows):
            return found
        chain, q, n = self.chain, found.joints[rows], len(rows)
        now = self._cost(chain, q, self.q_present, found.clearance[rows])
        start = chain.clipped(q + self_motions(chain, q, length))
        poses = np.broadcast_to(T_base_hand.matrix[rows], (len(start), n, 4, 4))
        near = follow(
            chain,
            SE3(poses.reshape(-1, 4, 4)),
            start.reshape(-1, chain.n_joints),
            rng=rng,
            config=self.config.ik,
        ).reshaped((len(start), n))
        # Only a posture that the descent kept nearby is the same one, moved.
        is_near = np.abs(chain.difference(near.q, q)).max(axis=-1) < 2.0 * length
        moved, is_open = near.q.swapaxes(0, 1), (near.is_solved & is_near).T
        clearance = np.full(is_open.shape, -np.inf)
        clearance[is_open] = self.collision.scene_clearance(moved[is_open], distance)
        is_open &= clearance >= self.config.margin
        choice = self.cheapest(moved, clearance, is_open, now - 1e-6)
        better = np.flatnonzero(choice >= 0)
        joints, all_clearance = found.joints.copy(), found.clearance.copy()
        joints[rows[better]] = moved[better, choice[better]]
        all_clearance[rows[better]] = clearance[better, choice[better]]
        return replace(found, joints=joints, clearance=all_clearance)

    def _look(self, q: FloatArray, status: IntArray, distance: Distance) -> ReachResult:
        """Choose from postures (k, n, d) with `IkStatus` (k, n).

        The first says why there is none.
        """
        is_solved = status == IkStatus.SOLVED
        clearance = np.full(is_solved.shape, -np.inf)
        clearance[is_solved] = self.collision.scene_clearance(q[is_solved], distance)
        is_clear = clearance >= self.config.margin
        choice = self.cheapest(q, clearance, is_clear, np.full(len(q), np.inf))
        is_reached = choice >= 0
        reasons = np.array([WORDS[IkStatus(code)] for code in status[:, 0]], object)
        reasons[is_solved.any(axis=1)] = HITS_SCENE
        reasons[is_clear.any(axis=1)] = HITS_ITSELF
        reasons[is_reached] = WORDS[IkStatus.SOLVED]
        shown = np.where(is_reached, choice, clearance.argmax(axis=1))
        rows = np.arange(len(q))
        best = clearance[rows, shown]
        return ReachResult(
            joints=np.where(is_reached[:, None], q[rows, shown], np.nan),
            is_reached=is_reached,
            reasons=tuple(map(str, reasons)),
            clearance=np.where(np.isfinite(best), best, np.nan),
        )

    def _first(
        self, T_base_hand: SE3, q_known: FloatArray | None, rng: Rng
    ) -> tuple[FloatArray, IntArray]:
        """Postures that are looked at first, (k, n, d), and their `IkStatus` (k, n)."""
        config = self.config.ik
        near = solve(
            self.chain,
            T_base_hand,
            q_seed=self.q_present,
            reach_map=self.reach_map,
            rng=rng,
            config=config,
        )
        if q_known is None:
            return near.q[:, None], near.status[:, None]
        known, takes = self.chain.clipped(q_known), np.zeros(len(near.q), dtype=bool)
        rows = np.flatnonzero(np.isfinite(q_known).all(axis=1))
        left = self.chain.fk(known[rows]).inverse() @ T_base_hand[rows]
        takes[rows] = np.linalg.norm(left.p, axis=-1) <= config.position_tolerance
        turned = np.linalg.norm(so3.log(left.R), axis=-1)
        takes[rows] &= turned <= config.rotation_tolerance
        known = np.where(takes[:, None], known, near.q)
        status = np.where(takes, IkStatus.SOLVED, IkStatus.STALLED)
        return np.stack([near.q, known], axis=1), np.stack([near.status, status], 1)

    def others(
        self, T_base_hand: SE3, round_: int, rng: Rng
    ) -> tuple[FloatArray, IntArray]:
        """Further postures, other ones in every round; see `_first`."""
        config, n = self.config, self.config.n_postures
        others = solve_distinct(
            self.chain,
            T_base_hand,
            n,
            reach_map=self.reach_map,
            n_seeds_used=(round_ - 1) * n,
            rng=rng,
            config=config.ik,
        )
        return others.q, others.status

    def cheapest(
        self,
        q: FloatArray,
        clearance: FloatArray,
        is_open: BoolArray,
        below: FloatArray,
    ) -> IntArray:
        """Index of the cheapest posture that doesn't touch the robot, or -1; (k,).

        Of postures (k, n, d), those that are open (k, n) and cost less than ``below``
        (k,).
        """
        cost = np.full(is_open.shape, np.inf)
        cost[is_open] = self._cost(
            self.chain, q[is_open], self.q_present, clearance[is_open]
        )
        cost[cost >= below[:, None]] = np.inf
        rows, first = np.arange(len(q)), cost.argmin(axis=1)
        asked = np.flatnonzero(np.isfinite(cost[rows, first]))
        hits = asked[self.collision.hits_itself(q[asked, first[asked]])]
        # The cheapest is mostly free; only where it isn't the others are tested.
        cost[hits, first[hits]] = np.inf
        others = np.isfinite(cost) & np.isin(rows, hits)[:, None]
        if others.any():
            is_hit = self.collision.hits_itself(q[others])
            cost[others] = np.where(is_hit, np.inf, cost[others])
        choice = cost.argmin(axis=1)
        return np.where(np.isfinite(cost[rows, choice]), choice, -1)

    @cached_property
    def _cost(self) -> PostureCost:
        config = self.config
        return PostureCost(
            limit_weight=config.limit_weight,
            singularity_weight=config.singularity_weight,
            free_dexterity=config.free_dexterity,
            scene_weight=config.scene_weight,
        )
