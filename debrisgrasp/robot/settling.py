"""Bodies that sink to rest among hands, which are in their way as anything else is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._words import arm_called
from debrisgrasp.geometry import SE3
from debrisgrasp.worlds import Body
from debrisgrasp.worlds.body import as_part

from .fake_arm import FakeArm, FakeForceSensor
from .fake_hand import FakeGripper
from .holding import NO_GRIP, Grip, Hold
from .rubble import Rubble
from .shapes import BodyShape
from .springs import Spring
from .touch import Touch

__all__ = ["HandState", "Settling"]

_FOLLOWS = 0.02
"""A hand that has moved by so much no longer props what lay against it [m]."""

_LEANS = 0.01
"""A body so near to a hand when it came to rest may lean against it [m]."""


@dataclass(slots=True, eq=False)
class HandState:
    """One hand and what it does."""

    arm: FakeArm
    gripper: FakeGripper
    sensor: FakeForceSensor
    touch: Touch
    hold: Hold | None = None
    seen: tuple[object, ...] | None = None
    springs: Sequence[Spring] = ()
    R: FloatArray = field(default_factory=lambda: np.eye(3))
    """Pose of the hand in odom, shape (3, 3) ..."""
    p: FloatArray = field(default_factory=lambda: np.zeros(3))
    """... and (3,) [m]."""
    grip: Grip = NO_GRIP
    """What the fingers do to what it holds."""

    def as_body(self) -> Body:
        """Palm and fingers where they are, as something to lie on."""
        parts = tuple(as_part(solid) for solid in self.gripper.solids())
        name = f"hand of the {arm_called(self.arm.name)}"
        place = SE3.from_parts(self.R, self.p)
        return Body(name, "hand", parts, self.gripper.model.mass, place)

    def is_at(self, bodies: set[int], rubble: Rubble) -> bool:
        """Whether it is near one of some bodies, and does not hold it."""
        held = set() if self.hold is None else {self.hold.index}
        return any(
            float(np.linalg.norm(shape.middle - self.p))
            < shape.radius + self.touch.shape.radius
            for shape in (rubble.shapes[body] for body in bodies - held)
        )


class Settling:
    """Lets bodies come to rest, and again when the hand that props them has gone."""

    def __init__(self, rubble: Rubble, hands: Sequence[HandState]) -> None:
        self._rubble, self._hands = rubble, hands
        self._leaning: dict[int, Sequence[float]] = {}
        """Bodies that came to rest against a hand or what it holds, and where the hands
        were."""

    def settle(
        self, loose: set[int], held: set[int], passed: HandState | None = None
    ) -> None:
        """Let bodies sink to rest.

        Parameters
        ----------
        held
            Bodies in hands, which stay.
        passed
            A hand that they are past already: they slipped out of it.
        """
        near = [
            hand
            for hand in self._hands
            if hand is not passed and hand.is_at(loose, self._rubble)
        ]
        props = [hand.as_body() for hand in near]
        moved = self._rubble.settle(loose, held, props)
        for hand in self._hands:
            hand.touch.settled(loose | moved)
        shapes = [BodyShape(prop) for prop in props]
        shapes += [self._rubble.shapes[body] for body in held]
        for body in (loose | moved) - held:
            self._leaning.pop(body, None)
            if any(self._leans(body, shape) for shape in shapes):
                self._leaning[body] = self._places()

    def _leans(self, body: int, prop: BodyShape) -> bool:
        """Whether a body that came to rest touches a hand, or what is in it."""
        shape = self._rubble.shapes[body]
        gaps = prop.deepest(shape.points)[0], shape.deepest(prop.points)[0]
        return max(gaps) > -_LEANS

    @property
    def is_leaning(self) -> bool:
        """Whether something lies against a hand, or what it holds."""
        return bool(self._leaning)

    def follow(self) -> None:
        """Let what lay against a hand that has moved away sink on.

        What rides on what is held goes with it.
        """
        now = self._places()
        due = {
            body
            for body, then in self._leaning.items()
            if max(abs(a - b) for a, b in zip(now, then, strict=True)) > _FOLLOWS
        }
        if not due:
            return
        holds = [hand.hold for hand in self._hands if hand.hold is not None]
        held = {hold.index for hold in holds}
        due = due.difference(held, *(hold.riders for hold in holds))
        if due:
            self.settle(due, held)

    def _places(self) -> list[float]:
        """Places and openings of all hands [m]."""
        return [
            value
            for hand in self._hands
            for value in (*hand.p.tolist(), *hand.gripper.openings)
        ]
