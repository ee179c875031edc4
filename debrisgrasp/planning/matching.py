"""What was measured next to the points of a prototype that is placed in a scene."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from debrisgrasp._arrays import BoolArray, Float32Array

from .scene import NEAREST_MASK, UNKNOWN_FLAG, GraspScene

__all__ = ["Match", "match_surface"]

_LEAST_EXPONENT = np.float32(-20.0)


class Match(NamedTuple):
    """Comparison of m points of each of k poses with the scene, arrays (k, m)."""

    point: tuple[Float32Array, Float32Array, Float32Array]
    """Coordinates x, y, z of the prototype's points, base frame [m]."""
    normal: tuple[Float32Array, Float32Array, Float32Array]
    """Normal of the measured point next to each, base frame, three of shape (k, m)."""
    along: Float32Array
    """Offset from that point along its normal [m]."""
    beside: Float32Array
    """Offset from it at right angles to the normal [m]."""
    cosine: Float32Array
    """Of the angle between the normals of both, shape (k, m)."""
    is_target: Float32Array
    """1 where the measured point belongs to the object, else 0, shape (k, m)."""
    is_known: BoolArray
    """Whether the camera saw this place, or through it, shape (k, m)."""

    def kernel(self, sigma: float, normal_sigma: float, gate: float) -> Float32Array:
        """Likeness of every point in [0, 1], zero off the object, shape (k, m).

        Parameters
        ----------
        sigma
            Width in distance [m].
        normal_sigma
            Width in the angle between the normals [rad].
        gate
            Offset beside the measured point that costs nothing [m].
        """
        excess = np.maximum(self.beside - np.float32(gate), 0)
        exponent = self.along * self.along
        exponent += excess * excess
        exponent *= np.float32(-0.5 / sigma**2)
        # 1 - cos approximates half the squared angle, so this is a Gaussian in both.
        exponent -= (1 - self.cosine) * np.float32(1.0 / normal_sigma**2)
        value: Float32Array = np.exp(np.maximum(exponent, _LEAST_EXPONENT))
        value *= self.is_target
        return value


def match_surface(
    scene: GraspScene, surface: Float32Array, R: Float32Array, t: Float32Array
) -> Match:
    """Look up what was measured next to each point.

    Parameters
    ----------
    surface
        Coordinates [m], then normals, of the points of each pose, hand frame, shape
        (k, 6, m).
    R, t
        Rotations (k, 3, 3) and positions [m] (k, 3) of the hand.
    """
    points, normals = R @ surface[:, :3], R @ surface[:, 3:]
    x, y, z = (points[:, i] + t[:, i, None] for i in range(3))
    nx, ny, nz = (normals[:, i] for i in range(3))
    code = scene.nearest.take(scene.field.cell(x, y, z))
    # take() copies whole rows, which indexing does element by element.
    row = scene.table.take(code & NEAREST_MASK, axis=0)
    px, py, pz, sx, sy, sz, is_target = (row[..., i] for i in range(7))
    dx, dy, dz = x - px, y - py, z - pz
    along = dx * sx + dy * sy + dz * sz
    beside2 = dx * dx + dy * dy + dz * dz - along * along
    return Match(
        point=(x, y, z),
        normal=(sx, sy, sz),
        along=along,
        beside=np.sqrt(np.maximum(beside2, 0)),
        cosine=nx * sx + ny * sy + nz * sz,
        is_target=is_target,
        is_known=(code & UNKNOWN_FLAG) == 0,
    )
