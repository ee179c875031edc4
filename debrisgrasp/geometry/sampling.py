"""Random rotations and poses, and directions spread evenly over the sphere."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import (
    FloatArray,
    Rng,
    as_floats,
    require_count,
    require_generator,
)
from debrisgrasp.errors import InputError, ShapeError

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

    Raises
    ------
    InputError
        If these are no poses, or a deviation is negative, not finite, or of a shape
        that theirs does not take.
    """
    require_generator(rng)
    if not isinstance(Ts, SE3):
        mend = "SE3.from_matrix(matrix) makes one."
        raise InputError("Ts", got=type(Ts).__name__, expected="an SE3", mend=mend)
    spread = _spread(position_sigma, "position_sigma", Ts.batch)
    shift = rng.standard_normal((*Ts.batch, 3)) * spread
    spread = _spread(rotation_sigma, "rotation_sigma", Ts.batch)
    turn = rng.standard_normal((*Ts.batch, 3)) * spread
    return SE3.from_parts(Ts.R @ so3.exp(turn), Ts.p + shift)


def _spread(sigma: ArrayLike, name: str, batch: tuple[int, ...]) -> FloatArray:
    """Give standard deviations of poses for each of their coordinates, (..., 1)."""
    sigma = as_floats(sigma, name, ())
    if not (np.isfinite(sigma) & (sigma >= 0)).all():
        raise InputError(name, got=sigma.tolist(), expected="finite, 0 or more")
    try:
        return np.broadcast_to(sigma, batch)[..., None]
    except ValueError as error:
        raise ShapeError(
            f"shape of {name}",
            got=sigma.shape,
            expected=f"one for all poses or {batch}",
        ) from error


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
