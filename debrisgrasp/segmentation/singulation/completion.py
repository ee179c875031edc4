"""Joining what an occluder divides: surfaces that go on behind it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import BoolArray, Float32Array, FloatArray, IntArray

from .camera import InverseDepthImage
from .pieces import Shapes
from .planes import PlanarPatches

__all__ = ["CompletionConfig", "continued_planes"]

_SAMPLES = 32
"""Places at which the straight line between two regions is inspected."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CompletionConfig:
    """When two visible parts go on behind what hides the space between them.

    Wider limits complete more and join more that only happens to be in line.
    """

    max_angle: float = float(np.deg2rad(11))
    """Between the planes [rad]."""
    max_offset: float = 0.012
    """Of the middle of one part from the plane of the other [m]; 2 % of the distance
    between the middles come on top."""
    hidden_share: float = 0.85
    """Least share of the line between the parts that is hidden by something nearer, or
    was not measured."""
    min_pixels: int = 150
    """Smaller patches don't determine a plane well enough."""


def continued_planes(
    image: InverseDepthImage,
    patches: PlanarPatches,
    piece: IntArray,
    shapes: Shapes,
    config: CompletionConfig,
) -> IntArray:
    """Pairs of pieces with coplanar patches and nothing seen between these, (k, 2).

    Parameters
    ----------
    piece
        Piece of each patch, shape (p,).
    shapes
        Shapes of the patches.
    """
    large = np.flatnonzero(shapes.size >= config.min_pixels)
    a, b = (large[k] for k in np.triu_indices(len(large), 1))
    normals = patches.planes / np.linalg.norm(patches.planes, axis=1, keepdims=True)
    cosine = np.einsum("ij,ij->i", normals[a], normals[b])
    fits = (piece[a] != piece[b]) & (cosine > np.cos(config.max_angle))
    a, b = a[fits], b[fits]
    middle = patches.moments[:, 1:4] / patches.moments[:, :1]
    place = np.concatenate([middle[:, :2], np.ones((len(middle), 1))], axis=1)
    place /= middle[:, 2:3]
    height = 1.0 / np.linalg.norm(patches.planes, axis=1)
    distance = np.linalg.norm(place[b] - place[a], axis=1)
    offset = np.maximum(
        np.abs(np.einsum("ij,ij->i", normals[a], place[b]) - height[a]),
        np.abs(np.einsum("ij,ij->i", normals[b], place[a]) - height[b]),
    )
    fits = offset < config.max_offset + 0.02 * distance
    fits &= _in_line(shapes, a, b)
    fits &= distance < 1.5 * (shapes.length[a] + shapes.length[b])
    a, b = a[fits], b[fits]
    row, column = _line(shapes.center[a], shapes.center[b], image.values.shape)
    plane = 0.5 * (patches.planes[a] + patches.planes[b])[:, :, None]
    expected = (
        plane[:, 0] * image.x[row, column]
        + plane[:, 1] * image.y[row, column]
        + plane[:, 2]
    )
    there = np.append(piece, -1)[patches.labels[row, column]]
    ends = np.stack([piece[a], piece[b]], axis=1)
    hidden = _hidden_share(
        image.values[row, column], expected, patches.noise, there, ends
    )
    return ends[hidden >= config.hidden_share]


def _in_line(shapes: Shapes, a: IntArray, b: IntArray) -> BoolArray:
    """Whether long regions lie along each other's axis; short ones always do."""
    apart = shapes.center[b] - shapes.center[a]
    thickness = shapes.size / shapes.pixel_length
    is_long = shapes.pixel_length > 3 * thickness
    fits = np.ones(len(a), dtype=bool)
    for one in (a, b):
        along = shapes.direction[one]
        aside = np.abs(apart[:, 0] * along[:, 1] - apart[:, 1] * along[:, 0])
        fits &= ~is_long[one] | (aside < 0.35 * (thickness[a] + thickness[b]))
    return fits


def _line(
    start: FloatArray, stop: FloatArray, shape: tuple[int, ...]
) -> tuple[IntArray, IntArray]:
    """Rows and columns of pixels along lines (k, 2), each (k, samples)."""
    share = np.linspace(0, 1, _SAMPLES)[:, None]
    line = np.rint(start[:, None] * (1 - share) + stop[:, None] * share)
    row = np.clip(line[..., 0], 0, shape[0] - 1).astype(np.int64)
    column = np.clip(line[..., 1], 0, shape[1] - 1).astype(np.int64)
    return row, column


def _hidden_share(
    inverse: Float32Array,
    expected: FloatArray,
    noise: float,
    there: IntArray,
    ends: IntArray,
) -> FloatArray:
    """Share of the samples outside both pieces that can't be seen, shape (k,).

    Parameters
    ----------
    inverse, expected
        1/z as measured (0: unknown) and as it would be seen [1/m], shape (k, samples).
    there
        Piece at each sample, shape (k, samples).
    ends
        The two pieces, shape (k, 2).
    """
    outside = (there != ends[:, :1]) & (there != ends[:, 1:])
    # Nearer than expected by 1 cm, or by what noise can't do.
    margin = np.maximum(0.01 * expected**2, 2 * noise)
    unseen = outside & ((inverse == 0) | (inverse > expected + margin))
    n_outside = outside.sum(axis=1)
    return np.where(n_outside > 0, unseen.sum(axis=1) / np.maximum(n_outside, 1), 1.0)
