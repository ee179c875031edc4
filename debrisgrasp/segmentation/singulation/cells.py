"""An inverse depth image at the resolution at which surfaces are told apart.

Noise of stereo cameras is correlated over two to four pixels, so cells of 2 x 2 pixels
hold nearly all that 640 x 480 pixels tell, at a quarter of the cost.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import BoolArray, Float32Array, FloatArray, IntArray

from .camera import InverseDepthImage

__all__ = ["CellImage", "cell_image", "noise_of"]

_ROUGHNESS = 4e-4
"""Noise that even smooth surfaces have [1/m]: about 1 mm at 1.5 m."""
_CELLS_ACROSS = 320
"""Pixels are averaged two by two until no more than about so many span the image."""


@dataclass(frozen=True, slots=True, eq=False)
class CellImage:
    """Inverse depth on cells of 2^k x 2^k pixels."""

    values: Float32Array
    """1/z of the nearest surface in each cell [1/m], 0 if none, shape (h, w)."""
    standing: BoolArray
    """Cells with a candidate point in them, shape (h, w)."""
    x: Float32Array
    """X/Z of the columns of cells, shape (w,)."""
    y: Float32Array
    """Y/Z of the rows of cells, shape (h,)."""
    focal: float
    """Cells per unit of x and y."""
    edge: int
    """Edge of a cell [pixels]."""
    noise: float
    """Standard deviation of 1/z [1/m]."""
    up: FloatArray
    """Direction of z of the base in the camera frame, shape (3,)."""

    def means(self, pixels: IntArray, width: int, values: FloatArray) -> FloatArray:
        """Mean of values (k, c) at pixels of an image in each cell, shape (h, w, c).

        Parameters
        ----------
        pixels
            Flat indices in an image ``width`` pixels wide, shape (k,).
        """
        row, column = np.divmod(pixels, width)
        cell = row // self.edge * self.values.shape[1] + column // self.edge
        size = self.values.size
        count = np.maximum(np.bincount(cell, minlength=size), 1)
        means = [np.bincount(cell, v, size) / count for v in values.T]
        return np.stack(means, axis=1).reshape(*self.values.shape, -1)


def cell_image(image: InverseDepthImage, mask: BoolArray, max_gap: float) -> CellImage:
    """Average pixels to cells, each over one surface.

    Parameters
    ----------
    mask
        Candidate pixels, shape (height, width). A cell that has any takes its value
        from them alone.
    max_gap
        Difference in 1/z [1/m] beyond which pixels of a cell are of two surfaces.
    """
    values, standing = image.values, mask
    x, y = image.x[0], image.y[:, 0]
    edge = 1
    while values.shape[1] >= 1.5 * _CELLS_ACROSS:
        values, standing = _halved(values, standing, np.float32(max_gap))
        x, y = _halved_axis(x), _halved_axis(y)
        edge *= 2
    return CellImage(
        values=values,
        standing=standing,
        x=x,
        y=y,
        focal=image.focal / edge,
        edge=edge,
        noise=noise_of(values, max(1, 8 // edge)),
        up=image.R_base_camera[2],
    )


def _halved_axis(values: Float32Array) -> Float32Array:
    if len(values) % 2:
        values = np.append(values, 2 * values[-1] - values[-2])
    middle: Float32Array = 0.5 * (values[::2] + values[1::2])
    return middle


def _halved(
    values: Float32Array, standing: BoolArray, max_gap: np.float32
) -> tuple[Float32Array, BoolArray]:
    height, width = values.shape
    if height % 2 or width % 2:
        pad = ((0, height % 2), (0, width % 2))
        values, standing = np.pad(values, pad), np.pad(standing, pad)
    corners = [
        np.ascontiguousarray(a[i::2, j::2])
        for a in (values, values * standing)
        for i in (0, 1)
        for j in (0, 1)
    ]
    everything, chosen = corners[:4], corners[4:]
    nearest = _largest(chosen)
    floor = nearest - max_gap
    others = [np.where(c < floor, c, np.float32(0)) for c in chosen]
    behind = _largest(others)
    # A single pixel in front of several others is most often a flying one.
    support = sum((c >= floor).astype(np.int8) for c in chosen)
    support_behind = sum((c > behind - max_gap).astype(np.int8) for c in others)
    is_stray = (behind > 0) & (support == 1) & (support_behind > 1)
    top = np.where(is_stray, behind, nearest)
    floor = np.maximum(top - max_gap, np.float32(1e-6))
    total = np.zeros_like(top)
    count = np.zeros_like(top)
    for corner in chosen:
        belongs = (corner >= floor) & (corner <= top)
        total += np.where(belongs, corner, np.float32(0))
        count += belongs
    is_standing = nearest > 0
    mean = total / np.maximum(count, 1)
    return np.where(is_standing, mean, _largest(everything)), is_standing


def _largest(images: list[Float32Array]) -> Float32Array:
    return np.maximum(
        np.maximum(images[0], images[1]), np.maximum(images[2], images[3])
    )


def noise_of(values: Float32Array, apart: int) -> float:
    """Estimate the standard deviation of 1/z over smooth places [1/m].

    From second differences over ``apart`` cells along rows and along columns, since
    noise of close ones is correlated; some cameras make stripes, so that the larger of
    both counts. It is never less than the roughness of surfaces.
    """
    every = max(1, apart // 2)
    largest = _ROUGHNESS
    for image in (values[::every], values.T[::every]):
        left, middle = image[:, : -2 * apart], image[:, apart:-apart]
        right = image[:, 2 * apart :]
        second = np.abs(left - 2 * middle + right)
        second = second[(left > 0) & (middle > 0) & (right > 0)]
        if second.size:
            deviation = 1.4826 * float(np.median(second)) / 6**0.5
            largest = max(largest, deviation)
    return largest
