"""From a posture to a pose of the hand, touching nothing."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import FloatArray, Rng, require_finite
from debrisgrasp._checked import checked
from debrisgrasp._stopwatch import Progress, Stopwatch
from debrisgrasp.errors import ConfigError, InputError, ShapeError
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import (
    ArmCollision,
    ArmReach,
    IkResult,
    IkStatus,
    KinematicChain,
    LimitSet,
    ReachMap,
    solve,
    solve_distinct,
)

from .config import MotionConfig
from .exact import ExactArm, ExactTest
from .query import MotionQuery
from .result import MotionPlan, MotionStatus
from .space import MotionSpace
from .spheres import ArmSpheres, discernible

__all__ = ["MotionPlanner"]


class MotionPlanner:
    """Plans for one arm, in any space."""

    @checked
    def __init__(
        self,
        collision: ArmCollision,
        limits: LimitSet,
        *,
        reach_map: ReachMap | None = None,
        config: MotionConfig | None = None,
    ) -> None:
        """Prepare for one arm.

        Parameters
        ----------
        collision
            The robot's body, in segments that the arm's chain moves.
        limits
            What every trajectory keeps, and is bound to; the planner's of a family.
        reach_map
            Of the chain, if there is one: rules goals out and finds postures faster.
        """
        self.chain: KinematicChain = collision.body.chain
        if limits.joint_names != self.chain.joint_names:
            raise ConfigError(
                "joints of the limits",
                got=", ".join(limits.joint_names),
                expected=", ".join(self.chain.joint_names),
            )
        self.limits, self.config = limits, config or MotionConfig()
        self._map = reach_map
        self._spheres = ArmSpheres(collision.body)
        self._solids = ExactArm(collision.body)

    def __repr__(self) -> str:
        return f"<MotionPlanner of {self.chain}>"

    @cached_property
    def _discerned(self) -> ArmSpheres:
        room = self.config.self_margin + self.config.spare
        return ArmSpheres(discernible(self._spheres.body, room))

    @classmethod
    @checked
    def of_arm(
        cls,
        arm: ArmReach,
        *,
        limits: LimitSet | None = None,
        config: MotionConfig | None = None,
    ) -> MotionPlanner:
        """Prepare for an arm of a robot, with its planner's limits by default."""
        limits = limits or arm.robot.limits(arm.name, arm.chain).planner
        return cls(arm.collision, limits, reach_map=arm.reach_map, config=config)

    def plan(
        self,
        q_start: ArrayLike,
        goal: SE3 | ArrayLike,
        space: MotionSpace,
        *,
        rng: Rng,
        known: ArrayLike | None = None,
        max_rounds: int | None = None,
        deadline: float | None = None,
        progress: Progress | None = None,
    ) -> MotionPlan:
        """Plan from a posture to a pose of the hand, or to any of several postures.

        Parameters
        ----------
        q_start
            Posture now (d,) [rad or m].
        goal
            Pose of the chain's tip in base, or postures (g, d) or (d,).
        space
            Obstacles. Unknown space near the start counts as free, see
            `MotionConfig.start_room`.
        rng
            The same state gives the same motion.
        known
            Postures (k, d) of a way that the arm has gone, for instance to the start:
            where no straight way leads to the goal the search begins from them, too.
        max_rounds
            Of the search by trees; None: as configured.
        deadline
            Seconds after which the search gives up.
        progress
            Called as the work goes on.

        Raises
        ------
        InputError
            If the start, or all postures given as goals, lie outside the limits, or
            contain NaN.
        ConfigError
            If the deadline is not a positive time.
        """
        if deadline is not None and not deadline > 0:
            raise ConfigError(
                "deadline",
                got=f"{deadline} s",
                expected="a positive number of seconds, or none",
            )
        start = self._checked_start(q_start)
        self._require_within(start[None], "start posture")
        watch, config = Stopwatch(deadline, progress), self.config
        if max_rounds is not None:
            config = replace(config, max_rounds=max_rounds)
        query = MotionQuery(
            spheres_of_arm=self._spheres,
            discerned=lambda: self._discerned,
            solids_of_arm=self._solids,
            limits=self.limits,
            config=config,
            space=self._opened(space, start),
            start=start,
            rng=rng,
            watch=watch,
            known=None if known is None or not np.size(known) else self._known(known),
        )
        with watch.stage("start"):
            contacts = query.at_start()
        if contacts:
            reason = "; ".join(map(str, contacts))
            return query.failed(MotionStatus.START_IN_COLLISION, reason, contacts)
        with watch.stage("goal"):
            goals, reason = self._goals(start, goal, rng)
        if not len(goals):
            return query.failed(MotionStatus.NO_GOAL_POSTURE, reason)
        return query.solved(goals)

    def stands_free(self, q_start: ArrayLike, space: MotionSpace) -> bool:
        """Whether a motion could begin in a posture (d,): nothing is touched there."""
        start = self._checked_start(q_start)
        test = self.exact_test(self._opened(space, start))
        return bool(test.is_free(start[None])[0])

    def exact_test(self, space: MotionSpace, *, with_hand: bool = True) -> ExactTest:
        """Return the test of the final check, by the links' solids.

        Parameters
        ----------
        space
            Obstacles.
        with_hand
            Whether the hand, too, is tested against the space: not where it grips.
        """
        return ExactTest(
            arm=self._solids,
            space=space,
            margin=self.config.margin,
            self_margin=self.config.self_margin,
            with_hand=with_hand,
        )

    def goal_postures(
        self, q_start: ArrayLike, T_base_goal: SE3, *, rng: Rng
    ) -> FloatArray:
        """Postures (g, d) within limits that take the hand to a pose; maybe none.

        The nearest to the start (d,) comes first; contact is not looked at.
        """
        start = self._checked_start(q_start)
        return self._goals(start, T_base_goal, rng)[0]

    def _checked(self, q: ArrayLike, what: str) -> FloatArray:
        """Postures (..., d) as finite numbers."""
        d = self.chain.n_joints
        try:
            array = np.array(q, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise ShapeError(what, got=repr(q), expected=f"{d} numbers") from error
        if array.ndim not in (1, 2) or array.shape[-1] != d or not array.size:
            raise ShapeError(
                f"shape of {what}", got=array.shape, expected=f"(..., {d})"
            )
        require_finite(array, what)
        return array

    def _known(self, q: ArrayLike) -> FloatArray:
        """Postures of a way (k, d) that the planner's limits allow."""
        known = np.atleast_2d(self._checked(q, "known postures"))
        within = [not self.limits.violation(row) for row in known]
        return known[within]

    def _checked_start(self, q: ArrayLike) -> FloatArray:
        start = self._checked(q, "start posture")
        if start.ndim != 1:
            raise ShapeError(
                "shape of start posture",
                got=start.shape,
                expected=f"({self.chain.n_joints},)",
            )
        return start

    def _require_within(self, q: FloatArray, what: str) -> None:
        broken = [self.limits.violation(row) for row in q]
        if all(broken):
            raise InputError(
                what,
                got=broken[0],
                expected="within the planner's limits",
                mend="Move the arm back inside them first, joint by joint; where it "
                "stands as the robot's file says, change the posture there.",
            )

    def _opened(self, space: MotionSpace, start: FloatArray) -> MotionSpace:
        """Space in which what is unknown around the robot at its start is free."""
        if space.unknown is None:
            return space
        balls = self.balls_at(start, self.config.margin)
        near = space.unknown_tree.query_ball_point(
            balls[:, :3], balls[:, 3], return_length=True
        )
        if not near.any():
            return space
        return space.with_opened(self.balls_at(start, self.config.start_room))

    def balls_at(self, q: FloatArray, room: float) -> FloatArray:
        """Balls that cover the robot in a posture (d,), and some room around it [m].

        Returns
        -------
        array
            Centre and radius of each [m], base frame, shape (b, 4).
        """
        arm = self._spheres
        R, p = arm.poses(q[None])
        centers = [arm.centers(R, p), arm.trunk_centers(R, p)]
        radii = np.concatenate([arm.radii, arm.trunk.radii])[:, 0]
        return np.column_stack([np.hstack(centers)[..., 0].T, radii + room])

    def _goals(
        self, start: FloatArray, goal: SE3 | ArrayLike, rng: Rng
    ) -> tuple[FloatArray, str]:
        """Postures of the goal (g, d), nearest to the start first, or why none."""
        limits = self.limits
        if isinstance(goal, SE3):
            q, reason = self._postures_at(start, goal, rng)
        else:
            q = np.atleast_2d(self._checked(goal, "goal postures"))
            self._require_within(q, "goal postures")
            reason = ""
        q = self._narrow.unwound(q, start)
        within = ((q >= limits.lower) & (q <= limits.upper)).all(axis=1)
        if len(q) and not within.any() and isinstance(goal, SE3):
            q = self._pulled_in(q, goal, rng)
            within = np.ones(len(q), dtype=bool)
        if not within.any() and not reason:
            reason = "all that were found lie outside the planner's limits"
        q = q[within]
        order = np.argsort(np.abs(q - start).max(axis=1), kind="stable")
        return q[order], reason

    def _pulled_in(self, q: FloatArray, goal: SE3, rng: Rng) -> FloatArray:
        """Postures near some just outside the limits (g, d) that lie within them."""
        limits = self.limits
        found = solve(
            self._narrow,
            SE3(np.tile(goal.matrix, (len(q), 1, 1))),
            q_seed=np.clip(q, limits.lower, limits.upper),
            rng=rng,
            config=replace(self.config.ik, attempts=4),
        )
        inner: FloatArray = found.q[found.is_solved]
        return inner

    @cached_property
    def _narrow(self) -> KinematicChain:
        """The chain with the planner's limits."""
        limits = self.limits
        return replace(self.chain, lower=limits.lower, upper=limits.upper)

    def _postures_at(
        self, start: FloatArray, goal: SE3, rng: Rng
    ) -> tuple[FloatArray, str]:
        """Postures (g, d) that take the hand to a pose, or why there are none."""
        if goal.matrix.shape != (4, 4):
            raise ShapeError("shape of goal", got=goal.matrix.shape, expected="(4, 4)")
        require_finite(goal.matrix, "pose of the goal")
        config, chain = self.config, self.chain
        near = solve(
            chain,
            goal,
            q_seed=start,
            reach_map=self._map,
            rng=rng,
            config=config.ik,
        )
        if not near.is_solved:
            return np.zeros((0, chain.n_joints)), _why_unreached(near)
        more = solve_distinct(
            chain,
            goal,
            config.n_goals - 1,
            reach_map=self._map,
            rng=rng,
            config=config.ik,
        )
        return np.concatenate([near.q[None], more.q[more.is_solved]]), ""


def _why_unreached(near: IkResult) -> str:
    if near.status == IkStatus.UNREACHABLE:
        return "it is out of the arm's reach for certain"
    held = ", held by a joint limit" if near.status == IkStatus.LIMIT else ""
    away = f"{1000 * float(near.position_error):.0f} mm and "
    away += f"{np.degrees(float(near.rotation_error)):.0f} degrees"
    return f"the nearest any attempt gets is {away} away{held}"
