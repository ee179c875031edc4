"""One set of limits that planner, inverse kinematics, controller and robot share.

Three sets lie within one another: the hardware's hold the controller's, and those hold
the planner's with some room to spare. A plan that ends exactly on a limit then does not
trip the controller that executes it.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import FloatArray, frozen, require_range
from debrisgrasp._words import counted
from debrisgrasp.errors import ConfigError

from .chain import KinematicChain

__all__ = ["DeflectionLimits", "LimitFamily", "LimitSet"]

LEAST_MARGIN = 0.02
"""Room between the planner's position limits and the controller's [rad or m]."""
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class DeflectionLimits:
    """How far, and how fast, a wrench may push the hand off its nominal path."""

    translation: float = 0.10
    """[m]."""
    rotation: float = 0.35
    """[rad]."""
    translation_rate: float = 0.05
    """[m/s]."""
    rotation_rate: float = 0.25
    """[rad/s]."""

    def __post_init__(self) -> None:
        most = (10.0, 100.0, 10.0, 100.0)  # beyond these, millimetres or degrees
        for name, value in zip(self.__slots__, most, strict=True):
            require_range(f"DeflectionLimits.{name}", getattr(self, name), 1e-9, value)

    def values(self) -> tuple[float, ...]:
        """All four numbers, in the order of the fields."""
        return tuple(float(getattr(self, name)) for name in self.__slots__)


@dataclass(frozen=True, eq=False, kw_only=True)
class LimitSet:
    """What one arm must not exceed."""

    joint_names: tuple[str, ...]
    lower: FloatArray
    """Smallest joint values [rad or m], shape (d,); -inf for continuous joints."""
    upper: FloatArray
    """Largest joint values [rad or m], shape (d,); +inf for continuous joints."""
    velocity: FloatArray
    """Largest speeds [rad/s or m/s], shape (d,)."""
    acceleration: FloatArray
    """Largest accelerations [rad/s^2 or m/s^2], shape (d,)."""
    deflection: DeflectionLimits = DeflectionLimits()
    force: float = 150.0
    """Largest force at the hand, absolute and never tared [N]."""
    torque: float = 40.0
    """Largest torque about the hand's reference point, absolute [N m]."""
    relaxed: tuple[str, ...] = ()
    """Why limits were raised, if they were; belongs into the record of a run."""

    def __post_init__(self) -> None:
        d = len(self.joint_names)
        for name in ("lower", "upper", "velocity", "acceleration"):
            array = frozen(getattr(self, name), f"LimitSet.{name}", (d,))
            if np.isnan(array).any() or array.ndim != 1:
                raise ConfigError(
                    f"LimitSet.{name}", got=array.tolist(), expected=f"{d} numbers"
                )
            object.__setattr__(self, name, array)
        require_range("LimitSet.force", self.force, 1e-9, 1e9)
        require_range("LimitSet.torque", self.torque, 1e-9, 1e9)
        for i, joint in enumerate(self.joint_names):
            if not self.lower[i] < self.upper[i]:
                raise ConfigError(
                    f"position limits of joint {joint!r}",
                    got=f"{self.lower[i]:g} to {self.upper[i]:g}",
                    expected="lower < upper",
                )
            for name in ("velocity", "acceleration"):
                value = float(getattr(self, name)[i])
                require_range(f"{name} limit of joint {joint!r}", value, 1e-9, 1e9)

    def __repr__(self) -> str:
        joints = counted(len(self.joint_names), "joint")
        return (
            f"<LimitSet {self.hash} of {joints}: {self.force:g} N, {self.torque:g} N m>"
        )

    @classmethod
    def of_chain(
        cls,
        chain: KinematicChain,
        *,
        velocity: ArrayLike,
        acceleration: ArrayLike,
        deflection: DeflectionLimits | None = None,
        force: float = 150.0,
        torque: float = 40.0,
    ) -> LimitSet:
        """Take the positions from a chain of d joints.

        Parameters
        ----------
        velocity, acceleration
            Largest of each joint [rad/s, rad/s^2, or m], shape (d,), or one for all.
        deflection
            How far forces may move the hand.
        force, torque
            Largest at the hand [N, N m].
        """
        d = chain.n_joints
        return cls(
            joint_names=chain.joint_names,
            lower=chain.lower,
            upper=chain.upper,
            velocity=np.broadcast_to(np.asarray(velocity, dtype=np.float64), (d,)),
            acceleration=np.broadcast_to(
                np.asarray(acceleration, dtype=np.float64), (d,)
            ),
            deflection=deflection or DeflectionLimits(),
            force=force,
            torque=torque,
        )

    @property
    def n_joints(self) -> int:
        """Number of joints d."""
        return len(self.joint_names)

    @cached_property
    def hash(self) -> str:
        """Digest of all numbers; a trajectory carries that of its limits."""
        digest = hashlib.sha256("|".join(self.joint_names).encode())
        scalars = np.array([*self.deflection.values(), self.force, self.torque])
        for array in (
            self.lower,
            self.upper,
            self.velocity,
            self.acceleration,
            scalars,
        ):
            digest.update(np.round(array, 9).tobytes())
        return digest.hexdigest()[:16]

    def shrunk(self, margin: float = LEAST_MARGIN) -> LimitSet:
        """Cut every bounded joint's range at both ends by a margin [rad or m].

        Raises
        ------
        ConfigError
            If nothing is left of one.
        """
        require_range("margin of shrunk limits", margin, 0.0)
        for joint, low, high in zip(
            self.joint_names, self.lower, self.upper, strict=True
        ):
            if not high - low > 2.0 * margin:
                raise ConfigError(
                    f"limits of joint {joint!r}",
                    got=f"{low:g} to {high:g}",
                    expected=f"a range above {2.0 * margin:g}, for at either end "
                    f"{margin:g} rad or m are kept free",
                    mend="To hold it still leave it out of the arm's joints.",
                )
        return replace(self, lower=self.lower + margin, upper=self.upper - margin)

    def scaled(
        self,
        *,
        velocity: float = 1.0,
        acceleration: float = 1.0,
        load: float = 1.0,
        because: str = "",
    ) -> LimitSet:
        """Multiply limits; ``load`` is for force and torque.

        Parameters
        ----------
        because
            Needed to raise a limit; it is kept in `relaxed`, for the record of a run.

        Raises
        ------
        ConfigError
            If a factor is not above zero, or exceeds 1 and no reason is given.
        """
        factors = {"velocity": velocity, "acceleration": acceleration, "load": load}
        for name, factor in factors.items():
            require_range(f"factor of {name}", factor, 1e-6, 1e6)
            if factor > 1.0 and not because:
                raise ConfigError(
                    f"factor of {name}",
                    got=factor,
                    expected="at most 1",
                    mend='To raise a limit say why: scaled(..., because="...").',
                )
        raised = [f"{n} x {f:g}: {because}" for n, f in factors.items() if f > 1.0]
        return replace(
            self,
            velocity=velocity * self.velocity,
            acceleration=acceleration * self.acceleration,
            force=load * self.force,
            torque=load * self.torque,
            relaxed=(*self.relaxed, *raised),
        )

    def violation(
        self,
        q: ArrayLike,
        dq: ArrayLike | None = None,
        ddq: ArrayLike | None = None,
        tolerance: float = _ROUNDING,
    ) -> str:
        """First limit that postures (..., d) and their derivatives break, in words.

        Empty if there is none. NaN breaks every limit. ``tolerance`` is relative to
        velocity and acceleration, and absolute for positions.
        """
        q = np.asarray(q, dtype=np.float64)
        checks = [("position", np.maximum(self.lower - q, q - self.upper), "rad or m")]
        for name, values, most in (
            ("velocity", dq, self.velocity),
            ("acceleration", ddq, self.acceleration),
        ):
            if values is not None:
                excess = np.abs(np.asarray(values, dtype=np.float64)) / most - 1.0
                checks.append((name, excess, "of its limit"))
        for name, excess, unit in checks:
            rows = excess.reshape(-1, self.n_joints)
            worst = np.where(np.isnan(rows), np.inf, rows)
            if rows.size and worst.max() > tolerance:
                joint = self.joint_names[int(worst.max(axis=0).argmax())]
                return f"{name} of {joint} exceeded by {worst.max():.3g} {unit}"
        return ""

    def require_contains(
        self, inner: LimitSet, what: str, *, margin: float = 0.0
    ) -> None:
        """Raise `ConfigError` unless ``inner`` lies within, positions by ``margin``."""
        if inner.joint_names != self.joint_names:
            raise ConfigError(
                f"joints of {what}",
                got=", ".join(inner.joint_names),
                expected=", ".join(self.joint_names),
            )
        bounds = [
            ("lower", -inner.lower, -self.lower - margin),
            ("upper", inner.upper, self.upper - margin),
            ("velocity", inner.velocity, self.velocity),
            ("acceleration", inner.acceleration, self.acceleration),
        ]
        for name, have, most in bounds:
            with np.errstate(invalid="ignore"):
                is_over = have > most + _ROUNDING
            for i in np.flatnonzero(is_over):
                sign = -1.0 if name == "lower" else 1.0
                raise ConfigError(
                    f"{name} limit of joint {self.joint_names[i]!r} in {what}",
                    got=f"{sign * have[i]:.6g}",
                    expected=f"{'at least' if sign < 0 else 'at most'} "
                    f"{sign * most[i]:.6g}",
                    mend="Derive it from the outer set: outer.shrunk().",
                )
        for name in ("force", "torque"):
            if getattr(inner, name) > getattr(self, name) + _ROUNDING:
                raise ConfigError(
                    f"{name} limit in {what}",
                    got=getattr(inner, name),
                    expected=f"at most {getattr(self, name):g}",
                )
        pairs = zip(inner.deflection.values(), self.deflection.values(), strict=True)
        if any(have > most + _ROUNDING for have, most in pairs):
            raise ConfigError(
                f"deflection limits in {what}",
                got=inner.deflection.values(),
                expected=f"at most {self.deflection.values()}",
            )

    def require_same(self, carried_hash: str, what: str) -> None:
        """Raise `ConfigError` unless ``what`` was made for exactly these limits."""
        if carried_hash != self.hash:
            raise ConfigError(
                f"limits of {what}",
                got=f"hash {carried_hash}",
                expected=f"hash {self.hash}, that of the limits in force",
                mend="Plan it again with the limits that will execute it.",
            )


@dataclass(frozen=True, eq=False, kw_only=True)
class LimitFamily:
    """The limits of robot, controller and planner; checked to lie within each other."""

    hardware: LimitSet
    """What the drives and the sensor stand; the robot refuses more."""
    controller: LimitSet
    """What a command never exceeds."""
    planner: LimitSet
    """What planning and inverse kinematics use."""

    def __post_init__(self) -> None:
        self.hardware.require_contains(self.controller, "the controller's limits")
        self.controller.require_contains(
            self.planner, "the planner's limits", margin=LEAST_MARGIN
        )

    @classmethod
    def around(cls, hardware: LimitSet, margin: float = LEAST_MARGIN) -> LimitFamily:
        """Make the controller as the hardware, the planner narrower by ``margin``."""
        return cls(
            hardware=hardware, controller=hardware, planner=hardware.shrunk(margin)
        )
