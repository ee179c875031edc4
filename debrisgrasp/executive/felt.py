"""Where an empty hand was touched: no camera saw that, so it is kept as an obstacle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import Solid

from .senses import Senses

__all__ = ["feel_out", "touched_at"]

_LEAST = 10.0
"""A smaller force tells too little of where it acts [N]."""
_REACH, _STEP = 0.4, 2e-3
"""How far along the line of the force the hand is sought, and how closely [m]."""
_NEAR = 0.01
"""By so much noise shifts the line [m]; farther off it tells of no touch."""
_GRAZES = 0.1
"""A line that comes nearer by a smaller share of its way runs along the hand."""
_RADIUS, _GRAIN = 0.03, 0.01
"""What was touched is taken for so large [m], of points so far apart [m]."""


def feel_out(senses: Senses) -> None:
    """Take what pushes on an empty hand for an obstacle, until the next look."""
    context, limb = senses.context, senses.limb
    if context.held is not None:
        return
    hand = limb.hand.solids(limb.preshape, limb.opening)
    found = touched_at(np.array(senses.load), hand)
    if found is not None:
        T_base_hand = limb.pose(context.posture(limb))
        context.memory.felt.append(T_base_hand.apply(_patch(*found)))


def touched_at(
    load: FloatArray, solids: Sequence[Solid]
) -> tuple[FloatArray, FloatArray] | None:
    """Find where a hand is touched that bears the load of one contact.

    A force without a moment of its own acts along one line, which its torque tells: the
    contact is where that enters the hand (Bicchi, Salisbury and Brock, "Contact sensing
    from force measurements", 1993).

    Parameters
    ----------
    load
        Force and torque on the hand, at its origin, its axes [N, N m], shape (6,).
    solids
        Of the hand, its frame.

    Returns
    -------
    tuple or None
        Point [m] and direction of the force, each (3,), frame of the hand; None where
        the load is none, or not of one contact with the hand.
    """
    force, torque = load[:3], load[3:]
    size = float(np.linalg.norm(force))
    if not size > _LEAST:
        return None
    way = force / size
    along = np.arange(-_REACH, _REACH, _STEP)
    line = np.cross(force, torque) / size**2 + along[:, None] * way
    gaps = np.min([solid.signed_distance(line) for solid in solids], axis=0)
    is_near = gaps < _NEAR
    if not is_near.any():
        return None
    first = int(is_near.argmax())
    # Where it does not enter, for noise, it ends to come nearer there.
    nears = np.append(np.diff(gaps[first:]) < -_GRAZES * _STEP, False)
    at = int(((gaps[first:] < 0.0) | ~nears).argmax())
    return line[first + at], way


def _patch(point: FloatArray, way: FloatArray) -> FloatArray:
    """Points (n, 3) of a disk before which a force (3,) on the hand arises [m]."""
    ticks = np.arange(-_RADIUS, _RADIUS + 0.5 * _GRAIN, _GRAIN)
    flat = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    flat = flat[np.linalg.norm(flat, axis=1) < _RADIUS + 1e-9]
    aside = np.cross(way, np.eye(3)[np.abs(way).argmin()])
    aside /= np.linalg.norm(aside)
    return np.asarray(point + flat @ np.stack([aside, np.cross(way, aside)]))
