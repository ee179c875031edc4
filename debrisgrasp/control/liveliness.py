"""Notices a sensor that is dead, or one of its axes at an end that nobody told of."""

from __future__ import annotations

from typing import NamedTuple

from ._rigid import Wrench

__all__ = ["Liveliness"]

_LIVELY = 25
"""An axis that turned so often in a row is noisy, and does not stand by chance."""


class Liveliness(NamedTuple):
    """How the axes of a sensor have changed, from reading to reading."""

    changed: Wrench
    """When each last differed from the reading before, or the arm stood [s]."""
    has_risen: tuple[bool, ...] = (False,) * 6
    """Whether it was larger then."""
    turns: tuple[int, ...] = (0,) * 6
    """How often each rose and fell by turns, and never stood for long between."""

    def followed(
        self, before: Wrench, after: Wrench, now: float, long: float, *, is_moving: bool
    ) -> Liveliness:
        """Take in the next reading; what stands for so much time [s] is not noisy."""
        changed, has_risen = list(self.changed), list(self.has_risen)
        turns = list(self.turns)
        for i, (was, value) in enumerate(zip(before, after, strict=True)):
            if was != value:
                if now - changed[i] > long:
                    turns[i] = 0
                elif has_risen[i] != (value > was):
                    turns[i] += 1
                changed[i], has_risen[i] = now, value > was
            elif not is_moving:
                changed[i] = now
        return Liveliness(tuple(changed), tuple(has_risen), tuple(turns))

    def equal_for(self, now: float) -> float:
        """Time for which all axes have been equal to the last digit [s]."""
        return now - max(self.changed)

    def ended(self, raw: Wrench, much: Wrench, since: float) -> int | None:
        """Find an axis that was noisy, and has stood at a large value since some time.

        It is at an end. One of a sensor that is coarse, or hardly noisy, stands by
        nature.
        """
        rows = zip(self.changed, self.turns, raw, much, strict=True)
        for i, (changed, n_turns, value, most) in enumerate(rows):
            if changed < since and n_turns >= _LIVELY and abs(value) > most:
                return i
        return None
