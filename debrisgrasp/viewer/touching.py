"""What a hand would hit in a pose that was ruled out: which solid, which points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray
from debrisgrasp.geometry import SE3, Solid
from debrisgrasp.prototypes import GripperModel

__all__ = ["Touch", "touches"]

TOLERANCE = 0.004
"""A point this deep inside a solid is hit [m], as in the close look of the planner."""
_STEPS = 8
"""Places on the approach, and positions of the closing fingers, that are looked at."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Touch:
    """One solid of the hand that is where something was measured."""

    part: str
    """``palm``, ``thumb side`` or ``pair side``."""
    when: str
    """``at the grasp``, ``on the way in`` or ``while closing``."""
    retreat: float
    """How far the hand is from its final pose then, along the approach [m]."""
    solid: Solid
    """Where the solid is then, base frame."""
    points: IntArray
    """Indices of the points inside it, deepest first, shape (h,)."""
    depth: float
    """How deep the deepest of them is [m]."""

    def __str__(self) -> str:
        place = f", {1e3 * self.retreat:.0f} mm before the end" * (self.retreat > 0)
        n = len(self.points)
        return (
            f"{self.part} {self.when}{place}: {n} point{'s' * (n != 1)}, up to "
            f"{1e3 * self.depth:.0f} mm deep"
        )


def touches(
    gripper: GripperModel,
    preshape: str,
    opening: float,
    width: float,
    T_base_hand: SE3,
    points: FloatArray,
    *,
    approach: float = 0.1,
) -> tuple[Touch, ...]:
    """Find which solids of a hand hit which points in a pose and on the way there.

    Parameters
    ----------
    opening
        Of the pads during the approach [m].
    width
        Of the pads when closed [m]; the fingers stop 16 mm before it, as the planner
        has it, so that they don't count what they grip.
    points
        Measured points, base frame [m], shape (n, 3).
    approach
        Length of the straight approach [m].

    Returns
    -------
    tuple[Touch, ...]
        One for each solid, with the time at which it hits most; the final pose first.
    """
    own = T_base_hand.inverse().apply(points)
    bounds = gripper.closing_region(preshape, opening).bounds
    reach = float(np.abs([bounds.lower, bounds.upper]).max()) + 0.25 + approach
    near = np.flatnonzero(np.linalg.norm(own, axis=1) < reach)
    found: dict[tuple[str, int, str], Touch] = {}

    def look(solids: list[tuple[str, Solid]], when: str, retreat: float) -> None:
        for number, (part, solid) in enumerate(solids):
            moved = solid.moved(SE3.from_parts(p=(0.0, 0.0, -retreat)))
            inside = near[moved.bounds.contains(own[near])]
            depth = -moved.signed_distance(own[inside])
            hit = np.flatnonzero(depth > TOLERANCE)
            if not len(hit):
                continue
            order = hit[np.argsort(-depth[hit])]
            touch = Touch(
                part=part,
                when=when,
                retreat=retreat,
                solid=moved.moved(T_base_hand),
                points=inside[order],
                depth=float(depth[order[0]]),
            )
            old = found.get((part, number, when))
            if old is None or len(old.points) < len(touch.points):
                found[part, number, when] = touch

    open_hand = _parts(gripper, preshape, opening)
    look(open_hand, "at the grasp", 0.0)
    for retreat in np.linspace(0.0, approach, _STEPS + 1)[1:]:
        look(open_hand, "on the way in", float(retreat))
    last = min(width + 0.016, opening)
    for step in np.linspace(opening, last, _STEPS + 1)[1:]:
        look(
            _parts(gripper, preshape, float(step))[len(gripper.palm) :],
            "while closing",
            0.0,
        )
    order = {"at the grasp": 0, "on the way in": 1, "while closing": 2}
    return tuple(
        sorted(found.values(), key=lambda t: (order[t.when], -len(t.points), -t.depth))
    )


def _parts(
    gripper: GripperModel, preshape: str, opening: float
) -> list[tuple[str, Solid]]:
    """Solids of the hand with the names of what they are part of, palm first."""
    return [
        *(("palm", solid) for solid in gripper.palm),
        *(
            (name, solid)
            for side, name in ((-1, "thumb side"), (1, "pair side"))
            for solid in gripper.finger_solids(preshape, opening, side)
        ),
    ]
