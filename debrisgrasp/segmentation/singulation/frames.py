"""Joining thin bars that end at other bars: trusses, ladders, gratings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from debrisgrasp._arrays import IntArray

from .camera import InverseDepthImage
from .pieces import Shapes
from .regions import Crossings, no_pairs

__all__ = ["FrameConfig", "framed_bars"]

_BLURRED = 2.0
"""Pixels by which the end of a bar may be off."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameConfig:
    """When a thin bar is a part of a frame."""

    max_brace_width: float = 0.032
    """Widest bar that may end at others [m]; larger takes lumber for braces."""
    max_chord_width: float = 0.06
    """Widest bar that others may end at [m]."""
    max_gap: float = 0.02
    """Between the end of a brace and the chord [m]; a few pixels come on top."""
    min_free: float = 0.5
    """Share of a bar's outline that touches nothing; faces of a box touch others."""
    min_pixels: int = 40
    """Smaller pieces are no bars."""


def framed_bars(
    image: InverseDepthImage,
    shapes: Shapes,
    crossings: Crossings,
    touching: Crossings,
    config: FrameConfig,
) -> IntArray:
    """Pairs (brace, chord) where both ends of the brace meet other bars, (k, 2).

    Parameters
    ----------
    shapes
        Shapes of the pieces.
    crossings
        All borders between pieces in the image.
    touching
        Those at which they touch.
    """
    n = len(shapes.size)
    outline = np.bincount(crossings.first, minlength=n)
    free = 1.0 - np.bincount(touching.first, minlength=n) / np.maximum(outline, 1)
    is_bar = (shapes.length > 2.5 * shapes.width) & (free > config.min_free)
    is_bar &= shapes.size > config.min_pixels
    is_chord = is_bar & (shapes.width < config.max_chord_width)
    braces = np.flatnonzero(is_bar & (shapes.width < config.max_brace_width))
    own = np.where(image.values > 0, crossings.labels, -1)
    row, column = np.nonzero(np.append(is_chord, False)[own])
    if not len(row) or not len(braces):
        return no_pairs()
    chord = own[row, column]
    rays = np.stack([image.x[row, column], image.y[row, column], np.ones(len(row))])
    tree = cKDTree((rays / image.values[row, column]).T)
    ends = shapes.ends[braces].reshape(-1, 3)
    # Where bars meet, a few pixels may have gone to the wrong one.
    reach = config.max_gap + _BLURRED * ends[:, 2] / image.focal
    found = tree.query_ball_point(ends, reach, return_sorted=False)
    pairs = []
    for k, brace in enumerate(braces):
        met = [np.setdiff1d(chord[found[2 * k + end]], brace) for end in (0, 1)]
        if len(met[0]) and len(met[1]):
            pairs += [(brace, other) for other in {*met[0], *met[1]}]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)
