"""What of a capture is the robot itself, by its joints and its solids."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray
from debrisgrasp._checked import checked
from debrisgrasp._joints import require_joints
from debrisgrasp.errors import CaptureError
from debrisgrasp.geometry import SE3, Intrinsics, Solid
from debrisgrasp.io import Capture
from debrisgrasp.kinematics import RobotModel

__all__ = ["are_near", "body_at", "own_pixels", "without_robot"]

_ROBOT = 0.02
"""What is so near to the robot is the robot [m]."""
_FINGERS = 0.06
"""The same of a hand, whose fingers may stand otherwise than in the model [m]."""
_NEAREST = 0.01
"""Nearer to the camera nothing is measured [m]."""


@checked
def without_robot(
    capture: Capture, robot: RobotModel, joints: Mapping[str, float] | None = None
) -> Capture:
    """Return a capture without what shows the robot: a self-filter.

    What is within 2 cm of a link, or 6 cm of a hand, counts as not measured.

    Parameters
    ----------
    capture
        With its pose in the base frame.
    robot
        That of the pipeline (`Pipeline.robot`), with the hands that its URDF lacks.
    joints
        Values by name when it was taken [rad or m]; arms not named are idle, all other
        joints at rest.

    Raises
    ------
    CaptureError
        If the capture has no pose in the base frame.
    UnknownNameError
        If the robot has no joint of a name.
    ConfigError
        If a value is beyond the limits of its joint, or the joint is fixed: where an
        arm is thought to be elsewhere, it would stay in the picture.
    """
    require_joints(robot, joints or {})
    T_base_camera, body = capture.T_base_camera, body_at(robot, joints)
    if T_base_camera is None:
        raise CaptureError(
            "pose of the capture",
            got="none",
            expected="the measured T_base_camera, to know where the robot is in it",
        )
    if capture.depth is not None and capture.intrinsics is not None:
        is_own = own_pixels(capture.depth, capture.intrinsics, T_base_camera, body)
        return replace(capture, depth=np.where(is_own, np.nan, capture.depth))
    assert capture.points is not None
    points = T_base_camera.apply(capture.points)
    is_own = are_near(points, body)
    return replace(capture, points=np.where(is_own[:, None], np.nan, capture.points))


def body_at(
    robot: RobotModel,
    joints: Mapping[str, float] | None = None,
    without: str | None = None,
) -> list[tuple[Solid, float]]:
    """Solids of a robot, and how far what is it may be from each [m].

    Parameters
    ----------
    without
        Arm whose hand is left out.
    """
    hands = {name: robot.tree.links_below(arm.hand) for name, arm in robot.arms.items()}
    of_hands = frozenset[str]().union(*hands.values())
    left = hands.get(without or "", frozenset())
    return [
        (solid, _FINGERS if link in of_hands else _ROBOT)
        for link, solid in robot.links_solids(joints)
        if link not in left
    ]


def are_near(points: FloatArray, body: Iterable[tuple[Solid, float]]) -> BoolArray:
    """Which points (n, 3) are as near to a solid as is given with it [m], (n,)."""
    found = np.zeros(len(points), dtype=bool)
    for solid, within in body:
        rows = np.flatnonzero(solid.bounds.grown(within).contains(points))
        found[rows] |= solid.signed_distance(points[rows]) < within
    return found


def own_pixels(
    depth: FloatArray,
    camera: Intrinsics,
    T_base_camera: SE3,
    body: Iterable[tuple[Solid, float]],
) -> BoolArray:
    """Which pixels show something so near to a solid (base frame), shape (h, w).

    Only those are looked at where the box around a solid is in the picture.
    """
    found = np.zeros(depth.shape, dtype=bool)
    T_camera_base = T_base_camera.inverse()
    for solid, within in body:
        solid = solid.moved(T_camera_base)
        box = solid.bounds.grown(within)
        near, far = max(box.lower[2], _NEAREST), box.upper[2]
        if far <= near:
            continue
        ends = 1.0 / near, 1.0 / far
        columns = _window(camera.fx, camera.cx, box.lower[0], box.upper[0], ends)
        rows = _window(camera.fy, camera.cy, box.lower[1], box.upper[1], ends)
        part = depth[rows, columns]
        is_near = (part > near) & (part < far) & ~found[rows, columns]
        index = np.flatnonzero(is_near)
        if not len(index):
            continue
        v, u = np.divmod(index, part.shape[1])
        z = part[v, u]
        v, u = v + rows.start, u + columns.start
        x, y = (u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z
        points = np.column_stack([x, y, z])
        found[v, u] = solid.signed_distance(points) < within
    return found


def _window(
    focal: float, center: float, low: float, high: float, ends: tuple[float, float]
) -> slice:
    """Pixels along one axis that look at an interval [m], by its inverse depths."""
    first = min(low * end for end in ends) * focal + center
    last = max(high * end for end in ends) * focal + center
    return slice(max(int(first), 0), max(int(last) + 2, 0))
