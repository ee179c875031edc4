"""Straight legs of the hand: planned ahead, or followed tick by tick.

A leg is a line for the position and a geodesic for the rotation. The screw between the
two poses, which interpolating on SE(3) would give, leaves the line by centimetres.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from math import degrees

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import FloatArray, finite, require_range
from debrisgrasp._checked import checked
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.kinematics import KinematicChain, LimitSet, Trajectory

from ._rigid import Rotation, Vector, exp3, norm, parts, pose, times
from .servo import CartesianServo, pose_error

__all__ = ["CartesianLeg", "LegPlan", "LegPlanner", "LegStatus"]

_LONGEST = 3.0
"""No arm moves its hand farther along one line [m]."""
_SPACING = (0.002, 0.01)
"""Of the waypoints of a planned leg, at most [m, rad]."""
_TOLERANCE = 1e-6
"""Error of a waypoint, metres and radians alike, that ends its iterations."""
_ACCEPTED = 1e-4
"""Error of a waypoint that is still on the line."""
_PUSHED = 1e-3
"""Error of a waypoint of a hand that is pushed aside: it is led there by no line."""
_LOOKS = 8
"""Waypoints on its way there."""
_KNOT = 0.02
"""Time between the knots of a planned leg [s]."""


class CartesianLeg:
    """Straight way from one pose of the hand to another.

    A leg of no length holds the hand where it is; compliant, it only gives way.

    Raises
    ------
    InputError
        If a pose is not finite, or the leg is longer than 3 m.
    """

    def __init__(self, T_base_start: SE3, T_base_goal: SE3) -> None:
        self.start, self.goal = T_base_start, T_base_goal
        self._R, self._p = parts(T_base_start)
        parts(T_base_goal)
        x, y, z = (T_base_goal.p - T_base_start.p).tolist()
        a, b, c = so3.log(T_base_start.R.T @ T_base_goal.R).tolist()
        self._way: Vector = (x, y, z)
        self._turn: Vector = (a, b, c)
        if not self.length <= _LONGEST:
            raise InputError(
                "length of a leg [m]",
                got=f"{self.length:g}",
                expected=f"at most {_LONGEST:g}",
                mend="Was it given in millimetres?",
            )

    @classmethod
    def along(cls, T_base_start: SE3, offset: ArrayLike) -> CartesianLeg:
        """Leg that moves by an offset in base [m], shape (3,), without turning."""
        parts(T_base_start)
        shift = finite(offset, "offset of a leg [m]", (3,))
        return cls(T_base_start, SE3.from_parts(p=shift) @ T_base_start)

    def __repr__(self) -> str:
        turn = degrees(self.angle)
        return f"<CartesianLeg of {1e3 * self.length:.0f} mm and {turn:.0f} deg>"

    @property
    def length(self) -> float:
        """[m]."""
        return norm(self._way)

    @property
    def angle(self) -> float:
        """[rad]."""
        return norm(self._turn)

    def at(self, s: float) -> tuple[Rotation, Vector]:
        """Pose at a share s of the way, in plain floats."""
        (x, y, z), (a, b, c), (p, q, r) = self._way, self._turn, self._p
        position = (p + s * x, q + s * y, r + s * z)
        if a == b == c == 0.0:
            return self._R, position
        return times(self._R, exp3((s * a, s * b, s * c))), position

    def pose(self, s: float) -> SE3:
        """Pose in base at a share s of the way."""
        return pose(*self.at(s))


class LegStatus(Enum):
    """What became of a leg."""

    DONE = "done"
    JOINT_LIMIT = "a joint limit is in the way"
    SINGULAR = "the arm is stretched out or folded: a singular posture"
    BLOCKED = "something is in the way"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LegPlan:
    """A leg as joint motion, or as much of it as can be done."""

    status: LegStatus
    reason: str
    """In words; empty if done."""
    share: float
    """How much of the way is done, in [0, 1]."""
    reached: SE3
    """Pose of the hand where the plan ends."""
    q: FloatArray
    """Postures at equal steps along the leg [rad or m], shape (n, d)."""
    trajectory: Trajectory
    """The same in time, up to where the plan ends; it keeps all limits."""

    def __repr__(self) -> str:
        reason = f", {self.reason}" if self.reason else ""
        return f"<LegPlan {self.status.value}{reason}: {self.trajectory}>"

    @property
    def is_done(self) -> bool:
        """Whether the whole leg can be done."""
        return self.status is LegStatus.DONE


class LegPlanner:
    """Turns straight legs into joint motion within limits."""

    @checked
    def __init__(
        self,
        chain: KinematicChain,
        limits: LimitSet,
        *,
        speed: float = 0.1,
        turn_rate: float = 0.5,
        is_free: Callable[[FloatArray], bool] | None = None,
    ) -> None:
        """Prepare for one arm.

        Parameters
        ----------
        speed, turn_rate
            Of the hand [m/s], [rad/s]; joints that can't keep up slow it down.
        is_free
            Says of a posture (d,) whether it collides with nothing; None: not checked.
        """
        require_range("speed of a leg [m/s]", speed, 1e-4, 10.0)
        require_range("turn rate of a leg [rad/s]", turn_rate, 1e-4, 10.0)
        self.limits, self.speed, self.turn_rate = limits, speed, turn_rate
        self._servo = CartesianServo(chain, limits, 0.004)
        self._is_free = is_free

    def plan(self, q_start: ArrayLike, T_base_goal: SE3) -> LegPlan:
        """Plan the straight leg from where a posture (d,) has the hand.

        Never raises for a leg that can't be done: the plan says how far it gets.

        Raises
        ------
        InputError
            If the start posture is outside the limits, or the goal is no leg at all:
            not finite, or farther than 3 m.
        """
        q0 = np.asarray(q_start, dtype=np.float64)
        self._servo.start(q0)
        kinematics = self._servo.kinematics
        leg = CartesianLeg(pose(*kinematics.pose(q0.tolist())), T_base_goal)
        steps = max(leg.length / _SPACING[0], leg.angle / _SPACING[1])
        n = int(np.ceil(steps - 1e-9))
        q, rows = q0.tolist(), [q0.tolist()]
        status, reason = LegStatus.DONE, ""
        for i in range(1, n + 1):
            following, status, reason = self._waypoint(q, *leg.at(i / n))
            if status is not LegStatus.DONE:
                break
            q = following
            rows.append(q)
        share = 1.0 if n == 0 else (len(rows) - 1) / n
        if reason:
            done = f"{1000 * share * leg.length:.0f} of {1000 * leg.length:.0f} mm"
            reason = f"{status.value}: {reason}; the hand gets {done} far"
        postures = np.array(rows)
        return LegPlan(
            status=status,
            reason=reason,
            share=share,
            reached=leg.pose(share),
            q=postures,
            trajectory=self._timed(postures, leg.length * share, leg.angle * share),
        )

    def margin_fault(self, plan: LegPlan) -> str:
        """Say why a leg can't also be done with the hand pushed aside, or nothing.

        Start, middle and end are tried with the deflection clamp added along each axis
        of base, to both sides.
        """
        if not plan.is_done:
            return plan.reason
        most, kinematics = self.limits.deflection, self._servo.kinematics
        for row in plan.q[[0, len(plan.q) // 2, -1]]:
            T = pose(*kinematics.pose(row.tolist()))
            for axis in range(6):
                size = most.translation if axis < 3 else most.rotation
                for sign in (-1.0, 1.0):
                    twist = np.zeros(6)
                    twist[axis] = sign * size
                    goal = SE3.from_parts(so3.exp(twist[3:]) @ T.R, T.p + twist[:3])
                    reason = self._reaches(row.tolist(), CartesianLeg(T, goal))
                    if reason:
                        kind = "pushed" if axis < 3 else "turned"
                        direction = f"{'+' if sign > 0 else '-'}{'xyz'[axis % 3]}"
                        return f"{kind} {size:g} along {direction}: {reason}"
        return ""

    def _reaches(self, q: list[float], leg: CartesianLeg) -> str:
        for i in range(1, _LOOKS + 1):
            q, status, reason = self._waypoint(q, *leg.at(i / _LOOKS), accepted=_PUSHED)
            if status is not LegStatus.DONE:
                return f"{status.value}: {reason}"
        return ""

    def _waypoint(
        self, q: list[float], R: Rotation, p: Vector, *, accepted: float = _ACCEPTED
    ) -> tuple[list[float], LegStatus, str]:
        """Posture at one pose, from the posture before it."""
        limits, servo = self.limits, self._servo
        lower, upper = limits.lower.tolist(), limits.upper.tolist()
        size, sigma, stopped = np.inf, np.inf, -1
        for _ in range(40):
            R_now, p_now, J = servo.kinematics.pose_and_jacobian(q)
            error = pose_error(R_now, p_now, R, p)
            size = max(norm(error[:3]), norm(error[3:]))
            if size < _TOLERANCE:
                break
            # Where a joint is stopped, shared ones do what they can.
            step, sigma = servo.solved(J, error, ease=None if stopped < 0 else 1.0)
            q = [value + d for value, d in zip(q, step, strict=True)]
            for j, value in enumerate(q):
                if not lower[j] <= value <= upper[j]:
                    q[j], stopped = min(max(value, lower[j]), upper[j]), j
        if size > accepted:
            if stopped >= 0:
                unit = "rad" if J[3:, stopped].any() else "m"
                words = f"stands at {q[stopped]:.3f} {unit}"
                name = limits.joint_names[stopped]
                return q, LegStatus.JOINT_LIMIT, f"{name} {words}"
            words = f"{1000 * size:.2g} mm or mrad off the line"
            if sigma < np.inf:
                words += f", smallest singular value {sigma:.2g}"
            return q, LegStatus.SINGULAR, words
        if self._is_free is not None and not self._is_free(np.array(q)):
            return q, LegStatus.BLOCKED, "the arm would collide"
        return q, LegStatus.DONE, ""

    def _timed(self, q: FloatArray, length: float, angle: float) -> Trajectory:
        """Ramp up, go at a steady pace, ramp down, within all limits."""
        from scipy.interpolate import CubicSpline  # slow to load

        if len(q) == 1:
            return _slowed(np.zeros(1), q, np.zeros_like(q), self.limits)
        s = np.linspace(0.0, 1.0, len(q))
        path = CubicSpline(s, q, bc_type="natural")
        slope, bend = np.abs(path(s, 1)).max(axis=0), np.abs(path(s, 2)).max(axis=0)
        velocity, acceleration = self.limits.velocity, self.limits.acceleration
        slope, bend = np.maximum(slope, 1e-9), np.maximum(bend, 1e-9)
        pace = min(
            self.speed / max(length, 1e-9),
            self.turn_rate / max(angle, 1e-9),
            float((velocity / slope).min()),
            float(np.sqrt(0.45 * acceleration / bend).min()),
        )
        ramp = float((0.45 * acceleration / slope).min())
        t, s, speed = _paced(pace, ramp)
        rows, speeds = _inside(t, path(s), path(s, 1) * speed[:, None], self.limits)
        return _slowed(t, rows, speeds, self.limits)


def _paced(pace: float, ramp: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Trapezoid of speed along s in [0, 1]; ``ramp`` is the change of pace [1/s^2].

    Returns times [s], s, and its speed [1/s], each (n,).
    """
    pace = min(pace, float(np.sqrt(ramp)))
    rise = pace / ramp
    total = 1.0 / pace + rise
    n = max(4, int(np.ceil(total / _KNOT)))
    t = np.union1d(np.linspace(0.0, total, n + 1), [rise, total - rise])
    t = t[np.r_[True, np.diff(t) > 1e-9]]
    left = total - t
    s = np.where(t < rise, 0.5 * ramp * t * t, pace * (t - 0.5 * rise))
    s = np.where(left < rise, 1.0 - 0.5 * ramp * left * left, s)
    speed = np.minimum(np.minimum(ramp * t, ramp * left), pace)
    return t, np.clip(s, 0.0, 1.0), np.maximum(speed, 0.0)


def _inside(
    t: FloatArray, q: FloatArray, dq: FloatArray, limits: LimitSet
) -> tuple[FloatArray, FloatArray]:
    """Hold joints back that swing beyond a position limit between waypoints there.

    A cubic stays among its ends and where these would come to at their speeds in a
    third of the step: with all four inside, it never leaves the limits.
    """
    q = np.clip(q, limits.lower, limits.upper)
    steps = np.pad(np.diff(t), 1, mode="edge")
    longest = np.maximum(steps[1:], steps[:-1])[:, None]
    room = 3.0 * np.minimum(q - limits.lower, limits.upper - q) / longest
    return q, np.clip(dq, -room, room)


def _slowed(
    t: FloatArray, q: FloatArray, dq: FloatArray, limits: LimitSet
) -> Trajectory:
    """Stretch the time as a whole until speeds and accelerations keep their limits."""
    h, m0, m1 = np.diff(t)[:, None], dq[:-1], dq[1:]
    mean = np.diff(q, axis=0) / h
    speed = np.concatenate([np.abs(dq), np.abs(3.0 * mean - m0 - m1)])
    begin, end = 6.0 * mean - 4.0 * m0 - 2.0 * m1, 2.0 * m0 + 4.0 * m1 - 6.0 * mean
    change = np.abs(np.concatenate([begin, end]) / np.concatenate([h, h]))
    slower = max(
        1.0,
        float((speed / limits.velocity).max()),
        float(np.sqrt((change / limits.acceleration).max(initial=0.0))),
    )
    return Trajectory(
        joint_names=limits.joint_names,
        times=slower * t,
        q=q,
        dq=dq / slower,
        limits_hash=limits.hash,
    )
