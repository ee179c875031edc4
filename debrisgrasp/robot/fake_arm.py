"""An arm in memory, and the sensor in its wrist."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import exp, isfinite

import numpy as np

from debrisgrasp._arrays import Rng
from debrisgrasp.control import LoadModel, PostureKinematics
from debrisgrasp.control._rigid import Rotation, Vector, Wrench
from debrisgrasp.kinematics import KinematicChain, LimitSet

from .config import FakeConfig
from .drives import Drives, Timeline, Violation
from .interface import JointReading, WrenchReading

__all__ = ["FakeArm", "FakeForceSensor"]

_SLACK = 1.02
"""Commands may exceed speed and acceleration by rounding and uneven ticks."""
_ROUNDING = 1e-6
_DRAWN = 256
"""Errors of so many readings are drawn at once."""


class FakeArm:
    """Joints of one arm; fulfils `debrisgrasp.robot.Arm`."""

    def __init__(
        self,
        name: str,
        chain: KinematicChain,
        limits: LimitSet,
        q_start: Sequence[float],
        drives: Drives,
        timeline: Timeline,
        config: FakeConfig,
        violations: list[Violation],
    ) -> None:
        self.name, self.chain = name, chain
        self._limits, self._config = limits, config
        self._drives, self._timeline, self._violations = drives, timeline, violations
        self._joints = drives.add(limits, q_start)
        self._kinematics = PostureKinematics(chain)
        self._lower, self._upper = limits.lower.tolist(), limits.upper.tolist()
        self._speed = limits.velocity.tolist()
        self._acceleration = limits.acceleration.tolist()
        self._engages_at: float | None = None
        self._is_engaged = self._is_stopped = self._is_following = False
        self._commanded: tuple[int, tuple[float, ...], tuple[float, ...]] | None = None
        self._q: tuple[int, tuple[float, ...]] = (-1, ())
        self._ranges = tuple(zip(self._lower, self._upper, strict=True))
        self._rates = tuple(
            (_SLACK * most + _ROUNDING, _SLACK * gain)
            for most, gain in zip(self._speed, self._acceleration, strict=True)
        )

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Joints, in the order of all readings and commands."""
        return self._limits.joint_names

    @property
    def limits(self) -> LimitSet:
        """What the drives keep."""
        return self._limits

    @property
    def is_engaged(self) -> bool:
        """Whether commands are followed."""
        return self._is_engaged

    @property
    def is_stopped(self) -> bool:
        """Whether a stop is latched."""
        return self._is_stopped

    @property
    def q(self) -> tuple[float, ...]:
        """True posture [rad or m]."""
        version, q = self._q
        if version != self._drives.version:
            now = self._drives.q
            q = tuple([now[i] for i in self._joints])
            self._q = self._drives.version, q
        return q

    @property
    def joints(self) -> Sequence[int]:
        """Numbers of the joints among all drives."""
        return self._joints

    def read(self) -> JointReading:
        """Read the true posture; the encoders are exact."""
        return JointReading(self._timeline.now, self.q)

    def pose(self) -> tuple[Rotation, Vector]:
        """Rotation and position of the hand in base, as plain numbers."""
        return self._kinematics.pose(self.q)

    def engage(self) -> None:
        """Begin to follow commands after a moment; not while a stop is latched."""
        is_asked = self._is_engaged or self._engages_at is not None
        if not self._is_stopped and not is_asked:
            self._engages_at = self._timeline.now + self._config.engage_time

    def disengage(self) -> None:
        """Hold."""
        self._engages_at, self._is_engaged = None, False
        self._hold()

    def stop(self) -> None:
        """Brake as hard as the limits allow, and follow nothing until `reset`."""
        self._is_stopped = True
        self.disengage()

    def reset(self) -> None:
        """End the latched stop; the drives stay disengaged."""
        self._is_stopped = False

    def command(self, q: Sequence[float]) -> None:
        """Go there by the next tick, or towards it as fast as the limits allow.

        What is no posture within the limits is refused: the arm holds.
        """
        if not self._is_engaged:
            return
        refusal, values = self._checked(q)
        if refusal:
            self._violations.append(
                Violation(self._timeline.now, f"arm {self.name}", refusal)
            )
            self._hold()
            return
        tick, before = self._timeline.tick, self._commanded
        if before is None:
            n, speed = 1, (0.0,) * len(values)
            last = self.q
        else:
            n, last, speed = tick - before[0], before[1], before[2]
        if n > 0:
            dt = n * self._timeline.period
            rate = tuple([(a - b) / dt for a, b in zip(values, last, strict=True)])
            self._check_rates(rate, speed, dt)
            speed = rate
        else:
            tick = before[0] if before else tick
        self._commanded = (tick, values, speed)
        self._is_following = True
        self._drives.aim(self._joints, values, max(n, 1))

    def advance(self) -> None:
        """Let a period pass: engage, or hold when no command came."""
        if self._engages_at is not None and self._timeline.now >= self._engages_at:
            self._engages_at, self._is_engaged = None, True
        if self._is_following and self._commanded is not None:
            age = self._timeline.tick - self._commanded[0]
            if age * self._timeline.period > self._config.watchdog:
                self._hold()

    def _hold(self) -> None:
        if self._is_following or self._commanded is not None:
            self._drives.hold(self._joints)
        self._is_following, self._commanded = False, None

    def _checked(self, q: Sequence[float]) -> tuple[str, tuple[float, ...]]:
        """Why a command is refused, if it is; and its numbers."""
        try:
            values = tuple(map(float, q))
        except (TypeError, ValueError):
            return f"commanded {q!r}, which are no numbers", ()
        if len(values) != len(self._joints):
            n = len(self._joints)
            return f"commanded {len(values)} values for {n} joints", ()
        checked = zip(values, self._ranges, strict=True)
        for i, (value, (low, high)) in enumerate(checked):
            if low <= value <= high:
                continue
            joint, now = self.joint_names[i], self.q[i]
            if not isfinite(value):
                return f"commanded {joint} to {value}", ()
            # From outside, where something else pushed it, a joint may come back.
            if not min(low, now) - 1e-9 <= value <= max(high, now) + 1e-9:
                return f"commanded {joint} to {value:.6g}, beyond its limits", ()
        return "", values

    def _check_rates(
        self, rate: Sequence[float], before: Sequence[float], dt: float
    ) -> None:
        checked = zip(rate, before, self._rates, strict=True)
        for i, (new, old, (most, gain)) in enumerate(checked):
            change = gain * dt + _ROUNDING
            if not -most <= new <= most:
                what = f"speed {new:.4g}, more than {self._speed[i]:g}"
            elif not -change <= new - old <= change:
                what = f"acceleration {(new - old) / dt:.4g}"
                what += f", more than {self._acceleration[i]:g}"
            else:
                continue
            joint = self.joint_names[i]
            self._violations.append(
                Violation(
                    self._timeline.now,
                    f"arm {self.name}",
                    f"commanded {joint} with {what}",
                )
            )
            return


class FakeForceSensor:
    """Six axes in the wrist; fulfils `debrisgrasp.robot.ForceSensor`."""

    def __init__(
        self,
        arm: FakeArm,
        loads: LoadModel,
        timeline: Timeline,
        config: FakeConfig,
        rng: Rng,
    ) -> None:
        self.load_ee: tuple[float, ...] = (0.0,) * 6
        """True load at the hand, in its axes [N, N m]."""
        self._arm, self._loads = arm, loads
        self._timeline, self._rng = timeline, rng
        way = rng.standard_normal((2, 3))
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        drift = np.array(config.drift)[:, None] / 3600.0
        self._drift = (drift * way).ravel().tolist()
        self._sigma = np.repeat(config.sensor_noise, 3)
        self._noise: Iterator[list[float]] = iter(())
        self._range = np.repeat(config.sensor_range, 3).tolist()
        self._lag = config.sensor_lag
        self._felt: Sequence[float] | None = None
        self._last: WrenchReading | None = None

    def read(self) -> WrenchReading:
        """Measure; the same until time goes on."""
        now = self._timeline.now
        if self._last is None or self._last.time != now:
            self._last = WrenchReading(now, self._reading(now))
        return self._last

    def _reading(self, now: float) -> Wrench:
        load, last = self.load_ee, self._last
        if self._felt is not None and last is not None and self._lag > 0.0:
            rest = exp((last.time - now) / self._lag)
            load = tuple(
                [x + rest * (y - x) for x, y in zip(load, self._felt, strict=True)]
            )
        self._felt = load
        raw = self._loads.reading_of(load, self._arm.pose()[0])
        noise = next(self._noise, None)
        if noise is None:
            drawn = self._sigma * self._rng.standard_normal((_DRAWN, 6))
            self._noise = iter(drawn.tolist())
            noise = next(self._noise)
        rows = zip(raw, self._drift, noise, strict=True)
        told = [value + drift * now + error for value, drift, error in rows]
        within = zip(told, self._range, strict=True)
        return tuple([-m if x < -m else m if x > m else x for x, m in within])
