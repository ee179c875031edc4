"""Joining planar patches to pieces by what their whole shared border says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray

from .camera import InverseDepthImage
from .planes import PlanarPatches
from .regions import Crossings, linked, mutual_choices

__all__ = ["Borders", "joined", "patch_borders"]

_INSIDE = 4
"""How far inside a patch its bend against a neighbour is measured [pixels]."""


@dataclass(frozen=True, slots=True, eq=False)
class Borders:
    """The borders between patches that touch in the image and in depth."""

    edges: IntArray
    """Pairs of patches (a, b), a < b, ascending, shape (e, 2)."""
    length: FloatArray
    """Pairs of neighbouring pixels across each border, shape (e,)."""
    step: FloatArray
    """Mean distance between the two planes along the border [m], shape (e,)."""
    angle: FloatArray
    """Angle between the planes [rad], shape (e,)."""
    opening: FloatArray
    """How far the planes bend away from the camera [m]: positive if convex, (e,)."""
    depth: FloatArray
    """Mean distance z of the border from the camera [m], shape (e,)."""
    rise: FloatArray
    """Sine of the elevation of b over a, a little inside each, shape (e,)."""


def patch_borders(
    image: InverseDepthImage, patches: PlanarPatches, touching: Crossings
) -> Borders:
    """Measure the borders at which pixels of two patches touch."""
    # Every pair of pixels comes both ways; the first patch of an edge is the smaller.
    at = touching.selected(touching.first < touching.second)
    a, b = at.first, at.second
    planes = patches.planes
    unique, index = np.unique(a * len(patches) + b, return_inverse=True)
    edges = np.stack(np.divmod(unique, len(patches)), axis=1)

    def total(values: FloatArray) -> FloatArray:
        return np.bincount(index, values, len(unique)).astype(np.float64)

    length = total(np.ones(len(a)))
    inverse = 0.5 * (at.near + at.far).astype(np.float64)
    gap = planes[a] - planes[b]
    between = _at(image, gap, at.row, at.column)
    beyond = _at(image, gap, at.row + at.step[:, 0], at.column + at.step[:, 1])
    # Planes that cross between the two pixels meet there, however steep they are.
    apart = np.where(
        between * beyond > 0, np.minimum(np.abs(between), np.abs(beyond)), 0.0
    )
    # A little inside each patch the plane of the other passes in front if convex.
    opening, sides = np.zeros(len(a)), np.zeros(len(a))
    places = []
    for patch, other, reach, sign in ((a, b, -_INSIDE, -1), (b, a, _INSIDE + 1, 1)):
        row = np.clip(at.row + reach * at.step[:, 0], 0, image.values.shape[0] - 1)
        column = np.clip(
            at.column + reach * at.step[:, 1], 0, image.values.shape[1] - 1
        )
        inside = at.labels[row, column] == patch
        bend = _at(image, planes[other] - planes[patch], row, column)
        opening += np.where(inside, bend - sign * between, 0.0)
        sides += inside
        fit = np.where(inside, _at(image, planes[patch], row, column), inverse)
        fit = np.clip(fit, 0.5 * inverse, 2.0 * inverse)
        places.append(image.rays(row, column) / fit[:, None])
    upwards = places[1] - places[0]
    upwards /= np.maximum(np.linalg.norm(upwards, axis=1, keepdims=True), 1e-9)
    normals = planes / np.linalg.norm(planes, axis=1, keepdims=True)
    first, second = normals[edges[:, 0]], normals[edges[:, 1]]
    cross = np.linalg.norm(np.cross(first, second), axis=1)
    return Borders(
        edges=edges,
        length=length,
        step=total(apart / inverse**2) / length,
        angle=np.arctan2(cross, np.einsum("ij,ij->i", first, second)),
        opening=total(opening / inverse**2) / np.maximum(total(sides), 1),
        depth=total(1.0 / inverse) / length,
        rise=total(upwards @ image.R_base_camera[2]) / length,
    )


def _at(
    image: InverseDepthImage, planes: FloatArray, row: IntArray, column: IntArray
) -> FloatArray:
    """1/z of one plane (k, 3) per pixel, shape (k,)."""
    x, y = image.x[row, column], image.y[row, column]
    inverse: FloatArray = planes[:, 0] * x + planes[:, 1] * y + planes[:, 2]
    return inverse


def joined(
    patches: PlanarPatches,
    borders: Borders,
    *,
    max_step: float,
    max_concavity: float,
    min_contact: float,
    min_pixels: int,
) -> IntArray:
    """Piece of each patch, numbered from 0 without gaps, shape (p,).

    Every border votes with its length, for joining if it is smooth or convex and
    against it if it is concave or a step. Votes of all borders between two pieces are
    summed, and pieces merge along the best borders first.

    Parameters
    ----------
    max_step
        Between the planes along a border [m]; noise comes on top.
    max_concavity
        Angle below which a concave border still counts as smooth [rad].
    min_contact
        Least sum of votes, in roots of the smaller piece's area.
    min_pixels
        Smaller patches have no vote; they go to the neighbour they border on most.
    """
    size = patches.moments[:, 0]
    noise = patches.noise * borders.depth**2
    is_step = borders.step > max_step + noise
    is_concave = (borders.opening < 0) & (borders.angle > max_concavity)
    vote = np.where(is_step | is_concave, -1.0, 1.0)
    speaks = (size[borders.edges] >= min_pixels).all(axis=1)
    votes = (vote * borders.length)[speaks]
    piece = _agglomerated(borders.edges[speaks], votes, size, min_contact)
    return _absorbed(piece, borders, size, min_pixels)


def _agglomerated(
    edges: IntArray, votes: FloatArray, size: FloatArray, min_contact: float
) -> IntArray:
    """Merge in rounds while the votes between two pieces are for it."""
    piece: IntArray = np.arange(len(size))
    while len(edges):
        strength = votes / np.sqrt(size[edges].min(axis=1))
        chosen = mutual_choices(edges, -strength, size, -min_contact)
        if not len(chosen):
            break
        into = linked(chosen, len(size))
        piece = into[piece]
        n = int(into.max()) + 1
        size = np.bincount(into, size, n).astype(np.float64)
        ends = np.sort(into[edges], axis=1).astype(np.int64)
        apart = ends[:, 0] != ends[:, 1]
        keys, index = np.unique(ends[apart] @ [n, 1], return_inverse=True)
        votes = np.bincount(index, votes[apart], len(keys)).astype(np.float64)
        edges = np.stack(np.divmod(keys, n), axis=1)
    return piece


def _absorbed(
    piece: IntArray, borders: Borders, size: FloatArray, min_pixels: int
) -> IntArray:
    """Give crumbs to the piece they border on most, from outside in."""
    is_crumb = np.bincount(piece, weights=size)[piece] < min_pixels
    piece = piece.copy()
    ends = np.concatenate([borders.edges, borders.edges[:, ::-1]])
    # A border with a step of 5 mm counts half as much as one without.
    weight = np.tile(borders.length / (1.0 + borders.step / 0.005), 2)
    while True:
        asks = is_crumb[ends[:, 0]] & ~is_crumb[ends[:, 1]]
        if not asks.any():
            return np.unique(piece, return_inverse=True)[1]
        order = np.lexsort((ends[asks, 1], weight[asks], ends[asks, 0]))
        asking = ends[asks][order]
        last = np.flatnonzero(np.diff(asking[:, 0], append=-1))
        crumb, host = asking[last].T
        piece[crumb] = piece[host]
        is_crumb[crumb] = False
