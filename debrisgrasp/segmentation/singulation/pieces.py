"""Sizes, directions and places of regions of an inverse depth image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from debrisgrasp._arrays import FloatArray, IntArray

from .camera import InverseDepthImage

__all__ = ["Shapes", "shapes_of"]


@dataclass(frozen=True, slots=True, eq=False)
class Shapes:
    """What regions look like in the image and in the camera frame."""

    size: FloatArray
    """Pixels, shape (r,)."""
    center: FloatArray
    """Mean row and column [pixels], shape (r, 2)."""
    direction: FloatArray
    """Long axis in the image (row, column), unit, shape (r, 2)."""
    pixel_length: FloatArray
    """Extent along the long axis [pixels], shape (r,)."""
    length: FloatArray
    """Distance between the ends in space [m], shape (r,)."""
    width: FloatArray
    """Area over length, seen from the camera [m], shape (r,)."""
    axes: FloatArray
    """Unit long axis in the camera frame, shape (r, 3); zero for single pixels."""
    ends: FloatArray
    """Places at both ends of the long axis, camera frame [m], shape (r, 2, 3)."""
    end_pixels: FloatArray
    """The same in the image (row, column), shape (r, 2, 2)."""


def shapes_of(image: InverseDepthImage, labels: IntArray, n_regions: int) -> Shapes:
    """Measure the regions 0, 1, ... of a label image (-1: none); none is empty."""
    row, column = np.nonzero(labels >= 0)
    own = labels[row, column]
    inverse = image.values[row, column]

    def mean(values: NDArray[Any]) -> FloatArray:
        return np.bincount(own, values, n_regions).astype(np.float64) / size

    size = np.bincount(own, minlength=n_regions).astype(np.float64)
    center = np.stack([mean(row), mean(column)], axis=1)
    i, j = row - center[own, 0], column - center[own, 1]
    angle = 0.5 * np.arctan2(2 * mean(i * j), mean(i * i) - mean(j * j))
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    along = i * direction[own, 0] + j * direction[own, 1]
    order = np.argsort(own, kind="stable")
    starts = np.concatenate([[0], np.cumsum(size)[:-1]]).astype(np.int64)
    lower = np.minimum.reduceat(along[order], starts)
    upper = np.maximum.reduceat(along[order], starts)
    pixel_length = upper - lower + 1
    # The mean over the outer tenth is an end that single pixels don't move.
    ends = np.empty((n_regions, 2, 3))
    end_pixels = np.empty((n_regions, 2, 2))
    rim = 0.1 * pixel_length + 0.5
    x, y = image.x[row, column] / inverse, image.y[row, column] / inverse
    for side, at_end in enumerate(
        (along < (lower + rim)[own], along > (upper - rim)[own])
    ):
        count = np.bincount(own[at_end], minlength=n_regions)
        for axis, values in enumerate((x, y, 1.0 / inverse)):
            ends[:, side, axis] = (
                np.bincount(own[at_end], weights=values[at_end], minlength=n_regions)
                / count
            )
        tip = lower if side == 0 else upper
        end_pixels[:, side] = center + tip[:, None] * direction
    # From the middles of the outer tenths to the tips.
    reach = (ends[:, 1] - ends[:, 0]) * (0.5 * 0.1 / 0.9)
    ends[:, 0] -= reach
    ends[:, 1] += reach
    between = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(between, axis=1)
    pixel_size = mean(1.0 / inverse) / image.focal
    return Shapes(
        size=size,
        center=center,
        direction=direction,
        pixel_length=pixel_length,
        length=np.maximum(length, pixel_size),
        width=size / pixel_length * pixel_size,
        axes=between / np.maximum(length, 1e-9)[:, None],
        ends=ends,
        end_pixels=end_pixels,
    )
