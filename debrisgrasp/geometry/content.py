"""Solids told apart by what they are and where, not by which objects they are.

The parts of a robot are made anew for every planner, and are mostly the same.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Self

import numpy as np

from .se3 import SE3
from .solids import Solid

__all__ = ["SolidContent"]


@dataclass(frozen=True, slots=True)
class SolidContent:
    """Key for what is remembered of some solids: equal for equal ones in one order."""

    key: tuple[object, ...]
    solids: tuple[Solid, ...] = field(compare=False)

    @classmethod
    def of(cls, solids: Iterable[Solid]) -> Self:
        """Take all fields of some solids, bit by bit."""
        kept = tuple(solids)
        return cls(tuple(part for solid in kept for part in _content(solid)), kept)


def _content(solid: Solid) -> tuple[object, ...]:
    if not is_dataclass(solid):
        return (solid,)
    values = (getattr(solid, item.name) for item in fields(solid))
    arrays = (v.matrix if isinstance(v, SE3) else np.asarray(v) for v in values)
    return (type(solid), *((a.shape, a.tobytes()) for a in arrays))
