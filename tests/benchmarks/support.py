"""Who bears on whom, and what is taken first, on piles with physics ground truth.

Run: python -m tests.benchmarks.support [--json FILE]

A body bears on another if it puts more than 5 % of its weight, and 0.3 N, on it. A
contact is visible if some point of it lies within 3 cm of visible pixels of both.
Precision is over all relations between bodies that are stated as clear, and over those
of bodies with a visible contact; recall over the visible true ones. Segments stand for
the body they show most of.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from debrisgrasp.geometry import PointCloud
from debrisgrasp.io import Capture
from debrisgrasp.segmentation import (
    CLEAR,
    PriorityPoint,
    Segmentation,
    SegmentEdges,
    SelectionPolicy,
    SupportAware,
    SupportGraph,
    segment_cloud,
    support_graph,
)
from debrisgrasp.segmentation.segmentation import measured_segments

from .piles import FEWEST_PIXELS, FreshPile, fresh_piles
from .report import arguments, begin, publish

SEEDS = (*range(7_000, 7_200), *range(210_000, 210_200))
"""Nothing was fitted to these piles, or chosen on them."""
POLICIES: dict[str, SelectionPolicy] = {
    "support": SupportAware(),
    "eq1": PriorityPoint.at(0.9, 0.0, 1.0),
    "eq1_at_base": PriorityPoint.at(0.0, 0.0, 0.0),
}
TARGETS = {"precision": 0.85, "recall": 0.80, "unencumbered_first_support": 0.95}
NO_EDGES = SegmentEdges(
    labels=np.zeros((0, 2), dtype=np.int32),
    convexity=np.zeros(0),
    contact_length=np.zeros(0),
    upper=np.zeros(0, dtype=np.int32),
    score=np.zeros(0),
)


@dataclass(frozen=True)
class Truth:
    """Which body (from 1) bears on which (0: ground), and what of it can be seen."""

    bearing: set[tuple[int, int]]
    visible: set[tuple[int, int]]
    near: set[tuple[int, int]]
    """Pairs with a visible contact, the smaller number first."""
    seen: set[int]
    weight: np.ndarray

    @classmethod
    def of(cls, pile: FreshPile, cloud: PointCloud, labels: np.ndarray) -> Truth:
        loads = pile.settled.loads
        weight = np.array([0.0] + [9.81 * b.mass for b in pile.settled.world.bodies])
        bearing = {
            (int(above), int(below))
            for above, below in np.argwhere(loads > 0.3)
            if above > 0 and loads[above, below] > 0.05 * weight[above]
        }
        seen = {k for k in range(1, len(weight)) if (labels == k).sum() > FEWEST_PIXELS}
        trees = {k: cKDTree(cloud.points[labels == k]) for k in seen}
        near = {
            (contact.a + 1, contact.b + 1)
            for contact in pile.settled.contacts
            if {contact.a + 1, contact.b + 1} <= seen
            and all(
                trees[k + 1].query(contact.point)[0] < 0.03
                for k in (contact.a, contact.b)
            )
        }
        visible = {pair for pair in bearing if tuple(sorted(pair)) in near}
        return cls(bearing, visible, near, seen, weight)


@dataclass
class Count:
    """Sums over captures."""

    stated: int = 0
    true: int = 0
    stated_near: int = 0
    true_near: int = 0
    visible: int = 0
    found: int = 0
    piles: int = 0
    inside: int = 0
    weighed: int = 0

    def __post_init__(self) -> None:
        self.free_first = dict.fromkeys(POLICIES, 0)
        self.ms: list[float] = []


def true_segmentation(
    found: Segmentation, cloud: PointCloud, labels: np.ndarray
) -> tuple[Segmentation, np.ndarray]:
    """Segmentation by the truth, and the body of each of its labels."""
    bodies, own = np.unique(np.append(labels, 0), return_inverse=True)
    own = own[:-1].astype(np.int32)
    return replace(
        found,
        labels=own,
        segments=measured_segments(cloud.points, own, np.ones(len(bodies))),
        edges=NO_EDGES,
        kinship=None,
    ), bodies


def bodies_of(segmentation: Segmentation, labels: np.ndarray) -> np.ndarray:
    """Body that each label shows most of; its negative if it shows none."""
    owners = [0]
    for segment in segmentation.segments:
        seen = labels[segmentation.labels == segment.label]
        seen = seen[seen > 0]
        owners.append(int(np.bincount(seen).argmax()) if len(seen) else -segment.label)
    return np.array(owners)


def count_relations(
    count: Count, graph: SupportGraph, bodies: np.ndarray, truth: Truth
) -> None:
    ends = bodies[graph.relations[graph.confidence >= CLEAR]]
    ends = ends[(ends[:, 1] != 0) & (ends[:, 0] != ends[:, 1])]
    stated = {(int(a), int(b)) for a, b in ends}
    count.stated += len(stated)
    count.true += len(stated & truth.bearing)
    at_contacts = {pair for pair in stated if tuple(sorted(pair)) in truth.near}
    count.stated_near += len(at_contacts)
    count.true_near += len(at_contacts & truth.bearing)
    count.visible += len(truth.visible)
    count.found += len(stated & truth.visible)
    for row, body in enumerate(bodies[1:]):
        if body > 0:
            low, high = graph.weight[row]
            count.weighed += 1
            count.inside += bool(low <= truth.weight[body] <= high)


def count_first(
    count: Count,
    segmentation: Segmentation,
    cloud: PointCloud,
    bodies: np.ndarray,
    truth: Truth,
) -> None:
    carriers = {below for _, below in truth.bearing}
    if not segmentation.segments or truth.seen <= carriers:
        return
    count.piles += 1
    for name, policy in POLICIES.items():
        first = policy.order(segmentation, cloud)[0].label
        count.free_first[name] += int(bodies[first]) not in carriers


def seen_labels(pile: FreshPile, cloud: PointCloud) -> np.ndarray:
    """Body of each point, 0 for the ground and for bodies hardly seen."""
    assert cloud.pixels is not None
    labels = np.maximum(pile.labels.ravel()[cloud.pixels].astype(int), 0)
    size = np.bincount(labels)
    return np.where(size[labels] >= FEWEST_PIXELS, labels, 0)


def captures(pile: FreshPile) -> Iterator[tuple[str, Capture]]:
    yield "clean", pile.clean
    yield "noisy", pile.noisy


def main() -> None:
    """Count over all piles, and print each target beside its figure."""
    options = arguments(__doc__.splitlines()[0])
    counts: dict[str, Count] = {}
    for pile in fresh_piles(SEEDS):
        for kind, capture in captures(pile):
            cloud = capture.cloud()
            labels = seen_labels(pile, cloud)
            truth = Truth.of(pile, cloud, labels)
            found = segment_cloud(cloud)
            by_truth, names = true_segmentation(found, cloud, labels)
            for mode, segmentation, bodies in (
                ("default", found, bodies_of(found, labels)),
                ("true_labels", by_truth, names),
            ):
                count = counts.setdefault(f"{mode}_{kind}", Count())
                start = time.thread_time()
                graph = support_graph(segmentation, cloud)
                count.ms.append(1e3 * (time.thread_time() - start))
                count_relations(count, graph, bodies, truth)
                count_first(count, segmentation, cloud, bodies, truth)
    figures = {}
    for name, count in counts.items():
        figures[f"precision_{name}"] = count.true / max(count.stated, 1)
        share = count.true_near / max(count.stated_near, 1)
        figures[f"precision_at_visible_contacts_{name}"] = share
        figures[f"recall_{name}"] = count.found / max(count.visible, 1)
        for policy, free in count.free_first.items():
            share = free / max(count.piles, 1)
            figures[f"unencumbered_first_{policy}_{name}"] = share
        figures[f"weight_in_bounds_{name}"] = count.inside / max(count.weighed, 1)
        figures[f"ms_{name}"] = float(np.median(count.ms))
    any_count = next(iter(counts.values()))
    figures["visible_relations"] = float(any_count.visible)
    print("targets: " + ", ".join(f"{k} {v}" for k, v in TARGETS.items()))
    publish(figures, options.json)


if __name__ == "__main__":
    begin(main)
