"""A clock that loops can rely on: it never falls, and a wait ends, or is a fault."""

from __future__ import annotations

from math import isfinite

from debrisgrasp.robot import Clock

from .result import FaultFound, FaultRaised

__all__ = ["SteadyClock"]

_EARLY = 1e-3
"""A wait may end so much before its time [s]."""


class SteadyClock:
    """The clock of a robot, which may fall, stand, or answer nonsense."""

    def __init__(self, clock: Clock) -> None:
        self._clock, self._latest = clock, 0.0

    def now(self) -> float:
        """Time that was reached so far [s]; raises nothing."""
        try:
            now = float(self._clock.now())
        except Exception:  # noqa: BLE001 - whoever waits next is told
            return self._latest
        if isfinite(now):
            self._latest = max(self._latest, now)
        return self._latest

    def wait_until(self, time: float) -> None:
        """Return once it is so late.

        Raises
        ------
        FaultRaised
            If the clock says afterwards that it is not: a loop would go on for ever.
        """
        self._clock.wait_until(time)
        now = self._clock.now()
        if not now >= time - _EARLY:
            words = f"the robot's clock says {now} s after a wait until {time:g} s"
            raise FaultRaised(FaultFound("clock_disorder", words))
