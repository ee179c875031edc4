"""Records of the inverse kinematics: settings, status and result."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray
from debrisgrasp.errors import ConfigError

__all__ = ["IkConfig", "IkResult", "IkStatus"]


class IkStatus(IntEnum):
    """What became of one pose."""

    SOLVED = 0
    """Reached within tolerance and limits."""
    UNREACHABLE = 1
    """Out of reach whatever the posture: farther away than the chain is long, or ruled
    out by the reachability map."""
    LIMIT = 2
    """The nearest approach found is held by a joint limit."""
    STALLED = 3
    """All attempts ended in postures from which no small motion leads nearer."""
    BUDGET = 4
    """The attempts were used up while still coming nearer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IkConfig:
    """Settings of the solver; the defaults suit arms of about a metre."""

    position_tolerance: float = 1e-4
    """Largest position error of a solved pose [m]."""
    rotation_tolerance: float = 1e-3
    """Largest rotation error of a solved pose [rad]."""
    attempts: int = 40
    """Seeds tried for a pose before it is given up; more find rarer solutions and make
    unreachable poses costlier."""
    max_iterations: int = 40
    """Iterations of one attempt."""
    rotation_weight: float = 0.3
    """Metres that one radian of error counts as in the descent; about a third of the
    arm's length."""
    damping: float = 0.1
    """Weight of the squared error in the damping; larger is slower and steadier."""
    width: int = 2048
    """Lanes that run side by side; sets memory, and speed through cache use."""
    separation: float = 0.3
    """Two solutions count as distinct if a joint differs by this much [rad or m]."""

    def __post_init__(self) -> None:
        for name in self.__slots__:
            if not getattr(self, name) > 0:
                raise ConfigError(
                    f"IkConfig.{name}", got=getattr(self, name), expected="above zero"
                )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class IkResult:
    """Postures that reach the poses asked for, or come near them."""

    q: FloatArray
    """Joint values within the limits [rad or m], shape (..., d)."""
    status: IntArray
    """`IkStatus` of each pose, shape (...)."""
    position_error: FloatArray
    """Distance left to the pose [m], shape (...)."""
    rotation_error: FloatArray
    """Angle left to the pose [rad], shape (...)."""

    @property
    def is_solved(self) -> BoolArray:
        """Whether the pose is reached, shape (...)."""
        return np.asarray(self.status == IkStatus.SOLVED)
