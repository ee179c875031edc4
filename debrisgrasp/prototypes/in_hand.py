"""What a hand closes on: the part of a surface in it, and where the fingers touch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3, Bounds
from debrisgrasp.geometry.sampling import fibonacci_sphere

from .check import contact_opening, seen_sides
from .gripper import GripperModel
from .prototype import GraspPrototype, PrototypeDefinition
from .prototype_file import DEFAULT_CLEARANCE
from .surface_shape import SurfaceShape

__all__ = ["PALM_GAP", "around_grip", "contacts", "settled"]

PALM_GAP = 0.012
"""Between the palm and the surface in a power grasp [m]."""
_MARGIN = 0.03
"""How far a prototype reaches beyond the breadth and the tips of the hand [m]."""


def around_grip(
    surface: SurfaceShape, T_surface_hand: SE3, gripper: GripperModel, preshape: str
) -> SurfaceShape:
    """Cut out what is inside the hand and 3 cm around it, in the palm frame.

    Raises
    ------
    InputError
        If next to nothing of the surface is there.
    """
    opening = float(gripper.preshape(preshape).openings[0])
    inside = gripper.closing_region(preshape, opening).bounds
    # Beyond the tips lies what the fingers can't touch, but what tells thick from thin.
    below, above = np.array([0.02, _MARGIN, 0.0]), np.array([0.02, _MARGIN, _MARGIN])
    box = Bounds(inside.lower - below, inside.upper + above)
    moved = surface.moved(T_surface_hand.inverse())
    n = int(np.count_nonzero(box.contains(moved.points)))
    if n < 30:
        raise InputError(
            "pose of the hand",
            got=f"one with {n} points of the surface between the fingers",
            expected="at least 30",
            mend="Check the frame and the units of the pose, or leave it to be "
            "proposed.",
        )
    return moved.cropped(box)


def settled(
    definition: PrototypeDefinition, gripper: GripperModel
) -> PrototypeDefinition:
    """Set width and opening from where the closing fingers touch the shape.

    The shape stays where it is. If neither side touches it, nothing changes; `check`
    then says so.
    """
    touching = [c for c in contacts(definition, gripper) if c is not None]
    if not touching:
        return definition
    preshape = gripper.preshape(definition.preshape)
    widest = float(preshape.openings[0])
    # Measured from one camera, only the side that was seen may be touched.
    width = float(np.clip(np.mean(touching), *preshape.widths))
    opening = min(width + DEFAULT_CLEARANCE, widest)
    # Files keep a tenth of a millimetre, and no more than the hand opens.
    opening = np.floor(1e4 * opening) / 1e4
    return replace(definition, width=round(width, 4), opening=float(opening))


def contacts(
    definition: PrototypeDefinition, gripper: GripperModel
) -> list[float | None]:
    """Find the openings [m] at which thumb and pair touch; None where unknown."""
    widest = float(gripper.preshape(definition.preshape).openings[0])
    open_wide = replace(definition, opening=widest)
    prototype = GraspPrototype.build(open_wide, fibonacci_sphere(1))
    known = seen_sides(prototype)
    return [
        contact_opening(prototype, gripper, side) if side in known else None
        for side in (-1, 1)
    ]
