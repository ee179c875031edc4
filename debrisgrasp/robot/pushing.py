"""Bodies that a hand pushes, what these push along, and until what."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from math import hypot, inf, sqrt

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._physics import GRAVITY

from .config import FakeConfig
from .rubble import Rubble
from .springs import GROUND, Spring

__all__ = ["Push", "Pushes", "Yielding"]

_SPEED = 0.3
"""At which a body yields at most [m/s]."""
_CHECK = 0.003
"""After every so much of a push it is looked whether something is in the way [m]."""
_MET = 0.003
"""Deeper than this in another than before, a body pushes it along, or is stuck [m]."""
_NET, _IDLE = 0.3, 2
"""What two sides push back and forth, and get no farther than this share of its way so
many times, is wedged between them."""
_WORSE, _OFTEN = 750.0, 3
"""What gave way, and is pushed harder at such a rate all the same [N/s], for so many
periods one after another, is wedged: it turns onto what pushes it."""
_PATCH = 0.5
"""Lever of the friction that resists a turn, as a share of a body's radius: a bar has
1/2, a disk 2/3."""


@dataclass(frozen=True, slots=True)
class Yielding:
    """How a pushed body gives way in one period."""

    way: FloatArray
    """[m], shape (3,)."""
    turn: float = 0.0
    """About the vertical through its centre of mass [rad]."""


@dataclass(slots=True, eq=False)
class Push:
    """A body that something pushes, and all that it pushes along."""

    bodies: list[int] = field(default_factory=list)
    """Their numbers."""
    weight: float = 0.0
    """Of them all [N]."""
    on_top: float = 0.0
    """Of what lies on them [N]."""
    centre: FloatArray = field(default_factory=lambda: np.zeros(3))
    """Their centre of mass [m]."""
    radius: float = 0.0
    """Largest distance of their points from the vertical through it [m]."""
    way: float = 0.0
    """How far they were pushed [m]."""
    is_lifted: bool = False
    """Whether all that lay on them was taken along."""
    is_stuck: bool = False
    felt: float = inf
    """What pushed them when they gave way in the last period [N]; infinite if they did
    not."""
    _depths: dict[tuple[int, int], float] = field(default_factory=dict)
    """How deep each was in others when it was taken along [m]."""
    _since_free: float = 0.0
    _net: FloatArray = field(default_factory=lambda: np.zeros(4))
    """What has come of that, turns by the radius [m]."""
    _n_idle: int = 0
    """So many times now hardly anything."""
    _n_worse: int = 0
    """So many times now they were pushed harder after that."""

    def take(self, bodies: Collection[int], rubble: Rubble) -> None:
        """Take bodies along from here on."""
        new = [body for body in bodies if body not in self.bodies]
        self.bodies += new
        self.is_lifted = False
        for body in new:
            for other, depth in rubble.depths(body).items():
                self._depths[body, other] = max(depth, 0.0)
        self._weigh(rubble)

    def leave(self, body: int, rubble: Rubble) -> None:
        """Leave a body behind."""
        self.bodies.remove(body)
        if self.bodies:
            self._weigh(rubble)

    def _weigh(self, rubble: Rubble) -> None:
        shapes = [rubble.shapes[body] for body in self.bodies]
        masses = np.array([shape.mass for shape in shapes])
        self.weight = GRAVITY * float(masses.sum())
        on_top = dict[int, float]()
        for body in self.bodies:
            on_top |= rubble.riders(body)
        self.on_top = GRAVITY * sum(
            share * rubble.shapes[other].mass
            for other, share in on_top.items()
            if other not in self.bodies
        )
        self.centre = masses @ [shape.com for shape in shapes] / masses.sum()
        points = np.concatenate([shape.points for shape in shapes])
        beside = (points - self.centre)[:, :2]
        self.radius = float(np.linalg.norm(beside, axis=1).max())
        # More resists now: that what pushes grows says nothing.
        self.rest()

    def wanted(self, springs: Sequence[Spring], config: FakeConfig) -> Yielding | None:
        """How the springs of hands move the bodies in one period.

        They are lifted by what exceeds their weight, or slide and turn on the ground
        by what exceeds the friction under and over them, along the normal of an
        ellipsoid (Lynch and Mason: the limit surface); as far as the springs then push
        no harder.
        """
        if self.is_stuck:
            return None
        forces = -np.array([spring.force for spring in springs])
        sizes = np.linalg.norm(forces, axis=1)
        depths = np.array([spring.depth for spring in springs])
        stiffness = sizes / np.maximum(depths, sizes / config.contact_stiffness)
        x, y, up = forces.sum(axis=0).tolist()
        most, carried = _SPEED * config.period, self.weight + self.on_top
        if up > carried:
            rise = (up - carried) / float(stiffness.sum())
            return Yielding(np.array([0.0, 0.0, min(rise, most)]))
        arms = np.array([spring.point for spring in springs]) - self.centre
        levers = np.column_stack([-arms[:, 1], arms[:, 0]])
        moment = float((levers * forces[:, :2]).sum())
        friction = max(config.friction * (carried - up + self.on_top), 1e-6)
        lever = max(_PATCH * self.radius, 1e-3)
        load = hypot(x, y, moment / lever) / friction
        if load <= 1.0:
            return None
        gain = (1.0 - 1.0 / load) * load**2
        slide = np.array([x, y]) / friction**2
        turn = moment / (lever * friction) ** 2
        # Each spring is eased along the level part of its force.
        eased = (forces[:, :2] / sizes[:, None] * (slide + turn * levers)).sum(axis=1)
        gain /= max(float(stiffness @ eased**2), 1e-12)
        gain = min(gain, most / (hypot(*slide) + abs(turn) * self.radius))
        return Yielding(np.array([*(gain * slide), 0.0]), gain * turn)

    def feel(self, felt: float, config: FakeConfig) -> None:
        """Take note of what pushes the bodies now [N].

        What is pushed ever harder, though it gives way each time, is stuck.
        """
        is_worse = felt > self.felt + _WORSE * config.period
        self._n_worse = self._n_worse + 1 if is_worse else 0
        self.felt = inf
        self.is_stuck = self.is_stuck or self._n_worse >= _OFTEN

    def rest(self) -> None:
        """Take note that nothing pushes the bodies now."""
        self.felt, self._n_worse = inf, 0

    def move(self, by: Yielding, rubble: Rubble) -> float:
        """Move the bodies; how far [m]."""
        for body in self.bodies:
            rubble.shift(body, by.way)
        self.centre = self.centre + by.way
        if by.turn:
            for body in self.bodies:
                rubble.turn(body, by.turn, self.centre)
        gone = sqrt(float(by.way @ by.way)) + abs(by.turn) * self.radius
        self.way += gone
        self._since_free += gone
        self._net = self._net + np.array([*by.way, by.turn * self.radius])
        return gone

    def met(self, rubble: Rubble) -> set[int]:
        """Find what they were pushed into, now and then.

        What goes back and forth gets stuck, where it is: set back, it would strike the
        hand.
        """
        if self._since_free <= _CHECK:
            return set()
        is_idle = float(np.linalg.norm(self._net)) < _NET * self._since_free
        self._n_idle = self._n_idle + 1 if is_idle else 0
        self.is_stuck = self._n_idle >= _IDLE
        self._since_free, self._net = 0.0, np.zeros(4)
        return {
            other
            for body in self.bodies
            for other, depth in rubble.depths(body).items()
            if depth > self._depths.get((body, other), 0.0) + _MET
        } - {*self.bodies}


class Pushes:
    """All bodies that something pushes at present."""

    def __init__(self, rubble: Rubble, config: FakeConfig) -> None:
        self._rubble, self._config = rubble, config
        self._of: dict[int, Push] = {}

    def __len__(self) -> int:
        return len(self._of)

    def forget(self, body: int) -> list[int]:
        """Count a body as not pushed, and all that moved with it; return these."""
        push = self._of.get(body)
        return [] if push is None else self._taken_out(push)

    def ended(
        self, touched: Collection[int], is_near: Callable[[int], bool]
    ) -> list[Push]:
        """Take out those of bodies that nothing touches, and no hand is near to."""
        over = []
        for push in dict.fromkeys(self._of.values()):
            if any(body in touched for body in push.bodies):
                continue
            push.rest()
            if not any(is_near(body) for body in push.bodies):
                over.append(push)
                self._taken_out(push)
        return over

    def push(
        self,
        touched: Mapping[int, Sequence[Spring]],
        is_held: Callable[[int], bool],
    ) -> float:
        """Move bodies as `Push.wanted` says; how far at most [m].

        What gets in their way they push along, unless it is held.
        """
        pushing: dict[Push, list[Spring]] = {}
        for body, springs in touched.items():
            if body not in self._of:
                self._join(Push(), {body})
            pushing.setdefault(self._of[body], []).extend(springs)
        return max(
            (self._give_way(push, pushed, is_held) for push, pushed in pushing.items()),
            default=0.0,
        )

    def _give_way(
        self, push: Push, springs: Sequence[Spring], is_held: Callable[[int], bool]
    ) -> float:
        """Move what the springs push; how far [m]."""
        for body in [body for body in push.bodies if is_held(body)]:
            push.leave(body, self._rubble)
            del self._of[body]
        if not push.bodies:  # another push took them along
            return 0.0
        felt = float(np.linalg.norm(np.sum([s.force for s in springs], axis=0)))
        push.feel(felt, self._config)
        by = push.wanted(springs, self._config)
        if by is None:
            return 0.0
        push.felt = felt
        if by.way[2] > 0.0 and not push.is_lifted:
            above = [b for body in push.bodies for b in self._rubble.riders(body)]
            self._join(push, {body for body in above if not is_held(body)})
            push.is_lifted = True
        way = push.move(by, self._rubble)
        met = push.met(self._rubble)
        push.is_stuck |= any(body == GROUND or is_held(body) for body in met)
        if not push.is_stuck:
            self._join(push, met)
        return way

    def _join(self, push: Push, bodies: set[int]) -> None:
        """Let a push take bodies along, and those that are pushed with these."""
        for body in bodies:
            other = self._of.get(body, push)
            if other is not push:
                bodies = bodies | {*self._taken_out(other)}
                push.way = max(push.way, other.way)
                other.bodies = []
        new = bodies.difference(push.bodies)
        if new:
            push.take(new, self._rubble)
            self._of |= dict.fromkeys(new, push)

    def _taken_out(self, push: Push) -> list[int]:
        """Count a push as over; return the bodies that it moved."""
        for body in push.bodies:
            del self._of[body]
        return push.bodies
