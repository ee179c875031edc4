"""The space around one preshaped hand as a grid: what every place means to it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import IntFlag

import numpy as np

from debrisgrasp._arrays import BoolArray, Float32Array, FloatArray, IntArray
from debrisgrasp.geometry import Bounds, Solid, lattice
from debrisgrasp.prototypes import GripperModel

__all__ = [
    "MARGIN_SHIFT",
    "MARGIN_STEPS",
    "HandSpace",
    "PackedSpaces",
    "SpaceOfHand",
]

GRIP_MARGIN = 0.016
"""An object may be so much wider than its prototype [m]."""
_SWEEP_STEP = 0.012
"""How far the pads close between two positions that are looked at [m]."""


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


_SOLID = HandSpace.PALM | HandSpace.FINGER
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
        *,
        approach: float,
        tolerance: float,
        spacing: float = 0.004,
    ) -> SpaceOfHand:
        """Fill the grid from the open hand's solids, exact at the centre of each cell.

        Parameters
        ----------
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
        ):
            for solid in solids:
                depth = 0.0 if flag is HandSpace.CLOSING else tolerance
                hand._mark(solid, flag, depth)
        is_solid = (flags & _SOLID) > 0
        back = max(0, int((approach - widest) / spacing))
        near = np.zeros(shape, dtype=np.uint8)
        near[:, :, back:] = _nearness(is_solid[:, :, back:])
        # Seen from the retreated hand, a point lies farther ahead than at the end.
        n_steps = round(approach / spacing)
        if n_steps:
            swept = _greatest_ahead(is_solid.view(np.uint8), n_steps)[:, :, 1:]
            flags[:, :, :-1] |= swept * np.uint8(HandSpace.APPROACH)
        flags |= _greatest_ahead(near, n_steps + 1) << MARGIN_SHIFT
        return hand

    def closed(
        self,
        gripper: GripperModel,
        preshape: str,
        opening: float,
        width: float,
        *,
        tolerance: float,
    ) -> SpaceOfHand:
        """Mark what the fingers sweep, too, until they grip at a width [m].

        Objects `GRIP_MARGIN` wider than that are still gripped.
        """
        hand = replace(self, flags=self.flags.copy())
        last = min(width + GRIP_MARGIN, opening)
        n_steps = math.ceil((opening - last) / _SWEEP_STEP)
        steps = np.linspace(opening, last, n_steps + 1)[1:]
        poses = gripper.link_poses(preshape, steps)
        for finger, links in zip(gripper.fingers, poses, strict=True):
            for step in range(n_steps):
                for solid in finger.placed([Ts[step] for Ts in links]):
                    hand._mark(solid, HandSpace.SWEPT, tolerance)
        return hand

    def _mark(self, solid: Solid, flag: HandSpace, depth: float) -> None:
        """Set a flag where a solid is deeper than ``depth`` [m]."""
        bounds = solid.bounds
        low = np.floor((bounds.lower + depth - self.origin) / self.spacing)
        high = np.ceil((bounds.upper - depth - self.origin) / self.spacing)
        # The outermost layer stays empty.
        low = np.maximum(low, 1.0).astype(int)
        end = np.minimum(high + 1.0, np.array(self.flags.shape) - 1)
        end = np.maximum(end.astype(int), low)
        axes = (
            first + np.arange(a, b) * self.spacing
            for first, a, b in zip(self.origin, low, end, strict=True)
        )
        points = lattice(*axes)
        # In one row: that of a grid would be turned line by line.
        distance = solid.signed_distance(points.reshape(-1, 3))
        inside = distance.reshape(points.shape[:-1]) < -depth
        self.flags[tuple(map(slice, low, end))] |= inside * np.uint8(flag)


def _nearness(is_solid: BoolArray) -> np.ndarray:
    """`MARGIN_STEPS` less the rounded distance to the nearest solid cell, uint8.

    A separable distance transform that looks no farther than matters.
    """
    squared = np.where(is_solid, np.uint8(0), np.uint8(_BEYOND))
    for _ in range(3):
        least = squared.copy()
        for step in range(1, MARGIN_STEPS):
            farther = squared + np.uint8(step * step)
            np.minimum(least[step:], farther[:-step], out=least[step:])
            np.minimum(least[:-step], farther[step:], out=least[:-step])
        # Each axis has its turn to be the first: whole layers are compared.
        squared = np.ascontiguousarray(np.moveaxis(least, 0, -1))
    steps = np.rint(np.sqrt(np.arange(256))).clip(None, MARGIN_STEPS)
    return (MARGIN_STEPS - steps).astype(np.uint8)[squared]


_BEYOND = MARGIN_STEPS**2
_STILL = 1e-4
"""What moves less along an axis on all of a way stays in its cell [cells]."""


def _greatest_ahead(values: np.ndarray, n: int) -> np.ndarray:
    """Greatest of the n values along z that begin at each cell, its own the first."""
    greatest, reach = values.copy(), 1
    while reach < n:
        step = min(reach, n - reach)
        here = greatest[:, :, :-step]
        np.maximum(here, greatest[:, :, step:], out=here)
        reach += step
    return greatest


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
    solid: IntArray
    """First cell along x, y, z that the open hand fills, and one past the last, shape
    (h, 2, 3)."""

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
            solid=np.array([_filled(space.flags) for space in spaces]),
        )

    @property
    def middle(self) -> Float32Array:
        """Middle of each grid [m], shape (h, 3)."""
        half = (self.shape - 1) * np.float32(self.spacing / 2)
        found: Float32Array = self.origin + half.astype(np.float32)
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

    def hits(
        self,
        points: Float32Array,
        Ts_hand: FloatArray,
        which: IntArray,
        ways: FloatArray,
        aside: FloatArray,
        steps: FloatArray,
    ) -> IntArray:
        """Count points that are met by open hands moved back along straight ways.

        Parameters
        ----------
        points
            [m], shape (3, n).
        Ts_hand, which
            Poses of the hands in the frame of the points (k, 4, 4), and grid of each.
        ways
            Unit vectors in the frames of the hands, shape (k, d, 3).
        aside
            Where each of them begins in these frames [m], shape (d, 3).
        steps
            Places along them [m], shape (s,).

        Returns
        -------
        IntArray
            Shape (k, d, s).
        """
        k, d, s = *ways.shape[:2], len(steps)
        per_cell = 1.0 / self.spacing
        to_hand = (Ts_hand[:, :3, :3].swapaxes(1, 2) * per_cell).astype(np.float32)
        begin = (to_hand @ Ts_hand[:, :3, 3:].astype(np.float32))[..., 0]
        begin += self.origin[which] * np.float32(per_cell) - np.float32(0.5)
        moves = (ways * per_cell).astype(np.float32)
        # A point is met where it is as far ahead as the hand has been moved back.
        ends = moves * np.float32(steps[-1])
        begins = (aside * per_cell).astype(np.float32)
        first, end = self.solid[which].astype(np.float32).swapaxes(0, 1)
        least = first[:, None] + begins + np.minimum(ends, 0.0)
        most = end[:, None] + begins + np.maximum(ends, 0.0)
        low, high = least.min(axis=1), most.max(axis=1)
        is_in = np.ones((k, points.shape[1]), dtype=bool)
        cells = []
        for axis in range(3):
            cell = to_hand[:, axis] @ points - begin[:, axis, None]
            is_in &= cell >= low[:, axis, None]
            is_in &= cell < high[:, axis, None]
            cells.append(cell)
        hands, points_in = np.nonzero(is_in)
        places = np.stack([cell[hands, points_in] for cell in cells])
        found = np.zeros((d, s, k), dtype=np.int64)
        back = steps[:, None].astype(np.float32)
        for way in range(d):
            hand, start = hands, places
            if d > 1:  # each way meets few of the points that all of them do
                meets = places >= least[:, way].T[:, hands]
                meets &= places < most[:, way].T[:, hands]
                kept = np.flatnonzero(meets.all(axis=0))
                hand, start = hands[kept], places[:, kept]
            flat = np.zeros((1, len(hand)), dtype=np.int32)
            for axis, place in enumerate(start):
                n = self.shape[which, axis].astype(np.int32)[hand]
                moved = place[None] - begins[way, axis]
                if np.abs(ends[:, way, axis]).max(initial=0.0) > _STILL:
                    moved = moved - back * moves[hand, way, axis]
                # The outermost layer is empty and takes whatever lies farther out.
                inside = np.minimum(np.maximum(moved, 0), n - np.float32(1))
                flat = flat * n + inside.astype(np.int32)
            flat += self.first[which].astype(np.int32)[hand]
            flags = np.broadcast_to(self.flags.take(flat, mode="clip"), (s, len(hand)))
            step, row = np.nonzero(flags & _SOLID)
            met = np.bincount(step * k + hand[row], minlength=s * k)
            found[way] = met.reshape(s, k)
        return np.moveaxis(found, 2, 0)


def _filled(flags: np.ndarray) -> IntArray:
    """First cell along each axis that palm or fingers fill, and one past the last."""
    is_solid = (flags & _SOLID) > 0
    ranges = []
    for axis in range(3):
        others = tuple(other for other in range(3) if other != axis)
        cells = np.flatnonzero(is_solid.any(axis=others))
        ranges.append((cells[0], cells[-1] + 1) if len(cells) else (0, 0))
    return np.array(ranges).T


def _union(boxes: Iterable[Bounds]) -> Bounds:
    lower, upper = zip(*((b.lower, b.upper) for b in boxes), strict=True)
    return Bounds(np.min(lower, axis=0), np.max(upper, axis=0))
