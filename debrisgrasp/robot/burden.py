"""What a hand bears: contacts, what it holds, and what lies on that."""

from __future__ import annotations

from collections.abc import Sequence

from debrisgrasp._arrays import FloatArray
from debrisgrasp._physics import GRAVITY
from debrisgrasp.control._rigid import (
    Rotation,
    Vector,
    Wrench,
    added,
    cross,
    turned_back,
)

from .settling import HandState
from .shapes import BodyShape
from .springs import HELD

__all__ = ["load_of"]


def load_of(
    hand: HandState, shapes: Sequence[BodyShape], R: Rotation, p: Vector
) -> tuple[Vector, Wrench]:
    """Force on what is held but for the fingers, and the load on the hand.

    The first is in the axes of odom, the second in those of the hand; plain
    numbers, as the pose of the hand in odom is.
    """
    force: Vector = (0.0, 0.0, 0.0)
    moment = on_body = force
    hold = hand.hold
    for spring in hand.springs:
        push, point = spring.force.tolist(), spring.point.tolist()
        force = added(force, push)
        moment = added(moment, cross(added(point, p, -1.0), push))
        if spring.owner == HELD:
            on_body = added(on_body, push)
    if hold is not None:
        body = shapes[hold.index]
        weight = GRAVITY * body.mass
        carried: Vector = (0.0, 0.0, -weight)
        if hold.seat is not None:
            carried = added(carried, hold.seat.force(body, weight).tolist())
            if carried[2] <= -weight:
                hold.seat = None
        loads: list[tuple[FloatArray, Vector]] = [(body.com, carried)]
        loads += [
            (shapes[i].com, (0.0, 0.0, -borne)) for i, borne in hold.borne.items()
        ]
        for com, push in loads:
            force, on_body = added(force, push), added(on_body, push)
            lever = added(com.tolist(), p, -1.0)
            moment = added(moment, cross(lever, push))
    return on_body, (*turned_back(R, force), *turned_back(R, moment))
