"""What the planner asks of an arm; `kinematics.ArmReach` answers it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from debrisgrasp._arrays import BoolArray, FloatArray, Rng
from debrisgrasp.geometry import SE3

__all__ = ["Arm", "Distance", "ReachAnswer"]

Distance = Callable[[FloatArray], FloatArray]
"""Maps points (..., 3) [m] in the base frame to their distance from the nearest
obstacle [m], shape (...), truncated at a few centimetres."""


class ReachAnswer(Protocol):
    """Whether an arm takes each of k poses, and how."""

    @property
    def joints(self) -> FloatArray:
        """Joint positions [rad or m], shape (k, d); NaN where not reached."""
        ...

    @property
    def is_reached(self) -> BoolArray:
        """Which poses are taken without collision, shape (k,)."""
        ...

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why each pose is not taken, empty where it is; k of them."""
        ...


class Arm(Protocol):
    """An arm that carries a gripper."""

    @property
    def name(self) -> str:
        """Name of the arm."""
        ...

    @property
    def gripper(self) -> str:
        """Name of the gripper that it carries."""
        ...

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of its d joints, base to tip."""
        ...

    @property
    def wrench_limits(self) -> tuple[float, float]:
        """Largest force [N] and torque [N m] at the hand."""
        ...

    def effort(self, joints: FloatArray, wrench_hand: FloatArray) -> FloatArray:
        """Share of the joints' torque that wrenches (k, 6) take in postures, (k,)."""
        ...

    def may_reach(self, T_base_hand: SE3) -> BoolArray:
        """Tell quickly which palm poses (k,) are not out of reach for certain."""
        ...

    def may_yield(self, T_base_hand: SE3) -> BoolArray:
        """Tell quickly which palm poses (k,) may leave room to give way to pushes."""
        ...

    def follow(self, T_base_hand: SE3, q_before: FloatArray, *, rng: Rng) -> FloatArray:
        """Postures (k, d) of k palm poses, collision aside; NaN where there is none.

        Those before, NaN where not known, are of poses close by.
        """
        ...

    def leeway(
        self, joints: FloatArray, T_base_hand: SE3, Ts_base_away: SE3, *, rng: Rng
    ) -> FloatArray:
        """Share of the pushes that the hand can give way to, in [0, 1], (k,).

        In postures (k, d) at palm poses (k,), and at places (k, w) that the hand comes
        from or goes to in a straight line.
        """
        ...

    def yielding(
        self,
        T_base_hand: SE3,
        Ts_base_away: SE3,
        distance: Distance,
        least: float,
        *,
        rng: Rng,
    ) -> FloatArray:
        """Postures (k, d) clear of all, with at least so much leeway; NaN if none."""
        ...

    def reach(
        self,
        T_base_hand: SE3,
        distance: Distance,
        *,
        q_known: FloatArray | None = None,
        rng: Rng,
    ) -> ReachAnswer:
        """Find a posture for each of k palm poses.

        ``q_known`` are postures that take them, collision aside, NaN where there is
        none, (k, d).
        """
        ...
