"""What can't be true of two readings of one limb, one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot
from typing import NamedTuple

from debrisgrasp._arrays import FloatArray
from debrisgrasp.control._rigid import floats_of

__all__ = ["Felt", "Measured"]

Measured = Sequence[float] | FloatArray
"""Values as a device tells them; any may be missing or no number."""

_STANDS = 4e-4
"""Between two readings a joint that stands moves by less [rad]."""
_STOOD, _BRAKES = 0.03, 0.15
"""Farther than this no joint gets after it stood, or while it brakes [rad or m]."""
_LEAST = 10.0
"""What the sensor feels of a hand at least, or its sign tells nothing [N]."""
_SAME, _NOISE = 0.2, (2.0, 0.5)
"""The same load, felt with the other sign, differs by no more than this share, and so
much [N, N m]."""


class Felt(NamedTuple):
    """One reading of a limb, and whether it can follow the one before."""

    q: tuple[float, ...] = ()
    """Joints [rad or m], length d."""
    wrench_ft: tuple[float, ...] = ()
    """Raw values of the sensor [N, N m], length 6."""
    is_moving: bool = False
    """Whether a joint moved since the reading before."""
    unturned: tuple[float, ...] | None = None
    """What the sensor measured before all of it changed its sign; None: it did not."""
    fault: str = ""
    """What a reading that can't be true is called; nothing: it may be."""
    message: str = ""

    def followed_by(
        self, q: Measured, wrench_ft: Measured, is_own: Sequence[bool]
    ) -> Felt:
        """Take the next reading.

        Joints don't jump, whoever stood between two motions; and a load that is felt
        as before, but for its sign, is the sensor's if a second reading says so, too: a
        stiff touch goes through there. A number that is none raises no doubt
        here: that is for whoever works with it, and what comes after it is compared
        with what was before.

        Parameters
        ----------
        is_own
            Which joints no other arm moves, length d.
        """
        heard = floats_of(q)
        q = heard or self.q
        wrench_ft = floats_of(wrench_ft) or self.wrench_ft
        away = 0.0
        if q != self.q:
            ways = zip(q, self.q, is_own, strict=False)
            away = max([abs(a - b) for a, b, own in ways if own], default=0.0)
        before = self.wrench_ft if self.unturned is None else self.unturned
        is_turned = _is_turned(before, wrench_ft)
        fault = message = ""
        if away > (_BRAKES if self.is_moving else _STOOD):
            fault = "encoder_jump"
            message = f"a joint reads {away:.2f} rad or m from where it stood"
        elif is_turned and self.unturned is not None and wrench_ft != self.wrench_ft:
            fault = "wrench_sign"
            message = "all that the sensor measures changed its sign at once"
        unturned = before if is_turned else None
        # Who is not heard moves on, or brakes.
        is_moving = away > _STANDS if heard else self.is_moving
        return Felt(q, wrench_ft, is_moving, unturned, fault, message)


def _is_turned(before: tuple[float, ...], after: tuple[float, ...]) -> bool:
    """Whether a raw wrench is about the negative of another."""
    if not len(before) == len(after) == 6:
        return False
    a, b, c, d, e, f = before
    p, q, r, s, t, u = after
    force, torque = hypot(a, b, c), hypot(d, e, f)
    return (
        force > _LEAST
        and hypot(a + p, b + q, c + r) < _SAME * force + _NOISE[0]
        and hypot(d + s, e + t, f + u) < _SAME * torque + _NOISE[1]
    )
