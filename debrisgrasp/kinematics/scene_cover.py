"""How far the links of an arm stay from a scene: spheres, and finer ones in doubt."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import Solid

from .spheres import covering_spheres

__all__ = ["Distance", "SceneCover", "scene_clearance"]

Distance = Callable[[FloatArray], FloatArray]
"""Maps points (..., 3) [m] in the base frame to their distance from the nearest
obstacle [m], shape (...). They may be truncated above the radius of the spheres."""

_EXCESS, _FINE_EXCESS = 0.03, 0.01
"""How far spheres, and the finer ones, stand out over the solids [m]."""
_MOST_FINE = 1000
"""Finer spheres of one solid at most."""
_DOUBT = 0.02
"""Spheres that come nearer to the scene than this [m] are looked at more closely."""


@dataclass(frozen=True, eq=False)
class SceneCover:
    """Spheres around solids that move together."""

    segment: int
    """Segment of the chain that they move with."""
    is_hand: bool
    solids: Sequence[Solid]
    """In the frame of the segment."""
    max_radius: float
    """No sphere is larger than this [m]."""

    @cached_property
    def spheres(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Centres (s, 3), radii, and how far each stands out, (s,) [m]."""
        covers = [covering_spheres(s, _EXCESS, self.max_radius) for s in self.solids]
        depths = [
            solid.signed_distance(centers)
            for solid, (centers, _) in zip(self.solids, covers, strict=True)
        ]
        centers, radii = _joined(covers)
        return centers, radii, np.concatenate(depths) + radii

    @cached_property
    def fine(self) -> tuple[FloatArray, FloatArray]:
        """Centres (f, 3) and radii (f,) of the finer spheres [m]."""
        return _joined(
            covering_spheres(solid, _FINE_EXCESS, self.max_radius, _MOST_FINE)
            for solid in self.solids
        )

    @cached_property
    def meets(self) -> FloatArray:
        """1 where a sphere meets a finer one, which may hold what it holds, (s, f)."""
        (centers, radii, _), (fine, fine_radii) = self.spheres, self.fine
        apart = np.linalg.norm(centers[:, None] - fine, axis=-1)
        meets = apart <= radii[:, None] + fine_radii
        return np.asarray(meets, dtype=np.float32)


def scene_clearance(
    covers: Sequence[SceneCover],
    poses: Sequence[tuple[FloatArray, FloatArray]],
    distance: Distance,
) -> FloatArray:
    """Least distance that solids keep from a scene, for certain.

    Parameters
    ----------
    covers, poses
        Solids, and rotations (k, 3, 3) and origins (k, 3) of their segments in base.

    Returns
    -------
    FloatArray
        [m], shape (k,): not below the true one by more than the finer spheres stand
        out where it is near zero; at a contact zero or less.
    """
    gaps: list[FloatArray] = []
    for cover, (R, p) in zip(covers, poses, strict=True):
        centers, radii, _ = cover.spheres
        points = centers @ R.swapaxes(1, 2) + p[:, None]
        gaps.append(distance(points) - radii)
    least: FloatArray = np.min([gap.min(axis=1) for gap in gaps], axis=0)
    # Where a centre is deeper inside its solid than the nearest obstacle is away from
    # it, that obstacle is inside, too.
    is_hit = np.any(
        [
            (gap + cover.spheres[2] < 0.0).any(axis=1)
            for cover, gap in zip(covers, gaps, strict=True)
        ],
        axis=0,
    )
    unsure = np.flatnonzero((least < _DOUBT) & ~is_hit)
    if not len(unsure):
        return least
    closer = np.full(len(unsure), np.inf)
    for cover, (R, p), gap in zip(covers, poses, gaps, strict=True):
        near = gap[unsure]
        is_near = near < _DOUBT
        np.minimum(closer, np.where(is_near, np.inf, near).min(axis=1), out=closer)
        if is_near.any():
            row, index = np.nonzero(is_near.astype(np.float32) @ cover.meets)
            centers, radii = (values[index] for values in cover.fine)
            one = unsure[row]
            points = (R[one] @ centers[..., None])[..., 0] + p[one]
            np.minimum.at(closer, row, distance(points) - radii)
    least[unsure] = np.maximum(least[unsure], closer)
    return least


def _joined(
    covers: Iterable[tuple[FloatArray, FloatArray]],
) -> tuple[FloatArray, FloatArray]:
    centers, radii = zip(*covers, strict=True)
    # Rounding of poses in single precision moves a sphere by less than this.
    return np.concatenate(centers), np.concatenate(radii) + 1e-5
