"""Ranges of joints that cannot be meant: empty ones, degrees, and millimetres."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, require_metres
from debrisgrasp.errors import ConfigError

__all__ = ["require_ranges"]

_MOST_TURNS = 5
"""No joint that has limits turns more often to either side; one in degrees does."""


def require_ranges(
    names: Sequence[str], is_revolute: BoolArray, lower: FloatArray, upper: FloatArray
) -> None:
    """Raise `ConfigError` unless joints can move, within radians or metres.

    Parameters
    ----------
    names
        Names of the joints, for messages.
    is_revolute
        Which turn, shape (d,).
    lower, upper
        Smallest and largest values [rad or m], shape (d,); those of joints that turn
        without end are infinite.
    """
    for name, turns, low, high in zip(names, is_revolute, lower, upper, strict=True):
        got = f"{low:g} to {high:g}"
        if not low < high:
            endless = ", or the type continuous if it turns without end"
            raise ConfigError(
                f"limits of joint {name!r}",
                got=got,
                expected="lower < upper",
                mend=f"Give both in its <limit>{endless if turns else ', in metres'}. "
                "To hold it still leave it out of the arm's joints, or "
                f"pass locked={{{name!r}: value}}.",
            )
        if not turns:
            require_metres(f"limits of joint {name!r}", (low, high))
        most = max(abs(low), abs(high))
        if turns and 2.0 * np.pi * _MOST_TURNS < most < np.inf:
            raise ConfigError(
                f"limits of joint {name!r}",
                got=got,
                expected=f"radians, at most {_MOST_TURNS} turns to either side",
                mend="If these are degrees, multiply by pi / 180. A joint that turns "
                "without end is continuous.",
            )
