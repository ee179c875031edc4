"""When fingers hold a body, and how much of its weight they carry."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import atan, cos, dist, hypot, pi, sqrt
from typing import NamedTuple

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.control._rigid import Vector
from debrisgrasp.prototypes import GripperModel

from .config import FakeConfig
from .shapes import BodyShape
from .springs import PALM, Spring
from .touch import Touch

__all__ = ["NO_GRIP", "Grip", "Hold", "Seat", "is_enclosed", "sides_of"]

_LEAST = 2.0
"""Force of a side below which it does not hold [N]."""
_GONE = 0.2
"""Less weight than this is none [N]."""
_JOLT = (5.0, 1.5)
"""Smaller changes of what pushes a hand are none at once [N, N m]."""
_PATCH = 0.02
"""Pads lie flat on what they hold: so far the middle of their pressure may shift, both
sides together [m]."""


@dataclass(slots=True)
class Seat:
    """What a body rested on when it was gripped; carries it until it is lifted."""

    com: FloatArray
    """Where its centre of mass was [m], odom."""
    stiffness: float
    friction: float
    on_ground: bool

    def force(self, body: BodyShape, weight: float) -> FloatArray:
        """Force on the body [N], shape (3,); it follows a body that slides."""
        gap = body.com - self.com
        up = min(max(weight - self.stiffness * gap[2], 0.0), weight)
        pull = -self.stiffness * gap[:2]
        size, most = float(np.hypot(*pull)), self.friction * up
        if size > most:
            pull *= most / size
            self.com[:2] = body.com[:2] + pull / self.stiffness
        return np.array([*pull, up])


@dataclass(slots=True)
class Hold:
    """A body that moves with a hand."""

    index: int
    """Number of the body."""
    R: FloatArray
    """Pose of the body in the hand, shape (3, 3) ..."""
    p: FloatArray
    """... and (3,) [m]."""
    seat: Seat | None
    start: FloatArray
    """Where its centre of mass was when it was gripped [m], odom."""
    settled_at: FloatArray
    """Where it was when its neighbours last sank to rest."""
    neighbours: set[int]
    """Bodies that touched it then."""
    n_settled: int = 0
    riders: dict[int, float] = field(default_factory=dict)
    """Bodies that lie on it, and the share of their weight that it carries."""
    borne: dict[int, float] = field(default_factory=dict)
    """Weight of each that it bears by now [N]: it comes on, and goes, bit by bit."""
    fading: list[Spring] = field(default_factory=list)
    """What is left of pushes that ended, and with the other sign of those that came,
    at once: frame of the hand."""
    is_changing: bool = False
    """Whether any of those weights is not yet what it will be."""
    is_slipping: bool = False
    slipped: float = 0.0
    """How far it has slipped since it was gripped [m]."""
    turn: Vector = (0.0, 0.0, 0.0)
    """By which it turned in the fingers in the last period, frame of the hand [rad]."""

    @property
    def is_loading(self) -> bool:
        """Whether what it bears still changes."""
        return self.is_changing or bool(self.fading)

    def load(
        self, wanted: Mapping[int, float], grown: Mapping[int, float], share: float
    ) -> None:
        """Let weights (body: [N]) come on, and go.

        Parameters
        ----------
        grown
            By how much each may grow [N]: what springs take up on the way moved.
        share
            Of what is over by which they may fall.
        """
        borne = {}
        for body in {*self.borne, *wanted}:
            now, then = self.borne.get(body, 0.0), wanted.get(body, 0.0)
            step = then - now
            step = min(step, grown[body]) if step > 0.0 else share * step
            value = now + step
            if body in wanted or value > _GONE:
                borne[body] = value
        self.is_changing = any(
            abs(value - wanted.get(body, 0.0)) > _GONE for body, value in borne.items()
        )
        self.borne = borne

    def fade(self, share: float) -> None:
        """Let go of a share of what is left of pushes that changed at once."""
        self.fading = [
            spring._replace(force=(1.0 - share) * spring.force)
            for spring in self.fading
            if float(spring.force @ spring.force) > _GONE**2
        ]

    def feel(
        self,
        before: Sequence[Spring],
        after: Sequence[Spring],
        moved: float,
        config: FakeConfig,
    ) -> None:
        """Let what pushes a hand, in its frame, become other pushes.

        Where they change by more than anything moved, they do so bit by bit: what
        begins to ride on a body pushes it no more, and one that is jammed is pushed by
        another side. Then the arm is not bent any more against whatever else pushes.

        Parameters
        ----------
        moved
            How far any of it came in the meantime [m].
        """
        if _is_sudden(before, after, moved, config):
            self.fading += before
            self.fading += [spring._replace(force=-spring.force) for spring in after]


class Grip(NamedTuple):
    """What the contacts of a hand with what it holds amount to."""

    contacts: Sequence[Spring]
    """Frame of the hand."""
    sides: tuple[list[Spring], list[Spring]]
    """Of the thumb's side, and of the pair's."""
    squeeze: float
    """Force of the weaker side [N]."""
    hook: float
    """How much the contacts face the palm, summed: fingers curled around a body keep
    it in the hand without friction."""
    felt: list[float]
    """Force on each finger, against its closing [N]."""

    @classmethod
    def of(cls, contacts: Sequence[Spring], body: int, touch: Touch) -> Grip:
        """Sum contacts up, in the frame of the hand, with the body that is held."""
        hand = touch.gripper.model
        sides = sides_of(contacts, body, hand)
        squeeze = min(
            _squeeze_of(side, sign) for side, sign in zip(sides, (-1, 1), strict=True)
        )
        felt = [0.0] * len(hand.fingers)
        for spring in contacts:
            if spring.owner > PALM:
                felt[spring.owner - 1] += touch.felt(spring.owner, *spring[2:4])
        return cls(contacts, sides, squeeze, _hook_of((*sides[0], *sides[1])), felt)


NO_GRIP = Grip((), ([], []), 0.0, 0.0, [])


def _is_sudden(
    before: Sequence[Spring],
    after: Sequence[Spring],
    moved: float,
    config: FakeConfig,
) -> bool:
    """Whether pushes on a hand change by more than what moved can have changed them.

    However many touch, the hand is pushed no more stiffly than its arm bends.
    """
    if not (before or after):
        return False
    wrenches = [
        (
            sum((spring.force for spring in springs), np.zeros(3)),
            sum(
                (np.cross(spring.point, spring.force) for spring in springs),
                np.zeros(3),
            ),
        )
        for springs in (before, after)
    ]
    forces, moments = zip(*wrenches, strict=True)
    stiffness = config.stiffness
    twist = 0.5 * sqrt(stiffness * config.turn_stiffness)
    return (
        dist(*forces) > _JOLT[0] + stiffness * moved
        or dist(*moments) > _JOLT[1] + twist * moved
    )


def sides_of(
    springs: Sequence[Spring], body: int, hand: GripperModel
) -> tuple[list[Spring], list[Spring]]:
    """Contacts of a body with the fingers of the thumb's side and of the pair's."""
    sides: tuple[list[Spring], list[Spring]] = ([], [])
    for spring in springs:
        if spring.body == body and spring.owner > PALM:
            sides[hand.fingers[spring.owner - 1].side > 0].append(spring)
    return sides


def is_enclosed(
    thumb: Sequence[Spring], pair: Sequence[Spring], friction: float
) -> bool:
    """Whether the contacts of two sides oppose each other within their friction."""
    if not thumb or not pair:
        return False
    (c_thumb, f_thumb), (c_pair, f_pair) = _mean(thumb), _mean(pair)
    if min(np.linalg.norm(f_thumb), np.linalg.norm(f_pair)) < _LEAST:
        return False
    way = c_pair - c_thumb
    length = float(np.linalg.norm(way))
    if length < 1e-4:
        return False
    least = cos(atan(friction))
    # Where pads press may shift, not in which direction: that is the surfaces'.
    size = float(np.linalg.norm(f_thumb)) * float(np.linalg.norm(f_pair))
    if -float(f_thumb @ f_pair) < cos(min(2.0 * atan(friction), pi)) * size:
        return False
    # On the body the forces are the other way round than on the hand.
    for force in (-f_thumb, f_pair):
        push = force / float(np.linalg.norm(force))
        along = float(push @ way)
        aside = max(float(np.linalg.norm(way - along * push)) - _PATCH, 0.0)
        if along < least * hypot(along, aside):
            return False
    return True


def _mean(side: Sequence[Spring]) -> tuple[FloatArray, FloatArray]:
    """Centre of the contacts of a side, and the sum of their forces on the hand."""
    weights = np.array([float(np.linalg.norm(spring.force)) for spring in side])
    points = np.array([spring.point for spring in side])
    force = np.sum([spring.force for spring in side], axis=0)
    return weights @ points / weights.sum(), np.asarray(force)


def _squeeze_of(side: Sequence[Spring], sign: int) -> float:
    """Sum of the forces of one side, frame of the hand [N].

    What presses a finger of the thumb's side (-1) or of the pair's (1) further open is
    not between the two.
    """
    return sum(
        float(np.linalg.norm(spring.force))
        for spring in side
        if sign * spring.force[0] > 0.0
    )


def _hook_of(springs: Sequence[Spring]) -> float:
    """How much contacts of fingers, in the frame of the hand, face the palm, summed."""
    total = 0.0
    for spring in springs:
        facing = float(spring.force[2]) / float(np.linalg.norm(spring.force))
        total += max(facing, 0.0)
    return total
