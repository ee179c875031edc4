"""What of a picture is the robot itself, by its joints and its solids."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray
from debrisgrasp.geometry import SE3, Intrinsics, Solid

from .context import Context
from .obstacles import are_near

__all__ = ["are_own", "own_body", "own_pixels"]

_ROBOT = 0.02
"""What is so near to the robot is the robot [m]."""
_FINGERS = 0.06
"""The same of an idle hand [m]."""
_NEAREST = 0.01
"""Nearer to the camera nothing is measured [m]."""


def own_body(context: Context, without: str | None = None) -> list[tuple[Solid, float]]:
    """Solids of the robot as it stands, and how far what is it may be from each [m].

    Parameters
    ----------
    without
        Arm whose hand is left out.
    """
    model, tree = context.model, context.model.tree
    links = model.links_solids(context.joint_values())
    hands = {name: tree.links_below(model.arm(name).hand) for name in context.limbs}
    idle = frozenset[str]().union(*hands.values())
    left = hands.get(without or "", frozenset())
    # Fingers of an idle hand may stand otherwise than in the model.
    return [
        (solid, _FINGERS if link in idle else _ROBOT)
        for link, solid in links
        if link not in left
    ]


def are_own(
    context: Context, arm: str, preshape: str, opening: float, points: FloatArray
) -> BoolArray:
    """Which points (n, 3) are of the robot as it stands, a hand open so far, (n,)."""
    limb = context.limbs[arm]
    T_base_hand = limb.pose(context.posture(limb))
    # Fingers may read a bit beyond their range.
    opening = min(opening, limb.hand.preshape(preshape).widest)
    hand = limb.hand.solids(preshape, opening)
    body = own_body(context, without=arm)
    body += [(solid.moved(T_base_hand), _ROBOT) for solid in hand]
    found = np.zeros(len(points), dtype=bool)
    for within in (_ROBOT, _FINGERS):
        found |= are_near(points, [s for s, most in body if most == within], within)
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
