"""Whether a hand can really take the shape of a prototype."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._checked import checked
from debrisgrasp.geometry import SE3, Bounds
from debrisgrasp.geometry.solids import Solid

from .gripper import GripperModel
from .prototype import GraspPrototype
from .surface_shape import SurfaceShape
from .surfaces import sample

__all__ = ["Finding", "check", "contact_opening", "depth_in", "seen_sides"]

PENETRATION_TOLERANCE = 0.002
"""How deep the open hand may reach into the shape [m]."""
WIDTH_TOLERANCE = 0.01
"""How far the width may be from the opening at which the fingers rest on the shape [m]:
fingers that touch with their inner links stand wider than the shape is thick."""
CENTERING_TOLERANCE = 0.02
"""How much earlier one side may touch than the other [m]."""
MIN_CLEARANCE = 0.01
"""How much wider than closed the hand should be during the approach [m]."""

_DENSE = 6e4
"""Points per square metre for tests of contact: 4 mm apart."""
_COARSE_STEP = 0.01
"""How far the pads close between two tests of contact [m]; less than a finger is thick,
so that none jumps across the shape."""
_APPROACH, _APPROACH_STEP = 0.1, 0.01
"""How far out the straight approach is looked at, and in what steps [m]."""
FACING, LEAST_SHARE = 0.5, 0.04
"""A side was seen if this share of the points faces its fingers [cosine, share]."""
_LEAST_FACING = 0.87
"""Where a finger rests, some of the surface faces it so far [cosine]: beyond 30 degrees
it slides off, as it does from a pipe thicker than the hand opens."""
_CONTACT_ACCURACY = 5e-4
"""To what accuracy the contact is then narrowed down [m]."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Something about a prototype that won't work."""

    prototype: str
    problem: str
    """What is wrong, with figures."""

    def __str__(self) -> str:
        return self.problem


@checked
def check(
    prototype: GraspPrototype,
    gripper: GripperModel,
    whole: SurfaceShape | None = None,
) -> tuple[Finding, ...]:
    """List what is wrong with a prototype; an empty list is a sound one.

    The palm frame of the hand must be where its palm and pads say. The open hand must
    not reach into the shape, neither where it closes nor on the straight way there; it
    must be open wider than it closes, and no wider than it can; and on closing the
    fingers of both sides must come to rest on the shape at about its ``width``, where
    it faces them. Of a surface that one camera saw, one side is enough.

    Parameters
    ----------
    whole
        Surface that the shape was cut out of, palm frame: the open hand must not reach
        into that either, wherever it lies; None: there is no more than the shape.
    """
    problems = [gripper.palm_doubt] if gripper.palm_doubt else []
    met = prototype
    if whole is not None:
        definition = replace(
            prototype.definition, shape=whole, T_hand_shape=SE3.identity()
        )
        met = replace(prototype, definition=definition)
    problems += _way_in_problems(met, gripper)
    preshape = gripper.preshape(prototype.preshape)
    widths = preshape.widths
    if prototype.opening > float(preshape.openings[0]) + 5e-7:
        problems.append(
            f"the opening of {prototype.opening:g} m is more than the "
            f"{float(preshape.openings[0]):.4g} m of preshape {prototype.preshape}"
        )
        return tuple(Finding(prototype.name, problem) for problem in problems)
    if not widths[0] <= prototype.width <= widths[1]:
        problems.append(
            f"width {prototype.width:g} m is outside the {widths[0]:g} to "
            f"{widths[1]:g} m of preshape {prototype.preshape}"
        )
    if prototype.opening < prototype.width + MIN_CLEARANCE:
        problems.append(
            f"the opening of {prototype.opening:g} m leaves less than "
            f"{1e3 * MIN_CLEARANCE:.0f} mm around the width of {prototype.width:g} m"
        )
    problems += _closing_problems(prototype, gripper)
    return tuple(Finding(prototype.name, problem) for problem in problems)


def contact_opening(
    prototype: GraspPrototype, gripper: GripperModel, side: int
) -> float | None:
    """Distance between the pads [m] at which one side first touches the shape.

    Parameters
    ----------
    side
        -1 for the fingers on the thumb side, +1 for those on the side of the pair.

    Returns
    -------
    float or None
        None if they close past the shape.
    """
    surface, _ = _surface(prototype)

    def touches(opening: float) -> bool:
        solids = gripper.finger_solids(prototype.preshape, opening, side)
        return depth_in(prototype, solids, surface)[0] > 0

    n_steps = 1 + int(np.ceil(prototype.opening / _COARSE_STEP))
    free = prototype.opening
    closed = max(0.0, gripper.preshape(prototype.preshape).narrowest)
    for opening in np.linspace(prototype.opening, closed, n_steps):
        if touches(float(opening)):
            break
        free = float(opening)
    else:
        return None
    touching = float(opening)
    while free - touching > _CONTACT_ACCURACY:
        middle = (free + touching) / 2
        free, touching = (free, middle) if touches(middle) else (middle, touching)
    return free


def depth_in(
    prototype: GraspPrototype, solids: Sequence[Solid], surface: FloatArray
) -> tuple[float, FloatArray]:
    """Find how deep solids and shape are in each other [m], and where, palm frame.

    Parameters
    ----------
    surface
        Points of the shape [m], palm frame, shape (n, 3).
    """
    depths, where = _depths(prototype, solids, surface, np.zeros(1))
    return float(depths[0]), where[0]


def _depths(
    prototype: GraspPrototype,
    solids: Sequence[Solid],
    surface: FloatArray,
    retreats: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Depths as of `depth_in`, (k,), and where, (k, 3), the solids drawn back (k,)."""
    back = retreats[:, None, None] * np.array([0.0, 0.0, -1.0])
    around = [solid.bounds for solid in solids]
    room = Bounds(
        np.min([box.lower for box in around], axis=0) + back.min(axis=0)[0],
        np.max([box.upper for box in around], axis=0),
    )
    surface = surface[room.contains(surface)]  # no other is in any of them
    in_solids = -np.min([s.signed_distance(surface - back) for s in solids], axis=0)
    # Solids that lie wholly inside the shape have none of its surface in them.
    corners = np.concatenate([solid.mesh()[0] for solid in solids]) + back
    definition = prototype.definition
    own = definition.T_hand_shape.inverse().apply(corners)
    in_shape = -np.min(
        [part.signed_distance(own) for part in definition.shape.parts()], axis=0
    )
    depths = np.concatenate([in_solids, in_shape], axis=1)
    met = np.broadcast_to(surface, (len(retreats), *surface.shape))
    points = np.concatenate([met, corners], axis=1)
    rows, deepest = np.arange(len(retreats)), depths.argmax(axis=1)
    return depths[rows, deepest], points[rows, deepest]


def seen_sides(prototype: GraspPrototype) -> tuple[int, ...]:
    """Sides of the hand (-1 thumb, +1 pair) whose fingers meet known surface.

    Of a surface that one camera saw, only what faces the fingers is known.
    """
    shape = prototype.definition.shape
    if not isinstance(shape, SurfaceShape) or shape.sides == "all":
        return (-1, 1)
    along = prototype.normals[:, 0]
    seen = tuple(s for s in (-1, 1) if (s * along > FACING).mean() > LEAST_SHARE)
    return seen or (-1, 1)


def _closing_problems(prototype: GraspPrototype, gripper: GripperModel) -> list[str]:
    problems, contacts = [], []
    for side in seen_sides(prototype):
        name = {-1: "thumb", 1: "pair"}[side]
        contact = contact_opening(prototype, gripper, side)
        if contact is None:
            problems.append(f"the fingers of the {name} side close past the shape")
            continue
        contacts.append(contact)
        slant = _slant(prototype, gripper, side, contact)
        if slant > np.arccos(_LEAST_FACING):
            problems.append(
                f"the {name} side rests where the surface slants "
                f"{np.rad2deg(slant):.0f} degrees: the shape is too thick for the hand"
            )
    if len(contacts) == 2:
        # The first side to touch pushes the object, or the arm gives way, until the
        # other touches too: the mean is where they hold.
        rest = float(np.mean(contacts))
        if abs(rest - prototype.width) > WIDTH_TOLERANCE:
            problems.append(
                f"the fingers come to rest at {1e3 * rest:.0f} mm, "
                f"the width says {1e3 * prototype.width:.0f} mm"
            )
        if abs(contacts[0] - contacts[1]) > CENTERING_TOLERANCE:
            problems.append(
                f"the thumb side touches at {1e3 * contacts[0]:.0f} mm and the pair "
                f"at {1e3 * contacts[1]:.0f} mm: the shape is off the middle"
            )
    return problems


def _slant(
    prototype: GraspPrototype, gripper: GripperModel, side: int, opening: float
) -> float:
    """Smallest angle [rad] of the surface that resting fingers meet to their way.

    Normals that were measured are too rough for this: they pass.
    """
    if isinstance(prototype.definition.shape, SurfaceShape):
        return 0.0
    points, normals = _surface(prototype)
    solids = gripper.finger_solids(prototype.preshape, opening, side)
    gaps = np.min([solid.signed_distance(points) for solid in solids], axis=0)
    facing = side * normals[gaps < gaps.min() + PENETRATION_TOLERANCE, 0]
    return float(np.arccos(np.clip(facing.max(), -1.0, 1.0)))


def _way_in_problems(prototype: GraspPrototype, gripper: GripperModel) -> list[str]:
    """Find what the open hand would hit where it closes, or on its way there."""
    preshape = gripper.preshape(prototype.preshape)
    opening = min(prototype.opening, float(preshape.openings[0]))
    retreats = np.arange(0.0, _APPROACH + 1e-9, _APPROACH_STEP)
    depths, where = _depths(
        prototype,
        gripper.solids(prototype.preshape, opening),
        _surface(prototype)[0],
        retreats,
    )
    met = np.flatnonzero(depths > PENETRATION_TOLERANCE)
    if not len(met):
        return []
    first = int(met[0])
    reaches = f"reaches {1e3 * depths[first]:.0f} mm into the shape at "
    reaches += f"{np.round(where[first], 3).tolist()}"
    if first == 0:
        return [f"the open hand {reaches}; move the shape or open wider"]
    return [
        f"on the approach, {1e3 * retreats[first]:.0f} mm before the end, the hand "
        f"{reaches}; turn or move the shape"
    ]


def _surface(prototype: GraspPrototype) -> tuple[FloatArray, FloatArray]:
    """Points and normals of the shape, palm frame, dense enough for contact."""
    shape, T = prototype.definition.shape, prototype.definition.T_hand_shape
    points, normals = sample(shape.patches(), shape.parts(), _DENSE)
    return T.apply(points), T.rotate(normals)
