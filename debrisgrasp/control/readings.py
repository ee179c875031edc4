"""What the robot measured, what is expected of it, and what is remembered of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from debrisgrasp._arrays import FloatArray, require_range
from debrisgrasp._checked import checked_fields

from ._rigid import Rotation, Vector, Wrench
from .faults import Stop
from .liveliness import Liveliness

__all__ = ["BiasBound", "Reading", "SafetyConfig", "SafetyState", "Verdict"]

_MOST = {
    "hold_after": 1.0,
    "frozen_after": 1.0,
    "jump_force": 1e3,
    "jump_torque": 300.0,
    "following_error": 0.3,
    "following_time": 1.0,
    "motion_force": 1e4,
    "motion_torque": 1e4,
    "lead": 1.0,
    "trend": 0.02,
}
"""With more, nothing would ever be judged by them; in the units of `SafetyConfig`."""


class Reading(NamedTuple):
    """What the robot measured; anything in it may be wrong."""

    time: float
    """When this tick takes place [s]."""
    q: Sequence[float] | FloatArray
    """Measured joint values [rad or m], d of them."""
    wrench_ft: Sequence[float] | FloatArray
    """As the sensor's driver gave it [N, N m], six values."""
    wrench_time: float
    """When the wrench was measured, by the same clock [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BiasBound:
    """How wrong the bias of the sensor may have become since its last baseline."""

    force: float = 2.0
    """At once [N]."""
    torque: float = 0.1
    """At once [N m]."""
    force_per_hour: float = 5.0
    """[N/h]; until the sensor has been characterised."""
    torque_per_hour: float = 0.3
    """[N m/h]."""

    def __post_init__(self) -> None:
        for name in self.__slots__:
            require_range(f"BiasBound.{name}", getattr(self, name), 0.0, 1e6)

    def at(self, age: float) -> tuple[float, float]:
        """Bounds on force [N] and torque [N m] after so many seconds."""
        hours = max(age, 0.0) / 3600.0
        return (
            self.force + self.force_per_hour * hours,
            self.torque + self.torque_per_hour * hours,
        )


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class SafetyConfig:
    """When readings are too old, too equal or too large to go on."""

    hold_after: float = 0.012
    """Without a new wrench for longer, the motion pauses [s]."""
    stop_after: float = 0.040
    """Without a new wrench, or a tick, for longer, it stops [s]; so it does if ticks
    come so far ahead of their period."""
    frozen_after: float = 0.050
    """A wrench that is equal to the last digit for so long while moving is dead, and a
    noisy axis of it that bears a quarter of a limit is at its end [s]."""
    jump_force: float = 60.0
    """Largest change of the force from one sample to the next [N]."""
    jump_torque: float = 15.0
    """Largest change of the torque from one sample to the next [N m]."""
    following_error: float = 0.05
    """Largest distance between commanded and measured joint [rad or m] ..."""
    following_time: float = 0.100
    """... for so long [s]."""
    motion_force: float | None = None
    """Largest change of the force within one motion [N]; None: only the absolute
    limit counts."""
    motion_torque: float | None = None
    """[N m]."""
    lead: float = 0.012
    """Time in which an arm that is stopped comes to stand [s]: the load must stay below
    its limit until then, if it grows on."""
    trend: float = 0.004
    """Over which its growth is measured [s], up to 20 ms: over less, noise would look
    like growth to a fast loop, over more a blow is judged too late."""
    bias: BiasBound = BiasBound()

    def __post_init__(self) -> None:
        for name, most in _MOST.items():
            if (value := getattr(self, name)) is not None:
                require_range(f"SafetyConfig.{name}", value, 1e-6, most)
        require_range("SafetyConfig.stop_after", self.stop_after, self.hold_after, 1.0)


class SafetyState(NamedTuple):
    """What the supervisor remembers from tick to tick."""

    time: float
    """Of the last tick [s]."""
    wrench_time: float
    """Of the last usable wrench [s]."""
    raw: Wrench
    """That wrench, as read."""
    liveliness: Liveliness
    """How its axes have changed."""
    q: tuple[float, ...]
    """Last believable measured posture."""
    followed: float
    """When the joints last followed [s]."""
    recent: tuple[Wrench, Wrench]
    """The two loads before the latest."""
    load: Wrench
    """Latest load, median of three."""
    trend: tuple[float, Wrench]
    """When growth was judged last [s], and the load then."""
    early: float = 0.0
    """How far the ticks have come ahead of their period [s]."""
    stop: Stop | None = None


class Verdict(NamedTuple):
    """What a tick may rely on."""

    load: Wrench
    """Absolute load at the hand, unfiltered, in its axes [N, N m]."""
    is_fresh: bool
    """Whether the load is from this tick."""
    may_advance: bool
    """Whether the motion may go on; else it pauses."""
    measured: tuple[Rotation, Vector]
    """Pose of the hand at the measured posture."""
