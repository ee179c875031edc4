"""What can't be true of two readings of one limb, one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot

__all__ = ["Felt"]

_STANDS = 4e-4
"""Between two readings a joint that stands moves by less [rad]."""
_STOOD, _BRAKES = 0.03, 0.15
"""Farther than this no joint gets after it stood, or while it brakes [rad or m]."""
_LEAST = 10.0
"""What the sensor feels of a hand at least, or its sign tells nothing [N]."""
_SAME, _NOISE = 0.2, (2.0, 0.5)
"""The same load, felt with the other sign, differs by no more than this share, and so
much [N, N m]."""


@dataclass(frozen=True, slots=True)
class Felt:
    """One reading of a limb, and whether it can follow the one before.

    Parameters of `after` are plain sequences: this is done at every tick.
    """

    q: Sequence[float]
    """Joints [rad or m], length d."""
    wrench_ft: Sequence[float]
    """Raw values of the sensor [N, N m], length 6."""
    is_moving: bool = False
    """Whether a joint moved since the reading before."""
    fault: str = ""
    """What a reading that can't be true is called; nothing: it may be."""
    message: str = ""

    def followed_by(
        self, q: Sequence[float], wrench_ft: Sequence[float], is_own: Sequence[bool]
    ) -> Felt:
        """Take the next reading.

        Joints don't jump, whoever stood between two motions; and a load that is felt
        as before, but for its sign, is the sensor's. A number that is none raises no
        doubt here: that is for whoever works with it.

        Parameters
        ----------
        is_own
            Which joints no other arm moves, length d.
        """
        if not len(q) == len(self.q) == len(is_own) or len(wrench_ft) != 6:
            return Felt(q, wrench_ft)
        gone = (abs(a - b) for a, b, own in zip(q, self.q, is_own, strict=True) if own)
        away = max(gone, default=0.0)
        fault = message = ""
        if away > (_BRAKES if self.is_moving else _STOOD):
            fault = "encoder_jump"
            message = f"a joint reads {away:.2f} rad from where it stood"
        elif _is_turned(self.wrench_ft, wrench_ft):
            fault = "wrench_sign"
            message = "all that the sensor measures changed its sign at once"
        return Felt(q, wrench_ft, away > _STANDS, fault, message)


def _is_turned(before: Sequence[float], after: Sequence[float]) -> bool:
    """Whether a raw wrench is about the negative of another."""
    a, b, c, d, e, f = before
    p, q, r, s, t, u = after
    force, torque = hypot(a, b, c), hypot(d, e, f)
    return (
        force > _LEAST
        and hypot(a + p, b + q, c + r) < _SAME * force + _NOISE[0]
        and hypot(d + s, e + t, f + u) < _SAME * torque + _NOISE[1]
    )
