"""Whether to look at further objects, because the first one's grasps are doubtful."""

from __future__ import annotations

import math
from collections.abc import Iterable

from debrisgrasp.planning import PassedOver, SearchResult
from debrisgrasp.prototypes import GripperModel
from debrisgrasp.segmentation import Segmentation

from .reasons import why_empty
from .targets import Target

__all__ = ["BestSoFar"]

_BEST = 0.95
"""Hardly any grasp scores higher: where even this would not do, none is sought."""


class BestSoFar:
    """The object to grip among those tried, and why the others were passed over.

    Parameters
    ----------
    doubtful
        Below this score a grasp is doubtful, and further objects are tried.
    further
        How many of them at most.
    """

    def __init__(self, doubtful: float, further: int) -> None:
        self.passed_over: list[PassedOver] = []
        self.result = SearchResult(())
        self.target: Target | None = None
        self.tried: list[Target] = []
        self._doubtful, self._left = doubtful, further
        self._first: Target | None = None
        self._worth = 0.0

    @property
    def is_found(self) -> bool:
        """Whether there is a grasp."""
        return self._first is not None

    @property
    def first_tried(self) -> Target | None:
        """What was searched first."""
        return self.tried[0] if self.tried else None

    @property
    def is_sure(self) -> bool:
        """Whether the search is over: a grasp without doubt, or enough was tried."""
        return self.is_found and (self._worth >= self._doubtful or self._left <= 0)

    def is_worth_a_look(self, target: Target) -> bool:
        """Whether a good grasp of an object would be worth more than the best so far.

        What stands later in the order at a lower cost carries something for certain.
        """
        if self._first is None:
            return True
        gain = math.exp(self._first.cost - target.cost)
        return gain <= 1.0 and _BEST * gain > self._worth

    def worth_beating(self, target: Target) -> float:
        """Score that a grasp of an object must exceed to be the best so far."""
        if self._first is None:
            return 0.0
        return self._worth * math.exp(target.cost - self._first.cost)

    def take(self, result: SearchResult, target: Target) -> None:
        """Keep the better of what was found and of this."""
        self.tried.append(target)
        if not result.grasps:
            reason = result.why_empty() or ""
            if self._first is not None and self.target is not None:
                reason = _no_better(self.target)
                self._left -= 1
            self.pass_over(target, reason)
            if self.target is None:
                self.result, self.target = result, target
            return
        score = result.grasps[0].score
        if self._first is None:
            self._first = target
        else:
            self._left -= 1
        # The costs of the order are mostly a probability that something is borne.
        worth = score * math.exp(self._first.cost - target.cost)
        if worth > self._worth:
            if self._worth and self.target is not None:
                known = self.result.grasps[0].score
                reason = f"its best grasp is doubtful (score {known:.2f}); object "
                reason += f"{target.label} has a better one ({score:.2f})"
                self.pass_over(self.target, reason)
            self.result, self.target, self._worth = result, target, worth
        elif self.target is not None:
            reason = f"{_no_better(self.target)} (score {score:.2f})"
            self.pass_over(target, reason)

    def why_empty(
        self, segmentation: Segmentation, hands: Iterable[GripperModel]
    ) -> str:
        """Say why a plan with some hands has no grasps."""
        return why_empty(segmentation, self.passed_over, hands)

    def pass_over(self, target: Target, reason: str) -> None:
        """Note why an object is not the one."""
        self.passed_over.append(PassedOver(target.label, reason))


def _no_better(best: Target) -> str:
    return (
        f"looked at because the best grasp of object {best.label} is doubtful, "
        "but no better"
    )
