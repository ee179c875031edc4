"""What a depth camera sees of a world: exact at pixel centres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray, require_range
from debrisgrasp._checked import checked
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3, Intrinsics, Solid

from .body import Part, as_part
from .raycast import corners_around, first_hits
from .world import World

__all__ = ["Rendered", "render"]

_NEAR = 0.02
"""Closest depth at which a corner still bounds the picture of its solid [m]."""
_GROUND_COLOR = (120, 116, 110)
_LAMP = np.array([0.35, 0.45, 0.82])


@dataclass(frozen=True, slots=True, eq=False)
class Rendered:
    """A noise-free picture."""

    depth: FloatArray
    """Metres along the optical axis, shape (height, width); 0 where nothing is."""
    labels: IntArray
    """0 ground, 1.. bodies in the order of the world, -1 nothing, (height, width)."""
    rgb: IntArray
    """Colours of the materials under one lamp, uint8, shape (height, width, 3)."""


@checked
def render(
    world: World,
    intrinsics: Intrinsics,
    T_base_camera: SE3,
    *,
    extra: Sequence[Solid] = (),
    max_depth: float = 10.0,
) -> Rendered:
    """Cast a ray through every pixel centre.

    Parameters
    ----------
    world
        Bodies and ground.
    intrinsics, T_base_camera
        The camera.
    extra
        Further convex solids in the base frame, for instance a hand; they occlude and
        are labelled after the bodies, in their order.
    max_depth
        What is farther is not seen [m].

    Raises
    ------
    InputError
        If the camera is inside a solid or under the ground, or its pose is no SE3.
    ConfigError
        If nothing could be within the greatest depth.
    """
    require_range("max_depth", max_depth, 1e-3)
    pose = SE3.from_matrix(T_base_camera.matrix, "T_base_camera")
    _require_free(world, extra, pose.p)
    shape = (intrinsics.height, intrinsics.width)
    x = (np.arange(shape[1]) - intrinsics.cx) / intrinsics.fx
    y = (np.arange(shape[0]) - intrinsics.cy) / intrinsics.fy
    # Along rays with z = 1 a distance in lengths of the ray is the depth.
    rays = np.stack([*np.meshgrid(x, y), np.ones(shape)]).reshape(3, -1)
    depth = world.ground.hit(pose.p, (pose.R @ rays).T)
    labels = np.zeros(len(depth), dtype=np.int16)
    groups = [body.solids for body in world.bodies] + [(solid,) for solid in extra]
    T_camera_base = pose.inverse()
    origin = np.zeros(3)
    for label, group in enumerate(groups, start=1):
        for solid in group:
            part = as_part(solid.moved(T_camera_base))
            pixels = _pixels_around(part, intrinsics)
            hit = first_hits(part, origin, rays[:, pixels].T)
            nearer = hit < depth[pixels]
            depth[pixels[nearer]] = hit[nearer]
            labels[pixels[nearer]] = label
    is_seen = depth <= max_depth
    depth = np.where(is_seen, depth, 0.0).reshape(shape)
    labels = np.where(is_seen, labels, np.int16(-1)).reshape(shape)
    colors = [_GROUND_COLOR, *(body.color for body in world.bodies)]
    colors += [(90, 90, 90)] * len(extra) + [(0, 0, 0)]
    rgb = _shaded(np.array(colors, dtype=float)[labels], depth, intrinsics, pose)
    return Rendered(depth, labels, rgb)


def _require_free(world: World, extra: Sequence[Solid], eye: FloatArray) -> None:
    if eye[2] <= float(world.ground.height(eye[:2])):
        raise InputError(
            "camera", got=f"{eye[2]:g} m high", expected="a place above the ground"
        )
    for body in world.bodies:
        if any(solid.contains(eye) for solid in body.solids):
            raise InputError(
                "camera", got=f"a place inside {body.name}", expected="a free place"
            )
    if any(part.contains(eye) for part in extra):
        raise InputError(
            "camera", got="a place inside an extra solid", expected="a free place"
        )


def _pixels_around(part: Part, intrinsics: Intrinsics) -> IntArray:
    """Flat indices of the pixels of a rectangle that holds the solid's picture."""
    corners = corners_around(part)
    if corners[:, 2].max() <= 0.0:
        return np.zeros(0, dtype=int)
    limits = np.array([intrinsics.width, intrinsics.height])
    if corners[:, 2].min() < _NEAR:
        low, high = np.zeros(2, dtype=int), limits
    else:
        uv, _ = intrinsics.project(corners)
        low = np.clip(np.ceil(uv.min(axis=0)), 0, limits).astype(int)
        high = np.clip(np.floor(uv.max(axis=0)) + 1, 0, limits).astype(int)
    rows, columns = np.arange(low[1], high[1]), np.arange(low[0], high[0])
    return (rows[:, None] * intrinsics.width + columns).ravel()


def _shaded(
    colors: FloatArray, depth: FloatArray, intrinsics: Intrinsics, T_base_camera: SE3
) -> IntArray:
    points = intrinsics.deproject(depth)
    across = np.gradient(points, axis=1)
    down = np.gradient(points, axis=0)
    normals = np.cross(down, across)
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
    lit = np.maximum(T_base_camera.rotate(normals) @ _LAMP, 0.0)
    shaded = np.clip(colors * (0.45 + 0.55 * lit)[..., None], 0, 255)
    return np.asarray(shaded, dtype=np.uint8)
