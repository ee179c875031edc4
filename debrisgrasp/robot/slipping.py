"""How a body moves in fingers that hold it too weakly."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import hypot
from typing import NamedTuple

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

__all__ = ["Leaning", "Slip", "slip_of"]

_SPEED = 0.05
"""At which a body slips out of fingers that hold it too weakly, and no part of it gets
anywhere faster as it turns in them [m/s] ..."""
_TURN_SPEED = 0.25
"""... but out of what bends it [rad/s]."""
_FASTER = 2.0
"""A turn that eases it may be so many times the last one."""
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
    turn: Vector
    """... by this rotation vector [rad]."""

    @property
    def rotation(self) -> Rotation:
        """The turn as a matrix."""
        return exp3(self.turn)

    @property
    def distance(self) -> float:
        """Length of the way [m]."""
        return norm(self.way)


class Leaning(NamedTuple):
    """How a body in the fingers leans on others, frame of the hand."""

    points: Iterable[Vector]
    """Where [m]; asked for only if it turns."""
    reach: float
    """Of the body from the hand [m]."""
    turn: Vector
    """By which it turned in the period before [rad]."""


def slip_of(
    load: Wrench,
    grip: Grip,
    leaning: Leaning,
    friction: float,
    hand: GripperModel,
    config: FakeConfig,
) -> Slip | None:
    """Motion of a body whose load is more than friction keeps; None if it stays.

    It goes where it is pushed, and turns the way it is bent, until what is left is
    what the fingers keep; no farther, since what it leans on would push it back, and
    slowly at first: it must not strike what it does not lean on yet.

    Parameters
    ----------
    load
        On the body, but for the fingers, in the frame of the hand.
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
        arms = [norm(cross(axis, added(p, centre, -1.0))) for p in leaning.points]
        stiffness = config.stiffness * sum(arm * arm for arm in arms)
        most = _SPEED * config.period / max(leaning.reach, _LEVER)
        if stiffness > 0.0:
            along = sum(a * b for a, b in zip(leaning.turn, axis, strict=True))
            most = max(most, _FASTER * along)
        most = min(most, _TURN_SPEED * config.period)
        excess = bent - kept * _LEVER
        angle = min(most, excess / stiffness) if stiffness > excess / most else most
        turn = added(turn, axis, angle)
    way = (0.0, step * aside / size, step * out / size)
    return Slip(way, centre, turn)


def _mean(points: Sequence[Vector]) -> Vector:
    total: Vector = (0.0, 0.0, 0.0)
    for point in points:
        total = added(total, point)
    return added((0.0, 0.0, 0.0), total, 1.0 / len(points))
