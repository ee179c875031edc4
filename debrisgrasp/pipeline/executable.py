"""The first grasp of a plan that can be carried out as a whole.

A grasp is worth nothing if the arm can't get to it, or is stuck once it holds the
object. For each grasp in turn the whole chain is planned: from the present posture to
the pre-grasp, the straight approach, and the straight lift. Approach and lift must also
be possible with the hand pushed aside as far as compliance lets it go.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from debrisgrasp._arrays import FloatArray, Rng, require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp._stopwatch import Progress, Stopwatch
from debrisgrasp._words import counted
from debrisgrasp.control import CartesianLeg, LegPlan, LegPlanner
from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import (
    ArmReach,
    DeflectionLimits,
    RobotModel,
    Trajectory,
)
from debrisgrasp.motion import MotionConfig, MotionPlan, MotionPlanner, MotionSpace
from debrisgrasp.planning import Grasp, GraspPlan

from .passage import Passage
from .reasons import NOT_TRIED

__all__ = ["GraspMotion", "GraspMotions", "MotionsConfig", "first_executable"]

_RETREAT = 0.15
"""How far the hand goes along the retreat of a grasp [m]."""
_LEAST_STAND_OFF = 0.06
"""Shortest straight approach that is tried [m]."""
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


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GraspMotions:
    """The grasp to carry out, or why there is none."""

    chosen: GraspMotion | None
    passed_over: tuple[tuple[int, str], ...]
    """Grasps before it: place in the plan, and what stops them."""

    @property
    def tried(self) -> tuple[tuple[int, str], ...]:
        """Those of the grasps passed over for which there was time."""
        return tuple(over for over in self.passed_over if over[1] != NOT_TRIED)

    @property
    def why_none(self) -> str:
        """Why no grasp can be carried out; empty if one can."""
        if self.chosen is not None:
            return ""
        if not self.passed_over:
            return "the plan has no grasp"
        n, left = len(self.tried), len(self.passed_over) - len(self.tried)
        index, reason = self.tried[0]
        why = f"none of {counted(n, 'grasp')} tried can be carried out; "
        why += f"grasp {index + 1}: "
        more = f"; {left} more were not tried, the deadline had passed" if left else ""
        return why + reason + more


def first_executable(
    plan: GraspPlan,
    robot: RobotModel,
    space: MotionSpace,
    *,
    passage: Passage | None = None,
    present: Mapping[str, float] | None = None,
    config: MotionsConfig | None = None,
    accepted: Callable[[GraspMotion], str] | None = None,
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
    passage
        What hand and held object must pass by on approach and lift, and how the fingers
        stand; None tests the arm alone, with the hand at rest.
    present
        Joint values now [rad or m]; None: each arm stands in its present posture.
    accepted
        Says of a feasible chain what else speaks against it, or nothing; None: nothing
        does.
    deadline
        Seconds after which no further grasp is tried.

    Raises
    ------
    ConfigError, InputError
        If the deadline is not positive, the plan is for a floating hand, or ``present``
        names a joint that the robot has not.
    """
    robot.joint_values(present)
    if deadline is not None and not deadline > 0:
        raise ConfigError(
            "deadline",
            got=f"{deadline} s",
            expected="a positive number of seconds, or none",
        )
    watch = Stopwatch(deadline, progress)
    config = config or MotionsConfig()
    chains: dict[tuple[object, ...], _Chain] = {}
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
            passed_over.append((index, NOT_TRIED))
            continue
        key = grasp.arm, grasp.preshape, grasp.opening
        if key not in chains:
            fingers = {} if passage is None else passage.finger_joints(grasp)
            held = _on_robot(fingers, robot, grasp.arm)
            arm = ArmReach(robot, grasp.arm, present=present, locked=held)
            chains[key] = _Chain(arm, space, passage, config)
        watch.report("motion", index / len(plan.grasps))
        found = chains[key].motion(grasp, index, rng, watch)
        if isinstance(found, GraspMotion) and accepted is not None:
            found = accepted(found) or found
        if isinstance(found, GraspMotion):
            return GraspMotions(chosen=found, passed_over=tuple(passed_over))
        passed_over.append((index, found))
    return GraspMotions(chosen=None, passed_over=tuple(passed_over))


class _Chain:
    """Plans the chain of motions for one arm."""

    def __init__(
        self,
        arm: ArmReach,
        space: MotionSpace,
        passage: Passage | None,
        config: MotionsConfig,
    ) -> None:
        family = arm.robot.limits(arm.name, arm.chain)
        self._arm, self._space, self._config = arm, space, config
        self._passage = passage
        self._planner = MotionPlanner.of_arm(arm, config=config.motion)
        self._legs = LegPlanner(arm.chain, family.planner, speed=config.speed)
        # The margins of a leg are the controller's to use.
        clamp = config.clamp or family.controller.deflection
        pushed = replace(family.controller, deflection=clamp)
        self._pushed = LegPlanner(arm.chain, pushed, speed=config.speed)
        self._is_free: Callable[[FloatArray], np.ndarray] = self._planner.exact_test(
            space, with_hand=False
        ).is_free

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
            if watch.is_late():
                break
        return first

    def _motion(
        self, grasp: Grasp, index: int, rng: Rng, watch: Stopwatch
    ) -> GraspMotion | str:
        """Plan the chain of a grasp from its pre-grasp, or say what stops it."""
        reason = self._approach_fault(grasp)
        if reason:
            return reason
        q_now = self._arm.q_present
        postures, free = self._pregrasps(grasp, rng)
        if len(postures) and not len(free):
            return "approach: the arm touches something after 0% of the way"
        for q_pregrasp in free:
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
        lift = self._leg("lift", approach.q[-1], T_base_lifted)
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


def _on_robot(
    fingers: Mapping[str, float], robot: RobotModel, arm: str
) -> dict[str, float]:
    """Values of a hand's joints by the names that they have in the robot's file.

    A robot puts the name of the hand before them; joints that it doesn't have stay out.
    """
    below = robot.tree.links_below(robot.arm(arm).hand)
    names = [name for name, j in robot.tree.joints.items() if j.child in below]
    return {
        name: value
        for finger, value in fingers.items()
        for name in names
        if name == finger or name.endswith(f"_{finger}")
    }


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
