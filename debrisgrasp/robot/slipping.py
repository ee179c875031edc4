"""How a body moves in fingers that hold it too weakly."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import hypot

from debrisgrasp.control._rigid import (
    Rotation,
    Vector,
    Wrench,
    added,
    cross,
    exp3,
    norm,
)
from debrisgrasp.prototypes import GripperModel

from .config import FakeConfig
from .holding import Grip

__all__ = ["Slip", "slip_of"]

_SPEED = 0.05
"""At which a body slips out of fingers that hold it too weakly [m/s] ..."""
_TURN_SPEED = 0.25
"""... and at which it turns in them [rad/s]."""
_LEVER = 0.05
"""Contacts of fingers lie so far apart: a body that they keep with a force they keep
from turning with that force at this lever [m]."""


@dataclass(frozen=True, slots=True)
class Slip:
    """Motion of a body in the hand within a period, frame of the hand."""

    way: Vector
    """[m]."""
    centre: Vector
    """About which it turns [m] ..."""
    turn: Rotation
    """... by this."""

    @property
    def distance(self) -> float:
        """Length of the way [m]."""
        return norm(self.way)


def slip_of(
    load: Wrench,
    grip: Grip,
    held_at: Iterable[Vector],
    friction: float,
    hand: GripperModel,
    config: FakeConfig,
) -> Slip | None:
    """Motion of a body whose load is more than friction keeps; None if it stays.

    It goes where it is pushed, and turns the way it is bent, until what is left is
    what the fingers keep; no farther, since what it leans on would push it back.

    Parameters
    ----------
    load
        On the body, but for the fingers, in the frame of the hand.
    held_at
        Where the body leans on others, in that frame [m]; asked for only if it turns.
    friction
        Of the fingers.
    """
    kept = 2.0 * friction * grip.squeeze
    _, aside, out = load[:3]
    if out > 0.0:
        out = max(out - grip.hook * hand.max_force, 0.0)
    size = hypot(aside, out)
    if size <= kept:
        return None
    step = min(_SPEED * config.period, (size - kept) / config.stiffness)
    centre = _mean([tuple(spring.point.tolist()) for spring in grip.contacts])
    moment = added(load[3:], cross(centre, load[:3]), -1.0)
    bent = norm(moment)
    turn: Vector = (0.0, 0.0, 0.0)
    if bent > kept * _LEVER:
        axis = added(turn, moment, 1.0 / bent)
        arms = [norm(cross(axis, added(point, centre, -1.0))) for point in held_at]
        most = _TURN_SPEED * config.period
        stiffness = config.stiffness * sum(arm * arm for arm in arms)
        excess = bent - kept * _LEVER
        angle = min(most, excess / stiffness) if stiffness > excess / most else most
        turn = added(turn, axis, angle)
    way = (0.0, step * aside / size, step * out / size)
    return Slip(way, centre, exp3(turn))


def _mean(points: Sequence[Vector]) -> Vector:
    total: Vector = (0.0, 0.0, 0.0)
    for point in points:
        total = added(total, point)
    return added((0.0, 0.0, 0.0), total, 1.0 / len(points))
