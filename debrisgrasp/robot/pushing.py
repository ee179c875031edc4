"""Bodies that a hand pushes over the ground: how far, and until what."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._physics import GRAVITY

from .config import FakeConfig
from .rubble import Rubble

__all__ = ["Push", "Pushes"]

_SPEED = 0.3
"""At which a body yields at most [m/s]."""
_CHECK = 0.003
"""After every so much of a push it is looked whether something is in the way [m]."""
_WEDGED = 0.003
"""Deeper than this in another than before, a pushed body is stuck [m]."""


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
    way: float = 0.0
    """How far it was pushed [m]."""
    is_stuck: bool = False
    _since_free: FloatArray = field(default_factory=lambda: np.zeros(3))

    @classmethod
    def begun(cls, body: int, rubble: Rubble) -> Push:
        """Begin to push a body."""
        return cls(
            body=body,
            weight=GRAVITY * rubble.shapes[body].mass,
            on_top=GRAVITY * rubble.load_on(body),
            overlap=rubble.overlap(body),
        )

    def wanted(
        self, force: FloatArray, config: FakeConfig, stiffness: float
    ) -> FloatArray | None:
        """How far a force (3,) [N] moves the body in one period [m], shape (3,).

        It slides by what exceeds the friction under and over it, or is lifted by what
        exceeds its weight; as far as the springs, together as stiff as given [N/m],
        then push no harder.
        """
        if self.is_stuck:
            return None
        most, carried = _SPEED * config.period, self.weight + self.on_top
        if force[2] > carried:
            up = (force[2] - carried) / stiffness
            return np.array([0.0, 0.0, min(up, most)])
        size = float(np.hypot(force[0], force[1]))
        excess = size - config.friction * (carried - force[2] + self.on_top)
        if excess <= 0.0:
            return None
        step = min(excess / stiffness, most)
        return np.array([step / size * force[0], step / size * force[1], 0.0])

    def move(self, way: FloatArray, rubble: Rubble) -> None:
        """Move the body by (3,) [m], unless something turns out to be in its way."""
        rubble.shift(self.body, way)
        self.way += float(np.linalg.norm(way))
        self._since_free = self._since_free + way
        if float(np.linalg.norm(self._since_free)) > _CHECK:
            # It stays where it got stuck: set back, it would strike the hand.
            self.is_stuck = rubble.overlap(self.body) > self.overlap + _WEDGED
            self._since_free = np.zeros(3)


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
        over = [b for b in self._begun if b not in touched and not is_near(b)]
        return [self._begun.pop(body) for body in over]

    def push(self, body: int, force: FloatArray, stiffness: float) -> float | None:
        """Move a body as `Push.wanted` says; how far [m], or nothing if it stays."""
        if body not in self._begun:
            self._begun[body] = Push.begun(body, self._rubble)
        push = self._begun[body]
        way = push.wanted(force, self._config, stiffness)
        if way is None:
            return None
        push.move(way, self._rubble)
        return float(np.linalg.norm(way))
