"""Where a hand is seen, and how far that is from where its joints say it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray
from debrisgrasp.geometry import Solid

from .context import Context
from .limb_state import LimbState

__all__ = [
    "LEAST",
    "NEARER",
    "REACH",
    "end_of_arm",
    "links_of_end",
    "rigid_links",
    "seen_shift",
]

NEARER = 0.05
"""A pixel that shows something so much nearer than before shows the arm [m]."""
REACH = 0.12
"""Points of the arm lie within this of where it must be [m]."""
LEAST = 60
"""Pixels on the arm, at least."""
_MOST = 500


def seen_shift(context: Context, limb: LimbState, was: FloatArray) -> FloatArray | None:
    """How far the arm is seen from where it is, base frame (3,); None: not seen.

    Parameters
    ----------
    was
        Depth before the hand was held there [m], infinite where the robot is.
    """
    frame = context.frame()
    values = context.joint_values()
    T_base_camera = context.model.T_base_camera(values)
    depth = np.nan_to_num(frame.depth)
    if depth.shape != was.shape:
        return None
    is_arm: BoolArray = (depth > 0.0) & (was > 0.0) & (depth < was - NEARER)
    seen = frame.intrinsics.deproject(depth)[is_arm]
    points = T_base_camera.apply(seen)
    away = _distance(points, end_of_arm(context, limb, values))
    is_near = away < REACH
    points, away = points[is_near], away[is_near]
    if others := _other_arms(context, limb, values):
        points = points[away < _distance(points, others)]
    if len(points) < LEAST:
        return None
    # Near the end of an arm is more of it, as the forearm.
    solids = [solid for _, solid in rigid_links(context, limb, values)]
    return _fitted_shift(points[:: max(1, len(points) // _MOST)], solids)


def end_of_arm(
    context: Context, limb: LimbState, values: Mapping[str, float]
) -> list[Solid]:
    """Solids beyond the third-last joint, fingers left out, base frame."""
    end = links_of_end(context, limb)
    return [s for link, s in rigid_links(context, limb, values) if link in end]


def links_of_end(context: Context, limb: LimbState) -> frozenset[str]:
    """Links beyond the third-last joint, fingers too."""
    tree, names = context.model.tree, limb.reach.chain.joint_names
    return tree.links_below(tree.joints[names[-3]].child)


def _other_arms(
    context: Context, limb: LimbState, values: Mapping[str, float]
) -> list[Solid]:
    """Solids of the arms that this one does not move, base frame."""
    model, names = context.model, limb.reach.chain.joint_names
    of_others = {name for arm in model.arms.values() for name in arm.joints}
    of_others.difference_update(names)
    return [
        solid
        for link, solid in model.links_solids(values)
        if any(joint.name in of_others for joint in model.tree.joints_above(link))
    ]


def rigid_links(
    context: Context, limb: LimbState, values: Mapping[str, float]
) -> list[tuple[str, Solid]]:
    """Links of an arm and of what carries it, fingers left out: solids, base frame."""
    tree, names = context.model.tree, limb.reach.chain.joint_names
    return [
        (link, solid)
        for link, solid in context.model.links_solids(values)
        if all(
            joint.kind == "fixed" or joint.name in names
            for joint in tree.joints_above(link)
        )
    ]


def _distance(points: FloatArray, solids: Sequence[Solid]) -> FloatArray:
    """Of points (n, 3) from the nearest solid [m], shape (n,)."""
    found: FloatArray = np.min([s.signed_distance(points) for s in solids], axis=0)
    return found


def _fitted_shift(points: FloatArray, solids: Sequence[Solid]) -> FloatArray:
    """Shift after which points (n, 3) lie on the solids, robustly, shape (3,)."""
    shift, step = np.zeros(3), 1e-3
    for _ in range(12):
        moved = points - shift
        gap = _distance(moved, solids)
        slope = np.column_stack(
            [
                (_distance(moved + e, solids) - _distance(moved - e, solids)) / 2e-3
                for e in step * np.eye(3)
            ]
        )
        # Fingers and edges are not where the solids are: their say is limited.
        weight = np.sqrt(np.minimum(1.0, 0.008 / np.maximum(np.abs(gap), 1e-9)))
        A, b = weight[:, None] * slope, weight * gap
        change = np.linalg.lstsq(A, b, rcond=0.02)[0]
        shift = shift + change
        if np.linalg.norm(change) < 2e-4:
            break
    return np.asarray(shift)
