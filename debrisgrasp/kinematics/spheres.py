"""Spheres that cover a solid, and how far they stand out over it."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from debrisgrasp._arrays import FloatArray, frozen
from debrisgrasp.geometry import SE3, Capsule, Cylinder, Solid, SolidContent, Sphere
from debrisgrasp.geometry.solids import SphereSet

__all__ = ["covering_spheres"]

_MOST = 64
"""Cells of one solid beyond which they are usually not divided any more."""


def covering_spheres(
    solid: Solid, excess: float, max_radius: float = np.inf, most: int = _MOST
) -> SphereSet:
    """Cover a solid by spheres that stand out little; the same are not covered twice.

    A round bar that is long enough gets a row of spheres. Every other solid is cut into
    cells, coarse inside and fine near its surface, until the sphere around each cell
    that meets the solid stands out by no more than ``excess``. As the cells hold all of
    the solid, so do the spheres.

    Parameters
    ----------
    solid
        What to cover.
    excess
        How far a sphere may stand out [m]. Exceeded at the flat ends of bars, and
        where it would take more cells than ``most``.
    max_radius
        No sphere is larger than this [m].
    most
        Cells beyond which they are not divided any more.

    Returns
    -------
    centers, radii
        Shapes (s, 3) and (s,), in the solid's frame [m].
    """
    return _covering(SolidContent.of([solid]), excess, max_radius, most)


@lru_cache(maxsize=4096)
def _covering(
    content: SolidContent, excess: float, max_radius: float, most: int
) -> SphereSet:
    centers, radii = _covered(content.solids[0], excess, max_radius, most)
    return frozen(centers, "centres of spheres", (None, 3)), frozen(
        radii, "radii of spheres", (None,)
    )


def _covered(solid: Solid, excess: float, max_radius: float, most: int) -> SphereSet:
    if isinstance(solid, Sphere) and solid.radius <= max_radius:
        return solid.center[None], np.array([solid.radius])
    if isinstance(solid, Cylinder | Capsule):
        row = _row(solid, excess, max_radius)
        if row is not None:
            return solid.T_frame_solid.apply(row[0]), row[1]
    own, T = _in_own_frame(solid)
    centers, half = _cells(own, excess, max_radius, most)
    return T.apply(centers), np.linalg.norm(half, axis=1)


def _in_own_frame(solid: Solid) -> tuple[Solid, SE3]:
    """Return the solid where its axes are those of its frame, and its pose."""
    if isinstance(solid, Sphere):
        return Sphere(solid.radius), SE3.from_parts(p=solid.center)
    T = getattr(solid, "T_frame_solid", SE3.identity())
    return solid.moved(T.inverse()), T


def _row(bar: Cylinder | Capsule, excess: float, max_radius: float) -> SphereSet | None:
    """Cover a bar about z by one row of spheres; None if it is no bar."""
    radius = min(bar.radius + excess, max_radius)
    if bar.radius > 0.95 * max_radius or (
        isinstance(bar, Cylinder) and bar.length < bar.radius
    ):
        return None
    reach = np.sqrt(radius**2 - bar.radius**2)
    n = max(1, int(np.ceil(bar.length / (2.0 * reach) - 1e-9)))
    half = bar.length / (2 * n)
    centers = np.zeros((n, 3))
    centers[:, 2] = (2 * np.arange(n) + 1 - n) * half
    radii = np.full(n, np.hypot(bar.radius, half))
    if isinstance(bar, Capsule):
        ends = np.array([[0.0, 0.0, -0.5], [0.0, 0.0, 0.5]]) * bar.length
        centers = np.concatenate([centers, ends])
        radii = np.concatenate([radii, np.full(2, bar.radius)])
    return centers, radii


def _cells(
    solid: Solid, excess: float, max_radius: float, most: int
) -> tuple[FloatArray, FloatArray]:
    """Centres and half edges (n, 3) of boxes that hold all of a solid."""
    bounds = solid.bounds
    centers = 0.5 * (bounds.lower + bounds.upper)[None]
    half = 0.5 * bounds.size[None]
    while True:
        around = np.linalg.norm(half, axis=1)
        gap = solid.signed_distance(centers)
        meets = gap <= around
        centers, half, around, gap = (a[meets] for a in (centers, half, around, gap))
        is_large = around > max_radius
        stands_out = np.where(is_large, np.inf, gap + around)
        split = np.flatnonzero(stands_out > excess)
        room = most - len(centers)
        if len(split) > room:
            split = split[np.argsort(-stands_out[split], kind="stable")]
            split = split[: max(room, np.count_nonzero(is_large))]
        if not len(split):
            return centers, half
        axis = half[split].argmax(axis=1)
        smaller, step = half[split], np.zeros((len(split), 3))
        rows = np.arange(len(split))
        smaller[rows, axis] *= 0.5
        step[rows, axis] = smaller[rows, axis]
        rest = np.setdiff1d(np.arange(len(centers)), split)
        centers = np.concatenate(
            [centers[rest], centers[split] - step, centers[split] + step]
        )
        half = np.concatenate([half[rest], smaller, smaller])
