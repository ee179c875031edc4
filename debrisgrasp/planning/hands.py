"""The preshaped hand of every prototype, packed so that all are checked at once."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntFlag

import numpy as np
from scipy.ndimage import distance_transform_edt

from debrisgrasp._arrays import Float32Array, FloatArray, IntArray
from debrisgrasp.geometry import Bounds, Solid
from debrisgrasp.prototypes import GraspPrototype, GripperModel, PrototypeLibrary

__all__ = [
    "MARGIN_SHIFT",
    "MARGIN_STEPS",
    "SPHERE_RADIUS",
    "HandSpace",
    "PackedHands",
    "PackedSpaces",
    "SpaceOfHand",
]

GRIP_MARGIN = 0.016
"""An object may be so much wider than its prototype [m]."""
_SWEEP_STEP = 0.012
"""How far the pads close between two positions that are looked at [m]."""
SPHERE_RADIUS = 0.03
"""Largest sphere of the cover of a hand [m]: wider ones are fewer and stand out more
over flat sides."""


class HandSpace(IntFlag):
    """What a place in the palm frame means to a hand."""

    PALM = 1
    """Inside the palm at the final pose."""
    FINGER = 2
    """Inside an open finger at the final pose."""
    APPROACH = 4
    """Swept by palm or fingers on the way to the final pose."""
    CLOSING = 8
    """Between the open fingers."""
    SWEPT = 16
    """Swept by the fingers while they close, until shortly before they grip."""


MARGIN_STEPS = 7
"""The flags of a place also say how near palm or open fingers come to it, on the way in
too: their upper three bits are 7 inside, 6 one cell outside, and 0 from 7 cells on."""
MARGIN_SHIFT = 5
"""Position of these bits."""


@dataclass(frozen=True, slots=True, eq=False)
class SpaceOfHand:
    """The palm frame around one preshaped hand as a grid of `HandSpace` flags."""

    flags: np.ndarray
    """`HandSpace` and `MARGIN_STEPS`, shape (nx, ny, nz), uint8; the outermost layer of
    cells is empty."""
    origin: FloatArray
    """Centre of the first cell [m], palm frame, shape (3,)."""
    spacing: float
    """Edge of a cell [m]."""

    @classmethod
    def of(
        cls,
        gripper: GripperModel,
        preshape: str,
        opening: float,
        width: float,
        *,
        approach: float,
        tolerance: float,
        spacing: float = 0.004,
    ) -> SpaceOfHand:
        """Fill the grid from the hand's solids, exact at the centre of each cell.

        Parameters
        ----------
        width
            Opening at which the hand grips [m]; objects `GRIP_MARGIN` wider still do.
        approach
            Length of the straight approach along +z [m].
        tolerance
            A place counts as inside a solid from this depth on [m].
        """
        fingers = gripper.finger_solids(preshape, opening)
        closing = gripper.closing_region(preshape, opening)
        bounds = _union([s.bounds for s in (*gripper.palm, *fingers, closing)])
        lower = bounds.lower - np.array([0.0, 0.0, approach]) - spacing
        # Above, where the hand comes from, the approach is longer than any margin.
        widest = MARGIN_STEPS * spacing
        lower[:2] -= widest
        upper = bounds.upper + widest
        shape = tuple(int(n) for n in np.ceil((upper - lower) / spacing) + 2)
        flags = np.zeros(shape, dtype=np.uint8)
        hand = cls(flags, lower, spacing)
        for solids, flag in (
            (gripper.palm, HandSpace.PALM),
            (fingers, HandSpace.FINGER),
            ((closing,), HandSpace.CLOSING),
            (_sweep(gripper, preshape, opening, width), HandSpace.SWEPT),
        ):
            for solid in solids:
                depth = 0.0 if flag is HandSpace.CLOSING else tolerance
                hand._mark(solid, flag, depth)
        is_solid = (flags & (HandSpace.PALM | HandSpace.FINGER)) > 0
        back = max(0, int((approach - widest) / spacing))
        away = np.rint(distance_transform_edt(~is_solid[:, :, back:]))
        near = np.zeros(shape, dtype=np.uint8)
        near[:, :, back:] = MARGIN_STEPS - np.minimum(away, MARGIN_STEPS)
        nearest = near.copy()
        # Seen from the retreated hand, a point lies farther ahead than at the end.
        for step in range(1, round(approach / spacing) + 1):
            flags[:, :, :-step][is_solid[:, :, step:]] |= np.uint8(HandSpace.APPROACH)
            ahead = nearest[:, :, :-step]
            np.maximum(ahead, near[:, :, step:], out=ahead)
        flags |= nearest << MARGIN_SHIFT
        return hand

    def _mark(self, solid: Solid, flag: HandSpace, depth: float) -> None:
        """Set a flag where a solid is deeper than ``depth`` [m]."""
        first = np.floor((solid.bounds.lower - self.origin) / self.spacing)
        last = np.ceil((solid.bounds.upper - self.origin) / self.spacing)
        axes = [np.arange(a, b + 1) for a, b in zip(first, last, strict=True)]
        cells = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        cells = cells[((cells >= 1) & (cells < np.array(self.flags.shape) - 1)).all(1)]
        inside = solid.signed_distance(self.origin + cells * self.spacing) < -depth
        i, j, k = cells[inside].astype(np.int64).T
        self.flags[i, j, k] |= np.uint8(flag)


@dataclass(frozen=True, slots=True, eq=False)
class PackedSpaces:
    """Several `SpaceOfHand` in one array, so that any mix of them is looked up."""

    flags: np.ndarray
    """All grids behind each other, flat, uint8."""
    first: IntArray
    """Where each grid begins, shape (h,)."""
    shape: IntArray
    """Cells of each along x, y, z, shape (h, 3)."""
    origin: Float32Array
    """Centre of each first cell [m], shape (h, 3)."""
    spacing: float
    """Edge of a cell [m]."""

    @classmethod
    def pack(cls, spaces: Iterable[SpaceOfHand]) -> PackedSpaces:
        """Collect grids of one spacing."""
        spaces = tuple(spaces)
        sizes = [space.flags.size for space in spaces]
        return cls(
            flags=np.concatenate([space.flags.ravel() for space in spaces]),
            first=np.concatenate([[0], np.cumsum(sizes)[:-1]]),
            shape=np.array([space.flags.shape for space in spaces]),
            origin=np.array([space.origin for space in spaces], dtype=np.float32),
            spacing=spaces[0].spacing,
        )

    @property
    def middle(self) -> Float32Array:
        """Middle of each grid [m], shape (h, 3)."""
        half = (self.shape - 1) * np.float32(self.spacing / 2)
        found: Float32Array = self.origin + half.astype(np.float32)
        return found

    @property
    def radius(self) -> Float32Array:
        """Half the diagonal of each grid [m], shape (h,)."""
        diagonal = np.linalg.norm((self.shape - 1) * self.spacing, axis=1)
        found: Float32Array = (diagonal / 2).astype(np.float32)
        return found

    @property
    def half(self) -> Float32Array:
        """Half the size of each grid along x, y, z [m], shape (h, 3)."""
        return np.asarray(self.shape * np.float32(self.spacing / 2), dtype=np.float32)

    def marked(
        self, points: Float32Array, Ts_hand: Float32Array, which: IntArray
    ) -> tuple[IntArray, IntArray, IntArray]:
        """Find the cells that points lie in, seen from several hands.

        Parameters
        ----------
        points
            Coordinates [m] and a one, shape (4, n).
        Ts_hand
            Poses of the hands in the frame of the points, shape (k, 4, 4).
        which
            Grid of each, shape (k,).

        Returns
        -------
        flags, pose, point
            Flags of every cell found, and the indices of hand and point that meet in
            it; points outside a grid are left out.
        """
        to_hand = Ts_hand[:, :3, :3].transpose(0, 2, 1) / np.float32(self.spacing)
        offset = (to_hand @ Ts_hand[:, :3, 3:])[..., 0]
        offset += self.origin[which] / np.float32(self.spacing) - np.float32(0.5)
        shape = self.shape[which]
        is_in = np.ones((len(which), points.shape[1]), dtype=bool)
        axes = []
        for axis in range(3):
            row = np.concatenate([to_hand[:, axis], -offset[:, axis, None]], axis=1)
            cell = row @ points
            # The outermost layer is empty.
            is_in &= cell >= 1
            is_in &= cell < shape[:, axis, None].astype(np.float32)
            axes.append(cell)
        found = np.flatnonzero(is_in)
        pose, point = np.divmod(found, points.shape[1])
        flat = np.zeros(len(found), dtype=np.int64)
        for axis, cell in enumerate(axes):
            flat *= shape[:, axis][pose]
            flat += cell.ravel()[found].astype(np.int64)
        return self.flags.take(flat + self.first[which][pose]), pose, point

    def at(self, points_hand: Float32Array, which: IntArray) -> np.ndarray:
        """Look up the flags at points (k, 3, n) in the palm frames of hands (k,)."""
        flat = np.zeros((len(which), points_hand.shape[2]), dtype=np.int32)
        for axis in range(3):
            # The outermost layer is empty and takes whatever lies farther out.
            n = self.shape[which, axis, None].astype(np.float32)
            cell = points_hand[:, axis] - self.origin[which, axis, None]
            cell *= np.float32(1.0 / self.spacing)
            cell += np.float32(0.5)
            np.clip(cell, 0, n - 1, out=cell)
            flat *= n.astype(np.int32)
            flat += cell.astype(np.int32)
        flat += self.first[which, None].astype(np.int32)
        found: np.ndarray = self.flags.take(flat)
        return found


@dataclass(frozen=True, slots=True, eq=False)
class PackedHands:
    """Hands at their open preshape, one for each of p prototypes, in the palm frame."""

    centers: Float32Array
    """Spheres that cover the hand [m], shape (p, 3, s)."""
    radii: Float32Array
    """Their radii [m], shape (p, s); minus infinity where a hand has fewer."""
    parts: IntArray
    """Which part each sphere belongs to: 0 the palm, 1 the thumb side, 2 the side of
    the finger pair, -1 none; shape (p, s)."""
    space_index: IntArray
    """Which of ``spaces`` each prototype's hand has, shape (p,)."""
    spaces: PackedSpaces
    """One for each combination of hand, preshape, opening and width."""
    grip_points: FloatArray
    """Middle of the space between the fingers [m], shape (p, 3)."""
    slack: FloatArray
    """Least distance between the open fingers and the prototype [m], shape (p,)."""

    @classmethod
    def pack(
        cls, library: PrototypeLibrary, *, approach: float, tolerance: float
    ) -> PackedHands:
        """Collect the hand of each prototype of a dictionary."""
        keys = [(p.gripper, p.preshape, p.opening, p.width) for p in library]
        unique = list(dict.fromkeys(keys))
        spaces = PackedSpaces.pack(
            SpaceOfHand.of(
                library.grippers[name],
                preshape,
                opening,
                width,
                approach=approach,
                tolerance=tolerance,
            )
            for name, preshape, opening, width in unique
        )
        covers = [
            _cover(library.grippers[name], preshape, opening)
            for name, preshape, opening, _ in unique
        ]
        grips = [
            library.grippers[n].closing_region(pre, w).T_frame_solid.p
            for n, pre, w, _ in unique
        ]
        index = np.array([unique.index(key) for key in keys])
        most = max(len(part) for _, _, part in covers)
        centers = np.zeros((len(unique), 3, most), np.float32)
        radii = np.full((len(unique), most), -np.inf, np.float32)
        parts = np.full((len(unique), most), -1, np.int8)
        for i, (center, radius, part) in enumerate(covers):
            n = len(part)
            centers[i, :, :n], radii[i, :n], parts[i, :n] = center.T, radius, part
        return cls(
            centers=centers[index],
            radii=radii[index],
            parts=parts[index],
            space_index=index,
            spaces=spaces,
            grip_points=np.array(grips)[index],
            slack=np.array([_slack(p, library.grippers[p.gripper]) for p in library]),
        )


def _slack(prototype: GraspPrototype, gripper: GripperModel) -> float:
    """Least distance between the open fingers of a hand and what it grips [m]."""
    fingers = gripper.finger_solids(prototype.preshape, prototype.opening)
    gaps = [float(s.signed_distance(prototype.points).min()) for s in fingers]
    return min(gaps, default=0.0)


def _cover(
    gripper: GripperModel, preshape: str, opening: float
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Centres (s, 3), radii (s,) and parts (s,) of the spheres that cover a hand."""
    parts = (
        gripper.palm,
        gripper.finger_solids(preshape, opening, side=-1),
        gripper.finger_solids(preshape, opening, side=1),
    )
    covers = [
        (*solid.sphere_cover(SPHERE_RADIUS), part)
        for part, solids in enumerate(parts)
        for solid in solids
    ]
    centers, radii, part = zip(*covers, strict=True)
    counts = [len(radius) for radius in radii]
    return np.concatenate(centers), np.concatenate(radii), np.repeat(part, counts)


def _sweep(
    gripper: GripperModel, preshape: str, opening: float, width: float
) -> tuple[Solid, ...]:
    """Fingers at openings from the first move to shortly before the grip."""
    last = min(width + GRIP_MARGIN, opening)
    n_steps = math.ceil((opening - last) / _SWEEP_STEP)
    steps = np.linspace(opening, last, n_steps + 1)[1:]
    return tuple(
        solid for step in steps for solid in gripper.finger_solids(preshape, step)
    )


def _union(boxes: Iterable[Bounds]) -> Bounds:
    lower, upper = zip(*((b.lower, b.upper) for b in boxes), strict=True)
    return Bounds(np.min(lower, axis=0), np.max(upper, axis=0))
