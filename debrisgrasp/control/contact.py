"""Touching on purpose: how fast to come, and when it is felt."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot

from debrisgrasp._arrays import require_range
from debrisgrasp.errors import ConfigError
from debrisgrasp.kinematics import LimitSet

from ._rigid import Wrench

__all__ = ["ContactGuard"]

_RANGES = (
    ("force", 1e-6, 1e4),
    ("torque", 1e-6, 1e4),
    ("stiffness", 10.0, 1e9),
    ("reaction_time", 1e-3, 10.0),
)
"""Whatever is softer than that, or felt sooner, would allow any speed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactGuard:
    """Ends a leg when the wrist feels that the hand touches something.

    No compliance softens an impact: while the contact is detected and the arm stopped,
    the force grows by stiffness times speed. That sets the speed.
    """

    force: float = 60.0
    """Change of the force at which the hand counts as touching [N]; above the noise,
    and above what accelerating the gripper takes."""
    torque: float = 15.0
    """The same for the torque [N m]."""
    stiffness: float = 1e5
    """Of the hardest thing that may be met [N/m]; concrete against a bare palm."""
    reaction_time: float = 0.060
    """From the touch until the arm stands [s]: one half to detect it and for the arm's
    lag, the other to brake. Joints that brake more slowly need a longer time, and so a
    lower speed."""

    def __post_init__(self) -> None:
        for name, least, most in _RANGES:
            require_range(f"ContactGuard.{name}", getattr(self, name), least, most)

    def largest_speed(self, limits: LimitSet) -> float:
        """Speed [m/s] at which the force stays below its limit."""
        room = max(limits.force - self.force, 0.0)
        return room / (self.stiffness * self.reaction_time)

    def require_speed(self, speed: float, limits: LimitSet) -> None:
        """Raise `ConfigError`, with the numbers, if an approach is too fast."""
        most = self.largest_speed(limits)
        if not 0.0 <= speed <= most * (1.0 + 1e-9):
            raise ConfigError(
                "speed of a guarded approach [m/s]",
                got=f"{speed:g}",
                expected=f"0 to {most:.3g}: limit {limits.force:g} N less threshold "
                f"{self.force:g} N, over {self.stiffness:g} N/m and "
                f"{1000 * self.reaction_time:g} ms",
                mend="Go slower, or touch something softer.",
            )

    def braking_fault(self, braking_time: float) -> str:
        """Say why an arm that brakes for so long [s] may not approach, or nothing."""
        half = 0.5 * self.reaction_time
        if braking_time <= half:
            return ""
        return (
            f"the joints brake for {1000 * braking_time:.0f} ms, longer than half the "
            f"guard's reaction time, {1000 * half:.0f} ms: go slower, or set a longer "
            "reaction time, which lowers the speed allowed"
        )

    def is_touched(self, load: Wrench, reference: Wrench) -> bool:
        """Whether the unfiltered load has changed enough since the leg began."""
        a, b, c, d, e, f = load
        p, q, r, s, t, u = reference
        # Written so that NaN counts as a touch.
        return not (
            hypot(a - p, b - q, c - r) < self.force
            and hypot(d - s, e - t, f - u) < self.torque
        )
