"""Small exact scenes: primitive solids on a floor, seen by a depth camera."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from debrisgrasp.geometry import SE3, Cylinder, Intrinsics, Solid, so3
from debrisgrasp.io import Capture

CAMERA = Intrinsics(fx=240.0, fy=240.0, cx=159.5, cy=119.5, width=320, height=240)

_DIAGONAL = np.sqrt(0.5)
LOOKING_DOWN_AND_AHEAD = SE3.from_parts(
    # Columns: image right, image down, and the view, 45 degrees down; in base.
    [[0.0, -_DIAGONAL, _DIAGONAL], [-1.0, 0.0, 0.0], [0.0, -_DIAGONAL, -_DIAGONAL]],
    [0.1, 0.0, 1.1],
)


def depth_image(
    solids: Sequence[Solid],
    *,
    T_base_camera: SE3 = LOOKING_DOWN_AND_AHEAD,
    camera: Intrinsics = CAMERA,
    has_floor: bool = True,
) -> np.ndarray:
    """Trace every ray to the surface by steps of the distance to the nearest solid."""
    rays = T_base_camera.rotate(
        camera.deproject(np.ones((camera.height, camera.width)))
    )
    length = np.linalg.norm(rays, axis=-1)
    travelled = np.zeros(length.shape)
    for _ in range(120):
        points = T_base_camera.p + rays * (travelled / length)[..., None]
        gap = points[..., 2] if has_floor else np.full(length.shape, 10.0)
        for solid in solids:
            gap = np.minimum(gap, solid.signed_distance(points))
        travelled = travelled + np.maximum(gap, 0.0)
    depth = travelled / length
    return np.where((gap < 1e-3) & (travelled < 6.0), depth, np.nan)


def capture_of(solids: Sequence[Solid], **settings: object) -> Capture:
    """Take a noise-free capture of solids on the floor."""
    pose = settings.get("T_base_camera", LOOKING_DOWN_AND_AHEAD)
    assert isinstance(pose, SE3)
    return Capture(
        depth=depth_image(solids, **settings),  # type: ignore[arg-type]  # passed through
        intrinsics=CAMERA,
        T_base_camera=pose,
        name="scene",
    )


def lying_pipe(
    radius: float = 0.03,
    length: float = 0.6,
    position: tuple[float, ...] = (0.9, 0, 0.2),
) -> Cylinder:
    """Return a pipe whose axis runs along y of the base."""
    return Cylinder(
        radius,
        length,
        SE3.from_parts(so3.from_rpy(np.array([np.pi / 2, 0.0, 0.0])), position),
    )
