"""How much of each object's outline is cut off by something in front of it."""

from __future__ import annotations

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray
from debrisgrasp.geometry import PointCloud

__all__ = ["occluded_shares"]

_BRIDGE = 4
"""Distance across an outline [pixels]: stereo cameras lose pixels along edges."""
_STEP = 0.02
"""Something is in front if it is this much nearer [m]."""


def occluded_shares(cloud: PointCloud, labels: IntArray, n: int) -> FloatArray:
    """Share of the outline of each object at which another one is in front.

    What is seen whole lies before everything else, and mostly on top.

    Parameters
    ----------
    cloud, labels
        Points, and one label for each, shape (n_points,); 0 is no object.
    n
        How many objects there are.

    Returns
    -------
    FloatArray
        In [0, 1], shape (n,); zero for clouds without an image.
    """
    if cloud.pixels is None or cloud.image_shape is None:
        return np.zeros(n)
    own = np.flatnonzero(labels > 0)
    if not len(own):
        return np.zeros(n)
    row, column = np.divmod(cloud.pixels[own], cloud.image_shape[1])
    # Nothing is in front of an object far from all of them.
    low = row.min() - _BRIDGE, column.min() - _BRIDGE
    height, width = (
        row.max() + _BRIDGE + 1 - low[0],
        column.max() + _BRIDGE + 1 - low[1],
    )
    image = np.zeros((height, width), dtype=np.int64)
    # What is left of the image or above it is not known.
    image[: max(-low[0], 0)] = image[:, : max(-low[1], 0)] = -1
    place = (row - low[0]) * width + column - low[1]
    inside = labels[own].astype(np.int64)
    offset = cloud.points.take(own, axis=0) - cloud.viewpoint
    range_ = np.sqrt(np.einsum("ij,ij->i", offset, offset)).astype(np.float32)
    away = np.empty(height * width, dtype=np.float32)
    image.ravel()[place], away[place] = inside, range_
    outline, hidden = np.zeros(n + 1), np.zeros(n + 1)
    for step in (width, -width, 1, -1):
        there = place + step * _BRIDGE
        beyond = image.take(there)
        at = np.flatnonzero((beyond != inside) & (beyond >= 0))
        outline += np.bincount(inside[at], minlength=n + 1)
        at = at[beyond[at] > 0]
        at = at[away.take(there[at]) < range_[at] - _STEP]
        hidden += np.bincount(inside[at], minlength=n + 1)
    shares: FloatArray = hidden[1:] / np.maximum(outline[1:], 1.0)
    return shares
