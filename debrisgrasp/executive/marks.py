"""Which objects were tried in vain, remembered by their places.

Labels change from look to look; the middle of an object that nobody moved does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import FloatArray
from debrisgrasp._memo import Memo
from debrisgrasp._words import counted
from debrisgrasp.geometry import SE3
from debrisgrasp.planning import Grasp

from .result import FaultFound

__all__ = ["Mark", "Marks"]

_SAME = 0.07
"""Middles nearer than this belong to one object [m]."""
_SEARCHES = 2
"""A search is drawn: so many that found no way are enough, until something changes."""
_STUCK = 2
"""An object that so often could not be lifted is not just caught under another."""


@dataclass(eq=False)
class Mark:
    """An object that was tried."""

    centroid: FloatArray
    """[m], shape (3,)."""
    reason: str
    tries: int = 0
    """By a hand, and in vain."""
    searches: int = 0
    """In vain since the last change."""
    is_hopeless: bool = False
    """Whether the last one drew no candidate at all, as the next one would."""
    n_changes: int = 0
    """How often something had changed when it was last tried: one was removed, or the
    robot moved."""
    n_stuck: int = 0
    """How often it could not be lifted."""
    within: float = _SAME
    """So near to it is the middle of the same object [m]."""
    n_stayed: int = 0
    """How often it was not pushed aside ..."""
    why_stays: str = ""
    """... and why."""
    is_heavy: bool = False
    """Whether it is too heavy to carry: by the scales, or because it never comes."""
    mass: float | None = None
    """What it weighs [kg]; None: it was not lifted yet."""
    promise: float | None = None
    """How likely it was to be held when it was put off; None: it never was ..."""
    n_promised: int = 0
    """... and how often something had changed by then: it is put off until the next."""
    failed: list[Grasp] = field(default_factory=list)
    """Grasps that were tried on it."""
    unreached: Memo[object, list[Grasp]] = field(default_factory=Memo)
    """By look, as long as it is kept: grasps to which no way was found as the pile lies
    there."""

    offered: Memo[object, list[Grasp]] = field(default_factory=Memo)
    """By look, too: grasps that were found on it when it was put off."""

    def is_sought(self, n_changes: int) -> bool:
        """Whether a way was sought often enough since something has changed."""
        is_enough = self.searches >= _SEARCHES or self.is_hopeless
        return is_enough and self.n_changes >= n_changes

    def in_vain(self, look: object) -> list[Grasp]:
        """Grasps that are no use by a look: tried, or sought a way to by this look."""
        return [*self.failed, *self.unreached.get(look, ())]

    def sought(self, look: object, grasps: Sequence[Grasp]) -> None:
        """Remember grasps to which a search found no way."""
        self.unreached.setdefault(look, []).extend(grasps)


@dataclass(eq=False)
class Marks:
    """Objects that were tried, and came to nothing."""

    marks: list[Mark] = field(default_factory=list)

    def of(self, centroid: ArrayLike) -> Mark | None:
        """Mark of the object at a place, if there is one."""
        place = np.asarray(centroid)
        near = [m for m in self.marks if np.linalg.norm(m.centroid - place) < m.within]
        return min(
            near, key=lambda m: float(np.linalg.norm(m.centroid - place)), default=None
        )

    def add(
        self,
        centroid: ArrayLike,
        found: FaultFound,
        n_changes: int,
        *,
        is_search: bool = False,
        is_same_try: bool = False,
    ) -> Mark:
        """Remember a try that came to nothing, or a search for a way to try.

        What goes wrong again in the same try is not counted again.
        """
        mark = self._at(centroid)
        if mark.n_changes < n_changes:
            mark.searches = 0
        mark.centroid = np.array(centroid, dtype=np.float64)
        mark.n_changes = n_changes
        if not mark.is_heavy:  # whatever comes of pushing it, that is why it is left
            mark.reason = found.message
        if is_search:
            mark.searches += 1
            mark.is_hopeless = found.values.get("candidates") == 0.0
            return mark
        mark.tries += not is_same_try
        mark.n_stuck += found.fault == "too_heavy"
        is_weighed = found.fault == "too_heavy" and "mass" in found.values
        mark.is_heavy |= is_weighed or mark.n_stuck >= _STUCK
        return mark

    def put_off(self, centroid: ArrayLike, promise: float, n_changes: int) -> Mark:
        """Leave an object for last that is hardly likely to be held."""
        mark = self._at(centroid)
        mark.promise, mark.n_promised = promise, n_changes
        return mark

    def _at(self, centroid: ArrayLike) -> Mark:
        """Mark of the object at a place, or a new one."""
        mark = self.of(centroid)
        if mark is None:
            mark = Mark(np.array(centroid, dtype=np.float64), "")
            self.marks.append(mark)
        return mark

    def moved(self, T_now_before: SE3) -> None:
        """Take the marks along when the base has moved."""
        for mark in self.marks:
            mark.centroid = T_now_before.apply(mark.centroid)

    def begin_anew(self) -> None:
        """Forget how things were tried: from elsewhere grips and pushes are others."""
        for mark in self.marks:
            mark.failed.clear()
            mark.unreached.clear()
            mark.offered.clear()
            mark.n_stayed = 0

    def promise(self, centroid: ArrayLike, n_changes: int) -> float | None:
        """Tell how likely what lies at a place is to be held, if it was put off."""
        mark = self.of(centroid)
        return None if mark is None or mark.n_promised < n_changes else mark.promise

    def turn(self, centroid: ArrayLike, n_changes: int) -> tuple[float, float]:
        """Order of what lies at a place, for sorting: it comes after what is less.

        What failed has another turn after all that did not, and what was put off after
        all else, the likeliest first.
        """
        mark, promise = self.of(centroid), self.promise(centroid, n_changes)
        n_failed = 0.0 if mark is None else float(mark.tries + mark.searches)
        return (0.0, n_failed) if promise is None else (1.0, n_failed - promise)

    def why_left(self, centroid: ArrayLike, n_changes: int, tries: int) -> str:
        """Say why not to try again what lies there, or nothing.

        Whatever failed may succeed once another object is gone.
        """
        mark = self.of(centroid)
        if mark is None:
            return ""
        is_tried = mark.tries >= tries and mark.n_changes >= n_changes
        if not (mark.is_heavy or is_tried or mark.is_sought(n_changes)):
            return ""
        counts = [(mark.tries, "try", "tries"), (mark.searches, "search", "searches")]
        words = ", ".join(f"{counted(*count)} in vain" for count in counts if count[0])
        stays = f"; not pushed aside: {mark.why_stays}" if mark.n_stayed else ""
        return f"{mark.reason} ({words}){stays}"
