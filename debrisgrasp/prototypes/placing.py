"""Where a hand takes a shape: how deep between the fingers it goes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Literal

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import SE3, fibonacci_sphere

from .check import PENETRATION_TOLERANCE, Finding, check, depth_in
from .gripper import GripperModel
from .in_hand import PALM_GAP, settled
from .prototype import GraspPrototype, PrototypeDefinition
from .surface_shape import SurfaceShape

__all__ = ["Grip", "grip_depths", "placed", "soundest"]

Grip = Literal["tip", "deep", "power"]
"""How deep a shape goes between the fingers: its near side between the fingertips, its
far side level with the fingertips, or as near to the palm as the hand goes."""

_STEP = 0.005
"""Between two places that are tried [m]."""
_FARTHEST = 0.03
"""How far from the place that a grip wants others are tried [m]."""
_OVERLAP = 0.035
"""How far the pads reach past the near side of what they take by the tip [m] ..."""
_PAST_WIDEST = 0.005
"""... and past its widest place, so that it is not squeezed out."""
_GROUND_GAP = 0.004
"""Between the fingertips and what the far side lies on [m]."""
_ENGAGED = 0.01
"""A pad presses on at least this much of a shape, up to half of a thinner one [m]."""


def placed(
    definition: PrototypeDefinition, gripper: GripperModel, grip: Grip
) -> tuple[PrototypeDefinition, tuple[Finding, ...]]:
    """Move a shape ahead of the palm to the fingers, and let them close on it.

    Parameters
    ----------
    definition
        Its shape is turned as it says; where it is, width and opening are found.

    Returns
    -------
    definition, findings
        The first place without findings, from the one that the grip wants outwards; if
        there is none, the one with the fewest. Where the hand can't go around the shape
        at all, the one at which it gets least into it.
    """
    y, R = _across(definition, gripper), definition.T_hand_shape.R
    places = ([0.0, y, round(float(z), 3)] for z in _heights(definition, gripper, grip))
    moved = (
        replace(definition, T_hand_shape=SE3.from_parts(R, place)) for place in places
    )
    return soundest((settled(each, gripper) for each in moved), gripper)


def soundest(
    made: Iterable[PrototypeDefinition],
    gripper: GripperModel,
    whole: SurfaceShape | None = None,
) -> tuple[PrototypeDefinition, tuple[Finding, ...]]:
    """Find the first definition without findings, or the one with the fewest.

    Parameters
    ----------
    made
        One definition or more.
    whole
        As in `check`.
    """
    best: tuple[PrototypeDefinition, tuple[Finding, ...]] | None = None
    for definition in made:
        findings = check(_built(definition), gripper, whole)
        if best is None or len(findings) < len(best[1]):
            best = definition, findings
        if not findings:
            break
    assert best is not None
    return best


def grip_depths(
    definition: PrototypeDefinition, gripper: GripperModel
) -> dict[Grip, float]:
    """How far in front of the palm [m] the origin of a shape is, for each grip.

    ``tip`` and ``deep`` are the same for what is thin, ``deep`` and ``power`` for what
    is higher than the fingers are long. By ``tip`` and ``deep`` the fingertips reach
    no farther than its far side, if the pads allow it: it may lie on the ground.
    """
    preshape = gripper.preshape(definition.preshape)
    middle = sum(preshape.widths) / 2
    reach = gripper.fingertip_reach(preshape.name, middle)
    pads = float(gripper.pad_positions(preshape.name, middle)[:, 2].mean())
    turned = replace(definition, T_hand_shape=_turn(definition))
    points = _built(turned).points
    near, far = float(points[:, 2].min()), float(points[:, 2].max())
    width = np.abs(points[:, 0])
    widest = float(points[width > width.max() - 2e-3, 2].min())
    engaged = pads - near - min((far - near) / 2, _ENGAGED)
    power = PALM_GAP - near
    deep = max(min(reach + _GROUND_GAP - far, engaged), power)
    past = min(pads - near - _OVERLAP, pads - widest - _PAST_WIDEST)
    return {"tip": max(past, deep), "deep": deep, "power": power}


def _heights(
    definition: PrototypeDefinition, gripper: GripperModel, grip: Grip
) -> FloatArray:
    """Distances from the palm [m] at which the wide open hand goes around the shape.

    The best come first; where there is none, the one at which it gets in least deep.
    """
    preshape = gripper.preshape(definition.preshape)
    reach = gripper.fingertip_reach(preshape.name, sum(preshape.widths) / 2)
    widest = float(preshape.openings[0])
    beside = SE3.from_parts(p=(0.0, _across(definition, gripper), 0.0))
    T_hand_shape = beside @ _turn(definition)
    turned = replace(definition, T_hand_shape=T_hand_shape, opening=widest)
    wide = _built(turned)
    nearest = -float(wide.points[:, 2].min())
    wanted = grip_depths(definition, gripper)[grip]
    steps = np.arange(-np.ceil(reach / _STEP), np.ceil(reach / _STEP) + 1)
    heights = wanted + _STEP * steps
    heights = heights[(heights >= nearest - 1e-9) & (heights <= reach + nearest)]
    if not len(heights):  # no finger is before the palm, which `check` tells
        return np.array([wanted])
    heights = heights[np.argsort(np.abs(heights - wanted), kind="stable")]
    # Whether the shape is farther out, or the hand farther back, is the same.
    hand = gripper.solids(preshape.name, widest)
    back = [SE3.from_parts(p=(0.0, 0.0, -z)) for z in heights]
    depths = np.array(
        [depth_in(wide, [s.moved(T) for s in hand], wide.points)[0] for T in back]
    )
    is_free = depths <= PENETRATION_TOLERANCE
    if not is_free.any():
        return heights[[np.argmin(depths)]]
    free: FloatArray = heights[is_free]
    away = np.abs(free - wanted)
    near: FloatArray = free[away <= away[0] + _FARTHEST]
    return near


def _across(definition: PrototypeDefinition, gripper: GripperModel) -> float:
    """Where along y the fingers stand about [m]: in their middle, to a millimetre."""
    preshape = gripper.preshape(definition.preshape)
    region = gripper.closing_region(preshape.name, sum(preshape.widths) / 2)
    return round(float(region.T_frame_solid.p[1]), 3) + 0.0


def _turn(definition: PrototypeDefinition) -> SE3:
    return SE3.from_parts(definition.T_hand_shape.R)


def _built(definition: PrototypeDefinition) -> GraspPrototype:
    return GraspPrototype.build(definition, fibonacci_sphere(1))
