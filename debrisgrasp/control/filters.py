"""Smoothing of the wrench, and the reference that is taken away from it (Eq. 6)."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, log
from numbers import Real

from numpy.typing import ArrayLike

from debrisgrasp._arrays import FloatArray, finite, require_range
from debrisgrasp.errors import ConfigError, InputError

from ._rigid import Wrench

__all__ = ["REFERENCE_SAMPLES", "ZERO_WRENCH", "WrenchFilter", "reference_wrench"]

ZERO_WRENCH: Wrench = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""State of the filter at every engagement."""

REFERENCE_SAMPLES = 50
"""Fewer are no reference."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WrenchFilter:
    """First-order smoothing, ``W = (1 - a) W + a W_react`` (Eq. 6b).

    Only the deflection is made from the filtered wrench. A limit checked on it would
    react as late as the filter.
    """

    tau: float = 0.398
    """Time constant [s]: how long the hand takes for 63 % of its yielding. Larger is
    calmer, and stays stable with more compliance. The paper's a = 0.01 at 250 Hz."""
    period: float = 0.004
    """Time between samples [s]."""

    def __post_init__(self) -> None:
        require_range("control period [s]", self.period, 1e-4, 0.1)
        require_range("WrenchFilter.tau [s]", self.tau, self.period / 10.0, 60.0)

    @property
    def alpha(self) -> float:
        """Weight of the new sample, a; it depends on the period, unlike tau."""
        return 1.0 - exp(-self.period / self.tau)

    def settling_time(self, share: float = 0.95) -> float:
        """Seconds until a step has passed the filter to this share.

        Raises
        ------
        ConfigError
            If that is no number, or not below 1.
        """
        if not (isinstance(share, Real) and 0.0 <= share < 1.0):
            raise ConfigError(
                "share of a step that has passed",
                got=share,
                expected="0 or more, below 1",
                mend="All of it never has: 0.95 is most.",
            )
        return -self.tau * log(1.0 - share)

    def step(self, filtered: Wrench, sample: Wrench) -> Wrench:
        """Blend in one sample."""
        a = self.alpha
        return blended(filtered, sample, a)


def blended(filtered: Wrench, sample: Wrench, a: float) -> Wrench:
    """``(1 - a) filtered + a sample``."""
    p, q, r, s, t, u = filtered
    x, y, z, i, j, k = sample
    return (
        p + a * (x - p),
        q + a * (y - q),
        r + a * (z - r),
        s + a * (i - s),
        t + a * (j - t),
        u + a * (k - u),
    )


def median(a: Wrench, b: Wrench, c: Wrench) -> Wrench:
    """Median of each component: one spike passes unnoticed, a second does not."""
    middle = [
        y if x <= y <= z or z <= y <= x else x if y <= x <= z or z <= x <= y else z
        for x, y, z in zip(a, b, c, strict=True)
    ]
    return tuple(middle)


def reference_wrench(
    loads: ArrayLike, *, max_sigma_force: float = 0.6, max_sigma_torque: float = 0.02
) -> FloatArray:
    """Mean load at a standstill, which reactions are measured from; shape (6,).

    A single sample, as in the printed Eq. 6a, would put its whole noise into every
    later reaction.

    Parameters
    ----------
    loads
        Unfiltered loads at the hand [N, N m], shape (n, 6), n at least
        `REFERENCE_SAMPLES`.
    max_sigma_force, max_sigma_torque
        More scatter than this along an axis means that something still moves.

    Raises
    ------
    ShapeError
        If the loads are not (n, 6).
    InputError
        If there are too few samples, or they scatter too much.
    """
    loads = finite(loads, "loads", (None, 6))
    if len(loads) < REFERENCE_SAMPLES:
        raise InputError(
            "samples for a reference",
            got=len(loads),
            expected=f"at least {REFERENCE_SAMPLES}",
        )
    sigma = loads.std(axis=0)
    for name, have, most in (
        ("force", sigma[:3].max(), max_sigma_force),
        ("torque", sigma[3:].max(), max_sigma_torque),
    ):
        if have > most:
            raise InputError(
                f"scatter of the {name} while a reference is taken",
                got=f"{have:.3g}",
                expected=f"at most {most:g}",
                mend="Wait until arm and load stand still.",
            )
    mean: FloatArray = loads.mean(axis=0)
    return mean
