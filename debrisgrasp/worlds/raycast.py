"""Where rays meet convex solids, in closed form."""

from __future__ import annotations

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._checked import checked
from debrisgrasp.geometry import SE3, Box, Capsule, Cylinder, Sphere

from .body import Part
from .hull import Hull

__all__ = ["corners_around", "first_hits"]

Span = tuple[FloatArray, FloatArray]
"""Where each ray enters and leaves, in lengths of the ray; empty if entry > exit."""


@checked
def first_hits(part: Part, origin: FloatArray, rays: FloatArray) -> FloatArray:
    """How many lengths of each ray lead from the origin to the solid.

    Parameters
    ----------
    part
        Solid in the frame of the rays.
    origin
        Where all rays start [m], shape (3,), outside the solid.
    rays
        Directions of any length, shape (n, 3).

    Returns
    -------
    FloatArray
        Shape (n,); infinity for rays that miss.
    """
    enter, leave = _span(part, origin, np.asarray(rays, dtype=np.float64).T)
    return np.where((enter <= leave) & (enter > 0.0), enter, np.inf)


@checked
def corners_around(part: Part) -> FloatArray:
    """Corners (v, 3) [m] of a polytope that contains the solid."""
    if isinstance(part, Hull):
        return part.vertices
    if isinstance(part, Box):
        half, pose = part.half_extents, part.T_frame_solid
    elif isinstance(part, Sphere):
        half, pose = np.full(3, part.radius), SE3.from_parts(p=part.center)
    else:
        reach = part.length / 2 + part.radius * isinstance(part, Capsule)
        half = np.array([part.radius, part.radius, reach])
        pose = part.T_frame_solid
    signs = np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3), axis=-1).reshape(-1, 3)
    return pose.apply(signs * half)


def _span(part: Part, origin: FloatArray, rays: FloatArray) -> Span:
    """Span of rays whose components come first, shape (3, n): sums run along memory."""
    if isinstance(part, Hull):
        return _between(part.normals @ rays, part.offsets - part.normals @ origin)
    if isinstance(part, Sphere):
        return _in_ball(origin - part.center, rays, part.radius)
    inverse = part.T_frame_solid.inverse()
    origin, rays = inverse.apply(origin), inverse.R @ rays
    if isinstance(part, Box):
        enter, leave = _in_slabs(origin, rays, part.half_extents)
        return enter.max(axis=0), leave.min(axis=0)
    # In the plane across the axis a tube is a ball of two coordinates.
    around = _in_ball(origin[:2], rays[:2], part.radius)
    half = part.length / 2
    low, high = _in_slabs(origin[2:], rays[2:], np.array([half]))
    straight = (np.maximum(around[0], low[0]), np.minimum(around[1], high[0]))
    if isinstance(part, Cylinder):
        return straight
    # The three pieces of a capsule overlap, so that their hits form one span.
    ends = [origin - np.array([0.0, 0.0, z]) for z in (-half, half)]
    pieces = [straight, *(_in_ball(end, rays, part.radius) for end in ends)]
    enters = [np.where(first <= last, first, np.inf) for first, last in pieces]
    leaves = [np.where(first <= last, last, -np.inf) for first, last in pieces]
    return np.min(enters, axis=0), np.max(leaves, axis=0)


def _between(rate: FloatArray, gap: FloatArray) -> Span:
    """Span inside half spaces: ``rate`` towards each plane, ``gap`` before it."""
    gap = gap[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = gap / rate
    misses = ((rate == 0.0) & (gap < 0.0)).any(axis=0)
    enter = np.where(rate < 0.0, steps, -np.inf).max(axis=0)
    leave = np.where(rate > 0.0, steps, np.inf).min(axis=0)
    return np.where(misses, np.inf, enter), leave


def _in_slabs(origin: FloatArray, rays: FloatArray, half: FloatArray) -> Span:
    """Spans of every coordinate inside [-half, half], shapes (k, n)."""
    is_parallel = rays == 0.0
    if is_parallel.any():
        rays = np.where(is_parallel, 1.0, rays)
    per_length = 1.0 / rays
    middle, reach = -origin[:, None] * per_length, half[:, None] * np.abs(per_length)
    enter, leave = middle - reach, middle + reach
    if is_parallel.any():
        outside = np.where(np.abs(origin) <= half, -np.inf, np.inf)[:, None]
        enter = np.where(is_parallel, outside, enter)
        leave = np.where(is_parallel, np.inf, leave)
    return enter, leave


def _in_ball(origin: FloatArray, rays: FloatArray, radius: float) -> Span:
    """Span where ``|origin + t ray| <= radius``, for any number of coordinates."""
    a = (rays**2).sum(axis=0)
    b = origin @ rays
    c = float(origin @ origin) - radius**2
    is_parallel = a < 1e-18
    a = np.where(is_parallel, 1.0, a)
    discriminant = b * b - a * c
    root = np.sqrt(np.maximum(discriminant, 0.0))
    misses = np.where(is_parallel, c > 0.0, discriminant < 0.0)
    enter = np.where(is_parallel, -np.inf, (-b - root) / a)
    leave = np.where(is_parallel, np.inf, (-b + root) / a)
    return np.where(misses, np.inf, enter), leave
