"""How sure one can be of a share that was counted."""

from __future__ import annotations

import math
from typing import NamedTuple

from scipy.special import ndtri

from debrisgrasp._arrays import require_range
from debrisgrasp.errors import InputError

__all__ = ["Interval", "newcombe", "wilson"]


class Interval(NamedTuple):
    """Two ends."""

    low: float
    high: float


def wilson(count: int, total: int, *, confidence: float = 0.95) -> Interval:
    """Interval of a share, by inverting the score test (Wilson 1927).

    It keeps its promise also for small totals and for shares near 0 and 1. Nothing
    counted says nothing: (0, 1).
    """
    _require_counts(count, total)
    if not total:
        return Interval(0.0, 1.0)
    z = _z(confidence)
    share, weight = count / total, z * z / total
    middle = (share + weight / 2) / (1 + weight)
    half = math.sqrt(share * (1 - share) * weight + weight * weight / 4) / (1 + weight)
    return Interval(
        0.0 if count == 0 else middle - half, 1.0 if count == total else middle + half
    )


def newcombe(
    old: tuple[int, int], new: tuple[int, int], *, confidence: float = 0.95
) -> Interval:
    """Interval of the difference of two shares, new minus old.

    Newcombe's hybrid of two Wilson intervals (Statistics in Medicine 17, 1998, method
    10), for campaigns that are independent of each other.

    Parameters
    ----------
    old, new
        Count and total of each.
    """
    (count_old, total_old), (count_new, total_new) = old, new
    low_old, high_old = wilson(count_old, total_old, confidence=confidence)
    low_new, high_new = wilson(count_new, total_new, confidence=confidence)
    if not (total_old and total_new):
        return Interval(-1.0, 1.0)
    share_old, share_new = count_old / total_old, count_new / total_new
    difference = share_new - share_old
    return Interval(
        difference - math.hypot(share_new - low_new, high_old - share_old),
        difference + math.hypot(high_new - share_new, share_old - low_old),
    )


def _z(confidence: float) -> float:
    require_range("confidence", confidence, 0.5, 0.999999)
    return float(ndtri((1 + confidence) / 2))


def _require_counts(count: int, total: int) -> None:
    if not 0 <= count <= total:
        raise InputError(
            "a count", got=f"{count} of {total}", expected="0 to the total"
        )
