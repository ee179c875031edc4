"""Records of the inverse kinematics: settings, status and result."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp._words import counted
from debrisgrasp.errors import ConfigError

__all__ = ["Freedom", "IkConfig", "IkResult", "IkStatus"]


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
    FAR = 5
    """Reached, but only by postures farther from the seed than was allowed."""


@dataclass(frozen=True, slots=True)
class Freedom:
    """Which turns of the tip about its own origin do not matter."""

    n_axes: int = 0
    """0: every turn matters. 1: those about one axis don't. 3: none does."""
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """The free axis, in the frame of the tip; any length."""

    def __post_init__(self) -> None:
        if self.n_axes not in (0, 1, 3):
            raise ConfigError("Freedom.n_axes", got=self.n_axes, expected="0, 1 or 3")
        length = math.hypot(*self.axis) if len(self.axis) == 3 else 0.0
        if not 0.0 < length < math.inf:
            raise ConfigError(
                "Freedom.axis", got=self.axis, expected="three numbers, not all zero"
            )

    @classmethod
    def spin(cls, axis: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> Freedom:
        """Let the tip turn about one of its own axes, as a round bar allows."""
        return cls(1, axis)

    @classmethod
    def position_only(cls) -> Freedom:
        """Let the tip turn in any way."""
        return cls(3)

    @property
    def frame(self) -> FloatArray:
        """Rotation whose third column is the axis, shape (3, 3)."""
        z = np.array(self.axis) / math.hypot(*self.axis)
        x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
        x /= np.linalg.norm(x)
        return np.stack([x, np.cross(z, x), z], axis=-1)


@checked_fields
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
    width: int = 4096
    """Lanes that run side by side; sets memory, and speed through cache use."""
    separation: float = 0.3
    """Two solutions count as distinct if a joint differs by this much [rad or m]."""
    freedom: Freedom = Freedom()
    """Turns of the tip that are free; a map then rules nothing out."""

    def __post_init__(self) -> None:
        for name in self.__slots__:
            if name != "freedom" and not getattr(self, name) > 0:
                raise ConfigError(
                    f"IkConfig.{name}", got=getattr(self, name), expected="above zero"
                )
        # Beyond these the descent no longer sees one error beside the other, or stands.
        require_range("IkConfig.rotation_weight [m]", self.rotation_weight, 1e-3, 100.0)
        require_range("IkConfig.damping", self.damping, 0.0, 10.0)

    @property
    def weighted_tolerance(self) -> float:
        """Weighted error [m] that keeps both errors within tolerance.

        They add up at the tip, so each takes a part.
        """
        rotation = self.rotation_tolerance * self.rotation_weight
        return 0.3 * min(self.position_tolerance, rotation)

    @property
    def last_step_error(self) -> float:
        """Weighted error [m] from which a step that meets no limit is the last.

        It squares the error; the proof finds the few for which it was not enough.
        """
        return min(2e-3, 0.4 * math.sqrt(self.weighted_tolerance))


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
    """Angle left to the pose [rad], shape (...); without turns that are free."""

    def __repr__(self) -> str:
        counts = np.bincount(self.status.ravel(), minlength=len(IkStatus))
        told = ", ".join(f"{n} {IkStatus(i).name}" for i, n in enumerate(counts) if n)
        return f"<IkResult of {counted(self.status.size, 'pose')}: {told or 'none'}>"

    @property
    def is_solved(self) -> BoolArray:
        """Whether the pose is reached, shape (...)."""
        return np.asarray(self.status == IkStatus.SOLVED)

    def reshaped(self, batch: tuple[int, ...]) -> IkResult:
        """Return the same results with other leading axes."""
        return IkResult(
            q=self.q.reshape(*batch, self.q.shape[-1]),
            status=self.status.reshape(batch),
            position_error=self.position_error.reshape(batch),
            rotation_error=self.rotation_error.reshape(batch),
        )
