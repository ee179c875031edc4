"""One arm with its hand, and what a run knows about it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import isfinite

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray
from debrisgrasp.control import LoadModel, PostureKinematics
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import ArmReach, LimitFamily
from debrisgrasp.motion import MotionPlanner
from debrisgrasp.prototypes import GripperModel
from debrisgrasp.robot import Limb

from .plausible import Felt, Measured
from .result import FaultFound

__all__ = ["LimbState"]

_APART = 0.15
"""Postures of a way that are nearer to each other count as one [rad or m]."""


@dataclass(eq=False, kw_only=True)
class LimbState:
    """One arm with its hand, and what is known about it."""

    name: str
    limb: Limb
    reach: ArmReach
    limits: LimitFamily
    hand: GripperModel
    kinematics: PostureKinematics
    loads: LoadModel
    """With the bias of the last verified baseline; that of `limb` as configured."""
    baseline_time: float = 0.0
    """When that was, by the robot's clock [s]."""
    felt: Felt | None = None
    """Its last reading; None: what it read before says nothing of the next one."""
    doubt: FaultFound | None = None
    """Why its readings can't be trusted any more: then nothing moves."""
    sent: tuple[float, Sequence[float]] | None = None
    """When joints were commanded last, by the robot's clock [s], and to where, d."""
    trail: list[FloatArray] = field(default_factory=list)
    """Postures on its way since it was at rest, each (d,); see `went`."""
    ways: FloatArray | None = None
    """Corners (k, d) of ways that it found to grasps, the latest."""
    is_own_joint: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    """Which of its joints no other arm moves, shape (d,)."""
    taken: str = ""
    """Name of the preshape that its hand took last; empty: none yet."""

    def feel(self, q: Measured, wrench_ft: Measured) -> None:
        """Take a reading, and note whether it can follow the last one."""
        before = self.felt or Felt()
        self.felt = before.followed_by(q, wrench_ft, self._own_joints)
        if self.felt.fault and self.doubt is None:
            self.doubt = FaultFound(self.felt.fault, self.felt.message, self.name)

    @cached_property
    def _own_joints(self) -> list[bool]:
        own: list[bool] = self.is_own_joint.tolist()
        return own

    def pose(self, q: FloatArray) -> SE3:
        """Pose of the palm in base."""
        R, p = self.kinematics.pose(q.tolist())
        return SE3.from_parts(np.array(R).reshape(3, 3), np.array(p))

    def went(self, rows: FloatArray) -> None:
        """Take note of postures (n, d) on the way, but not of those near to others."""
        for q in rows:
            if all(np.abs(q - known).max() > _APART for known in self.trail):
                self.trail.append(np.array(q))

    @property
    def known_way(self) -> FloatArray | None:
        """The trail, shape (k, d); None: it is at rest, or the base has moved since."""
        return np.array(self.trail) if self.trail else None

    @cached_property
    def planner(self) -> MotionPlanner:
        """Of motions with nothing in the hand."""
        return MotionPlanner.of_arm(self.reach, limits=self.limits.planner)

    @property
    def first_preshape(self) -> str:
        """Name of the preshape of a hand that no grasp asks for another."""
        return next(iter(self.hand.preshapes))

    @property
    def preshape(self) -> str:
        """Name of the preshape that its hand has."""
        return self.taken or self.first_preshape

    @property
    def opening(self) -> float:
        """How wide its hand is open by the widest finger that tells, in range [m]."""
        shape = self.hand.preshape(self.preshape)
        told = [x for x in self.limb.gripper.read().openings if isfinite(x)]
        return min(max([shape.narrowest, *(told or [shape.widest])]), shape.widest)

    @property
    def rest_of(self) -> str:
        """Name of the idle posture."""
        return self.reach.robot.arm(self.name).idle
