"""Which objects were tried in vain, remembered by their places.

Labels change from look to look; the middle of an object that nobody moved does not.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import FloatArray
from debrisgrasp.planning import Grasp

__all__ = ["Mark", "Marks"]

_SAME = 0.07
"""Middles nearer than this belong to one object [m]."""


@dataclass(eq=False)
class Mark:
    """An object that was tried."""

    centroid: FloatArray
    """[m], shape (3,)."""
    reason: str
    fault: str
    tries: int = 1
    n_removed: int = 0
    """How many objects had been removed when it was last tried."""
    is_heavy: bool = False
    """Whether it was too heavy to lift."""
    failed: list[Grasp] = field(default_factory=list)
    """Grasps that were tried on it."""


@dataclass(eq=False)
class Marks:
    """Objects that were tried, and came to nothing."""

    marks: list[Mark] = field(default_factory=list)

    def of(self, centroid: ArrayLike) -> Mark | None:
        """Mark of the object at a place, if there is one."""
        place = np.asarray(centroid)
        near = [m for m in self.marks if np.linalg.norm(m.centroid - place) < _SAME]
        return min(
            near, key=lambda m: float(np.linalg.norm(m.centroid - place)), default=None
        )

    def add(self, centroid: ArrayLike, fault: str, reason: str, n_removed: int) -> Mark:
        """Remember a try that came to nothing."""
        mark = self.of(centroid)
        if mark is None:
            mark = Mark(np.array(centroid, dtype=np.float64), reason, fault, tries=0)
            self.marks.append(mark)
        mark.centroid = np.array(centroid, dtype=np.float64)
        mark.reason, mark.fault, mark.n_removed = reason, fault, n_removed
        mark.tries += 1
        mark.is_heavy |= fault == "too_heavy"
        return mark

    def why_left(self, centroid: ArrayLike, n_removed: int, tries: int) -> str:
        """Say why not to try again what lies there, or nothing.

        A plan that failed may succeed once another object is gone; a grip that failed
        is tried a few times in all.
        """
        mark = self.of(centroid)
        if mark is None:
            return ""
        is_plan = mark.fault in ("no_grasp", "unreachable", "plan_collision")
        if is_plan and mark.n_removed < n_removed:
            return ""
        if not is_plan and mark.tries < tries and not mark.is_heavy:
            return ""
        return f"{mark.reason} ({mark.tries} {'try' if mark.tries == 1 else 'tries'})"
