"""From cells back to pixels: at borders each pixel chooses the surface it lies on."""

from __future__ import annotations

import numpy as np

from debrisgrasp._arrays import IntArray

from .camera import InverseDepthImage
from .cells import CellImage
from .patches import PlanarPatches

__all__ = ["pixel_patches"]

_STRAY = 4.0
"""Pixels farther than so many steps from every surface belong to none."""


def pixel_patches(
    image: InverseDepthImage,
    cells: CellImage,
    patches: PlanarPatches,
    pixels: IntArray,
    max_gap: float,
) -> IntArray:
    """Patch of each pixel, -1 where none fits, shape (k,).

    Parameters
    ----------
    pixels
        Flat indices of measured pixels, shape (k,).
    max_gap
        Step of 1/z between the pixels of one surface [1/m].
    """
    labels = patches.labels
    height, width = labels.shape
    row, column = np.divmod(pixels.astype(np.int32), np.int32(image.values.shape[1]))
    around = np.full((height + 2, width + 2), -1, dtype=np.int32)
    around[1:-1, 1:-1] = labels
    is_border = np.zeros(labels.shape, dtype=bool)
    for i, j in ((0, 1), (2, 1), (1, 0), (1, 2)):
        is_border |= around[i : i + height, j : j + width] != labels
    cell = row // cells.edge * np.int32(width) + column // cells.edge
    patch: IntArray = np.maximum(labels.ravel()[cell], -1)
    at = np.flatnonzero(is_border.ravel()[cell])
    d = image.values.ravel()[pixels[at]]
    x, y = image.x[0, column[at]], image.y[row[at], 0]
    a, b, c = patches.planes.astype(np.float32)
    own = patch[at]
    place = cell[at] // width * 2 + cell[at] + width + 3
    choice = own.copy()
    best = np.full(len(at), np.inf, dtype=np.float32)
    # The cell speaks for its pixels unless another surface is clearly nearer.
    lead = np.float32(0.5 * cells.noise)
    for shift in (0, -1, 1, -(width + 2), width + 2):
        other = around.ravel()[place + shift]
        sel = np.flatnonzero((other >= 0) & ((other != own) | (shift == 0)))
        k = other[sel]
        offer = np.abs(d[sel] - (a[k] * x[sel] + b[k] * y[sel] + c[k]))
        offer -= lead if shift == 0 else np.float32(0)
        better = offer < best[sel]
        sel = sel[better]
        best[sel] = offer[better]
        choice[sel] = other[sel]
    choice[best > _STRAY * max_gap] = -1
    patch[at] = choice
    return patch
