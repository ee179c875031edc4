"""Notices when the hand swings against what it touches."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, hypot, pi
from typing import NamedTuple

from debrisgrasp._arrays import require_range

from ._rigid import Wrench
from .filters import ZERO_WRENCH, blended

__all__ = ["OscillationGuard", "OscillationState"]

_WINDOW = 1.0
"""Reversals are counted over this time [s]."""


class OscillationState(NamedTuple):
    """What the guard remembers."""

    slow: Wrench = ZERO_WRENCH
    """The load as it would be without the swinging."""
    signs: tuple[int, ...] = (0,) * 6
    """On which side of it each component was last beyond the threshold."""
    reversals: tuple[tuple[float, ...], ...] = ((),) * 6
    """When each component changed side [s], the latest few."""
    strikes: int = 0
    """How often the guard has struck since engagement."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OscillationGuard:
    """Counts how often the load swings from one side of its mean to the other."""

    crossover: float
    """Frequency near which contact would swing [Hz], `StabilityBound.crossover`."""
    force: float
    """Swings smaller than this don't count [N]."""
    torque: float
    """[N m]."""
    reversals: int = 4
    """So many in a second strike; fewer make the guard touchier."""

    def __post_init__(self) -> None:
        require_range("OscillationGuard.crossover [Hz]", self.crossover, 1e-3, 1e3)
        require_range("OscillationGuard.force [N]", self.force, 1e-6)
        require_range("OscillationGuard.torque [N m]", self.torque, 1e-6)
        require_range("OscillationGuard.reversals", self.reversals, 2, 100)

    def step(
        self, state: OscillationState, now: float, period: float, load: Wrench
    ) -> tuple[OscillationState, bool]:
        """Take in one unfiltered load; returns whether the guard strikes now."""
        # Loads that change slower than a quarter of the crossover are handling.
        share = 1.0 - exp(-2.0 * pi * 0.25 * self.crossover * period)
        slow = blended(state.slow, load, share)
        swings = tuple([felt - mean for felt, mean in zip(load, slow, strict=True)])
        if hypot(*swings[:3]) <= self.force and hypot(*swings[3:]) <= self.torque:
            return state._replace(slow=slow), False
        signs, has_struck = state.signs, False
        for i in range(6):
            swing, band = swings[i], self.force if i < 3 else self.torque
            side = 1 if swing > band else -1 if swing < -band else 0
            if side != 0 and side != signs[i]:
                if signs[i] != 0:
                    state = self._with_reversal(state, i, now)
                    times = state.reversals[i]
                    is_full = len(times) >= self.reversals
                    has_struck |= is_full and now - times[0] <= _WINDOW
                signs = (*signs[:i], side, *signs[i + 1 :])
        if has_struck:
            struck = OscillationState(slow, (0,) * 6, ((),) * 6, state.strikes + 1)
            return struck, True
        return OscillationState(slow, signs, state.reversals, state.strikes), False

    def _with_reversal(
        self, state: OscillationState, i: int, now: float
    ) -> OscillationState:
        kept = (*state.reversals[i], now)[-self.reversals :]
        reversals = (*state.reversals[:i], kept, *state.reversals[i + 1 :])
        return OscillationState(state.slow, state.signs, reversals, state.strikes)
