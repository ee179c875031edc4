"""Random rotations and poses, and directions spread evenly over the sphere."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import FloatArray, Rng, require_count, require_generator

from . import so3
from .se3 import SE3

__all__ = ["fibonacci_sphere", "perturbed", "random_rotations"]


def random_rotations(n: int, *, rng: Rng) -> FloatArray:
    """Rotations distributed uniformly over SO(3), shape (n, 3, 3).

    A normal sample in four dimensions has no preferred direction, so that its direction
    is a uniform quaternion.
    """
    require_generator(rng)
    require_count("number of rotations", n)
    return so3.from_quat_wxyz(rng.standard_normal((n, 4)))


def perturbed(
    Ts: SE3, position_sigma: ArrayLike, rotation_sigma: ArrayLike, *, rng: Rng
) -> SE3:
    """Move every pose a little: its origin, and its axes about its own origin.

    Parameters
    ----------
    Ts
        Poses with any leading axes.
    position_sigma
        Standard deviation of each coordinate of the origin [m]; broadcasts against the
        leading axes.
    rotation_sigma
        Standard deviation of each component of the rotation vector [rad]; broadcasts
        likewise.
    """
    shift = rng.standard_normal((*Ts.batch, 3)) * np.asarray(position_sigma)[..., None]
    turn = rng.standard_normal((*Ts.batch, 3)) * np.asarray(rotation_sigma)[..., None]
    return SE3.from_parts(Ts.R @ so3.exp(turn), Ts.p + shift)


def fibonacci_sphere(n: int) -> FloatArray:
    """Spread unit vectors almost evenly over the sphere, shape (n, 3).

    Each owns the same area, ``4 pi / n``; the first lies near +z, the last near -z.
    """
    require_count("number of directions", n)
    index = np.arange(n)
    z = 1.0 - (2.0 * index + 1.0) / n
    rho = np.sqrt(1.0 - z * z)
    golden_angle = np.pi * (3.0 - np.sqrt(5.0))
    turn = golden_angle * index
    return np.stack([rho * np.cos(turn), rho * np.sin(turn), z], axis=-1)
