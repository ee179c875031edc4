"""The first grasp of a plan that can be carried out as a whole.

A grasp is worth nothing if the arm can't get to it, or is stuck once it holds the
object. For each grasp in turn the whole chain is planned: from the present posture to
the pre-grasp, the straight approach, and the straight lift. Approach and lift must also
be possible with the hand pushed aside as far as compliance lets it go.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray, Rng, require_range
from debrisgrasp._stopwatch import Progress, Stopwatch
from debrisgrasp.control import CartesianLeg, LegPlan, LegPlanner
from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import ArmReach, RobotModel, Trajectory
from debrisgrasp.motion import MotionConfig, MotionPlan, MotionPlanner, MotionSpace
from debrisgrasp.planning import Grasp, GraspPlan

__all__ = ["GraspMotion", "GraspMotions", "MotionsConfig", "first_executable"]


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionsConfig:
    """What the chain of motions is."""

    motion: MotionConfig = MotionConfig()
    lift: tuple[float, float, float] = (0.0, 0.0, 0.15)
    """Way of the hand after it has gripped, base frame [m]."""
    speed: float = 0.1
    """Of the hand on approach and lift [m/s]."""
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


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GraspMotions:
    """The grasp to carry out, or why there is none."""

    chosen: GraspMotion | None
    passed_over: tuple[tuple[int, str], ...]
    """Grasps before it: place in the plan, and what stops them."""

    @property
    def why_none(self) -> str:
        """Why no grasp can be carried out; empty if one can."""
        if self.chosen is not None:
            return ""
        if not self.passed_over:
            return "the plan has no grasp"
        index, reason = self.passed_over[0]
        n = len(self.passed_over)
        return f"none of {n} grasps can be carried out; grasp {index + 1}: {reason}"


def first_executable(
    plan: GraspPlan,
    robot: RobotModel,
    space: MotionSpace,
    *,
    present: Mapping[str, float] | None = None,
    config: MotionsConfig | None = None,
    rng: Rng,
    deadline: float | None = None,
    progress: Progress | None = None,
) -> GraspMotions:
    """Find the first grasp of a plan whose whole chain of motions is feasible.

    Parameters
    ----------
    plan
        Grasps, best first, made for the robot.
    space
        Obstacles of the arm.
    present
        Joint values now [rad or m]; None: each arm stands in its present posture.
    deadline
        Seconds after which no further grasp is tried.
    """
    if deadline is not None and not deadline > 0:
        raise ConfigError(
            "deadline",
            got=f"{deadline} s",
            expected="a positive number of seconds, or none",
        )
    watch = Stopwatch(deadline, progress or (lambda _stage, _share: None))
    config = config or MotionsConfig()
    chains: dict[str, _Chain] = {}
    passed_over: list[tuple[int, str]] = []
    for index, grasp in enumerate(plan.grasps):
        if grasp.arm is None or grasp.joints is None:
            raise InputError(
                f"grasp {index + 1}",
                got="no arm",
                expected="one that an arm takes",
                mend="Plan with a robot rather than for a floating hand.",
            )
        if passed_over and watch.is_late():
            passed_over.append((index, "not tried: the deadline had passed"))
            continue
        if grasp.arm not in chains:
            arm = ArmReach(robot, grasp.arm, present=present)
            chains[grasp.arm] = _Chain(arm, space, config)
        watch.report("motion", index / len(plan.grasps))
        found = chains[grasp.arm].motion(grasp, index, rng, watch)
        if isinstance(found, GraspMotion):
            return GraspMotions(chosen=found, passed_over=tuple(passed_over))
        passed_over.append((index, found))
    return GraspMotions(chosen=None, passed_over=tuple(passed_over))


class _Chain:
    """Plans the chain of motions for one arm."""

    def __init__(
        self, arm: ArmReach, space: MotionSpace, config: MotionsConfig
    ) -> None:
        family = arm.robot.limits(arm.name, arm.chain)
        self._arm, self._space, self._config = arm, space, config
        self._planner = MotionPlanner.of_arm(arm, config=config.motion)
        self._legs = LegPlanner(arm.chain, family.planner, speed=config.speed)
        # The margins of a leg are the controller's to use.
        self._pushed = LegPlanner(arm.chain, family.controller, speed=config.speed)
        self._is_free: Callable[[FloatArray], np.ndarray] = self._planner.exact_test(
            space, with_hand=False
        ).is_free

    def motion(
        self, grasp: Grasp, index: int, rng: Rng, watch: Stopwatch
    ) -> GraspMotion | str:
        """Plan the chain of a grasp, or say what stops it."""
        q_now, reason = self._arm.q_present, ""
        for q_pregrasp in self._pregrasps(grasp, rng):
            legs = self._legs_from(q_pregrasp, grasp)
            if isinstance(legs, str):
                reason = reason or legs
                continue
            reach = self._planner.plan(q_now, q_pregrasp, self._space, rng=rng)
            if reach.is_solved:
                return GraspMotion(
                    grasp=grasp,
                    index=index,
                    arm=self._arm.name,
                    reach=reach,
                    approach=legs[0],
                    lift=legs[1],
                )
            reason = f"reach: {reach.reason}"
            if watch.is_late():
                break
        if reason:
            return reason
        # No posture at all: the planner knows why.
        reach = self._planner.plan(q_now, grasp.T_base_pregrasp, self._space, rng=rng)
        return f"reach: {reach.reason}"

    def _pregrasps(self, grasp: Grasp, rng: Rng) -> list[FloatArray]:
        """Postures at the pre-grasp: first the one that backs out of the grasp."""
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
        return [*found, *others][: self._config.tries]

    def _legs_from(
        self, q_pregrasp: FloatArray, grasp: Grasp
    ) -> tuple[LegPlan, LegPlan] | str:
        """Approach and lift from a posture at the pre-grasp, or what stops them."""
        approach = self._leg("approach", q_pregrasp, grasp.T_base_hand)
        if isinstance(approach, str):
            return approach
        T_base_lifted = CartesianLeg.along(approach.reached, self._config.lift).goal
        lift = self._leg("lift", approach.q[-1], T_base_lifted)
        return lift if isinstance(lift, str) else (approach, lift)

    def _leg(self, name: str, q_start: FloatArray, goal: SE3) -> LegPlan | str:
        leg = self._legs.plan(q_start, goal)
        reason = leg.reason or self._pushed.margin_fault(leg)
        if reason:
            return f"{name}: {reason}"
        blocked = np.flatnonzero(~self._is_free(leg.q))
        if len(blocked):
            share = blocked[0] / max(1, len(leg.q) - 1)
            return f"{name}: the arm touches something after {share:.0%} of the way"
        return leg
