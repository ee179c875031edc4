"""What a dictionary can grip: object size against hand and approach, and its gaps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray

from .gripper import GripperModel
from .prototype import GraspPrototype
from .shapes import BarShape, CylinderShape, EdgeShape, RimShape
from .supported import CellShape, HandleShape, RungShape
from .surface_shape import SurfaceShape

__all__ = ["APPROACHES", "CoverageMap", "approach_of", "coverage"]

APPROACHES = (
    "across a round piece",
    "across a flat piece",
    "end of a round piece",
    "end of a flat piece",
    "edge or rim",
    "handle or rung",
)
"""Ways to take things that shapes are sorted by."""
SIZES = np.arange(0.02, 0.1801, 0.01)
"""Diameters and widths that are looked at [m]."""
_THIN = {"edge or rim": 0.04, "handle or rung": 0.04}
"""Widest of what is thin by its nature [m]; beyond it there is no gap."""
_TOLERANCE = 0.01
"""A prototype stands for things this much wider or thinner [m]: a little more than the
width of the distance kernel of the planner, 8 mm."""


@dataclass(frozen=True, slots=True, eq=False)
class CoverageMap:
    """How many prototypes there are for each size, hand and approach."""

    sizes: FloatArray
    """Diameters or widths [m], shape (s,)."""
    rows: tuple[tuple[str, str], ...]
    """Hand and approach of each row."""
    counts: IntArray
    """Prototypes within 1 cm of each size, shape (rows, s)."""
    in_range: IntArray
    """1 where the hand can close on the size at all, shape (rows, s)."""

    def gaps(self) -> tuple[str, ...]:
        """Name sizes that a hand can take but no prototype of an approach covers."""
        found = []
        for (hand, approach), counts, usable in zip(
            self.rows, self.counts, self.in_range, strict=True
        ):
            if usable.any() and not counts.any():
                found.append(f"{hand}, {approach}: none at all")
                continue
            spans = [
                f"{100 * self.sizes[first]:.0f}"
                + (f" to {100 * self.sizes[last]:.0f}" if last > first else "")
                for first, last in _runs((counts == 0) & (usable == 1))
            ]
            if spans:
                found.append(f"{hand}, {approach}: {', '.join(spans)} cm")
        return tuple(found)


def coverage(
    prototypes: Iterable[GraspPrototype], grippers: Mapping[str, GripperModel]
) -> CoverageMap:
    """Map the sizes that a dictionary covers, for each hand that it names.

    Parameters
    ----------
    grippers
        The hands, by name.
    """
    known = tuple(prototypes)
    hands = sorted({prototype.gripper for prototype in known})
    counted: dict[tuple[str, str], IntArray] = {}
    for hand in hands:
        for approach in APPROACHES[:5]:
            counted[hand, approach] = np.zeros(len(SIZES), dtype=np.int64)
    for prototype in known:
        key = prototype.gripper, approach_of(prototype)
        row = counted.setdefault(key, np.zeros(len(SIZES), dtype=np.int64))
        row += np.abs(SIZES - prototype.width) <= _TOLERANCE + 1e-9
    rows = tuple(sorted(counted, key=lambda key: (key[0], APPROACHES.index(key[1]))))
    usable = []
    for hand, approach in rows:
        spans = [shape.widths for shape in grippers[hand].preshapes.values()]
        low, high = min(s[0] for s in spans), max(s[1] for s in spans)
        high = min(high, _THIN.get(approach, high))
        usable.append((low - 1e-9 <= SIZES) & (high + 1e-9 >= SIZES))
    return CoverageMap(
        SIZES,
        rows,
        np.array([counted[key] for key in rows]).reshape(-1, len(SIZES)),
        np.array(usable, dtype=np.int64).reshape(-1, len(SIZES)),
    )


def approach_of(prototype: GraspPrototype) -> str:
    """Sort a prototype into `APPROACHES` by its shape and how the hand comes to it."""
    shape, R = prototype.definition.shape, prototype.definition.T_hand_shape.R
    if isinstance(shape, EdgeShape):
        return "end of a flat piece" if shape.ends == "both" else "edge or rim"
    if isinstance(shape, RimShape | CellShape):
        return "edge or rim"
    if isinstance(shape, CylinderShape | BarShape):
        # The long axis of both is their y; the hand comes along its own z.
        is_end = abs(R[2, 1]) > np.cos(np.pi / 4)
        kind = "round" if isinstance(shape, CylinderShape) else "flat"
        return f"end of a {kind} piece" if is_end else f"across a {kind} piece"
    if isinstance(shape, SurfaceShape):
        return _approach_of_surface(prototype)
    if isinstance(shape, HandleShape | RungShape):
        return "handle or rung"
    return "across a flat piece"


def _approach_of_surface(prototype: GraspPrototype) -> str:
    """By the longest direction of the points, and how far the normals spread."""
    offset = prototype.points - prototype.points.mean(axis=0)
    long = np.linalg.eigh(offset.T @ offset)[1][:, 2]
    across = prototype.normals - np.outer(prototype.normals @ long, long)
    angles = np.arctan2(across @ np.cross(long, _side(long)), across @ _side(long))
    filled = np.histogram(angles, bins=12, range=(-np.pi, np.pi))[0]
    # On a box nearly all normals share a few directions.
    kind = "flat" if np.sort(filled)[-3:].sum() > 0.7 * filled.sum() else "round"
    where = "end of" if abs(long[2]) > np.cos(np.pi / 4) else "across"
    return f"{where} a {kind} piece"


def _side(direction: FloatArray) -> FloatArray:
    side = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    unit: FloatArray = side / np.linalg.norm(side)
    return unit


def _runs(flags: IntArray) -> list[tuple[int, int]]:
    """First and last index of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]
