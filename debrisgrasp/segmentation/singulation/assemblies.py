"""Joining strips that are built together: planks of pallets, boards on legs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import BoolArray, IntArray

from .joining import Borders
from .pieces import Shapes
from .planes import PlanarPatches

__all__ = ["AssemblyConfig", "crossed_strips", "parallel_strips"]


@dataclass(frozen=True, slots=True, kw_only=True)
class AssemblyConfig:
    """When strips belong to one thing that somebody built.

    What fell on a heap crosses at any angle; what was nailed together, at a right one.
    Wider limits join more of both.
    """

    max_tilt: float = float(np.deg2rad(9))
    """Between the planes of crossed strips [rad]."""
    max_skew: float = float(np.deg2rad(8))
    """Between the axes of crossed strips and a right angle [rad]."""
    max_rise: float = 0.045
    """Of one crossed strip over the other [m]: the thickness of a board."""
    max_parallel_tilt: float = float(np.deg2rad(4))
    """Between the planes of parallel strips [rad]."""
    max_parallel_skew: float = float(np.deg2rad(5))
    """Between the axes of parallel strips [rad]."""
    max_parallel_rise: float = 0.01
    """Between the planes of parallel strips [m]; 1 % of the distance comes on top."""
    max_ratio: float = 1.5
    """Between the widths of parallel strips."""
    max_spacing: float = 2.6
    """Between the middle lines of parallel strips, in widths."""
    min_pixels: int = 100
    """Smaller regions are no strips."""


def _strips(shapes: Shapes, config: AssemblyConfig) -> BoolArray:
    return (shapes.length > 2.5 * shapes.width) & (shapes.size >= config.min_pixels)


def crossed_strips(
    borders: Borders, ends: IntArray, shapes: Shapes, config: AssemblyConfig
) -> IntArray:
    """Pairs of regions that lie flat on each other at right angles, (k, 2).

    Parameters
    ----------
    borders
        Borders of patches.
    ends
        The two regions whose patches meet at each border, shape (e, 2).
    shapes
        Shapes of the regions.
    """
    a, b = ends.T
    is_strip = _strips(shapes, config)
    cosine = np.abs(np.einsum("ij,ij->i", shapes.axes[a], shapes.axes[b]))
    fits = (a != b) & is_strip[a] & is_strip[b]
    fits &= (borders.angle < config.max_tilt) & (borders.step < config.max_rise)
    fits &= (cosine < np.sin(config.max_skew)) & (borders.length >= 4)
    pairs: IntArray = ends[fits]
    return pairs


def parallel_strips(
    patches: PlanarPatches, shapes: Shapes, config: AssemblyConfig
) -> IntArray:
    """Pairs of coplanar parallel patches of one width, side by side, (k, 2)."""
    strips = np.flatnonzero(_strips(shapes, config))
    a, b = (strips[k] for k in np.triu_indices(len(strips), 1))
    scale = np.linalg.norm(patches.planes, axis=1)
    normals, height = patches.planes / scale[:, None], 1.0 / scale
    middle = shapes.ends.mean(axis=1)
    apart = middle[b] - middle[a]
    along = np.abs(np.einsum("ij,ij->i", apart, shapes.axes[a]))
    across = np.sqrt(np.maximum(np.square(apart).sum(axis=1) - along**2, 0))
    rise = np.maximum(
        np.abs(np.einsum("ij,ij->i", normals[a], middle[b]) - height[a]),
        np.abs(np.einsum("ij,ij->i", normals[b], middle[a]) - height[b]),
    )
    wider = np.maximum(shapes.width[a], shapes.width[b])
    narrower = np.minimum(shapes.width[a], shapes.width[b])
    longer = np.maximum(shapes.length[a], shapes.length[b])
    tilt = np.einsum("ij,ij->i", normals[a], normals[b])
    skew = np.abs(np.einsum("ij,ij->i", shapes.axes[a], shapes.axes[b]))
    fits = tilt > np.cos(config.max_parallel_tilt)
    fits &= skew > np.cos(config.max_parallel_skew)
    fits &= rise < config.max_parallel_rise + 0.01 * across
    fits &= wider < config.max_ratio * narrower
    fits &= across < config.max_spacing * wider
    fits &= along < 0.5 * longer
    return np.stack([a[fits], b[fits]], axis=1)
