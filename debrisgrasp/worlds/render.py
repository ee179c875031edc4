"""What a depth camera sees of a world: exact at pixel centres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray, require_range
from debrisgrasp._checked import checked
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3, Intrinsics, Solid

from .body import Body, Part, as_part
from .raycast import corners_around, first_hits
from .slopes import points_and_normals
from .world import World

__all__ = ["Rendered", "body_around", "render"]

_NEAR = 0.02
"""Closest depth at which a corner still bounds the picture of its solid [m]."""
_ROUNDING = 1e-9
"""[m]."""
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
    x = np.asarray((np.arange(shape[1]) - intrinsics.cx) / intrinsics.fx, np.float64)
    y = np.asarray((np.arange(shape[0]) - intrinsics.cy) / intrinsics.fy, np.float64)
    # Along rays with z = 1 a distance in lengths of the ray is the depth.
    rays = np.stack([*np.meshgrid(x, y), np.ones(shape)])
    depth = world.ground.hit(pose.p, (pose.R @ rays.reshape(3, -1)).T).reshape(shape)
    labels = np.zeros(shape, dtype=np.int16)
    groups = [body.solids for body in world.bodies] + [(solid,) for solid in extra]
    T_camera_base = pose.inverse()
    origin = np.zeros(3)
    for label, group in enumerate(groups, start=1):
        for solid in group:
            part = as_part(solid.moved(T_camera_base))
            window = _window_around(part, intrinsics, x, y)
            before = depth[window]
            if not before.size:
                continue
            hit = first_hits(part, origin, rays[:, *window].reshape(3, -1).T)
            nearer = hit.reshape(before.shape) < before
            before[nearer] = hit[nearer.ravel()]
            labels[window][nearer] = label
    is_seen = depth <= max_depth
    depth = np.where(is_seen, depth, 0.0)
    labels = np.where(is_seen, labels, np.int16(-1))
    colors = [_GROUND_COLOR, *(body.color for body in world.bodies)]
    colors += [(90, 90, 90)] * len(extra) + [(0, 0, 0)]
    rgb = _shaded(np.array(colors, dtype=float)[labels], depth, intrinsics, pose)
    return Rendered(depth, labels, rgb)


def body_around(world: World, place: FloatArray) -> Body | None:
    """Find a body that a place (3,) of the world [m] is inside of."""
    bodies = world.bodies
    around = (b for b in bodies if any(part.contains(place) for part in b.solids))
    return next(around, None)


def _require_free(world: World, extra: Sequence[Solid], eye: FloatArray) -> None:
    if eye[2] <= float(world.ground.height(eye[:2])):
        raise InputError(
            "camera", got=f"{eye[2]:g} m high", expected="a place above the ground"
        )
    over = body_around(world, eye)
    if over is not None:
        raise InputError(
            "camera", got=f"a place inside {over.name}", expected="a free place"
        )
    if any(part.contains(eye) for part in extra):
        raise InputError(
            "camera", got="a place inside an extra solid", expected="a free place"
        )


def _window_around(
    part: Part, intrinsics: Intrinsics, x: FloatArray, y: FloatArray
) -> tuple[slice, slice]:
    """Rows and columns of a rectangle that holds the solid's picture.

    ``x`` and ``y`` are where the rays of columns and rows pass at a depth of 1.
    """
    corners = corners_around(part)
    if corners[:, 2].max() <= 0.0:
        return slice(0), slice(0)
    if corners[:, 2].min() < _NEAR:
        return _crossed(corners, 1, y), _crossed(corners, 0, x)
    uv, _ = intrinsics.project(corners)
    limits = np.array([intrinsics.width, intrinsics.height])
    low = np.clip(np.ceil(uv.min(axis=0)), 0, limits).astype(int)
    high = np.clip(np.floor(uv.max(axis=0)) + 1, 0, limits).astype(int)
    return slice(low[1], high[1]), slice(low[0], high[0])


def _crossed(corners: FloatArray, axis: int, rays: FloatArray) -> slice:
    """Columns (axis 0) or rows (1) in which a polytope with corners (v, 3) may be seen.

    Their plane through the eye has corners on both of its sides, which holds for
    corners behind the eye, too.
    """
    beside = corners[:, axis, None] - corners[:, 2, None] * rays
    is_met = (beside.min(axis=0) < _ROUNDING) & (beside.max(axis=0) > -_ROUNDING)
    found = np.flatnonzero(is_met)
    return slice(found[0], found[-1] + 1) if len(found) else slice(0)


def _shaded(
    colors: FloatArray, depth: FloatArray, intrinsics: Intrinsics, T_base_camera: SE3
) -> IntArray:
    _, normals = points_and_normals(depth, intrinsics)
    normals /= np.maximum(np.linalg.norm(normals, axis=0), 1e-12)
    normals = np.ascontiguousarray(np.moveaxis(normals, 0, -1))
    lit = np.maximum(T_base_camera.rotate(normals) @ _LAMP, 0.0)
    shaded = np.clip(colors * (0.45 + 0.55 * lit)[..., None], 0, 255)
    return np.asarray(shaded, dtype=np.uint8)
