r"""Joint commands that bring the hand to a pose, and never leave the limits.

One step solves :math:`\dot q = J^T (J J^T + \lambda^2 I)^{-1} e` for the error of the
pose, leaves to other joints what one at its limit can't do, and cuts the result to
what the joints may do in one period: each joint's next displacement lies in an interval
given by its speed, its acceleration, and the distance in which it can still stop before
its position limit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, sqrt
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dposv, dpotrf, dsyevd

from debrisgrasp._arrays import FloatArray, require_range
from debrisgrasp._checked import checked, checked_fields
from debrisgrasp.errors import ConfigError, ShapeError
from debrisgrasp.kinematics import KinematicChain, LimitSet

from ._rigid import Rotation, Vector, Wrench, added, cross, norm, rotation_error
from .posture import PostureKinematics
from .refusals import RefusalCause, StartError

__all__ = [
    "CartesianServo",
    "Joints",
    "ServoConfig",
    "ServoState",
    "pose_error",
    "stoppable",
]

Joints = tuple[float, ...]
"""One posture, or its change in one period, as plain floats."""
_MOST = {"max_speed": 10.0, "max_turn_rate": 100.0, "sigma_min": 1.0}
_OFF = 0.02
"""Share of a displacement by which the hand may stray so that a joint can stand."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class ServoConfig:
    """Settings of the differential inverse kinematics."""

    max_speed: float = 0.5
    """At which the hand goes to its goal, at most [m/s], whatever the period; no leg is
    faster."""
    max_turn_rate: float = 2.5
    """The same for its turn [rad/s]."""
    sigma_min: float = 0.05
    """Smallest singular value of the Jacobian below which damping sets in."""
    max_damping: float = 0.05
    """Damping at a singular posture; larger moves the joints less, and the hand strays
    more."""
    shared_cost: float = 30.0
    """How much dearer than of other joints motion is of those that turn other arms,
    too; larger turns them less, and the arm's own joints get to their limits sooner."""

    def __post_init__(self) -> None:
        for name in self.__slots__:
            most = _MOST.get(name, 1e6)
            require_range(f"ServoConfig.{name}", getattr(self, name), 1e-9, most)


class ServoState(NamedTuple):
    """What was commanded last."""

    q: Joints
    """Commanded posture [rad or m], d values."""
    step: Joints
    """Its change in the last period [rad or m], d values."""
    sigma: float = inf
    """Smallest singular value of the Jacobian at the last step, if below the
    threshold of damping; else infinity."""
    gap: float = 0.0
    """Distance from the commanded pose to the goal before the last step [m]."""
    turn: float = 0.0
    """Angle between them [rad]."""

    @property
    def is_moving(self) -> bool:
        """Whether the last step moved a joint by more than rounding."""
        return max(self.step) > 1e-6 or min(self.step) < -1e-6


class CartesianServo:
    """Follows poses with one arm within its limits."""

    @checked
    def __init__(
        self,
        chain: KinematicChain,
        limits: LimitSet,
        period: float,
        config: ServoConfig | None = None,
    ) -> None:
        if limits.joint_names != chain.joint_names:
            raise ConfigError(
                "joints of the limits",
                got=", ".join(limits.joint_names),
                expected=", ".join(chain.joint_names),
            )
        require_range("control period [s]", period, 1e-4, 0.1)
        self.kinematics = PostureKinematics(chain)
        self.limits, self.period = limits, period
        self.config = config or ServoConfig()
        self._farthest = self.config.max_speed * period
        self._largest_turn = self.config.max_turn_rate * period
        self._least = self.config.sigma_min**2 * np.eye(6)
        is_shared = [name in chain.shared for name in chain.joint_names]
        ease = np.where(is_shared, self.config.shared_cost**-0.5, 1.0)
        self._ease = ease / ease.max()  # with none to spare them, all count in full
        most = limits.velocity * period
        gain = limits.acceleration * period * period
        self._bounds = list(
            zip(
                limits.lower.tolist(),
                limits.upper.tolist(),
                most.tolist(),
                gain.tolist(),
                ((most + 0.5 * gain) ** 2 / (2.0 * gain)).tolist(),
                strict=True,
            )
        )

    def start(self, q: Sequence[float] | FloatArray) -> ServoState:
        """State of an arm that stands at a posture (d,).

        Raises
        ------
        ShapeError
            If it has another number of joints.
        StartError
            If the posture is not finite or lies outside the limits.
        """
        posture = np.asarray(q, dtype=np.float64)
        if posture.shape != (len(self._bounds),):
            raise ShapeError(
                "posture", got=posture.shape, expected=f"({len(self._bounds)},)"
            )
        broken = self.limits.violation(posture)
        if broken:
            raise StartError(
                RefusalCause.OUTSIDE,
                "start posture",
                got=broken,
                expected="a posture within the limits",
                mend="Move the arm back inside first.",
            )
        return ServoState(tuple(posture.tolist()), (0.0,) * len(posture))

    def step(self, state: ServoState, R: Rotation, p: Vector) -> ServoState:
        """Move one period towards the pose (R, p) in base."""
        R_now, p_now, J = self.kinematics.pose_and_jacobian(state.q)
        error = pose_error(R_now, p_now, R, p)
        gap, angle = norm(error[:3]), norm(error[3:])
        if gap > self._farthest or angle > self._largest_turn:
            share = min(
                self._farthest / max(gap, 1e-12),
                self._largest_turn / max(angle, 1e-12),
            )
            error = tuple([share * value for value in error])
        wanted, sigma = self.solved(J, error)
        wanted = self._around_stops(state.q, wanted, J, error)
        return self.limited(state, wanted, sigma, gap, angle)

    def _around_stops(
        self, q: Joints, wanted: list[float], J: FloatArray, error: Wrench
    ) -> list[float]:
        """Let other joints do what those at their limits can't, if they can.

        Saturation in the null space (Flacco, De Luca, Khatib, ICRA 2012), for limits of
        position: a joint that would not stop in time goes as far as it may, and the
        others are solved again. Where they can't do it, what was wanted stays, of
        which `limited` makes so much that the hand stays on its way.
        """
        near = [
            j
            for j, (value, (lower, upper, *_, far)) in enumerate(
                zip(q, self._bounds, strict=True)
            )
            if value - lower < far or upper - value < far
        ]
        if not near:
            return wanted
        # At the pace that the joints can keep; catching up, more is wanted.
        pace = min(
            min(bound[2] / max(abs(d), 1e-12), 1.0)
            for d, bound in zip(wanted, self._bounds, strict=True)
        )
        goal, step = pace * np.array(error), [pace * d for d in wanted]
        held: dict[int, float] = {}
        slow, off = step, 0.0
        for _ in near:
            beyond = {
                j: bound
                for j in near
                if (bound := self._stopped_at(j, q[j], step[j])) != step[j]
            }
            if not beyond:
                break
            if not held:
                share = min(bound / step[j] for j, bound in beyond.items())
                slow = [share * d for d in step]
            held |= beyond
            rows = list(held)
            free = J.copy()
            free[:, rows] = 0.0
            left = goal - J[:, rows] @ list(held.values())
            step, _ = self.solved(free, left.tolist())
            # What the damping left of it, or arms of six joints could never do it; of
            # that shared joints do as much as others, where it takes them.
            rest, _ = self.solved(free, (left - free @ step).tolist(), ease=1.0)
            step = [d + more for d, more in zip(step, rest, strict=True)]
            off = float(np.linalg.norm(left - free @ step) / np.linalg.norm(goal))
            if not off < _OFF:
                return wanted
            for j, bound in held.items():
                step[j] = bound
        if not held:
            return wanted
        # Ever less up to there, or the hand would start and stop from tick to tick.
        share = 1.0 - off / _OFF
        return [(d + share * (e - d)) / pace for d, e in zip(slow, step, strict=True)]

    def _stopped_at(self, j: int, value: float, d: float) -> float:
        """Largest part of a joint's displacement from which it stops at its limit."""
        lower, upper, _, gain, _ = self._bounds[j]
        if d > 0.0:
            return min(d, stoppable(upper - value, gain))
        return max(d, -stoppable(value - lower, gain))

    def solved(
        self,
        J: FloatArray,
        error: Sequence[float],
        *,
        ease: FloatArray | float | None = None,
    ) -> tuple[list[float], float]:
        """Damped least-squares displacement (d,), and the smallest singular value.

        The singular value is only worked out below ``sigma_min``; above it is infinite.
        It is that of a Jacobian whose shared joints count less, unless ``ease`` says
        how much each joint counts (d,), or all do.
        """
        ease = self._ease if ease is None else ease
        J = J * ease
        A = J.dot(J.T)
        # Positive definite even with sigma_min^2 taken away: far from singular.
        if dpotrf(A - self._least, clean=0)[1] == 0:
            _, x, info = dposv(A, error)
            if info == 0:
                regular: list[float] = (x.dot(J) * ease).tolist()
                return regular, inf
        eigenvalues, U, info = dsyevd(A)
        if info != 0:
            return [0.0] * J.shape[1], 0.0
        config = self.config
        sigma = sqrt(max(float(eigenvalues[0]), 0.0))
        damping = config.max_damping * max(0.0, 1.0 - sigma / config.sigma_min)
        eigenvalues = np.maximum(eigenvalues, 0.0) + damping * damping
        damped = ((U.T @ error) / eigenvalues) @ (U.T @ J) * ease
        return damped.tolist(), sigma

    def limited(
        self,
        state: ServoState,
        wanted: Sequence[float],
        sigma: float = inf,
        gap: float = 0.0,
        turn: float = 0.0,
    ) -> ServoState:
        """Largest part of a displacement (d,) that the joints can make now.

        The direction is kept wherever possible. Where a joint can't be slowed down fast
        enough for that, each joint goes as far as it can on its own.
        """
        share, is_cut, is_near = 1.0, False, False
        room = []
        for value, last, d, (lower, upper, most, gain, far) in zip(
            state.q, state.step, wanted, self._bounds, strict=True
        ):
            low, high = last - gain, last + gain
            if low < -most:
                low = -most
            if high > most:
                high = most
            if value - lower < far or upper - value < far:
                is_near = True
                high = min(high, stoppable(upper - value, gain))
                low = max(low, -stoppable(value - lower, gain))
            room.append((low, high))
            if not low <= d <= high:
                is_cut = True
                size, reach = abs(d), max(high if d > 0.0 else -low, 0.0)
                if size > reach:
                    # Catching up must end at rest, or the joint swings about the goal.
                    share = min(share, min(stoppable(size, gain), reach) / size)
        step = wanted
        if is_cut:
            # Clipped where a joint can't be slowed down fast enough for its share.
            step = [
                min(max(share * d, low), high)
                for d, (low, high) in zip(wanted, room, strict=True)
            ]
        q = [value + d for value, d in zip(state.q, step, strict=True)]
        if is_near:
            q = [
                min(max(value, lower), upper)
                for value, (lower, upper, *_) in zip(q, self._bounds, strict=True)
            ]
        return ServoState(tuple(q), tuple(step), sigma, gap, turn)

    def braked(self, state: ServoState) -> ServoState:
        """Come to rest as fast as the joints may, all at once.

        Each by itself would turn the hand off its way: near a singularity joints are
        fast that cancel out.
        """
        share = max(
            1.0 - gain / max(abs(last), gain)
            for last, (_, _, _, gain, _) in zip(state.step, self._bounds, strict=True)
        )
        return self.limited(state, [share * d for d in state.step], state.sigma)


def stoppable(distance: float, gain: float) -> float:
    """Largest displacement from which a joint still stops within a distance.

    Stopping from a displacement u takes at most ``(u + gain / 2)^2 / (2 gain)`` when
    each displacement is smaller than the last by at most ``gain``.
    """
    if distance <= 0.5 * gain:
        return max(distance, 0.0)
    return sqrt(2.0 * gain * distance) - 0.5 * gain


def pose_error(R: Rotation, p: Vector, R_goal: Rotation, p_goal: Vector) -> Wrench:
    """Return ``log6(T^-1 T_goal)``, turned into the axes of base: (v, omega)."""
    w = rotation_error(R, R_goal)
    gap = added(p_goal, p, -1.0)
    # Inverse of the left Jacobian; its third term is within 1e-9 up to 0.1 rad.
    wv = cross(w, gap)
    v = added(added(gap, wv, -0.5), cross(w, wv), 1.0 / 12.0)
    return (*v, *w)
