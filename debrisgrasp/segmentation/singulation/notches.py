"""Telling bars apart that lie flush side by side.

Where two bars touch and their faces are level, depth shows a single face. What tells
them apart is the outline: unless both end together it has a notch where one goes on
alone, and the edge there, continued through the face, is the border between them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray
from debrisgrasp.geometry import so3

from .cells import CellImage
from .patches import PlanarPatches, measured_patches

__all__ = ["flush_bars_apart"]

_MIN_CELLS = 250
"""Smallest face that is looked at [cells]."""
_LOOK = (2, 6)
"""How far across an outline one looks for what lies behind it [cells]."""
_BEHIND = 0.01
"""What lies so much behind a face is neither part of it nor before it [m]."""
_MIN_FREE = 20
"""Fewest cells of an outline from which its direction is told."""
_TURNS = 45
"""Directions that are tried first, over a half turn; then finer ones."""
_WINDOW = 3
"""Rows of a face on either side of a cut whose ends are compared."""
_MIN_STEP = 0.025
"""Shortest notch [m]."""
_MIN_SEEN = 0.4
"""Share of the edge of a notch behind which something must be seen."""
_MIN_PART = 60
"""Smallest bar [cells]."""
_MIN_WIDTH = 0.06
"""Narrowest bar [m]: slats and rungs belong to frames."""
_MAX_RATIO = 1.35
"""Widest bar over the narrowest beside it: what is level is mostly of one stock."""
_MIN_BORDER = 1.3
"""Shortest border, over the width of a bar: they lie side by side."""
_MIN_STRAIGHT = 0.8
"""Share of the open outline that runs along the cuts, or across where bars end."""


@dataclass(frozen=True, slots=True, eq=False)
class _Face:
    """One planar patch, seen from straight above it and turned along its bars."""

    across: FloatArray
    """Position of its cells across the bars [m], shape (n,)."""
    along: FloatArray
    """Position of its cells along the bars [m], shape (n,)."""
    edge_across: FloatArray
    """The same of its outline where something lies behind it [m], shape (m,)."""
    edge_along: FloatArray
    pitch: float
    """Largest distance of neighbouring cells [m]."""

    @classmethod
    def of(
        cls, cells: FloatArray, edge: FloatArray, turn: float, pitch: float
    ) -> _Face:
        """Turn flat positions of cells (n, 2) and of the outline (m, 2)."""
        along = np.array([np.cos(turn), np.sin(turn)])
        across = np.array([-along[1], along[0]])
        return cls(cells @ across, cells @ along, edge @ across, edge @ along, pitch)


def flush_bars_apart(cells: CellImage, patches: PlanarPatches) -> PlanarPatches:
    """Divide faces at straight lines that continue the edges of notches.

    Returns
    -------
    PlanarPatches
        The same patches, but that each of a set of bars has its own; ``face`` is what
        they have in common.
    """
    labels = patches.labels.ravel().copy()
    size = patches.moments[0]
    large = np.flatnonzero(size >= _MIN_CELLS)
    if not len(large):
        return patches
    is_large = np.append(size >= _MIN_CELLS, [False, False])
    inside = np.flatnonzero(is_large[labels])
    inside = inside[np.argsort(labels[inside], kind="stable")]
    bounds = np.searchsorted(labels[inside], [large, large + 1])
    edge = _open_outline(cells, patches, is_large)
    edge_bounds = np.searchsorted(labels[edge], [large, large + 1])
    face = np.arange(len(patches))
    for patch, start, stop, first, last in zip(
        large, *bounds, *edge_bounds, strict=True
    ):
        own = inside[start:stop]
        bar = _bars(cells, patches.planes[:, patch], own, edge[first:last])
        if bar is not None:
            labels[own[bar > 0]] = len(face) + bar[bar > 0] - 1
            face = np.append(face, np.full(int(bar.max()), patch))
    if len(face) == len(patches):
        return patches
    shape = patches.labels.shape
    return replace(measured_patches(cells, labels.reshape(shape)), face=face)


def _open_outline(
    cells: CellImage, patches: PlanarPatches, is_large: BoolArray
) -> IntArray:
    """Cells at which large faces end and something behind them is seen, by patch."""
    labels = patches.labels
    height, width = labels.shape
    around = np.pad(labels, 1, constant_values=-3)
    found = []
    for i, j in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        there = around[1 + i : 1 + i + height, 1 + j : 1 + j + width]
        row, column = np.nonzero((there != labels) & is_large[labels])
        a, b, c = patches.planes[:, labels[row, column]]
        step = np.arange(1, _LOOK[1] + 1)[:, None]
        r = np.clip(row + step * i, 0, height - 1)
        k = np.clip(column + step * j, 0, width - 1)
        value = cells.values[r, k]
        expected = a * cells.x[k] + b * cells.y[r] + c
        behind = (expected - value) / expected**2
        known = value > 0
        margin = np.maximum(_BEHIND, 3.0 * cells.noise / expected[0] ** 2)
        is_open = (np.where(known, behind, 0.0) > -margin).all(axis=0)
        is_open &= (known & (behind > margin))[_LOOK[0] - 1 :].any(axis=0)
        found.append((row * width + column)[is_open])
    edge = np.concatenate(found)
    return edge[np.argsort(labels.ravel()[edge], kind="stable")]


def _bars(
    cells: CellImage, plane: FloatArray, inside: IntArray, edge: IntArray
) -> IntArray | None:
    """Bar of each cell (n,) of a face; None if there is only one."""
    if len(edge) < _MIN_FREE:
        return None
    normal = plane / np.linalg.norm(plane)
    times = so3.hat(normal)
    first = times[:, np.abs(normal).argmin()]
    first = first / np.linalg.norm(first)
    basis = np.stack([first, times @ first], axis=1)

    def rays(index: IntArray) -> FloatArray:
        row, column = np.divmod(index, cells.values.shape[1])
        return np.stack([cells.x[column], cells.y[row], np.ones(len(index))], axis=1)

    ray, edge_ray = rays(inside), rays(edge)
    flat, flat_edge = (r @ basis / (r @ plane)[:, None] for r in (ray, edge_ray))
    middle = ray.mean(axis=0)
    cosine = abs(normal @ middle) / np.linalg.norm(middle)
    pitch = 1.0 / (plane @ middle) / cells.focal / max(cosine, 0.15)
    turn = _direction(flat_edge, pitch)
    for angle in (turn, turn + np.pi / 2):
        face = _Face.of(flat, flat_edge, angle, pitch)
        cuts = _without_slivers(face, _notches(face))
        if len(cuts) and _are_bars(face, cuts):
            bar: IntArray = np.searchsorted(cuts, face.across)
            return bar
    return None


def _direction(points: FloatArray, pitch: float) -> float:
    """Direction in which most of an outline (m, 2) runs straight [rad]."""
    points = points - points.mean(axis=0)

    def straightest(angles: FloatArray) -> float:
        across = points @ np.stack([-np.sin(angles), np.cos(angles)])
        row = np.floor(across / pitch).astype(np.int64)
        row -= row.min()
        n = int(row.max()) + 1
        key = (row + n * np.arange(len(angles))).ravel()
        count = np.bincount(key, minlength=n * len(angles)).reshape(-1, n)
        # Neighbouring rows together, so that it doesn't matter where rows begin.
        together = count[:, 1:] + count[:, :-1]
        return float(angles[np.square(together).sum(axis=1).argmax()])

    angle = straightest(np.arange(_TURNS) * np.pi / _TURNS)
    return straightest(angle + np.linspace(-1, 1, 9) * np.pi / _TURNS)


def _notches(face: _Face) -> FloatArray:
    """Where one end of a face steps out or in, across its bars, ascending, (k,)."""
    low = float(face.across.min())
    ends = _ends_of_rows(face, low)
    if ends.shape[1] < 2 * _WINDOW + 1 or not np.isfinite(ends).all():
        return np.empty(0)
    windows = np.sort(sliding_window_view(ends, _WINDOW, axis=1), axis=2)
    level, bend = windows[..., _WINDOW // 2], windows[..., -1] - windows[..., 0]
    before, after = level[:, : -_WINDOW - 1], level[:, _WINDOW + 1 :]
    bend = np.maximum(bend[:, : -_WINDOW - 1], bend[:, _WINDOW + 1 :])
    step = np.abs(after - before)
    excess = step - np.maximum(2.0 * bend + 1.5 * face.pitch, _MIN_STEP)
    place = low + face.pitch * (np.arange(step.shape[1]) + _WINDOW + 0.5)
    ends_at, places_at = np.nonzero(excess >= 0)
    found: list[float] = []
    apart = (_WINDOW + 0.5) * face.pitch
    for index in np.argsort(-excess[ends_at, places_at]):
        end, k = ends_at[index], places_at[index]
        if any(abs(place[k] - other) < apart for other in found):
            continue
        near = np.abs(face.edge_across - place[k]) < 1.5 * face.pitch
        outward = (1.0 if end else -1.0) * face.edge_along[near]
        inner, outer = sorted((before[end, k], after[end, k]))
        outward = outward[(outward > inner) & (outward < outer)]
        seen = len(np.unique(np.floor(outward / face.pitch)))
        if seen * face.pitch >= _MIN_SEEN * step[end, k]:
            found.append(float(place[k]))
    return np.sort(found)


def _ends_of_rows(face: _Face, low: float) -> FloatArray:
    """How far rows of a face reach out at either end [m], shape (2, rows)."""
    row = np.floor((face.across - low) / face.pitch).astype(np.int64)
    ends = np.full((2, int(row.max()) + 1), -np.inf)
    np.maximum.at(ends[0], row, -face.along)
    np.maximum.at(ends[1], row, face.along)
    return ends


def _without_slivers(face: _Face, cuts: FloatArray) -> FloatArray:
    """Leave out cuts that are short, or leave something narrow."""
    while len(cuts):
        size = np.bincount(np.searchsorted(cuts, face.across), minlength=len(cuts) + 1)
        limits = np.concatenate([[face.across.min()], cuts, [face.across.max()]])
        width = np.where(size < _MIN_PART, 0.0, np.diff(limits))
        narrow = np.minimum(width[1:], width[:-1])
        wide = np.maximum(width[1:], width[:-1])
        near = np.abs(face.across - cuts[:, None]) < 0.5 * face.pitch
        rows = [np.unique(np.floor(face.along[at] / face.pitch)) for at in near]
        border = face.pitch * np.array([len(row) for row in rows])
        excess = np.minimum(border - _MIN_BORDER * wide, narrow - _MIN_WIDTH)
        stock = narrow * np.where(wide > 1.6 * narrow, 2.0, 1.0)
        excess = np.minimum(
            excess, _MAX_RATIO * np.minimum(stock, wide) - np.maximum(stock, wide)
        )
        if excess.min() >= 0:
            break
        cuts = np.delete(cuts, int(excess.argmin()))
    return cuts


def _are_bars(face: _Face, cuts: FloatArray) -> bool:
    """Whether what cuts divide has straight sides, square ends, and notches."""
    bar = np.searchsorted(cuts, face.across)
    ends = []
    for k in range(len(cuts) + 1):
        own = replace(face, across=face.across[bar == k], along=face.along[bar == k])
        rows = _ends_of_rows(own, float(own.across.min()))
        ends.append(np.median(rows[:, np.isfinite(rows[1])], axis=1) * [-1.0, 1.0])
    level = np.array(ends)
    if np.abs(np.diff(level, axis=0)).max(axis=1).min() < _MIN_STEP:
        return False
    limits = np.concatenate([[face.across.min()], cuts, [face.across.max()]])
    tolerance = 1.5 * face.pitch
    at_side = np.abs(face.edge_across - limits[:, None]).min(axis=0) < tolerance
    own_level = level[np.searchsorted(cuts, face.edge_across)]
    at_end = np.abs(face.edge_along[:, None] - own_level).min(axis=1) < tolerance
    # Holes say nothing: only the ends of rows count.
    low = float(face.across.min())
    rows = _ends_of_rows(face, low)
    row = np.clip(
        np.floor((face.edge_across - low) / face.pitch).astype(np.int64),
        0,
        rows.shape[1] - 1,
    )
    outer = (
        np.array([[-1.0], [1.0]]) * face.edge_along > rows[:, row] - tolerance
    ).any(axis=0)
    return bool(np.mean((at_side | at_end)[at_side | outer]) > _MIN_STRAIGHT)
