"""Where the inner faces of closing fingers meet an object, and how they lean there.

Curled fingers close over a thin thing rather than on it: what is narrower than what
they leave between them is not squeezed, and what is round and lies where their faces
lean over it is squeezed out of them, towards the palm.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import ndtr

from debrisgrasp._arrays import Float32Array, FloatArray, IntArray, bounded
from debrisgrasp.prototypes import GripperModel, PrototypeLibrary

from .near_pads import ROOM_ERROR

__all__ = ["HEIGHTS", "FingerFaces", "meets_both"]

HEIGHTS = np.arange(0.005, 0.6, 0.01)
"""Over the palm, at which the gap between closed fingers is known [m]."""
_RADII = np.array([0.01, 0.015, 0.02, 0.025, 0.03, 0.04, 0.05, 0.06, 0.08])
"""Of round things, for which the lean of the faces that meet them is known [m]."""
_FINE = 0.0025
"""Spacing along the fingers of places where they may meet what is round [m]."""
_OPENINGS = 12
"""Between closed and open, in which they are looked at."""
_ON_PALM = 0.015
"""What is so near to the palm rests on it where it is squeezed towards it [m]."""
_HIDDEN = 0.04
"""By so much what was seen of debris falls short of its thickness, where nothing tells
that, on average [m]."""
_GIVES = 0.01
"""By so much hand or object give way to the other fingers where those of one side close
to the middle and meet nothing [m] ..."""
_GIVES_ERROR = 0.005
"""... and the standard deviation of that [m]."""
_FAR = 1.0
"""What goes on out of sight reaches to any finger [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class FingerFaces:
    """Inner faces of the hands of p prototypes."""

    gaps: Float32Array
    """Left between closed fingers at each of `HEIGHTS` [m], shape (p, h); past the tips
    as at the tips, and no more than the opening."""
    leans: Float32Array
    """Of the faces where they meet a round thing, away from upright [rad], by the
    height of its middle, as `HEIGHTS`, and its radius, shape (p, h, r)."""

    @classmethod
    def of(cls, library: PrototypeLibrary) -> FingerFaces:
        """Collect those of each prototype's hand."""
        gaps, leans = [], []
        for prototype in library:
            gripper = library.grippers[prototype.gripper]
            gap = _closed_gaps(gripper, prototype.preshape)
            gaps.append(np.minimum(gap, prototype.opening))
            leans.append(_leans(gripper, prototype.preshape))
        return cls(np.array(gaps, np.float32), np.array(leans, np.float32))

    def lean(
        self, prototype: IntArray, middle: FloatArray, radius: FloatArray
    ) -> FloatArray:
        """Lean of the faces that meet round things [rad], shape (k,).

        Parameters
        ----------
        prototype
            Whose hand closes, shape (k,).
        middle, radius
            Of each thing [m]: height over the palm, and radius, shape (k,).
        """
        step = HEIGHTS[1] - HEIGHTS[0]
        height = bounded((middle - HEIGHTS[0]) / step, 0.0, len(HEIGHTS) - 1.001)
        size = np.interp(radius, _RADII, np.arange(len(_RADII)))
        size = np.minimum(size, len(_RADII) - 1.001)
        i, j = height.astype(np.intp), size.astype(np.intp)
        u, v = height - i, size - j
        p, leans = prototype, self.leans
        low = (1.0 - v) * leans[p, i, j] + v * leans[p, i, j + 1]
        high = (1.0 - v) * leans[p, i + 1, j] + v * leans[p, i + 1, j + 1]
        return np.asarray((1.0 - u) * low + u * high)


def meets_both(
    extents: FloatArray, outlines: FloatArray, gap: FloatArray
) -> FloatArray:
    """Probability that the fingers of both sides meet what is between them, (k,).

    Parameters
    ----------
    extents, outlines
        See `NearPads.extents`.
    gap
        That closed fingers leave [m], shape (k,).
    """
    thickness, least = extents.sum(axis=0), np.maximum(outlines.sum(axis=0), 0.0)
    wide = ndtr((thickness - gap) / ROOM_ERROR)
    wider = np.exp(np.minimum(least - gap, 0.0) / _HIDDEN)
    wide = np.where(np.isfinite(thickness), wide, wider)
    # What is thin fails for that, not for being off the middle, too.
    beside = 0.5 * np.minimum(gap, least) - np.minimum(extents, _FAR)
    met: FloatArray = wide * ndtr((_GIVES - beside) / _GIVES_ERROR).prod(axis=0)
    return met


@lru_cache(maxsize=64)
def _closed_gaps(gripper: GripperModel, preshape: str) -> FloatArray:
    """Gaps of a closed hand at `HEIGHTS` [m]; beyond its tips that of the tips."""
    closed = gripper.preshape(preshape).narrowest
    faces = gripper.inner_faces(preshape, closed, HEIGHTS)
    gaps: FloatArray = np.maximum(faces.sum(axis=0), 0.0)
    known = np.flatnonzero(np.isfinite(gaps))
    if not len(known):  # its sides pass each other: where is not told
        return np.zeros(len(gaps))
    gaps[known[-1] :] = gaps[known[-1]]
    return gaps


@lru_cache(maxsize=64)
def _leans(gripper: GripperModel, preshape: str) -> FloatArray:
    """Lean [rad] at `HEIGHTS` and `_RADII`; 0 if nothing is met, or the palm holds."""
    shape = gripper.preshape(preshape)
    closed = shape.narrowest
    reach = gripper.fingertip_reach(preshape, closed)
    heights = np.arange(_FINE, reach + _FINE, _FINE)
    half = np.array(
        [
            gripper.inner_faces(preshape, opening, heights).mean(axis=0)
            for opening in np.linspace(closed, shape.widest, _OPENINGS)
        ]
    )
    leans = np.zeros((len(HEIGHTS), len(_RADII)))
    for i, middle in enumerate(HEIGHTS):
        for j, radius in enumerate(_RADII):
            below = heights - middle
            is_level = np.abs(below) < radius
            if middle - radius < _ON_PALM or not is_level.any():
                continue
            below = below[is_level]
            spare = half[:, is_level] - np.sqrt(radius**2 - below**2)
            fits = np.flatnonzero(spare.min(axis=1) >= 0.0)
            if len(fits) and fits[0] > 0:  # closed further, they touch it
                touched = below[spare[fits[0]].argmin()]
                leans[i, j] = np.arcsin(max(touched, 0.0) / radius)
    return leans
