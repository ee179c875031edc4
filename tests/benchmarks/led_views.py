"""Synthetic looks at an LED on a palm: exact geometry, a camera's faults on top.

Only the part of the picture around the LED is made; its intrinsics are those of a
camera of 848 x 480 pixels, cropped.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from debrisgrasp.geometry import SE3, Box, Intrinsics, Solid, Sphere, sampling

__all__ = ["LedView", "led_view"]

FOCAL = 617.0
SIDE = 150
WALL = 2.2
"""Depth of what is behind everything [m]."""
PALM = np.array([0.05, 0.06, 0.03])
"""Half extents of the palm [m]."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LedView:
    """Two pictures and a depth image, and where the LED is in them."""

    on: np.ndarray
    off: np.ndarray
    depth: np.ndarray
    intrinsics: Intrinsics
    pixel: np.ndarray
    point: np.ndarray
    expected: np.ndarray
    """Where kinematics has the LED: off by some centimetres."""


def led_view(
    rng: np.random.Generator, *, is_lit: bool = True, is_hidden: bool = False
) -> LedView:
    """Look at an LED from 0.5 to 1.6 m, with clutter around, some of it blue."""
    z = rng.uniform(0.5, 1.6)
    point = np.array([*rng.uniform(-0.25, 0.25, 2) * z, z])
    pixel = FOCAL * point[:2] / z
    corner = np.round(pixel - SIDE / 2 + rng.uniform(-12, 12, 2))
    intrinsics = Intrinsics(
        fx=FOCAL, fy=FOCAL, cx=-corner[0], cy=-corner[1], width=SIDE, height=SIDE
    )
    u, v = np.meshgrid(np.arange(SIDE), np.arange(SIDE))
    uv = pixel - corner
    away = np.hypot(u - uv[0], v - uv[1])
    core = rng.uniform(0.003, 0.005) * FOCAL / z
    while True:
        solids, colors = _scene(rng, point, is_hidden=is_hidden)
        depth, owner, facing = _traced(intrinsics, solids)
        # Clutter that covers the LED by chance would make another kind of view.
        if is_hidden or (owner[away < core + 2.0] == 0).all():
            break
    palette = np.array([[110.0, 100.0, 90.0], *colors])
    surface = palette[owner + 1] * (0.35 + 0.65 * facing)[..., None]
    glow = rng.uniform(0.6, 1.0) * core + 0.8
    strength = rng.uniform(250.0, 900.0)
    light = strength * np.exp(-0.5 * (np.maximum(away - core, 0.0) / glow) ** 2)
    is_open = is_lit and not is_hidden
    tint = np.array([0.35, 0.5, 1.0]) * light[..., None] * is_open
    pictures = []
    for extra in (tint, 0.0 * tint):
        gain = rng.uniform(0.97, 1.03)
        blurred = ndimage.gaussian_filter(gain * (surface + extra), (0.7, 0.7, 0.0))
        noisy = blurred + rng.normal(0.0, rng.uniform(1.5, 4.0), blurred.shape)
        pictures.append(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
    depth = depth * (1.0 + rng.normal(0.0, 0.002, depth.shape))
    is_lost = rng.random(depth.shape) < 0.05
    edges = ndimage.maximum_filter(depth, 3) - ndimage.minimum_filter(depth, 3)
    is_lost |= (edges > 0.05) & (rng.random(depth.shape) < 0.7)
    if is_open:
        is_lost |= away < core + glow
    shift = rng.normal(size=3)
    shift *= rng.uniform(0.0, 0.04) / np.linalg.norm(shift)
    return LedView(
        on=pictures[0],
        off=pictures[1],
        depth=np.where(is_lost, 0.0, depth),
        intrinsics=intrinsics,
        pixel=uv,
        point=point,
        expected=point + shift,
    )


def _scene(
    rng: np.random.Generator, point: np.ndarray, *, is_hidden: bool
) -> tuple[list[Solid], list[np.ndarray]]:
    """Palm under the LED, things around and behind, and one before it if hidden."""
    towards = -point / np.linalg.norm(point)
    normal = towards + rng.normal(0.0, 0.35, 3)
    normal /= np.linalg.norm(normal)
    other = sampling.random_rotations(1, rng=rng)[0][0]
    x = np.cross(normal, other)
    x /= np.linalg.norm(x)
    R = np.stack([x, np.cross(normal, x), normal], axis=1)
    across = rng.uniform(-0.7, 0.7, 2) * PALM[:2]
    middle = point - R @ np.array([*across, PALM[2] + 1e-3])
    solids: list[Solid] = [Box(PALM, SE3.from_parts(R, middle))]
    colors = [np.full(3, rng.uniform(40, 120))]
    for _ in range(5):
        place = point + rng.uniform(-0.15, 0.15, 3) + (0, 0, rng.uniform(0.1, 0.5))
        size = rng.uniform(0.01, 0.08, 3)
        turned = SE3.from_parts(sampling.random_rotations(1, rng=rng)[0], place)
        solids.append(Box(size, turned))
        is_blue = rng.random() < 0.3
        colors.append(
            np.array([20.0, 40.0, rng.uniform(90, 190)])
            if is_blue
            else rng.uniform(20, 190, 3)
        )
    if is_hidden:
        before = point * rng.uniform(0.7, 0.93)
        solids.append(Sphere(rng.uniform(0.02, 0.05), before))
        colors.append(rng.uniform(20, 190, 3))
    return solids, colors


def _traced(
    intrinsics: Intrinsics, solids: list[Solid]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depth, which solid (-1: the wall behind), and how far it faces the camera."""
    rays = intrinsics.deproject(np.ones((intrinsics.height, intrinsics.width)))
    depths = np.stack([np.full(rays.shape[:2], WALL), *(_hit(s, rays) for s in solids)])
    owner = np.argmin(depths, axis=0) - 1
    depth = depths.min(axis=0)
    dz_v, dz_u = np.gradient(depth)
    slope = np.hypot(dz_u, dz_v) * FOCAL / depth
    return depth, owner, 1.0 / np.sqrt(1.0 + np.minimum(slope, 3.0) ** 2)


def _hit(solid: Solid, rays: np.ndarray) -> np.ndarray:
    """Depth at which rays of unit depth from the origin enter a solid."""
    if isinstance(solid, Sphere):
        a = (rays**2).sum(axis=-1)
        b = rays @ solid.center
        inside = b * b - a * (solid.center @ solid.center - solid.radius**2)
        return np.where(inside > 0, (b - np.sqrt(np.maximum(inside, 0))) / a, np.inf)
    assert isinstance(solid, Box)
    to_solid = solid.T_frame_solid.inverse()
    with np.errstate(divide="ignore"):
        rate = 1.0 / to_solid.rotate(rays)
    ends = np.stack([-solid.half_extents, solid.half_extents]) - to_solid.p
    times = rate[..., None, :] * ends
    enter, leave = times.min(axis=-2).max(axis=-1), times.max(axis=-2).min(axis=-1)
    return np.where((enter < leave) & (enter > 0.05), enter, np.inf)
