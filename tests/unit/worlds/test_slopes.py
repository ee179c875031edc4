from __future__ import annotations

import numpy as np

from debrisgrasp.geometry import Intrinsics
from debrisgrasp.worlds.slopes import points_and_normals

CAMERA = Intrinsics(fx=50.0, fy=60.0, cx=15.5, cy=11.5, width=32, height=24)


def test_normals_of_a_slope_point_to_the_side_of_the_camera():
    """Depth of the plane z = 2 - 0.5 y."""
    v = np.arange(CAMERA.height)[:, None]
    depth = 2.0 / (1.0 + 0.5 * (v - CAMERA.cy) / CAMERA.fy)
    points, normals = points_and_normals(
        np.broadcast_to(depth, (CAMERA.height, CAMERA.width)), CAMERA
    )
    inner = normals[:, 1:-1, 1:-1]
    inner = inner / np.linalg.norm(inner, axis=0)
    expected = np.array([0.0, -0.5, -1.0]) / np.hypot(1.0, 0.5)
    np.testing.assert_allclose(inner, expected[:, None, None] + 0 * inner, atol=1e-6)
    assert ((points * normals).sum(axis=0) < 0.0).all()
