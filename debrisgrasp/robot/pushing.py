"""Bodies that a hand pushes over the ground: how far, and until what."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from math import hypot, inf, sqrt

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._physics import GRAVITY

from .config import FakeConfig
from .rubble import Rubble
from .springs import Spring

__all__ = ["Push", "Pushes", "Yielding"]

_SPEED = 0.3
"""At which a body yields at most [m/s]."""
_CHECK = 0.003
"""After every so much of a push it is looked whether something is in the way [m]."""
_WEDGED = 0.003
"""Deeper than this in another than before, a pushed body is stuck [m]."""
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


@dataclass(slots=True)
class Push:
    """A body that something pushes."""

    body: int
    """Its number."""
    weight: float
    """Of the body [N]."""
    on_top: float
    """Of what lies on it [N]."""
    overlap: float
    """How deep it was in others when the push began [m]."""
    radius: float
    """Largest distance of its points from the vertical through its centre of mass [m].
    """
    way: float = 0.0
    """How far it was pushed [m]."""
    is_stuck: bool = False
    felt: float = inf
    """What pushed it when it gave way in the last period [N]; infinite if it did not.
    """
    _since_free: float = 0.0
    _net: FloatArray = field(default_factory=lambda: np.zeros(4))
    """What has come of that, turns by the radius [m]."""
    _n_idle: int = 0
    """So many times now hardly anything."""
    _n_worse: int = 0
    """So many times now it was pushed harder after that."""

    @classmethod
    def begun(cls, body: int, rubble: Rubble) -> Push:
        """Begin to push a body."""
        shape = rubble.shapes[body]
        beside = (shape.points - shape.com)[:, :2]
        return cls(
            body=body,
            weight=GRAVITY * shape.mass,
            on_top=GRAVITY * rubble.load_on(body),
            overlap=rubble.overlap(body),
            radius=float(np.linalg.norm(beside, axis=1).max()),
        )

    def wanted(
        self, springs: Sequence[Spring], com: FloatArray, config: FakeConfig
    ) -> Yielding | None:
        """How the springs of hands move the body in one period.

        It is lifted by what exceeds its weight, or slides and turns on the ground by
        what exceeds the friction under and over it, along the normal of an ellipsoid
        (Lynch and Mason: the limit surface); as far as the springs then push no harder.
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
        arms = np.array([spring.point for spring in springs]) - com
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
        """Take note of what pushes the body now [N].

        What is pushed ever harder, though it gives way each time, is stuck.
        """
        is_worse = felt > self.felt + _WORSE * config.period
        self._n_worse = self._n_worse + 1 if is_worse else 0
        self.felt = inf
        self.is_stuck = self.is_stuck or self._n_worse >= _OFTEN

    def rest(self) -> None:
        """Take note that nothing pushes the body now."""
        self.felt, self._n_worse = inf, 0

    def move(self, by: Yielding, rubble: Rubble) -> float:
        """Move the body, unless something turns out to be in its way; how far [m]."""
        rubble.shift(self.body, by.way)
        if by.turn:
            rubble.turn(self.body, by.turn)
        gone = sqrt(float(by.way @ by.way)) + abs(by.turn) * self.radius
        self.way += gone
        self._since_free += gone
        self._net = self._net + np.array([*by.way, by.turn * self.radius])
        if self._since_free > _CHECK:
            is_idle = float(np.linalg.norm(self._net)) < _NET * self._since_free
            self._n_idle = self._n_idle + 1 if is_idle else 0
            # It stays where it got stuck: set back, it would strike the hand.
            self.is_stuck = (
                rubble.overlap(self.body) > self.overlap + _WEDGED
                or self._n_idle >= _IDLE
            )
            self._since_free, self._net = 0.0, np.zeros(4)
        return gone


class Pushes:
    """All bodies that something pushes at present."""

    def __init__(self, rubble: Rubble, config: FakeConfig) -> None:
        self._rubble, self._config = rubble, config
        self._begun: dict[int, Push] = {}

    def __len__(self) -> int:
        return len(self._begun)

    def forget(self, body: int) -> None:
        """Count a body as not pushed."""
        self._begun.pop(body, None)

    def ended(
        self, touched: Collection[int], is_near: Callable[[int], bool]
    ) -> list[Push]:
        """Take out those of bodies that nothing touches, and no hand is near to."""
        free = [body for body in self._begun if body not in touched]
        for body in free:
            self._begun[body].rest()
        over = [body for body in free if not is_near(body)]
        return [self._begun.pop(body) for body in over]

    def push(self, body: int, springs: Sequence[Spring]) -> float | None:
        """Move a body as `Push.wanted` says; how far [m], or nothing if it stays."""
        if body not in self._begun:
            self._begun[body] = Push.begun(body, self._rubble)
        push = self._begun[body]
        com = self._rubble.shapes[body].com
        felt = float(np.linalg.norm(np.sum([s.force for s in springs], axis=0)))
        push.feel(felt, self._config)
        by = push.wanted(springs, com, self._config)
        if by is None:
            return None
        push.felt = felt
        return push.move(by, self._rubble)
