"""Joining what is seen through an opening of the same object: insides, back sides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray

from .joining import Borders
from .planes import PlanarPatches
from .regions import Crossings, linked, no_pairs

__all__ = ["EnclosureConfig", "enclosed", "lined"]


@dataclass(frozen=True, slots=True, kw_only=True)
class EnclosureConfig:
    """When pieces are the inside of what surrounds them."""

    min_share: float = 0.55
    """Least share of the outline of the inside that borders on the one piece around;
    smaller takes what merely lies behind for the inside."""
    max_front: float = 0.05
    """Share of that border at which the inside may be nearer to the camera: a thing
    that lies in a bucket hides a part of it."""
    max_depth: float = 0.15
    """Largest mean distance of the inside behind the border [m]."""
    max_area: float = 0.5
    """Of the inside, in areas of what is around it; larger also takes heaps of other
    things that lie behind."""
    min_around: int = 500
    """Pixels of the smallest piece that encloses others."""
    max_wall_tilt: float = float(np.deg2rad(7))
    """Between far and near walls of a box [rad]."""
    min_wall: int = 150
    """Pixels of the smallest wall."""
    min_rim: float = 0.4
    """Least length along which near walls hide a far one, in roots of its area."""


def enclosed(
    crossings: Crossings, size: FloatArray, noise: float, config: EnclosureConfig
) -> IntArray:
    """Pairs (inside, around) of pieces, (k, 2).

    The floor of a bucket, the far wall of a hole in a block or the lower deck of a
    pallet are bounded by their own object almost all round, and are nowhere in front
    of it.
    Pieces that touch in the image are judged together.

    Parameters
    ----------
    crossings
        All borders between pieces in the image.
    size
        Pixels of each piece, shape (r,).
    noise
        Standard deviation of 1/z [1/m].
    """
    n = len(size)
    inside, around, length, front, depth = _outlines(crossings, n, noise)
    pairs = [no_pairs()]
    for host in np.flatnonzero(size >= config.min_around):
        to_host = around == host
        if not to_host.any():
            continue
        # Without the host, what hangs together is inside or outside as a whole.
        others = (inside != host) & ~to_host & (around >= 0)
        group = linked(np.stack([inside[others], around[others]], axis=1), n)
        own = group[inside]
        shared = np.bincount(own[to_host], weights=length[to_host], minlength=n)
        open_to = to_host | (around < 0)
        outline = np.bincount(own[open_to], weights=length[open_to], minlength=n)
        in_front = np.bincount(own[to_host], weights=front[to_host], minlength=n)
        behind = np.bincount(own[to_host], weights=depth[to_host], minlength=n)
        fits = (shared > config.min_share * outline) & (shared > 0)
        fits &= in_front < config.max_front * shared
        fits &= behind < config.max_depth * shared
        fits &= np.bincount(group, size, n) < config.max_area * size[host]
        members = np.flatnonzero(fits[group] & (size > 0))
        members = members[members != host]
        pairs.append(np.stack([members, np.full(len(members), host)], axis=1))
    return np.concatenate(pairs)


def _outlines(
    crossings: Crossings, n_pieces: int, noise: float
) -> tuple[IntArray, IntArray, FloatArray, FloatArray, FloatArray]:
    """Outlines of pieces by what lies on their other side.

    Returns
    -------
    inside, around
        The piece, and the one on the other side or -1 for none, shape (k,).
    length
        Pixels of the border.
    front
        Of these, pixels where ``inside`` is nearer to the camera.
    depth
        Sum over the pixels of the distance of ``inside`` behind ``around`` [m].
    """
    n = n_pieces + 1
    near, far = crossings.near.astype(np.float64), crossings.far.astype(np.float64)
    is_known = crossings.second >= 0
    is_front = is_known & (near > far + np.maximum(2 * noise, 0.01 * far**2))
    behind = np.where(is_known, 1.0 / near - 1.0 / np.where(is_known, far, 1.0), 0.0)
    unique, index = np.unique(
        crossings.first * n + crossings.second + 1, return_inverse=True
    )
    inside, around = np.divmod(unique, n)
    sums = [
        np.bincount(index, values, len(unique)).astype(np.float64)
        for values in (np.ones(len(index)), is_front.astype(np.float64), behind)
    ]
    return inside, around - 1, sums[0], sums[1], sums[2]


def lined(
    patches: PlanarPatches,
    borders: Borders,
    piece: IntArray,
    crossings: Crossings,
    config: EnclosureConfig,
) -> IntArray:
    """Pairs (inside, outside) of pieces for the walls of open boxes, (k, 2).

    Over the near walls of a box its far walls are seen from within: they meet at a
    concave crease, both are hidden in part by the near walls, and each is parallel to
    one of these.

    Parameters
    ----------
    piece
        Piece of each patch, shape (p,).
    crossings
        All borders between patches in the image.
    """
    size = patches.moments[:, 0]
    normals = patches.planes / np.linalg.norm(patches.planes, axis=1, keepdims=True)
    is_crease = (borders.opening < 0) & (borders.angle > np.deg2rad(50))
    is_crease &= (size[borders.edges] >= config.min_wall).all(axis=1)
    is_crease &= borders.length >= 4
    near, far = _hiding(patches, piece, crossings, config.min_rim)
    pairs = []
    for i, j in borders.edges[is_crease]:
        for outside in np.intersect1d(near[far == i], near[far == j]):
            walls = (piece == outside) & (size >= config.min_wall)
            aligned = np.abs(normals[walls] @ normals[[i, j]].T) > np.cos(
                config.max_wall_tilt
            )
            if outside not in piece[[i, j]] and aligned.any(axis=0).all():
                pairs += [(piece[i], outside), (piece[j], outside)]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _hiding(
    patches: PlanarPatches, piece: IntArray, crossings: Crossings, min_rim: float
) -> tuple[IntArray, IntArray]:
    """Pieces that hide a good part of the outline of patches, and these, both (k,)."""
    n = len(patches)
    far = crossings.far
    hides = crossings.near > far + np.maximum(4 * patches.noise, 0.02 * far**2)
    hides &= crossings.second >= 0
    keys, length = np.unique(
        piece[crossings.first[hides]] * np.int64(n) + crossings.second[hides],
        return_counts=True,
    )
    near_piece, hidden = np.divmod(keys, n)
    enough = length >= min_rim * np.sqrt(patches.moments[hidden, 0])
    return near_piece[enough], hidden[enough]
