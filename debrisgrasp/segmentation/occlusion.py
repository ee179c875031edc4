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
    image = np.zeros(cloud.image_shape, dtype=np.int64)
    away = np.full(cloud.image_shape, np.inf)
    image.ravel()[cloud.pixels] = labels
    away.ravel()[cloud.pixels] = np.linalg.norm(cloud.points - cloud.viewpoint, axis=1)
    outline, hidden = np.zeros(n + 1), np.zeros(n + 1)
    for axis in (0, 1):
        first = np.moveaxis(image, axis, 0)
        range_ = np.moveaxis(away, axis, 0)
        here, there = slice(_BRIDGE, None), slice(None, -_BRIDGE)
        for a, b in ((here, there), (there, here)):
            own, other = first[a], first[b]
            at = np.nonzero((own > 0) & (own != other))
            outline += np.bincount(own[at], minlength=n + 1)
            before = (other[at] > 0) & (range_[b][at] < range_[a][at] - _STEP)
            hidden += np.bincount(own[at], before, n + 1)
    shares: FloatArray = hidden[1:] / np.maximum(outline[1:], 1.0)
    return shares
