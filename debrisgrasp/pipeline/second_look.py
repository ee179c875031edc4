"""Which object to grip of those tried, which to look at besides, and where to go on."""

from __future__ import annotations

import math
from dataclasses import dataclass

from debrisgrasp.planning import SETTLED, PassedOver, SearchResult

from .targets import Target

__all__ = ["BestSoFar"]

_HOPELESS = 0.005
"""From below this score a search hardly comes to a chance: of 44 objects of 22 piles
none came from there to more than 0.02."""

_POOR = 0.4
"""Below this share of a score that is without doubt a grasp is hardly better than none.
"""

_BEST = 0.95
"""Hardly any grasp scores higher: where even this would not do, none is sought."""


@dataclass(slots=True, eq=False)
class _Look:
    """An object, and what came of the search there."""

    target: Target
    result: SearchResult

    @property
    def score(self) -> float:
        """Of the best grasp; 0 without any."""
        return self.result.grasps[0].score if self.result.grasps else 0.0

    @property
    def counts(self) -> bool:
        """Whether there is a grasp, or may well be one if the search goes on."""
        return bool(self.result.grasps) or self.may_come_to(_HOPELESS)

    def may_come_to(self, least: float) -> bool:
        """Whether the search can go on, and came to a score of so much at least."""
        return self.result.further is not None and self.result.promise >= least


class BestSoFar:
    """The object to grip among those tried, and why the others were passed over.

    A first look at several objects comes before a long one at any.

    Parameters
    ----------
    doubtful
        Below this score a grasp is doubtful, and further objects are tried.
    further
        How many of them at most, once a fair grasp was found or promised.
    """

    def __init__(self, doubtful: float, further: int) -> None:
        self._doubtful, self._further = doubtful, further
        self._looks: list[_Look] = []
        self._unfit: list[tuple[int, PassedOver]] = []
        self._least_promise = _HOPELESS

    @property
    def tried(self) -> list[Target]:
        """What was searched."""
        return [look.target for look in self._looks]

    @property
    def first_tried(self) -> Target | None:
        """What was searched first."""
        return self._looks[0].target if self._looks else None

    @property
    def result(self) -> SearchResult:
        """What was found on the best object; on the first, where nothing was found."""
        best = self._best
        return SearchResult(()) if best is None else best.result

    @property
    def target(self) -> Target | None:
        """The best object; the first one tried, where nothing was found."""
        best = self._best
        return None if best is None else best.target

    @property
    def is_found(self) -> bool:
        """Whether there is a grasp."""
        return any(look.result.grasps for look in self._looks)

    @property
    def has_looked(self) -> bool:
        """Whether no further object is to be looked at before a longer search.

        There is a grasp without doubt, or a fair one, or the promise of one, and enough
        were looked at.
        """
        first = self._first
        hope = max(map(self._hope, self._looks), default=0.0)
        if first is None or hope < _POOR * self._doubtful:
            return False
        n_after = len(self._looks) - 1 - self._looks.index(first)
        return self._most >= self._doubtful or n_after >= self._further

    @property
    def passed_over(self) -> list[PassedOver]:
        """Objects that are not the best, and why."""
        passed, best = [], self._best
        for n, look in enumerate(self._looks):
            passed += [one for at, one in self._unfit if at == n]
            if look is not best or not self.is_found:
                words = self._why_not(look, best)
                passed.append(PassedOver(look.target.label, words))
        return passed + [one for at, one in self._unfit if at == len(self._looks)]

    def is_worth_a_look(self, target: Target) -> bool:
        """Whether a good grasp of an object would be worth more than the best so far.

        What stands later in the order at a lower cost carries something for certain.
        """
        first = self._first
        if first is None:
            return True
        gain = math.exp(first.target.cost - target.cost)
        return gain <= 1.0 and _BEST * gain > self._most

    def worth_beating(self, target: Target) -> float:
        """Score that a grasp of an object must exceed to be the best so far."""
        first = self._first
        if first is None:
            return 0.0
        return self._most * math.exp(target.cost - first.target.cost)

    def take(self, result: SearchResult, target: Target) -> None:
        """Take note of what was found on an object."""
        self._looks.append(_Look(target, result))

    def pass_over(self, left: PassedOver) -> None:
        """Note what is not searched, and why."""
        self._unfit.append((len(self._looks), left))

    @property
    def promises_more(self) -> bool:
        """Whether there is no good grasp yet, and to search on may lead to one."""
        return self._next is not None

    def hope_for_anything(self) -> None:
        """From now on search on where that is hardly of use, too.

        Of 47 scenes that offered no grasp eight did so after that.
        """
        self._least_promise = 0.0

    def search_on(self) -> None:
        """Search on where that promises most, if anywhere."""
        look = self._next
        if look is not None and look.result.further is not None:
            is_best = look is self._best
            beyond = 0.0 if is_best else self.worth_beating(look.target)
            look.result = look.result.further(beyond)

    @property
    def _first(self) -> _Look | None:
        """What others are weighed against."""
        return next((look for look in self._looks if look.counts), None)

    @property
    def _best(self) -> _Look | None:
        return max(self._looks, key=self._worth, default=None)

    @property
    def _most(self) -> float:
        """What the best grasp is worth."""
        return max(map(self._worth, self._looks), default=0.0)

    @property
    def _next(self) -> _Look | None:
        """Where to search on."""
        least = self._least_promise
        looks = [look for look in self._looks if look.may_come_to(least)]
        look = max(looks, key=self._promise, default=None)
        if look is None or self._most >= SETTLED or self._promise(look) < self._most:
            return None
        return look

    def _worth(self, look: _Look) -> float:
        """Score of a grasp, less what the object costs more than the first."""
        return self._discounted(look.score, look)

    def _promise(self, look: _Look) -> float:
        """Worth of what an object may come to."""
        return self._discounted(max(look.result.promise, look.score), look)

    def _hope(self, look: _Look) -> float:
        """Worth of what an object offers, or may come to."""
        is_open = look.result.further is not None
        return self._promise(look) if is_open else self._worth(look)

    def _discounted(self, score: float, look: _Look) -> float:
        first = self._first
        if first is None:
            return score
        # The costs of the order are mostly a probability that something is borne.
        return score * math.exp(first.target.cost - look.target.cost)

    def _why_not(self, look: _Look, best: _Look | None) -> str:
        """Say why another object is better, or why this one is not."""
        if best is None or not best.result.grasps:
            return look.result.why_empty() or ""
        is_later = self._looks.index(look) > self._looks.index(best)
        if not look.result.grasps:
            reason = look.result.why_empty() or ""
            return _no_better(best.target) if is_later else reason
        if is_later:
            return f"{_no_better(best.target)} (score {look.score:.2f})"
        reason = f"its best grasp is doubtful (score {look.score:.2f}); object "
        return reason + f"{best.target.label} has a better one ({best.score:.2f})"


def _no_better(best: Target) -> str:
    return (
        f"looked at because the best grasp of object {best.label} is doubtful, "
        "but no better"
    )
