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
    row, column = np.divmod(cloud.pixels, cloud.image_shape[1])
    own = labels > 0
    if not own.any():
        return np.zeros(n)
    # Nothing is in front of an object far from all of them.
    low = [max(int(axis[own].min()) - _BRIDGE, 0) for axis in (row, column)]
    high = [int(axis[own].max()) + _BRIDGE + 1 for axis in (row, column)]
    shape = high[0] - low[0], high[1] - low[1]
    image = np.zeros(shape, dtype=np.int32)
    away = np.full(shape, np.inf, dtype=np.float32)
    place = row[own] - low[0], column[own] - low[1]
    image[place] = labels[own]
    offset = np.take(cloud.points, np.flatnonzero(own), axis=0) - cloud.viewpoint
    away[place] = np.sqrt(np.einsum("ij,ij->i", offset, offset))
    outline, hidden = np.zeros(n + 1), np.zeros(n + 1)
    for axis in (0, 1):
        first = np.moveaxis(image, axis, 0)
        range_ = np.moveaxis(away, axis, 0)
        here, there = slice(_BRIDGE, None), slice(None, -_BRIDGE)
        for a, b in ((here, there), (there, here)):
            at = np.nonzero((first[a] > 0) & (first[a] != first[b]))
            inside, beyond = first[a][at], first[b][at]
            outline += np.bincount(inside, minlength=n + 1)
            before = (beyond > 0) & (range_[b][at] < range_[a][at] - _STEP)
            hidden += np.bincount(inside, before, n + 1)
    shares: FloatArray = hidden[1:] / np.maximum(outline[1:], 1.0)
    return shares
