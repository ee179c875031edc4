"""Can this arm take these grasps, and how? What the planner asks of the kinematics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, Rng, require_trailing
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import SE3

from .chain import KinematicChain
from .collision import ArmCollision, Distance
from .descent import Goals
from .ik import solve, solve_distinct
from .ik_types import IkConfig, IkStatus
from .posture import PostureCost, self_motions
from .reach_files import cached_reach_map
from .reach_map import ReachMap
from .robot import RobotModel

__all__ = ["ArmReach", "ReachConfig", "ReachResult"]

_OK = ""
_WORDS = {
    IkStatus.SOLVED: _OK,
    IkStatus.UNREACHABLE: "out of reach",
    IkStatus.LIMIT: "joint limit",
    IkStatus.STALLED: "no posture found",
    IkStatus.BUDGET: "no posture found",
}
_HITS_SCENE = "arm hits the scene"
_HITS_ITSELF = "arm hits itself"


@dataclass(frozen=True, slots=True, kw_only=True)
class ReachConfig:
    """How hard to look for a posture, and which to prefer."""

    n_postures: int = 6
    """Postures looked at for each pose; more find a collision-free one more often."""
    rounds: int = 2
    """How often the poses without a free posture are looked at again."""
    margin: float = 0.01
    """Clearance from the scene that the links keep [m]."""
    self_margin: float = 0.005
    """Distance that the parts of the robot keep from one another [m]."""
    limit_weight: float = 1.0
    """Cost of a joint at its limit, in radians of travel; see `PostureCost`."""
    singularity_weight: float = 1.0
    """Cost of a singular posture, in radians of travel."""
    free_dexterity: float = 0.04
    """Smallest singular value of the Jacobian from which on a posture counts as free of
    singularities; see `dexterity`."""
    scene_weight: float = 0.5
    """Cost of a link that touches the scene, in radians of travel."""
    slides: int = 1
    """Steps in which a chain with more than six joints moves within its nullspace to
    where the posture costs less; 0 takes it as it was found."""
    ik: IkConfig = IkConfig(attempts=16)
    """Solver settings; seeds of the map make further attempts pointless."""

    def __post_init__(self) -> None:
        for name in ("n_postures", "rounds"):
            if getattr(self, name) < 1:
                raise ConfigError(
                    f"ReachConfig.{name}", got=getattr(self, name), expected="1 or more"
                )
        if self.slides < 0 or not self.free_dexterity > 0:
            raise ConfigError(
                "ReachConfig.slides, free_dexterity",
                got=(self.slides, self.free_dexterity),
                expected="0 or more, above zero",
            )
        for name in (
            "margin",
            "self_margin",
            "limit_weight",
            "singularity_weight",
            "scene_weight",
        ):
            if not getattr(self, name) >= 0:
                raise ConfigError(
                    f"ReachConfig.{name}", got=getattr(self, name), expected="0 or more"
                )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ReachResult:
    """For each of k poses: the posture that takes it, or why there is none."""

    joints: FloatArray
    """Joint values [rad or m], shape (k, d); NaN where not reached."""
    is_reached: BoolArray
    """Taken within limits, clear of scene and robot; shape (k,)."""
    reasons: tuple[str, ...]
    """Why a pose is not reached, empty where it is; k of them."""
    clearance: FloatArray
    """Distance between links and scene [m], shape (k,); NaN where no posture."""

    def improved(self, rows: IntArray, other: ReachResult) -> ReachResult:
        """Take over what another result for some of the poses has reached."""
        better = np.flatnonzero(other.is_reached)
        joints, clearance = self.joints.copy(), self.clearance.copy()
        is_reached, reasons = self.is_reached.copy(), list(self.reasons)
        joints[rows[better]] = other.joints[better]
        clearance[rows[better]] = other.clearance[better]
        is_reached[rows[better]] = True
        for row in rows[better]:
            reasons[row] = _OK
        return ReachResult(
            joints=joints,
            is_reached=is_reached,
            reasons=tuple(reasons),
            clearance=clearance,
        )


@dataclass(frozen=True, eq=False)
class ArmReach:
    """One arm of a robot, ready to answer for palm poses."""

    robot: RobotModel
    name: str
    """Name of the arm."""
    config: ReachConfig = ReachConfig()
    locked: Mapping[str, float] | None = None
    """Joints of the arm to hold still, for instance ``{"torso_joint": 0.0}``."""
    present: Mapping[str, float] | None = None
    """Joint values that the arm has now; None for the robot's ``present`` posture."""

    @property
    def gripper(self) -> str:
        """Name of the gripper that the arm carries."""
        return self.robot.arm(self.name).gripper

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the d joints, base to tip."""
        return self.chain.joint_names

    @cached_property
    def chain(self) -> KinematicChain:
        """Chain from base to palm."""
        return self.robot.chain(self.name, self.locked)

    @cached_property
    def reach_map(self) -> ReachMap | None:
        """Map of the chain, or None if it has a prismatic end joint."""
        if self.chain.is_revolute[0] and self.chain.is_revolute[-1]:
            return cached_reach_map(self.chain)
        return None

    @cached_property
    def collision(self) -> ArmCollision:
        """Collision tests of the arm, the rest of the robot held."""
        return ArmCollision.fit(
            self.robot,
            self.name,
            self.chain,
            held=self.locked,
            self_margin=self.config.self_margin,
        )

    @cached_property
    def q_present(self) -> FloatArray:
        """Posture that solutions should be near, shape (d,)."""
        values = self.present
        if values is None:
            spec = self.robot.arm(self.name)
            values = self.robot.posture(self.name, spec.present)
        return self.chain.clipped(self.chain.vector(values))

    def may_reach(self, T_base_hand: SE3) -> BoolArray:
        """Tell quickly which palm poses (k,) the map doesn't rule out, shape (k,)."""
        if self.reach_map is None:
            return np.ones(len(T_base_hand.matrix), dtype=bool)
        goals = Goals.from_matrices(self.chain.form, T_base_hand.matrix)
        return self.reach_map.may_reach(goals)

    def solves(self, T_base_hand: SE3, *, rng: Rng) -> BoolArray:
        """Tell which palm poses (k,) have a posture at all, collision aside, (k,)."""
        found = solve(
            self.chain,
            T_base_hand,
            reach_map=self.reach_map,
            rng=rng,
            config=self.config.ik,
        )
        return found.is_solved

    def reach(self, T_base_hand: SE3, distance: Distance, *, rng: Rng) -> ReachResult:
        """Find a collision-free posture for each palm pose.

        Of the postures found, those free of collision with scene and robot are kept,
        and of them the one nearest to the present posture and far from limits.

        Parameters
        ----------
        T_base_hand
            Palm poses, shape (k,).
        distance
            Distance of points in base to the nearest obstacle; see `Distance`. The
            hand's own links are not tested against it.
        rng
            Source of the random seeds.
        """
        require_trailing(T_base_hand.matrix, "palm poses", (None, 4, 4))
        found = self._look(T_base_hand, distance, 0, rng)
        for round_ in range(1, self.config.rounds):
            # What collides may have another posture that doesn't; what can't be
            # reached at all has none.
            open_poses = [
                i
                for i, reason in enumerate(found.reasons)
                if reason in (_HITS_SCENE, _HITS_ITSELF)
            ]
            if not open_poses:
                break
            again = self._look(T_base_hand[open_poses], distance, round_, rng)
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
        chain, q = self.chain, found.joints[rows]
        clearance = found.clearance[rows]
        cost = self._cost(chain, q, self.q_present, clearance)
        for direction in self_motions(chain, q, length):
            near = solve(
                chain,
                T_base_hand[rows],
                q_seed=chain.clipped(q + direction),
                rng=rng,
                config=replace(self.config.ik, attempts=1),
            )
            # Only a posture that the descent kept nearby is the same one, moved.
            is_near = np.abs(chain.difference(near.q, q)).max(axis=-1) < 2.0 * length
            trial = np.flatnonzero(near.is_solved & is_near)
            q_new = near.q[trial]
            clearance_new = self.collision.scene_clearance(q_new, distance)
            cost_new = self._cost(chain, q_new, self.q_present, clearance_new)
            is_better = cost_new < cost[trial] - 1e-6
            is_better &= clearance_new >= self.config.margin
            is_better[is_better] = ~self.collision.hits_itself(q_new[is_better])
            kept = trial[is_better]
            q[kept], cost[kept] = q_new[is_better], cost_new[is_better]
            clearance[kept] = clearance_new[is_better]
        joints, all_clearance = found.joints.copy(), found.clearance.copy()
        joints[rows], all_clearance[rows] = q, clearance
        return replace(found, joints=joints, clearance=all_clearance)

    def _look(
        self, T_base_hand: SE3, distance: Distance, round_: int, rng: Rng
    ) -> ReachResult:
        """Try ``n_postures`` postures of each pose (k,), others in every round."""
        q, status = self._postures(T_base_hand, round_, rng)
        is_solved = status == IkStatus.SOLVED
        clearance = np.full(is_solved.shape, -np.inf)
        clearance[is_solved] = self.collision.scene_clearance(q[is_solved], distance)
        is_clear = clearance >= self.config.margin
        choice = self._choose(q, clearance, is_clear)
        is_reached = choice >= 0
        reasons = np.array([_WORDS[IkStatus(code)] for code in status[:, 0]], object)
        reasons[is_solved.any(axis=1)] = _HITS_SCENE
        reasons[is_clear.any(axis=1)] = _HITS_ITSELF
        reasons[is_reached] = _OK
        shown = np.where(is_reached, choice, clearance.argmax(axis=1))
        rows = np.arange(len(q))
        best = clearance[rows, shown]
        return ReachResult(
            joints=np.where(is_reached[:, None], q[rows, shown], np.nan),
            is_reached=is_reached,
            reasons=tuple(map(str, reasons)),
            clearance=np.where(np.isfinite(best), best, np.nan),
        )

    def _postures(
        self, T_base_hand: SE3, round_: int, rng: Rng
    ) -> tuple[FloatArray, IntArray]:
        """Postures (k, n, d) and their `IkStatus` (k, n); the best status first."""
        config, chain, n = self.config, self.chain, self.config.n_postures
        if round_:
            others = solve_distinct(
                chain,
                T_base_hand,
                n,
                reach_map=self.reach_map,
                n_seeds_used=round_ * n,
                rng=rng,
                config=config.ik,
            )
            return others.q, others.status
        near = solve(
            chain,
            T_base_hand,
            q_seed=self.q_present,
            reach_map=self.reach_map,
            rng=rng,
            config=config.ik,
        )
        q = np.repeat(near.q[:, None], n, axis=1)
        status = np.repeat(near.status[:, None], n, axis=1)
        again = np.flatnonzero(near.is_solved)
        if n > 1 and len(again):
            others = solve_distinct(
                chain,
                T_base_hand[again],
                n - 1,
                reach_map=self.reach_map,
                rng=rng,
                config=config.ik,
            )
            q[again, 1:], status[again, 1:] = others.q, others.status
        return q, status

    def _choose(
        self, q: FloatArray, clearance: FloatArray, is_clear: BoolArray
    ) -> IntArray:
        """Index of the cheapest posture that doesn't touch the robot, or -1; (k,)."""
        is_free = is_clear.copy()
        is_free[is_clear] = ~self.collision.hits_itself(q[is_clear])
        cost = np.full(is_free.shape, np.inf)
        cost[is_free] = self._cost(
            self.chain, q[is_free], self.q_present, clearance[is_free]
        )
        return np.where(is_free.any(axis=1), cost.argmin(axis=1), -1)

    @cached_property
    def _cost(self) -> PostureCost:
        config = self.config
        return PostureCost(
            limit_weight=config.limit_weight,
            singularity_weight=config.singularity_weight,
            free_dexterity=config.free_dexterity,
            scene_weight=config.scene_weight,
        )
