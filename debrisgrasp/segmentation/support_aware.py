"""Selection that takes first what carries least and comes out freely."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray, require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp._words import in_kilograms
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import PointCloud

from .corridor import Corridor, freest_corridor
from .segmentation import Segmentation
from .selection import DEFAULT_POINT, Candidate, nearest_distances, require_point
from .support import (
    CLEAR,
    GROUND,
    SupportConfig,
    SupportGraph,
    graph_of_surface,
    labelled_surface,
)

__all__ = ["SupportAware"]

_HEAVY = 100.0
"""Load [N] from which on more makes no difference to the cost."""
_MOST = 1e6
"""Weight beside which no other counts; infinite ones of nothing would cost NaN."""
_WORTH_SAYING = 0.2
"""Probability, or share of the way out, from which on it is spoken of at all."""


@checked_fields
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SupportAware:
    """Least load on it, free way out, near, and graspable.

    The cost is a sum of penalties: the probability that something bears on the object,
    the load, the blocked share of its way out, whether it is too wide for the hands,
    and its distance from the priority point. Their weights are the fields.
    """

    point: FloatArray = field(default_factory=lambda: np.array(DEFAULT_POINT))
    """Priority point [m], base frame, shape (3,): what lies near it is preferred."""
    openings: tuple[float, ...] = (0.155, 0.185)
    """Widest opening of each hand [m]; an object wider than all of them in every
    direction costs more."""
    encumbrance: float = 1.0
    """Cost of something certainly bearing on it; the other costs are relative to it."""
    load: float = 0.2
    """Cost of a heavy load on it, 100 N or more."""
    blocked: float = 0.15
    """Cost of a way out that is wholly filled by others."""
    too_wide: float = 0.05
    """Cost of being wider than every hand opens."""
    distance: float = 0.2
    """Cost of each metre from the priority point."""
    support: SupportConfig = field(default_factory=SupportConfig)

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", require_point(self.point))
        for name in ("encumbrance", "load", "blocked", "too_wide", "distance"):
            require_range(name, getattr(self, name), 0.0, _MOST)
        for width in self.openings:
            require_range("openings [m]", width, 1e-6, 5.0)
        if not self.openings:
            raise ConfigError("openings", got=self.openings, expected="at least one")

    def order(
        self, segmentation: Segmentation, cloud: PointCloud
    ) -> tuple[Candidate, ...]:
        """Order the segments by their cost."""
        surface = labelled_surface(segmentation, cloud, self.support)
        graph = graph_of_surface(segmentation, cloud, surface, self.support)
        distance = nearest_distances(segmentation, cloud, self.point)
        found, carried = [], {}
        for segment in segmentation.segments:
            row = segment.label - 1
            corridor = freest_corridor(surface, segment.label)
            width = float(graph.extents[row, 1])
            is_wide = width > max(self.openings)
            cost = (
                self.encumbrance * graph.encumbrance[row]
                + self.load * min(float(graph.load[row].mean()) / _HEAVY, 1.0)
                + self.blocked * corridor.blocked
                + self.too_wide * is_wide
                + self.distance * distance[row]
            )
            above, confidence = graph.resting_on(segment.label)
            sure = carried[segment.label] = above[confidence >= CLEAR]
            likely = above[confidence >= _WORTH_SAYING]
            reasons = [
                _carried(graph, segment.label, sure, self.support.gravity)
                or _borne(likely, confidence)
                or _held(graph, segment.label),
                _way_out(corridor),
            ]
            if is_wide:
                reasons.append(
                    f"{100 * width:.0f} cm wide, hands open "
                    f"{100 * max(self.openings):.0f} cm"
                )
            reasons.append(f"{distance[row]:.2f} m from the priority point")
            reason = "; ".join(text for text in reasons if text)
            warning = _warned(sure, segment.label)
            found.append(Candidate(segment.label, float(cost), reason, warning))
        return _feasible(sorted(found, key=lambda c: (c.cost, c.label)), carried)


def _feasible(
    candidates: Sequence[Candidate], carried: Mapping[int, IntArray]
) -> tuple[Candidate, ...]:
    """Keep the order, but take what surely lies on an object before the object."""
    above = {label: set(sure.tolist()) for label, sure in carried.items()}
    waiting, order = list(candidates), []
    while waiting:
        left = {c.label for c in waiting}
        # In a ring of mutual support the cheapest gives way.
        free = (c for c in waiting if not above[c.label] & (left - {c.label}))
        chosen = next(free, waiting[0])
        waiting.remove(chosen)
        order.append(chosen)
    return tuple(order)


def _warned(sure: IntArray, label: int) -> str:
    """Say what comes down when an object is pulled out on which that surely lies."""
    if not len(sure):
        return ""
    lies = "it lies" if len(sure) == 1 else "they lie"
    return f"{_named(sure)} may fall: {lies} on object {label}"


def _carried(graph: SupportGraph, label: int, sure: IntArray, gravity: float) -> str:
    """Say of an object how heavy is what surely lies on it, if anything does."""
    if not len(sure):
        return ""
    low, high = graph.load[label - 1] / gravity
    first = min(sure, key=lambda k: np.flatnonzero(graph.removal_order == k)[0])
    load = f"up to {in_kilograms(max(high, 0.1))}"
    if low >= 0.05:
        load = in_kilograms(low, high)
    return f"carries {load} of {_named(sure)}; take {first} first"


def _borne(likely: IntArray, confidence: FloatArray) -> str:
    """Say what may lie on an object, if anything may."""
    if not len(likely):
        return ""
    return f"{_named(likely)} may bear on it ({100 * confidence.max():.0f} %)"


def _held(graph: SupportGraph, label: int) -> str:
    """Say what may hide something that lies on an object, or what holds it."""
    occluded = float(graph.occluded[label - 1])
    if occluded >= _WORTH_SAYING:
        return f"others hide {100 * occluded:.0f} % of its outline and may bear on it"
    below, confidence = graph.supports_of(label)
    held = below[confidence >= CLEAR]
    if not len(held):
        return "nothing bears on it; what holds it is not seen"
    named = [_named(held[held != GROUND])] if (held != GROUND).any() else []
    named += ["the ground"] if (held == GROUND).any() else []
    return f"nothing bears on it; lies on {' and '.join(named)}"


def _way_out(corridor: Corridor) -> str:
    if corridor.blocked < _WORTH_SAYING:
        return f"way out free {corridor.way}"
    share = 100 * corridor.blocked
    return f"{share:.0f} % of its way out blocked by {_named(corridor.blockers)}"


def _named(labels: IntArray) -> str:
    """Objects in words: "object 3", "objects 3 and 5"."""
    names = [str(label) for label in sorted(labels.tolist())]
    if len(names) == 1:
        return f"object {names[0]}"
    return f"objects {', '.join(names[:-1])} and {names[-1]}"
