"""Can this arm take these grasps, and how? What the planner asks of the kinematics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
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
from .reach_map import ReachMap
from .robot import RobotModel

__all__ = ["ArmReach", "ReachConfig", "ReachResult"]

_LIMIT_ZONE = 0.05
"""Part of a joint's range, at either end, that postures rather avoid."""
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
    """Cost of coming near a joint limit, against one radian of travel."""
    ik: IkConfig = IkConfig(attempts=16)
    """Solver settings; seeds of the map make further attempts pointless."""

    def __post_init__(self) -> None:
        for name in ("n_postures", "rounds"):
            if getattr(self, name) < 1:
                raise ConfigError(
                    f"ReachConfig.{name}", got=getattr(self, name), expected="1 or more"
                )
        for name in ("margin", "self_margin", "limit_weight"):
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
            return ReachMap.build(self.chain)
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
        return found

    def _look(
        self, T_base_hand: SE3, distance: Distance, round_: int, rng: Rng
    ) -> ReachResult:
        """Try ``n_postures`` postures of each pose (k,), others in every round."""
        q, status = self._postures(T_base_hand, round_, rng)
        is_solved = status == IkStatus.SOLVED
        clearance = np.full(is_solved.shape, -np.inf)
        clearance[is_solved] = self.collision.scene_clearance(q[is_solved], distance)
        is_clear = clearance >= self.config.margin
        choice = self._choose(q, is_clear)
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

    def _choose(self, q: FloatArray, is_clear: BoolArray) -> IntArray:
        """Index of the cheapest posture that doesn't touch the robot, or -1; (k,)."""
        is_free = is_clear.copy()
        is_free[is_clear] = ~self.collision.hits_itself(q[is_clear])
        cost = np.where(is_free, self._cost(q), np.inf)
        return np.where(is_free.any(axis=1), cost.argmin(axis=1), -1)

    def _cost(self, q: FloatArray) -> FloatArray:
        """Travel from the present posture [rad], plus nearness to limits; (k, n)."""
        chain, is_bounded = self.chain, np.isfinite(self.chain.lower)
        # Joints with limits can't take the short way round, even if it would fit.
        gap = np.where(
            is_bounded, q - self.q_present, chain.difference(q, self.q_present)
        )
        lower, upper = chain.lower[is_bounded], chain.upper[is_bounded]
        inner = q[..., is_bounded]
        edge = np.minimum(inner - lower, upper - inner) / (upper - lower)
        nearness = np.maximum(0.0, 1.0 - edge / _LIMIT_ZONE).sum(axis=-1)
        travel = np.sqrt((gap * gap).sum(axis=-1))
        return np.asarray(travel + self.config.limit_weight * nearness)
