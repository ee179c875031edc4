"""Notices what an empty hand pushes along: it gives way, until it no longer does."""

from __future__ import annotations

from math import hypot

from debrisgrasp.control._rigid import Wrench

__all__ = ["Lingering"]

_PUSHED, _MORE = 20.0, 10.0
"""A hand that bears so much, and by so much more than at first [N] ..."""
_FOR = 0.15
"""... for so long [s], is not shaken: it touches something."""


class Lingering:
    """Watches the load on an empty hand that is taken elsewhere, tick by tick.

    What slides before the hand resists with its friction only, below what ends a motion
    at once. Where it can't slide on, the force grows within a few ticks: faster than a
    hand brakes that is as fast as in free space.
    """

    def __init__(self, load: Wrench, period: float) -> None:
        self._most = max(_PUSHED, hypot(*load[:3]) + _MORE)
        self._period, self._time = period, 0.0

    def is_met(self, load: Wrench) -> bool:
        """Take the load of the next tick [N, N m], and tell whether it lingers."""
        force = hypot(*load[:3])
        self._time = self._time + self._period if force > self._most else 0.0
        return self._time >= _FOR
