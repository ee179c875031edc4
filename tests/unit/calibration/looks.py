"""Simulated looks at a fiducial by a camera whose place is known."""

from __future__ import annotations

import numpy as np

from debrisgrasp.calibration import Head, Observations
from debrisgrasp.geometry import SE3, so3

CAMERA = SE3.from_parts(
    so3.from_rpy(np.array([-np.pi / 2 - 0.75, 0.0, -np.pi / 2])), [0.4, 0.02, 0.93]
)
"""Looks ahead and 43 degrees down."""
PLACES = np.array(
    [
        [1.30, -0.56, 0.42],
        [0.80, 0.37, 0.27],
        [0.61, -0.16, 0.54],
        [1.08, 0.34, 0.56],
        [1.07, -0.58, 0.16],
        [0.80, -0.20, 0.72],
        [0.88, 0.30, 0.20],
        [0.85, -0.47, 0.25],
    ]
)
"""Spread well over the workspace."""
REST = np.array([0.0, 0.75])
"""Pan and tilt at rest [rad]."""


def head() -> Head:
    """Pan-tilt unit of RoMan's dimensions; at tilt 0.75 the camera is near CAMERA."""
    level = so3.from_rpy(np.array([-np.pi / 2, 0.0, -np.pi / 2]))
    return Head(
        T_base_camera_at_zero=SE3.from_parts(level, [0.3706, 0.0175, 0.9521]),
        axes=np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]),
        points=np.array([[0.36, 0.0, 0.8568], [0.36, 0.0, 0.9005]]),
        joint_names=("pan", "tilt"),
    )


def looks(
    places: np.ndarray = PLACES,
    *,
    T_base_camera: SE3 = CAMERA,
    noise: float = 0.0,
    rng: np.random.Generator | None = None,
    **fields: object,
) -> Observations:
    """Look at places with a camera that stands still."""
    seen = T_base_camera.inverse().apply(places)
    if rng is not None:
        seen = seen + rng.normal(0.0, noise, seen.shape)
    return Observations(places, seen, **fields)  # type: ignore[arg-type]  # passed on


def head_looks(
    carrier: Head,
    places: np.ndarray,
    readings: np.ndarray,
    *,
    noise: float = 0.0,
    rng: np.random.Generator | None = None,
) -> Observations:
    """Look at places with a camera on a head."""
    readings = np.broadcast_to(readings, (len(places), carrier.n_joints))
    seen = carrier.T_base_camera(readings).inverse().apply(places)
    if rng is not None:
        seen = seen + rng.normal(0.0, noise, seen.shape)
    return Observations(places, seen, head=readings)
