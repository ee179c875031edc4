"""Which object to take first, and where to look for grasps on it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import isfinite
from numbers import Integral, Real
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import (
    FloatArray,
    as_floats,
    frozen,
    require_finite,
    require_metres,
)
from debrisgrasp._checked import checked, checked_fields
from debrisgrasp._words import shortened
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import Bounds, PointCloud

from .segmentation import Segmentation

__all__ = [
    "DEFAULT_POINT",
    "Candidate",
    "OperatorPick",
    "PriorityPoint",
    "SelectionPolicy",
    "nearest_distances",
    "ordered",
    "region_of_interest",
    "require_point",
]

DEFAULT_POINT = (0.9, 0.0, 1.0)
"""Above the middle of the workspace, base frame [m]: what lies near and on top comes
first."""
_PICK_REACH = 0.1
"""A picked point of an object lies within this of its measured points [m]."""


@checked_fields
@dataclass(frozen=True, slots=True)
class Candidate:
    """An object in the order of selection."""

    label: int
    cost: float
    """What the order ascends by, as a rule; its meaning is the policy's."""
    reason: str
    """Why it stands where it does, in words."""
    warning: str = ""
    """What to beware of when it is pulled out, in words; empty if of nothing."""


class SelectionPolicy(Protocol):
    """Anything that puts the objects of a segmentation into an order."""

    def order(
        self, segmentation: Segmentation, cloud: PointCloud
    ) -> tuple[Candidate, ...]:
        """Candidates, first choice first; empty if there are no objects."""
        ...


@checked
def ordered(
    policy: SelectionPolicy, segmentation: Segmentation, cloud: PointCloud
) -> tuple[Candidate, ...]:
    """Ask a policy for its order, and look whether it is one.

    Raises
    ------
    InputError
        If it is anything else than candidates, each with a label of its own and a
        finite cost, or the policy has no order at all.
    UnknownNameError
        If a label is not in the segmentation.
    """
    what = f"order of {type(policy).__name__}"
    given = policy.order(segmentation, cloud)
    items = list(given) if isinstance(given, Iterable) else [given]
    for item in items:
        if not isinstance(item, Candidate):
            raise InputError(
                what,
                got=shortened(repr(given)),
                expected="a tuple of Candidate(label, cost, reason)",
            )
        if not isfinite(item.cost):
            raise InputError(
                f"cost of object {item.label} in the {what}",
                got=item.cost,
                expected="a finite number",
            )
        segmentation.segment(item.label)
    labels = [item.label for item in items]
    if len(set(labels)) < len(labels):
        raise InputError(what, got=f"labels {labels}", expected="each label once")
    # numpy's numbers are none to JSON.
    return tuple(
        replace(item, label=int(item.label), cost=float(item.cost)) for item in items
    )


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
        object.__setattr__(self, "point", require_point(self.point))

    @classmethod
    def at(cls, x: float, y: float, z: float) -> PriorityPoint:
        """Policy for a point given by its coordinates [m], base frame."""
        return cls(np.array([x, y, z], dtype=np.float64))

    def order(
        self, segmentation: Segmentation, cloud: PointCloud
    ) -> tuple[Candidate, ...]:
        """Order the segments by the distance of their nearest point."""
        nearest = nearest_distances(segmentation, cloud, self.point)
        ranked = sorted(
            (
                float(nearest[segment.label - 1]),
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


@dataclass(frozen=True, slots=True, eq=False)
class OperatorPick:
    """What a person chose comes first, the rest in the order of another policy.

    The reason keeps what that policy says of the object, so that a person who picks
    what carries something is told.
    """

    pick: int | tuple[int, int] | tuple[float, float, float]
    """A label, a pixel (column, row) of the depth image, or a point (x, y, z) [m] in
    the base frame."""
    others: SelectionPolicy
    """What orders the rest."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "pick", _checked_pick(self.pick))

    def order(
        self, segmentation: Segmentation, cloud: PointCloud
    ) -> tuple[Candidate, ...]:
        """Put the picked object first.

        Raises
        ------
        UnknownNameError
            If the label is not in the segmentation.
        InputError
            If there is no object at the pixel or near the point.
        """
        label = self._label(segmentation, cloud)
        ranked = ordered(self.others, segmentation, cloud)
        picked = tuple(
            replace(item, reason=f"picked by the operator; {item.reason}")
            for item in ranked
            if item.label == label
        )
        return picked + tuple(item for item in ranked if item.label != label)

    def _label(self, segmentation: Segmentation, cloud: PointCloud) -> int:
        _require_labels(segmentation, cloud)
        if isinstance(self.pick, int):
            return segmentation.segment(self.pick).label
        if len(self.pick) == 2:
            return _label_at_pixel(segmentation, cloud, *self.pick)
        point = np.array(self.pick)
        is_object = segmentation.labels > 0
        distance = np.linalg.norm(cloud.points[is_object] - point, axis=1)
        nearest = float(distance.min(initial=np.inf))
        if nearest > _PICK_REACH:
            raise InputError(
                "picked point",
                got=f"{point.tolist()}, {nearest:.3g} m from the nearest object",
                expected=f"a point within {_PICK_REACH} m of one",
                mend="Base frame, metres: x forward, y left, z up.",
            )
        return int(segmentation.labels[is_object][distance.argmin()])


def _checked_pick(pick: object) -> int | tuple[Any, ...]:
    """Return a label, a pixel or a point as Python's own numbers, or raise."""
    if isinstance(pick, Integral) and not isinstance(pick, bool):
        return int(pick)
    items = pick.tolist() if isinstance(pick, np.ndarray) else pick
    if isinstance(items, tuple | list):
        if len(items) == 2 and all(isinstance(item, Integral) for item in items):
            return tuple(map(int, items))
        if len(items) == 3 and all(isinstance(item, Real) for item in items):
            require_point(items, "pick")
            return tuple(map(float, items))
    raise InputError(
        "pick",
        got=shortened(repr(items)),
        expected="a label, a pixel (column, row) in whole numbers, or a point "
        "(x, y, z) [m]",
    )


def _label_at_pixel(
    segmentation: Segmentation, cloud: PointCloud, column: int, row: int
) -> int:
    """Label of what was measured at a pixel."""
    if cloud.pixels is None or cloud.image_shape is None:
        raise InputError(
            "picked pixel",
            got="a cloud without an image",
            expected="an organised one",
            mend="Pick by label or by a point in the base frame.",
        )
    height, width = cloud.image_shape
    if not (0 <= column < width and 0 <= row < height):
        raise InputError(
            "picked pixel",
            got=f"column {column}, row {row}",
            expected=f"0 to {width - 1}, 0 to {height - 1}",
        )
    found = np.flatnonzero(cloud.pixels == row * width + column)
    label = int(segmentation.labels[found[0]]) if len(found) else 0
    if not label:
        raise InputError(
            "picked pixel",
            got=f"no object at column {column}, row {row}",
            expected="a pixel of a segment",
            mend="`debrisgrasp segment --report FILE` shows the segments.",
        )
    return label


def nearest_distances(
    segmentation: Segmentation, cloud: PointCloud, point: FloatArray
) -> FloatArray:
    """Distance of a point (3,) to the nearest point of each segment [m], shape (s,)."""
    _require_labels(segmentation, cloud)
    index = np.flatnonzero(segmentation.labels)
    # Column by column: reductions along rows of three are ten times slower.
    columns = zip(cloud.points.T, point, strict=True)
    square = sum(np.square(axis[index] - place) for axis, place in columns)
    nearest = np.full(len(segmentation.segments) + 1, np.inf)
    np.minimum.at(nearest, segmentation.labels[index], square)
    distances: FloatArray = np.sqrt(nearest[1:])
    return distances


def require_point(point: ArrayLike, name: str = "point") -> FloatArray:
    """Freeze a priority or picked point [m], or raise if it isn't one."""
    result = frozen(point, name, (3,))
    if result.shape != (3,):
        raise InputError(name, got=result.shape, expected="one point")
    require_metres(name, result)
    return result


def _require_labels(segmentation: Segmentation, cloud: PointCloud) -> None:
    if len(cloud) != len(segmentation.labels):
        raise InputError(
            "cloud",
            got=f"{len(cloud)} points",
            expected=f"the {len(segmentation.labels)} points that were segmented",
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

    Raises
    ------
    InputError
        If there are no points, or one is not finite, the margin is negative, or the
        outliers at both ends are all of them.
    """
    if not 0 <= margin < np.inf:
        raise InputError("margin", got=margin, expected="0 or more metres")
    if not 0 <= outliers < 0.5:
        raise InputError("outliers", got=outliers, expected="0 or more, below 0.5")
    points = as_floats(points, "points", (3,))
    if not len(points):
        raise InputError("points of the object", got="none", expected="at least one")
    require_finite(points, "points of the object")
    lower, upper = np.quantile(points, [outliers, 1.0 - outliers], axis=0)
    return Bounds(lower - margin - 1e-6, upper + margin + 1e-6)
