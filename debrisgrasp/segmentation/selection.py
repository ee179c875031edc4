"""Which object to take first, and where to look for grasps on it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from debrisgrasp._arrays import FloatArray, frozen, require_finite
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import Bounds, PointCloud

from .segmentation import Segmentation

__all__ = ["Candidate", "PriorityPoint", "SelectionPolicy", "region_of_interest"]


@dataclass(frozen=True, slots=True)
class Candidate:
    """An object in the order of selection."""

    label: int
    cost: float
    """What the order ascends by; its meaning is the policy's."""
    reason: str
    """Why it stands where it does, in words."""


class SelectionPolicy(Protocol):
    """Anything that puts the objects of a segmentation into an order."""

    def order(
        self, segmentation: Segmentation, cloud: PointCloud
    ) -> tuple[Candidate, ...]:
        """Candidates, first choice first; empty if there are no objects."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class PriorityPoint:
    """Nearest object first (Eq. 1).

    The cost of a segment is the distance from the priority point to the *nearest* of
    its points. The distance to the centroid would put a long beam that reaches right to
    the point behind a small object farther off, although the beam is what lies in the
    way. Of segments at the same distance the one with the nearer centroid comes first.
    """

    point: FloatArray
    """Priority point [m], base frame, shape (3,)."""

    def __post_init__(self) -> None:
        point = frozen(self.point, "priority point", (3,))
        if point.shape != (3,):
            raise InputError("priority point", got=point.shape, expected="one point")
        require_finite(point, "priority point")
        object.__setattr__(self, "point", point)

    @classmethod
    def at(cls, x: float, y: float, z: float) -> PriorityPoint:
        """Policy for a point given by its coordinates [m], base frame."""
        return cls(np.array([x, y, z], dtype=np.float64))

    def order(
        self, segmentation: Segmentation, cloud: PointCloud
    ) -> tuple[Candidate, ...]:
        """Order the segments by the distance of their nearest point."""
        if len(cloud) != len(segmentation.labels):
            raise InputError(
                "cloud",
                got=f"{len(cloud)} points",
                expected=f"the {len(segmentation.labels)} points that were segmented",
            )
        square = np.square(cloud.points - self.point).sum(axis=1)
        nearest = np.full(len(segmentation.segments) + 1, np.inf)
        np.minimum.at(nearest, segmentation.labels, square)
        ranked = sorted(
            (
                float(np.sqrt(nearest[segment.label])),
                float(np.linalg.norm(segment.centroid - self.point)),
                segment.label,
            )
            for segment in segmentation.segments
        )
        return tuple(
            Candidate(
                label=label,
                cost=cost,
                reason=f"nearest point {cost:.3f} m from the priority point",
            )
            for cost, _, label in ranked
        )


def region_of_interest(
    points: FloatArray, *, margin: float = 0.05, outliers: float = 0.005
) -> Bounds:
    """Volume V around an object in which grasps are sought (section 5.2).

    Parameters
    ----------
    points
        Visible points of the object [m], shape (n, 3).
    margin
        How far it reaches beyond them on every side [m]: room for the unseen back of
        the object.
    outliers
        Share of the points that may be left out at each end of each axis: flying pixels
        would otherwise blow the volume up to several times its size.
    """
    if not 0 <= margin < np.inf:
        raise InputError("margin", got=margin, expected="0 or more metres")
    lower, upper = np.quantile(points, [outliers, 1.0 - outliers], axis=0)
    return Bounds(lower - margin - 1e-6, upper + margin + 1e-6)
