"""What a hand bears: contacts, what it holds, and what lies on that."""

from __future__ import annotations

from collections.abc import Sequence
from operator import add

from debrisgrasp._physics import GRAVITY
from debrisgrasp.control._rigid import (
    Rotation,
    Vector,
    Wrench,
    added,
    cross,
    turned,
    turned_back,
)

from .settling import HandState
from .shapes import BodyShape
from .springs import HELD

__all__ = ["load_of"]


def load_of(
    hand: HandState, shapes: Sequence[BodyShape], R: Rotation, p: Vector
) -> tuple[Wrench, Wrench]:
    """Load on what is held but for the fingers, and on the hand.

    Both in the frame of the hand; plain numbers, as its pose in odom is. What is held
    is pushed where it is touched, though the hand feels that bit by bit: bent by a push
    that lags, it would be turned deeper into what pushes it.
    """
    on_body: list[tuple[Vector, Vector]] = []
    on_hand: list[tuple[Vector, Vector]] = []
    hold = hand.hold
    lagging: Vector = (0.0, 0.0, 0.0)
    for spring in hand.springs:
        of = on_body if spring.owner == HELD else on_hand
        force = spring.force.tolist()
        of.append((spring.point.tolist(), force))
        if spring.owner == HELD:
            lagging = added(lagging, cross(spring.lag.tolist(), force))
    if hold is not None:
        body = shapes[hold.index]
        weight = GRAVITY * body.mass
        carried: Vector = (0.0, 0.0, -weight)
        if hold.seat is not None:
            carried = added(carried, hold.seat.force(body, weight).tolist())
            if carried[2] <= -weight:
                hold.seat = None
        on_body.append((body.com.tolist(), carried))
        on_body += [
            (shapes[i].com.tolist(), (0.0, 0.0, -borne))
            for i, borne in hold.borne.items()
        ]
        for spring in hold.fading:  # the hand lags, not the body
            point = added(turned(R, spring.point.tolist()), p)
            on_hand.append((point, turned(R, spring.force.tolist())))
    body_load = _sum_of(on_body, R, p)
    hand_load = tuple(map(add, body_load, _sum_of(on_hand, R, p)))
    bent = added(body_load[3:], turned_back(R, lagging))
    return (*body_load[:3], *bent), hand_load


def _sum_of(loads: Sequence[tuple[Vector, Vector]], R: Rotation, p: Vector) -> Wrench:
    """Wrench of (point, force)s in odom, in the frame of the hand."""
    force: Vector = (0.0, 0.0, 0.0)
    moment = force
    for point, push in loads:
        force = added(force, push)
        moment = added(moment, cross(added(point, p, -1.0), push))
    return (*turned_back(R, force), *turned_back(R, moment))
