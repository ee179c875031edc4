"""Two campaigns run by run, where both had the same scenes."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass

from scipy.stats import binomtest

from .record import RunRecord

__all__ = ["SameScenes", "same_scenes"]

_SCENE = ("world", "level", "tier", "seed", "faults")
"""Fields of a spec that say what a run met; others say what it did there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SameScenes:
    """What became of the runs that both campaigns have."""

    runs: int
    """How many."""
    gained: tuple[str, ...]
    """Names, in the new campaign, of those that succeed in it alone."""
    lost: tuple[str, ...]
    """Names of those that succeed in the old one alone."""

    @property
    def chance(self) -> float:
        """How often luck alone splits so many as unequally: the exact sign test.

        Much sharper than the difference of two shares, for what is easy or hopeless in
        both campaigns does not blur it.
        """
        unequal = len(self.gained) + len(self.lost)
        if not unequal:
            return 1.0
        return float(binomtest(len(self.gained), unequal).pvalue)


def same_scenes(old: Iterable[RunRecord], new: Iterable[RunRecord]) -> SameScenes:
    """Pair the runs of two campaigns by their scenes and injected faults."""
    before = {_scene(record): record for record in old}
    now = {_scene(record): record for record in new}
    pairs = [(before[scene], now[scene]) for scene in now if scene in before]
    return SameScenes(
        runs=len(pairs),
        gained=tuple(b.name for a, b in pairs if b.is_success and not a.is_success),
        lost=tuple(b.name for a, b in pairs if a.is_success and not b.is_success),
    )


def _scene(record: RunRecord) -> str:
    return json.dumps([record.spec.get(name) for name in _SCENE])
