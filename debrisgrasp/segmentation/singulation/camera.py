"""The pinhole camera behind an organised cloud, found from the cloud itself.

A cloud keeps the pixel of each of its points and the viewpoint, whatever frame it was
moved to. That determines camera and pose: p - viewpoint = z M (u, v, 1) with
M = R inv(K), which is linear in M up to scale.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import Float32Array, FloatArray
from debrisgrasp.geometry import PointCloud

__all__ = ["InverseDepthImage", "inverse_depth_image"]

_MAX_RESIDUAL = 1e-3
"""Largest angle [rad] between rays of the fitted camera and those of the cloud."""
_N_SAMPLES = 2000
"""Points that the camera is fitted to."""


@dataclass(frozen=True, slots=True, eq=False)
class InverseDepthImage:
    """Depth as 1/z, in which planes are linear and stereo noise is constant.

    A plane n . X = h of the camera frame is 1/z = a x + b y + c in the normalised image
    coordinates x = X/Z, y = Y/Z, with (a, b, c) = n / h.
    """

    values: Float32Array
    """1/z [1/m], shape (height, width); 0 where nothing was measured."""
    x: Float32Array
    """X/Z of each pixel, shape (height, width)."""
    y: Float32Array
    """Y/Z of each pixel, shape (height, width)."""
    R_base_camera: FloatArray
    """Axes of the camera (x right, y down, z forward) as columns, shape (3, 3)."""
    focal: float
    """Pixels per unit of x and y."""


def inverse_depth_image(cloud: PointCloud) -> InverseDepthImage | None:
    """Lay an organised cloud out as an image; None if no pinhole camera fits it."""
    if cloud.pixels is None or cloud.image_shape is None or len(cloud) < 50:
        return None
    height, width = cloud.image_shape
    M = _fitted_camera(cloud, (height, width))
    if M is None:
        return None
    # z = r3 . (p - viewpoint), and r3 is the last row of K inv(R) = inv(M).
    inverse = np.linalg.inv(M)
    scale = np.linalg.norm(inverse[2])
    forward = inverse[2] / scale
    z = cloud.points @ forward - cloud.viewpoint @ forward
    if z.min() <= 0:
        return None
    right = inverse[0] / scale - (inverse[0] / scale @ forward) * forward
    fx = float(np.linalg.norm(right))
    right /= fx
    down = np.cross(forward, right)
    K = inverse / scale @ np.stack([right, down, forward], axis=1)
    values = np.zeros(height * width, dtype=np.float32)
    values[cloud.pixels] = 1.0 / z
    if abs(K[0, 1]) > _MAX_RESIDUAL * fx:
        return None
    x = (np.arange(width) - K[0, 2]) / K[0, 0]
    y = (np.arange(height) - K[1, 2]) / K[1, 1]
    return InverseDepthImage(
        values=values.reshape(height, width),
        x=np.broadcast_to(x.astype(np.float32), (height, width)),
        y=np.broadcast_to(y.astype(np.float32)[:, None], (height, width)),
        R_base_camera=np.stack([right, down, forward], axis=1),
        focal=0.5 * (fx + abs(float(K[1, 1]))),
    )


def _fitted_camera(cloud: PointCloud, shape: tuple[int, int]) -> FloatArray | None:
    """M (3, 3) with rays along M (u, v, 1), or None if there is no such matrix."""
    pixels = np.asarray(cloud.pixels)
    # A coarse lattice of pixels, so that the order of the points doesn't matter.
    number = np.full(shape, -1, dtype=np.int32)
    number.ravel()[pixels] = np.arange(len(pixels), dtype=np.int32)
    step = max(1, int(np.sqrt(len(pixels) / _N_SAMPLES)))
    lattice = number[::step, ::step]
    chosen = lattice[lattice >= 0]
    if len(chosen) < 10:
        return None
    row, column = np.divmod(pixels[chosen], shape[1])
    direction = cloud.points[chosen] - cloud.viewpoint
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    # Centred and scaled pixel coordinates keep the system well conditioned.
    size = max(shape)
    normalise = np.array(
        [[2 / size, 0, -shape[1] / size], [0, 2 / size, -shape[0] / size], [0, 0, 1]]
    )
    pixel = np.stack([column, row, np.ones(len(chosen))], axis=1)
    h = pixel @ normalise.T
    x, y, z = direction.T
    zero = np.zeros_like(h)
    system = np.concatenate(
        [
            np.concatenate([zero, -z[:, None] * h, y[:, None] * h], axis=1),
            np.concatenate([z[:, None] * h, zero, -x[:, None] * h], axis=1),
            np.concatenate([-y[:, None] * h, x[:, None] * h, zero], axis=1),
        ]
    )
    values, vectors = np.linalg.eigh(system.T @ system)
    # Two small eigenvalues: the pixels lie on a line and leave the camera open.
    if values[1] < 1e-6 * values[-1]:
        return None
    M = vectors[:, 0].reshape(3, 3)
    predicted = h @ M.T
    predicted /= np.linalg.norm(predicted, axis=1, keepdims=True)
    if np.mean(np.einsum("ij,ij->i", predicted, direction)) < 0:
        M, predicted = -M, -predicted
    sine = np.linalg.norm(np.cross(predicted, direction), axis=1)
    if np.median(sine) > _MAX_RESIDUAL:
        return None
    camera: FloatArray = M @ normalise
    return camera
