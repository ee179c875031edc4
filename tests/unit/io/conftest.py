"""A small scene as arrays, from which every format is written."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from debrisgrasp.geometry import SE3, Intrinsics, so3

HEIGHT, WIDTH = 48, 64
K = np.array([[60.0, 0.0, 31.5], [0.0, 60.0, 23.5], [0.0, 0.0, 1.0]])


@pytest.fixture
def camera() -> Intrinsics:
    return Intrinsics.from_matrix(K, (HEIGHT, WIDTH))


@pytest.fixture
def T_base_camera() -> SE3:
    R = so3.from_rpy(np.array([-2.3, 0.0, -np.pi / 2]))
    return SE3.from_parts(R, [0.37, 0.02, 0.95])


@pytest.fixture
def depth() -> np.ndarray:
    rows = np.arange(HEIGHT)[:, None] * np.ones(WIDTH)
    depth = (1.0 + 0.005 * rows).astype(np.float32)
    depth[:5, :5] = 0.0
    return depth


@pytest.fixture
def arrays(depth, T_base_camera) -> dict[str, Any]:
    return {"depth": depth, "K": K, "T_base_camera": T_base_camera.matrix}


@pytest.fixture
def points(rng) -> np.ndarray:
    points = rng.uniform(-0.5, 0.5, (300, 3))
    points[:, 2] = 0.2 * points[:, 0]
    return points.astype(np.float32).astype(np.float64)
