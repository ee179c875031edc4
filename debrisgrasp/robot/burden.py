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
    turned_back,
)

from .holding import Hold
from .rubble import Rubble
from .settling import HandState
from .shapes import BodyShape
from .springs import GROUND, HELD, Spring

__all__ = ["load_of", "springs_of_loose"]


def springs_of_loose(
    springs: Sequence[Spring], hold: Hold | None, rubble: Rubble
) -> Sequence[Spring]:
    """Limit what presses on a held body from above to what lies there.

    However a body is jammed with it, it is lifted then, and all that lies on it.
    """
    if hold is None:
        return springs
    down: dict[int, float] = {}
    for spring in springs:
        if _presses_down(spring):
            down[spring.body] = down.get(spring.body, 0.0) - float(spring.force[2])
    shares = {}
    for body, force in down.items():
        most = GRAVITY * rubble.shapes[body].mass
        if force > most:
            most += GRAVITY * rubble.mass_above(body, {hold.index})
        if force > most:
            shares[body] = most / force
    if not shares:
        return springs
    return [
        spring._replace(force=shares[spring.body] * spring.force)
        if spring.body in shares and _presses_down(spring)
        else spring
        for spring in springs
    ]


def _presses_down(spring: Spring) -> bool:
    """Whether a body presses on what is held from above."""
    return spring.owner == HELD and spring.body > GROUND and spring.force[2] < 0.0


def load_of(
    hand: HandState, shapes: Sequence[BodyShape], R: Rotation, p: Vector
) -> tuple[Wrench, Wrench]:
    """Load on what is held but for the fingers, and on the hand.

    Both in the frame of the hand; plain numbers, as its pose in odom is.
    """
    on_body: list[tuple[Vector, Vector]] = []
    on_hand: list[tuple[Vector, Vector]] = []
    hold = hand.hold
    for spring in hand.springs:
        of = on_body if spring.owner == HELD else on_hand
        of.append((spring.point.tolist(), spring.force.tolist()))
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
    body_load = _sum_of(on_body, R, p)
    hand_load = _sum_of(on_hand, R, p)
    return body_load, tuple(map(add, body_load, hand_load))


def _sum_of(loads: Sequence[tuple[Vector, Vector]], R: Rotation, p: Vector) -> Wrench:
    """Wrench of (point, force)s in odom, in the frame of the hand."""
    force: Vector = (0.0, 0.0, 0.0)
    moment = force
    for point, push in loads:
        force = added(force, push)
        moment = added(moment, cross(added(point, p, -1.0), push))
    return (*turned_back(R, force), *turned_back(R, moment))
