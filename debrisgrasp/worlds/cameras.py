"""Where a depth camera on a robot's head stands, and what kind it is."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import Rng, finite, require_range
from debrisgrasp._checked import checked
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3, Intrinsics, so3

__all__ = ["draw_intrinsics", "draw_view", "look_at"]


@checked
def look_at(eye: ArrayLike, target: ArrayLike, *, roll: float = 0.0) -> SE3:
    """Pose ``T_base_camera`` whose optical axis meets the target.

    Parameters
    ----------
    eye, target
        Positions in the base frame [m], shape (3,).
    roll
        Turn about the optical axis [rad]; at 0 the image's rows are level, and if it
        looks straight up or down, they run along -y, as for a robot that looks ahead.

    Raises
    ------
    InputError
        If the target lies at the eye.
    """
    eye = finite(eye, "eye of a camera", (3,))
    target = finite(target, "target of a camera", (3,))
    z = target - eye
    if not np.linalg.norm(z) > 1e-9:
        raise InputError(
            "target of a camera",
            got=f"{target.tolist()}, where the camera is",
            expected="another place",
        )
    x = np.cross(z, (0.0, 0.0, 1.0))
    if not np.linalg.norm(x) > 1e-9 * max(1.0, float(np.linalg.norm(z))):
        x = np.array([0.0, -1.0, 0.0])
    x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    R = np.stack([x, np.cross(z, x), z], axis=-1)
    return SE3.from_parts(R @ so3.exp(np.array([0.0, 0.0, roll])), eye)


@checked
def draw_intrinsics(rng: Rng) -> Intrinsics:
    """Draw intrinsics of one D435 or another, at 640 x 480."""
    f = rng.uniform(610.0, 622.0)
    return Intrinsics(
        fx=f,
        fy=f,
        cx=rng.normal(319.5, 3.0),
        cy=rng.normal(239.5, 4.0),
        width=640,
        height=480,
    )


@checked
def draw_view(
    target: ArrayLike,
    *,
    rng: Rng,
    height: tuple[float, float] = (1.15, 1.9),
    tilt: tuple[float, float] = (38.0, 58.0),
) -> SE3:
    """Draw a pose of the camera that looks down at a place, from the robot's side.

    Parameters
    ----------
    target
        What to look at, base frame [m], shape (3,).
    rng
        Source of randomness.
    height
        Range of the camera's height above the base plane [m].
    tilt
        Range of the angle below the horizon at which it looks [degrees].

    Raises
    ------
    InputError
        If a range is none, or too wide.
    """
    target = finite(target, "target of a camera", (3,))
    for name, (low, high), most in (("height", height, 50.0), ("tilt", tilt, 89.0)):
        require_range(f"least {name}", low, 0.1, most)
        require_range(f"greatest {name}", high, low, most)
    z = rng.uniform(*height)
    angle = np.radians(rng.uniform(*tilt))
    distance = (z - target[2]) / np.tan(angle)
    heading = rng.normal(0.0, 0.1)
    back = np.array([-np.cos(heading), np.sin(heading)])
    eye = np.array([*(target[:2] + distance * back), z])
    aside = rng.normal(0.0, 0.05, 2)
    return look_at(eye, target + np.array([*aside, 0.0]))
