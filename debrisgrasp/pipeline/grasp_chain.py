"""The chain of motions of one grasp: to the pre-grasp, straight in, and up."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from debrisgrasp._arrays import FloatArray, Rng, require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp._stopwatch import Stopwatch
from debrisgrasp.control import CartesianLeg, LegPlan, LegPlanner
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import ArmReach, DeflectionLimits, Trajectory
from debrisgrasp.motion import MotionConfig, MotionPlan, MotionPlanner, MotionSpace
from debrisgrasp.planning import Grasp

from .passage import Passage

__all__ = ["GraspChain", "GraspMotion", "MotionsConfig", "Ready"]

_RETREAT = 0.15
"""How far the hand goes along the retreat of a grasp [m]."""
_LEAST_STAND_OFF = 0.06
"""Shortest straight approach that is tried [m]."""
_SHORT = 20
"""Rounds of search for the way to one posture; more are spent on all at once."""
_LONG = 3
"""So many times as hard as for one motion is a way sought then."""
_ENOUGH = 4
"""Postures of one grasp that wait for that search."""
_EVERY = 0.008
"""Spacing of the poses of the hand that are looked at along a leg [m]."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class MotionsConfig:
    """What the chain of motions is."""

    motion: MotionConfig = MotionConfig()
    lift: tuple[float, float, float] | None = (0.0, 0.0, 0.15)
    """Way of the hand after it has gripped, base frame [m]; None for 15 cm along the
    retreat of the grasp."""
    speed: float = 0.1
    """Of the hand on approach and lift [m/s]."""
    clamp: DeflectionLimits | None = None
    """How far the controller lets the hand be pushed aside; None: by its limits."""
    tries: int = 12
    """Postures at the pre-grasp from which approach and lift are tried."""

    def __post_init__(self) -> None:
        require_range("MotionsConfig.speed [m/s]", self.speed, 1e-3, 2.0)
        require_range("MotionsConfig.tries", self.tries, 1, 1000)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GraspMotion:
    """One grasp, and the motions that carry it out."""

    grasp: Grasp
    index: int
    """Its place in the plan."""
    arm: str
    reach: MotionPlan
    """From the present posture to the pre-grasp."""
    approach: LegPlan
    lift: LegPlan

    @property
    def trajectories(self) -> Mapping[str, Trajectory]:
        """Motions in their order, by name."""
        assert self.reach.trajectory is not None
        return {
            "reach": self.reach.trajectory,
            "approach": self.approach.trajectory,
            "lift": self.lift.trajectory,
        }


@dataclass(frozen=True, slots=True, eq=False)
class Ready:
    """A grasp and how it goes on from a posture at its pre-grasp."""

    grasp: Grasp
    index: int
    approach: LegPlan
    lift: LegPlan

    @property
    def q_pregrasp(self) -> FloatArray:
        """Where the approach begins, shape (d,)."""
        q: FloatArray = self.approach.q[0]
        return q


class GraspChain:
    """Plans the chain of motions for one arm, its fingers as they are on the way in."""

    def __init__(
        self,
        arm: ArmReach,
        space: MotionSpace,
        passage: Passage | None,
        config: MotionsConfig,
        known: FloatArray | None,
    ) -> None:
        """Prepare for all grasps that leave the fingers the same on the way in."""
        family = arm.robot.limits(arm.name, arm.chain)
        self._arm, self._space, self._config = arm, space, config
        self._passage, self._known = passage, known
        self._planner = MotionPlanner.of_arm(arm, config=config.motion)
        self._legs = LegPlanner(arm.chain, family.planner, speed=config.speed)
        # The margins of a leg are the controller's to use.
        clamp = config.clamp or family.controller.deflection
        pushed = replace(family.controller, deflection=clamp)
        self._pushed = LegPlanner(arm.chain, pushed, speed=config.speed)
        self._is_free: Callable[[FloatArray], np.ndarray] = self._planner.exact_test(
            space, with_hand=False
        ).is_free
        self.waiting: list[Ready] = []
        """To which a short search found no way."""

    def motion(
        self, grasp: Grasp, index: int, rng: Rng, watch: Stopwatch
    ) -> GraspMotion | str:
        """Plan the chain of a grasp, or say what stops it.

        Where it can't be done, a shorter straight approach may still do.
        """
        first = self._lift_fault(grasp)
        if first:
            return first
        for standing_off in _stand_offs(grasp):
            found = self._motion(standing_off, index, rng, watch)
            if isinstance(found, GraspMotion):
                return found
            first = first or found
            is_waiting = any(one.index == index for one in self.waiting)
            if is_waiting or watch.is_late():
                break
        return first

    def sought(self, rng: Rng, share: float, watch: Stopwatch) -> GraspMotion | str:
        """Seek a way to any of the grasps that wait: one tree serves them all.

        Parameters
        ----------
        share
            Of the effort that is worth while for all chains, in [0, 1].
        watch
            The search gives up at its deadline.
        """
        rounds = self._config.motion.max_rounds
        rounds = max(round(_LONG * rounds * share), rounds)
        return self._reached(self.waiting, rng, rounds, _left(watch))

    def drop(self, indices: Collection[int]) -> None:
        """Wait no more for some grasps."""
        self.waiting = [one for one in self.waiting if one.index not in indices]

    def _motion(
        self, grasp: Grasp, index: int, rng: Rng, watch: Stopwatch
    ) -> GraspMotion | str:
        """Plan the chain of a grasp from its pre-grasp, or say what stops it."""
        reason = self._approach_fault(grasp)
        if reason:
            return reason
        postures, free = self._pregrasps(grasp, rng)
        if len(postures) and not len(free):
            return "approach: the arm touches something after 0% of the way"
        n_waiting = 0
        for q_pregrasp in free:
            legs = self._legs_from(q_pregrasp, grasp)
            if isinstance(legs, str):
                reason = reason or legs
                continue
            ready = Ready(grasp, index, *legs)
            found = self._reached([ready], rng, _SHORT)
            if isinstance(found, GraspMotion):
                return found
            self.waiting.append(ready)
            n_waiting, reason = n_waiting + 1, found
            if n_waiting == _ENOUGH or watch.is_late():
                break
        if reason:
            return reason
        # No posture at all: the planner knows why.
        q_now, goal = self._arm.q_present, grasp.T_base_pregrasp
        reach = self._planner.plan(
            q_now, goal, self._space, rng=rng, deadline=_left(watch)
        )
        return f"reach: {reach.reason}"

    def _reached(
        self,
        ready: Sequence[Ready],
        rng: Rng,
        rounds: int,
        deadline: float | None = None,
    ) -> GraspMotion | str:
        """Plan from where the arm stands to where any of some approaches begins."""
        goals = np.array([one.q_pregrasp for one in ready])
        reach = self._planner.plan(
            self._arm.q_present,
            goals,
            self._space,
            rng=rng,
            known=self._known,
            max_rounds=rounds,
            deadline=deadline,
        )
        if reach.trajectory is None:
            return f"reach: {reach.reason}"
        away = np.abs(goals - reach.trajectory.q[-1]).max(axis=1)
        one = ready[int(away.argmin())]
        return GraspMotion(
            grasp=one.grasp,
            index=one.index,
            arm=self._arm.name,
            reach=reach,
            approach=one.approach,
            lift=one.lift,
        )

    def _pregrasps(self, grasp: Grasp, rng: Rng) -> tuple[FloatArray, FloatArray]:
        """Postures at the pre-grasp, all and those to try in which nothing is touched.

        The one that backs out of the grasp is the first.
        """
        chain, limits = self._arm.chain, self._legs.limits
        found = []
        q_grasp = chain.vector(grasp.joints or {})
        if not limits.violation(q_grasp):
            back = self._legs.plan(q_grasp, grasp.T_base_pregrasp)
            if back.is_done and not limits.violation(back.q[-1]):
                found.append(back.q[-1])
        others = self._planner.goal_postures(
            self._arm.q_present, grasp.T_base_pregrasp, rng=rng
        )
        postures = np.array([*found, *others]).reshape(-1, chain.n_joints)
        return postures, postures[self._is_free(postures)][: self._config.tries]

    def _legs_from(
        self, q_pregrasp: FloatArray, grasp: Grasp
    ) -> tuple[LegPlan, LegPlan] | str:
        """Approach and lift from a posture at the pre-grasp, or what stops them."""
        approach = self._leg("approach", q_pregrasp, grasp.T_base_hand)
        if isinstance(approach, str):
            return approach
        way = _lift_of(grasp, self._config)
        T_base_lifted = CartesianLeg.along(approach.reached, way).goal
        name = f"lift by {np.linalg.norm(way):.2g} m"
        lift = self._leg(name, approach.q[-1], T_base_lifted)
        if isinstance(lift, str):
            return lift
        return approach, lift

    def _approach_fault(self, grasp: Grasp) -> str:
        """Say what the hand runs into on its straight way in, or nothing."""
        if self._passage is None:
            return ""
        leg = CartesianLeg(grasp.T_base_pregrasp, grasp.T_base_hand)
        fault = self._passage.approach_fault(grasp, _poses(leg))
        return f"approach: {fault} of the way" if fault else ""

    def _lift_fault(self, grasp: Grasp) -> str:
        """Say what closed hand or held object run into on the lift, or nothing."""
        if self._passage is None:
            return ""
        leg = CartesianLeg.along(grasp.T_base_hand, _lift_of(grasp, self._config))
        fault = self._passage.lift_fault(grasp, _poses(leg))
        return f"lift: {fault} of the way" if fault else ""

    def _leg(self, name: str, q_start: FloatArray, goal: SE3) -> LegPlan | str:
        leg = self._legs.plan(q_start, goal)
        if leg.reason:
            return f"{name}: {leg.reason}"
        blocked = np.flatnonzero(~self._is_free(leg.q))
        if len(blocked):
            share = blocked[0] / max(1, len(leg.q) - 1)
            return f"{name}: the arm touches something after {share:.0%} of the way"
        reason = self._pushed.margin_fault(leg)
        return f"{name}: {reason}" if reason else leg


def _left(watch: Stopwatch) -> float | None:
    """Seconds that a search has: a trifle where the deadline has passed."""
    left = watch.left()
    return None if left is None else max(left, 1e-3)


def _lift_of(grasp: Grasp, config: MotionsConfig) -> FloatArray:
    """Way of the hand with the object [m], base frame, shape (3,)."""
    if config.lift is not None:
        return np.array(config.lift)
    up = (0.0, 0.0, 1.0)
    return _RETREAT * np.array(grasp.retreat.direction if grasp.retreat else up)


def _stand_offs(grasp: Grasp) -> list[Grasp]:
    """Return the grasp as it is, and with half its stand-off if that is enough."""
    if grasp.approach_distance < 2 * _LEAST_STAND_OFF:
        return [grasp]
    half = 0.5 * (grasp.T_base_pregrasp.p - grasp.T_base_hand.p)
    nearer = SE3.from_parts(p=half) @ grasp.T_base_hand
    return [grasp, replace(grasp, T_base_pregrasp=nearer)]


def _poses(leg: CartesianLeg) -> SE3:
    """Poses of the hand along a leg, a few millimetres apart, first and last."""
    n = max(int(np.ceil(leg.length / _EVERY)), 1)
    poses = [leg.at(k / n) for k in range(n + 1)]
    return SE3(
        np.stack(
            [
                SE3.from_parts(np.reshape(R, (3, 3)), np.array(p)).matrix
                for R, p in poses
            ]
        )
    )
