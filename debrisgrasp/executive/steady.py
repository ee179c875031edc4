"""A clock that loops can rely on: it never falls, and a wait ends, or is a fault."""

from __future__ import annotations

from math import isfinite

from debrisgrasp.robot import Clock

from .result import FaultFound, FaultRaised

__all__ = ["SteadyClock"]

_EARLY, _LATE = 1e-3, 1.0
"""A wait may end so much before its time, or after it [s]."""
_SLICE = 0.1
"""Longer waits are made of such, so that a clock that goes wrong is noticed [s]."""


class SteadyClock:
    """The clock of a robot, which may fall, jump, stand, or answer nonsense."""

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
            If the clock says that it is earlier than it was, or after a wait that it is
            not as late as was asked for, or much later: a loop would go on for ever, or
            a motion for as long as the clock was ahead.
        """
        end = float(self._clock.now())
        if not end >= self._latest - _EARLY or not isfinite(time):
            words = f"the robot's clock says {end} s, after it said {self._latest:g} s"
            raise FaultRaised(FaultFound("clock_disorder", words))
        self._latest = max(self._latest, end)
        while end < time:
            end = min(end + _SLICE, time)
            self._clock.wait_until(end)
            now = float(self._clock.now())
            if not end - _EARLY <= now <= end + _LATE:
                words = f"the robot's clock says {now} s after a wait until {end:g} s"
                raise FaultRaised(FaultFound("clock_disorder", words))
            self._latest = max(self._latest, now)
