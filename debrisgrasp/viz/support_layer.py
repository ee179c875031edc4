"""What both forms of the selection report show: nodes, arrows, and doubtful borders."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import PointCloud
from debrisgrasp.segmentation import (
    GROUND,
    Candidate,
    Segmentation,
    SupportGraph,
)

from .overlay import label_anchors, label_image, painted
from .report import Image
from .words import UNSURE

__all__ = ["Arrow", "Node", "SelectionReport", "SupportLayer"]

_SHOWN = 0.25
"""Relations less likely than this would only clutter the picture."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SelectionReport:
    """A capture, who lies on whom in it, and the order of removal."""

    cloud: PointCloud
    segmentation: Segmentation
    support: SupportGraph
    order: tuple[Candidate, ...]
    capture: Image | None = None
    """Where ``cloud`` came from, for its name and colours; None if there is none."""

    def __post_init__(self) -> None:
        self.cloud.require_frame("base")
        self.segmentation.require_of(self.cloud)

    @property
    def title(self) -> str:
        """Heading of the report."""
        return "Selection" if self.capture is None else self.capture.name


@dataclass(frozen=True, slots=True)
class Node:
    """An object, where it is drawn."""

    label: int
    place: int
    """Its turn, from 1; 0 if it is not in the order."""
    u: float
    v: float
    size: float
    """Edge of the square as large as what is seen of it [pixels]."""
    is_on_ground: bool
    is_unsure: bool
    """Whether the segment may be several objects."""


@dataclass(frozen=True, slots=True)
class Arrow:
    """A relation between two nodes, from what rests to what carries it."""

    above: Node
    below: Node
    confidence: float
    is_leaning: bool


@dataclass(frozen=True, slots=True, eq=False)
class SupportLayer:
    """The picture of a report and what is drawn over it, in pixels of the picture."""

    colors: FloatArray
    """Red, green, blue in [0, 1], shape (H, W, 3), borders in doubt marked."""
    nodes: dict[int, Node]
    """By label."""
    arrows: tuple[Arrow, ...]
    """The least likely first, so that the others lie over it."""

    @classmethod
    def of(cls, report: SelectionReport) -> SupportLayer:
        """Lay out a report."""
        segmentation, support = report.segmentation, report.support
        ground = segmentation.ground
        image = label_image(
            report.cloud, segmentation.labels, report.capture, ground.kinds
        )
        chosen = report.order[0].label if report.order else 0
        colors = painted(image, chosen, segmentation.edges, strength=0.42)
        place = {item.label: turn for turn, item in enumerate(report.order, start=1)}
        below = dict(_supports(support))
        nodes = {
            label: Node(
                label=label,
                place=place.get(label, 0),
                u=u,
                v=v,
                size=float(np.sqrt(np.count_nonzero(image.labels == label))),
                is_on_ground=below.get((label, GROUND), (0.0, False))[0] >= 0.5,
                is_unsure=segmentation.segment(label).certainty < UNSURE,
            )
            for label, (u, v) in label_anchors(image.labels).items()
        }
        arrows = [
            Arrow(nodes[a], nodes[b], confidence, is_leaning)
            for (a, b), (confidence, is_leaning) in below.items()
            if confidence >= _SHOWN and a in nodes and b in nodes
        ]
        arrows.sort(key=lambda arrow: arrow.confidence)
        return cls(colors, nodes, tuple(arrows))


def _supports(
    support: SupportGraph,
) -> Iterator[tuple[tuple[int, int], tuple[float, bool]]]:
    """Pairs (above, below) with confidence, and whether it leans."""
    for (a, b), confidence, is_leaning in zip(
        support.relations.tolist(),
        support.confidence.tolist(),
        support.is_leaning.tolist(),
        strict=True,
    ):
        yield (a, b), (confidence, is_leaning)
