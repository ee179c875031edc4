"""Which faults are active, and since when."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from debrisgrasp._arrays import Rng

from .interface import Clock

__all__ = ["Live", "Spoiling"]


@dataclass(slots=True, eq=False, kw_only=True)
class Live:
    """A fault that is to strike, does, or did."""

    fault: str
    device: str
    state: str
    arm: str | None
    at: float
    severity: float
    lasting: float
    rng: Rng
    begins: float | None = None
    """When it begins [s]; None until its state has begun."""
    times: int = 0
    """How often it had an effect."""
    kept: dict[Any, Any] = field(default_factory=dict)
    """What its effect remembers, by device."""


class Spoiling:
    """All faults of a run, on the clock of its robot."""

    def __init__(self, clock: Clock, lives: Sequence[Live]) -> None:
        self.lives = tuple(lives)
        self.state = ""
        """State of the task."""
        self.on_time: Callable[[], None] = _nothing
        self._clock = clock
        self._has_world = any(live.device == "world" for live in lives)
        self.clock: Clock = self if self._has_world else clock
        """To be used instead, so that the world changes in time."""

    def now(self) -> float:
        """Seconds; never falls."""
        return self._clock.now()

    def wait_until(self, time: float) -> None:
        """Return at that time, having let happen what was due by then."""
        for live in self.lives:
            begins = live.begins
            if live.device == "world" and begins is not None and not live.times:
                self._clock.wait_until(min(max(begins, self.now()), time))
                self.on_time()
        self._clock.wait_until(time)

    def begin(self, state: str) -> None:
        """Arm what waits for a state."""
        self.state = state
        for live in self.lives:
            if live.begins is None and live.state == state:
                live.begins = self.now() + live.at

    def due(self, devices: tuple[str, ...], arm: str | None = None) -> list[Live]:
        """Faults of some devices that are active now."""
        begun = [
            live
            for live in self.lives
            if live.begins is not None
            and live.device in devices
            and (arm is None or live.arm is None or live.arm == arm)
        ]
        if not begun:
            return begun
        now = self.now()
        return [
            live for live in begun if 0.0 <= now - (live.begins or 0.0) < live.lasting
        ]


def _nothing() -> None:
    """Do nothing."""
