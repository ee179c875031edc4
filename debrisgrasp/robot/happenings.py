"""Faults that no device tells: the world itself is changed behind the robot's back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Protocol

import numpy as np

from debrisgrasp.geometry import SE3, Box
from debrisgrasp.worlds import Body, World

from .spoiling import Live

__all__ = ["APPEARING", "HAPPENINGS", "RESTING", "Changeable"]


class Changeable(Protocol):
    """A world in which things can be made to happen; `FakeRobot` fulfils it."""

    def change_world(self, change: Callable[[World], World]) -> bool:
        """Replace the world by what it becomes; refused while a hand holds anything."""

    def change_friction(self, friction: float) -> None:
        """Make everything as slick, or as rough."""

    def stick(self, seconds: float) -> None:
        """Let what a hand holds stick to it for so long."""

    def misplace(self, margin: float, arm: str | None) -> bool:
        """Put a joint of an arm beyond the limits of its controller by a margin [rad].

        It stays within those of the drives. None: an arm of its choice. Refused while
        the hand is at a body, which it would be driven through.
        """


_Happening = Callable[[Changeable, Live], bool]


def _farther(world: World, live: Live) -> World:
    shift = SE3.from_parts(p=[live.severity, 0.0, 0.0])
    return world.placed([shift @ body.T_base_body for body in world.bodies])


def _bulky(world: World, live: Live) -> World:
    """Make a block of every body, beside each other."""
    half = 0.5 * live.severity
    block = Box(np.full(3, half))
    bodies = []
    for i, body in enumerate(world.bodies):
        place = [body.T_base_body.p[0] + half, 1.05 * live.severity * i, half]
        moved = SE3.from_parts(p=place)
        bodies.append(replace(body, parts=(block,), T_base_body=moved))
    return replace(world, bodies=tuple(bodies))


def _barred(world: World, live: Live) -> World:
    """Put bars before the pile: the camera sees through, no hand fits between."""
    front = min(float(body.T_base_body.p[0]) for body in world.bodies) - 0.3
    half = np.array([0.01, 0.01, 0.5])
    places = np.arange(-1.2, 1.2, live.severity + 0.02)
    bars = tuple(Box(half, SE3.from_parts(p=[0.0, y, 0.0])) for y in places)
    n_before = sum(body.kind == "bars" for body in world.bodies)
    fence = Body(
        f"bars_{n_before + 1}",
        "bars",
        bars,
        60.0,
        T_base_body=SE3.from_parts(p=[front, 0.0, 0.5]),
    )
    return replace(world, bodies=(*world.bodies, fence))


def _slick(world: Changeable, live: Live) -> bool:
    world.change_friction(live.severity)
    return True


def _sticky(world: Changeable, live: Live) -> bool:
    world.stick(live.lasting)
    return True


def _misplaced(world: Changeable, live: Live) -> bool:
    return world.misplace(live.severity, live.arm)


def _changed(edit: Callable[[World, Live], World]) -> _Happening:
    return lambda world, live: world.change_world(lambda before: edit(before, live))


HAPPENINGS: Mapping[str, _Happening] = {
    "start_outside_limits": _misplaced,
    "no_grasp": _changed(_bulky),
    "unreachable": _changed(_farther),
    "plan_collision": _changed(_barred),
    "empty_grip": _changed(_farther),
    "slip": _slick,
    "not_released": _sticky,
}
"""What is done to the world, by the fault; each says whether it could be done."""

APPEARING = ("no_grasp", "plan_collision")
"""Faults that put something where nothing was: only before the robot looks."""

RESTING = ("start_outside_limits",)
"""Faults that would be others while an arm moves: only when a state begins."""
