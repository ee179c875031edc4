"""What the definitions of shapes have in common: ranges, faces, a symmetry."""

from __future__ import annotations

from dataclasses import field
from typing import Any

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import SE3

from .surfaces import Patch, flat
from .symmetry import Symmetry

__all__ = ["HALF_TURN_Z", "face", "half_turn_about_z", "one_of", "span"]

HALF_TURN_Z = np.diag([-1.0, -1.0, 1.0])


def span(low: float, high: float, default: float | None = None) -> Any:
    """Declare a length [m] with the range that a file may give."""
    metadata = {"low": low, "high": high}
    if default is None:
        return field(metadata=metadata)
    return field(default=default, metadata=metadata)


def one_of(default: str, *others: str) -> Any:
    """Declare a word with the alternatives that a file may give."""
    return field(default=default, metadata={"known": (default, *others)})


def face(lower: FloatArray, upper: FloatArray, axis: int, up: int) -> Patch:
    """Face of a box square to an axis: the upper one, or the lower one."""
    edges = np.diag(upper - lower)
    u, v = edges[(axis + 1) % 3], edges[(axis + 2) % 3]
    if up:
        return flat(lower + edges[axis], u, v)
    return flat(lower, v, u)


def half_turn_about_z() -> Symmetry:
    """Build the symmetry of what looks the same from thumb and pair side."""
    return Symmetry(SE3.from_parts(np.stack([np.eye(3), HALF_TURN_Z])))
