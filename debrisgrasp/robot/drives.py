"""Joints that go where they are told, as fast as their limits allow and no faster."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import copysign

from debrisgrasp.control.servo import stoppable
from debrisgrasp.kinematics import LimitSet

__all__ = ["Drives", "Timeline", "Violation"]


class Timeline:
    """The one time of a robot in memory: it only advances when told."""

    def __init__(self, period: float) -> None:
        self.period = period
        self.tick = 0

    @property
    def now(self) -> float:
        """Seconds since the start."""
        return self.tick * self.period


@dataclass(frozen=True, slots=True)
class Violation:
    """A command that a device refused, or could not follow as it was meant."""

    time: float
    """[s]."""
    device: str
    message: str


class Drives:
    """All joints of all arms; a joint that arms share is one joint."""

    def __init__(self, period: float) -> None:
        self.period = period
        self.index: dict[str, int] = {}
        self.q: list[float] = []
        self.step: list[float] = []
        """What each moved in the last tick [rad or m]."""
        self._goal: list[float | None] = []
        self._flow: list[float] = []
        """By how much the goal itself goes on per tick [rad or m] ..."""
        self._ahead: list[int] = []
        """... and for how many ticks."""
        self._bounds: list[tuple[float, float, float, float, float]] = []
        """Lower and upper end, speed and acceleration per tick, and the way in which a
        joint stops from that speed."""
        self._busy: set[int] = set()
        self.version = 0
        """Grows whenever a joint may have moved."""

    def add(self, limits: LimitSet, q: Sequence[float]) -> list[int]:
        """Take the joints of one arm at a posture (d,); return their numbers."""
        period = self.period
        rows = zip(
            limits.joint_names,
            q,
            limits.lower.tolist(),
            limits.upper.tolist(),
            (limits.velocity * period).tolist(),
            (limits.acceleration * period * period).tolist(),
            strict=True,
        )
        for name, value, *bounds in rows:
            if name not in self.index:
                self.index[name] = len(self.q)
                self.q.append(float(value))
                self.step.append(0.0)
                self._goal.append(None)
                self._flow.append(0.0)
                self._ahead.append(0)
                lower, upper, most, gain = bounds
                braking = (most + 0.5 * gain) ** 2 / (2.0 * gain)
                self._bounds.append((lower, upper, most, gain, braking))
        return [self.index[name] for name in limits.joint_names]

    @property
    def is_still(self) -> bool:
        """Whether no joint moves or is about to."""
        return not self._busy

    def aim(self, joints: Sequence[int], q: Sequence[float], n_ticks: int) -> None:
        """Send joints somewhere, to be there after so many ticks."""
        for i, value in zip(joints, q, strict=True):
            last = self._goal[i]
            start = self.q[i] if last is None else last
            self._goal[i] = value
            self._flow[i], self._ahead[i] = (value - start) / n_ticks, n_ticks
        self._busy.update(joints)

    def hold(self, joints: Sequence[int]) -> None:
        """Bring joints to rest."""
        for i in joints:
            self._goal[i] = None

    def put(self, joint: int, value: float) -> None:
        """Place a joint anywhere, as if something had pushed it there."""
        self.q[joint], self.step[joint], self._goal[joint] = value, 0.0, None
        self.version += 1

    def advance(self) -> None:
        """Move every joint for one period."""
        self.version += 1
        q, steps, ahead = self.q, self.step, self._ahead
        for i in tuple(self._busy):
            lower, upper, most, gain, braking = self._bounds[i]
            value, last, goal = q[i], steps[i], self._goal[i]
            if goal is None:
                wanted = 0.0
            else:
                # What is left after going on with the goal is made up for so that the
                # joint can still come to rest there.
                flow = 0.0
                if ahead[i] > 0:
                    flow = self._flow[i]
                    ahead[i] -= 1
                left = goal - ahead[i] * flow - value - flow
                if -0.5 * gain <= left <= 0.5 * gain:
                    wanted = flow + left
                else:
                    wanted = flow + copysign(stoppable(abs(left), gain), left)
            # Written out, since this is done for every joint in every period.
            high, low = last + gain, last - gain
            high, low = most if high > most else high, -most if low < -most else low
            if upper - value < braking:
                high = min(high, stoppable(upper - value, gain))
            if value - lower < braking:
                low = max(low, -stoppable(value - lower, gain))
            step = wanted if wanted > low else low
            step = high if step > high else step
            there = value + step
            if not lower <= there <= upper:
                # Something else may have pushed it out; it comes back step by step.
                there = min(max(there, min(lower, value)), max(upper, value))
            q[i], steps[i] = there, there - value
            if step == 0.0 and (goal is None or goal == value):
                self._busy.discard(i)
