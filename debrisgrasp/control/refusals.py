"""Why a motion does not begin, or a baseline is not taken: by cause, and in words."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

from debrisgrasp.errors import InputError

from ._rigid import Wrench, norm

__all__ = ["Refusal", "RefusalCause", "StartError", "load_faults", "refusals_of"]


class RefusalCause(Enum):
    """What stands in the way."""

    STALE = "stale"
    """The first wrench is too old."""
    OUTSIDE = "outside"
    """A joint is outside its limits."""
    SATURATED = "saturated"
    """The force sensor is at the end of its range."""
    BIAS = "bias"
    """The bias of the sensor may be wrong by too much: it is time for a baseline."""
    LOADED = "loaded"
    """The hand bears too much before it begins."""
    ELSEWHERE = "elsewhere"
    """The hand is not where the leg begins."""
    BRAKING = "braking"
    """The joints could not stop in time."""
    UNSTABLE = "unstable"
    """Giving way might oscillate."""
    NO_PROOF = "no_proof"
    """A look of a baseline, or how the looks are turned, proves nothing."""
    TOUCHED = "touched"
    """The looks of a baseline disagree: the hand touches or holds something."""
    SHIFTED = "shifted"
    """The bias has moved farther than a sensor drifts."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """One thing that stands in the way."""

    cause: RefusalCause
    words: str
    """It in words, with the numbers."""

    def __str__(self) -> str:
        return self.words


class StartError(InputError):
    """By what was read, there is no state to begin with.

    Parameters
    ----------
    cause
        What stands in the way.
    what, got, expected, mend
        See `InputError`.
    """

    def __init__(
        self,
        cause: RefusalCause,
        what: str,
        *,
        got: object,
        expected: str,
        mend: str = "",
    ) -> None:
        self.cause = cause
        super().__init__(what, got=got, expected=expected, mend=mend)


def refusals_of(cause: RefusalCause, found: Iterable[str]) -> list[Refusal]:
    """Give what was found a cause; what is empty is nothing."""
    return [Refusal(cause, words) for words in found if words]


def load_faults(load: Wrench, limits: tuple[float, float], share: float) -> list[str]:
    """Why what the hand bears already is over a share of its limits [N], [N m]."""
    faults = []
    for name, part, most in zip(
        ("force", "torque"), (load[:3], load[3:]), limits, strict=True
    ):
        if not norm(part) <= share * most:
            faults.append(
                f"the {name} on the hand is {norm(part):.3g} already, over "
                f"{share * most:.3g}: {100 * share:.0f} % of its limit {most:.3g}"
            )
    return faults
