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

    def may_reach(self, T_base_hand: SE3) -> BoolArray:
        """Tell quickly which of k palm poses are not out of reach for certain."""
        ...

    def solves(self, T_base_hand: SE3, *, rng: Rng) -> BoolArray:
        """Tell which of k palm poses have a posture at all, collision aside."""
        ...

    def reach(self, T_base_hand: SE3, distance: Distance, *, rng: Rng) -> ReachAnswer:
        """Find a posture for each of k palm poses."""
        ...
