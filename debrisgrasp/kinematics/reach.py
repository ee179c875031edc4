"""Can this arm take these grasps, and how? What the planner asks of the kinematics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, Rng, require_trailing
from debrisgrasp._checked import checked, checked_fields
from debrisgrasp.geometry import SE3

from .chain import KinematicChain
from .choosing import PostureChoice
from .collision import ArmCollision, Distance
from .descent import Goals
from .following import follow
from .ik import solve
from .ik_types import IkStatus
from .leeway import leeway
from .limits import LimitFamily
from .reach_files import cached_reach_map
from .reach_map import ReachMap
from .reach_types import ReachConfig, ReachResult
from .robot import RobotModel

__all__ = ["ArmReach"]

_OUTWARDS = 2.5
"""So many deflections from the edge of the map, an arm mostly gives way."""


@checked_fields
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

    def __post_init__(self) -> None:
        self.robot.arm(self.name)

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
        """Map of the chain, or None if there is none for it; see `ReachMap.build`."""
        return cached_reach_map(self.chain) if ReachMap.suits(self.chain) else None

    @cached_property
    def collision(self) -> ArmCollision:
        """Collision tests of the arm, the rest of the robot held."""
        held, margin = self.locked, self.config.self_margin
        return ArmCollision.fit(
            self.robot, self.name, self.chain, held=held, self_margin=margin
        )

    @cached_property
    def q_present(self) -> FloatArray:
        """Posture that solutions should be near, shape (d,)."""
        values = self.present
        if values is None:
            spec = self.robot.arm(self.name)
            values = self.robot.posture(self.name, spec.present)
        return self.chain.clipped(self.chain.vector(values))

    @cached_property
    def _limits(self) -> LimitFamily:
        return self.robot.limits(self.name, self.chain)

    @property
    def wrench_limits(self) -> tuple[float, float]:
        """Largest force [N] and torque [N m] at the hand."""
        limits = self._limits.planner
        return limits.force, limits.torque

    def effort(self, joints: FloatArray, wrench_hand: FloatArray) -> FloatArray:
        """Share of a joint's torque that wrenches on the hand take, the largest, (k,).

        The weight of the arm itself is not counted, nor are joints whose limit the
        robot's file does not give.

        Parameters
        ----------
        joints
            Postures [rad or m], shape (k, d).
        wrench_hand
            Force [N] and torque about the palm [N m], palm frame, shape (k, 6).
        """
        tree = self.robot.tree
        most = np.array([tree.joints[name].effort for name in self.joint_names])
        torque = (wrench_hand[:, None] @ self.chain.jacobian(joints))[:, 0]
        share: FloatArray = np.abs(torque / most).max(axis=1, initial=0.0)
        return share

    @checked
    def may_reach(self, T_base_hand: SE3) -> BoolArray:
        """Tell quickly which palm poses (...) the map doesn't rule out, shape (...)."""
        batch, T = T_base_hand.batch, T_base_hand.matrix.reshape(-1, 4, 4)
        if self.reach_map is None:
            return np.ones(batch, dtype=bool)
        goals = Goals.from_matrices(self.chain.form, T)
        return self.reach_map.may_reach(goals).reshape(batch)

    @checked
    def may_yield(self, T_base_hand: SE3) -> BoolArray:
        """Tell quickly which palm poses (...) may leave room to give way, shape (...).

        Not those from which a step outwards, away from the arm's first joint and some
        times as long as compliance gives way, leads beyond the map.
        """
        pushed = T_base_hand.matrix.copy()
        x, y = pushed[..., 0, 3], pushed[..., 1, 3]
        foot = self.chain.form.T_base_first[:2, 3]
        outwards = _OUTWARDS * self._limits.controller.deflection.translation
        step = outwards / np.maximum(np.hypot(x - foot[0], y - foot[1]), 1e-9)
        x += step * (x - foot[0])
        y += step * (y - foot[1])
        return self.may_reach(SE3(pushed))

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

    def follow(self, T_base_hand: SE3, q_before: FloatArray, *, rng: Rng) -> FloatArray:
        """Postures for palm poses (k,), collision aside, from those (k, d) nearby.

        NaN where none is found, and where none is known beforehand; see `follow`.
        """
        found = follow(
            self.chain,
            T_base_hand,
            q_before,
            reach_map=self.reach_map,
            rng=rng,
            config=self.config.ik,
        )
        return np.where(found.is_solved[:, None], found.q, np.nan)

    @checked
    def leeway(
        self, joints: FloatArray, T_base_hand: SE3, Ts_base_away: SE3, *, rng: Rng
    ) -> FloatArray:
        """Share of the pushes that the hand can give way to, shape (k,); see `leeway`.

        Parameters
        ----------
        joints, T_base_hand, Ts_base_away
            Postures (k, d) at palm poses (k,), and places (k, w) that the hand comes
            from or goes to in a straight line.
        """
        return leeway(
            self.chain,
            joints,
            T_base_hand,
            Ts_base_away,
            self._limits.controller.deflection,
            rng=rng,
            config=self.config.ik,
        )

    @checked
    def yielding(
        self,
        T_base_hand: SE3,
        Ts_base_away: SE3,
        distance: Distance,
        least: float,
        *,
        rng: Rng,
    ) -> FloatArray:
        """Cheapest of the postures (k, d) that are clear of all and give way enough.

        ``least`` is their `leeway`; NaN where there is none.
        """
        q, status = self._choice.others(T_base_hand, 1, rng)
        is_open, clearance = status == IkStatus.SOLVED, np.full(status.shape, -np.inf)
        clearance[is_open] = self.collision.scene_clearance(q[is_open], distance)
        is_open &= clearance >= self.config.margin
        row = np.nonzero(is_open)[0]
        way = T_base_hand[row], Ts_base_away[row]
        is_open[is_open] = self.leeway(q[is_open], *way, rng=rng) >= least
        choice = self._choice.cheapest(q, clearance, is_open, np.full(len(q), np.inf))
        found = q[np.arange(len(q)), choice]
        return np.where(choice[:, None] >= 0, found, np.nan)

    @checked
    def reach(
        self,
        T_base_hand: SE3,
        distance: Distance,
        *,
        q_known: FloatArray | None = None,
        rng: Rng,
    ) -> ReachResult:
        """Find a collision-free posture for each palm pose.

        The posture that a descent from the present one leads to is looked at first, and
        the one that is known; others only where neither is free. Of those free of
        collision with scene and robot the one nearest to the present posture and far
        from limits is taken.

        Parameters
        ----------
        T_base_hand
            Palm poses, shape (k,).
        distance
            Distance of points in base to the nearest obstacle; see `Distance`. The
            hand's own links are not tested against it.
        q_known
            Postures that take the poses, collision aside, shape (k, d); rows of NaN
            where none is known. One that doesn't take its pose counts as not known.
        rng
            Source of the random seeds.
        """
        require_trailing(T_base_hand.matrix, "palm poses", (None, 4, 4))
        return self._choice.reach(T_base_hand, distance, q_known, rng)

    @cached_property
    def _choice(self) -> PostureChoice:
        return PostureChoice(
            chain=self.chain,
            reach_map=self.reach_map,
            collision=self.collision,
            q_present=self.q_present,
            config=self.config,
        )
