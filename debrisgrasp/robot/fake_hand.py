"""A hand in memory: fingers that move at a limited speed and with a limited force."""

from __future__ import annotations

from math import isfinite

from debrisgrasp.control import GripCommand
from debrisgrasp.geometry import Solid
from debrisgrasp.prototypes import GripperModel

from .config import FakeConfig
from .drives import Timeline, Violation
from .interface import HandReading

__all__ = ["FakeGripper"]

_EXTRA = 0.05
"""So much more than asked for do fingers squeeze, so that they reach it [N]."""
_STILL = 2e-7
"""Smaller steps of a finger that squeezes are left out [m]."""
_TOLERANCE = 1e-3
"""By which a commanded opening may miss the range of the hand [m]."""


class FakeGripper:
    """Fingers of one hand; fulfils `debrisgrasp.robot.Gripper`."""

    def __init__(
        self,
        model: GripperModel,
        timeline: Timeline,
        config: FakeConfig,
        violations: list[Violation],
    ) -> None:
        self.model = model
        self._timeline, self._config, self._violations = timeline, config, violations
        self.shape = next(iter(model.preshapes))
        """Present preshape."""
        n = len(model.fingers)
        widest = model.opening_range[1]
        self.openings = [widest] * n
        """Of each finger [m]."""
        self.forces = [0.0] * n
        """With which what a finger touches resists its closing [N]."""
        self._goals = [widest] * n
        self.force = model.max_force
        """Largest that the fingers of a side exert together now [N]."""
        sides = [finger.side for finger in model.fingers]
        self.peers = [sides.count(side) for side in sides]
        """How many share the force of their side, for each finger."""
        self._is_initialised = config.is_initialised
        self._ready_at: float | None = None

    @property
    def name(self) -> str:
        """Name of the hand's model."""
        return self.model.name

    @property
    def is_initialised(self) -> bool:
        """Whether it takes commands."""
        return self._is_initialised

    def initialise(self) -> None:
        """Find the zero of the fingers; takes a moment."""
        if not self._is_initialised and self._ready_at is None:
            self._ready_at = self._timeline.now + self._config.initialise_time

    def preshape(self, name: str, opening: float) -> None:
        """Begin to take a preshape, with all the force that the hand has."""
        if self._refuses():
            return
        self.model.opening_to_command(name, opening)
        self.shape = name
        widest = self._range()[1]
        self.openings = [min(value, widest) for value in self.openings]
        self._goals = [float(opening)] * len(self._goals)
        self.force = self.model.max_force

    def command(self, command: GripCommand) -> None:
        """Send the pads somewhere; what the hand cannot do is refused."""
        if self._refuses():
            return
        low, high = self._range()
        values, force = tuple(command.openings), command.force
        if len(values) != len(self._goals) or not isfinite(sum(values) + force):
            self._report(f"commanded openings {values}, force {force}")
            return
        is_beyond = min(values) < -_TOLERANCE or max(values) > high + _TOLERANCE
        if is_beyond or not 0.0 <= force <= self.model.max_force + 1e-9:
            self._report(
                f"commanded openings {values} and {force:g} N; it has 0 to {high:g} m "
                f"and {self.model.max_force:g} N"
            )
            return
        self._goals = [min(max(value, low), high) for value in values]
        self.force = float(force)

    def read(self) -> HandReading:
        """Read openings and forces of the fingers."""
        openings = tuple(self.openings)
        return HandReading(self._timeline.now, openings, tuple(self.forces))

    @property
    def is_still(self) -> bool:
        """Whether all fingers are where they were sent, without resistance."""
        return self.openings == self._goals and not any(self.forces)

    @property
    def is_opening(self) -> bool:
        """Whether fingers were sent farther out than they are, and none farther in."""
        ways = [goal - at for goal, at in zip(self._goals, self.openings, strict=True)]
        return min(ways) >= 0.0 and max(ways) > 0.0

    @property
    def is_wide_open(self) -> bool:
        """Whether all fingers were sent to the end of their range, and are there."""
        widest = self._range()[1] - _TOLERANCE
        return min(*self.openings, *self._goals) >= widest

    def solids(self) -> tuple[Solid, ...]:
        """Palm and fingers as they stand, in the frame of the hand."""
        shape = self.model.preshape(self.shape)
        fingers = [
            solid
            for finger, opening in zip(self.model.fingers, self.openings, strict=True)
            for solid in finger.solids(
                shape.values(self.model.opening_to_command(self.shape, opening))
            )
        ]
        return (*self.model.palm, *fingers)

    def advance(self) -> bool:
        """Let a period pass; return whether a finger moved."""
        if self._ready_at is not None and self._timeline.now >= self._ready_at:
            self._ready_at, self._is_initialised = None, True
        if self.is_still:
            return False
        before = tuple(self.openings)
        most = self._config.finger_speed * self._timeline.period
        low, high = self._range()
        for i, goal in enumerate(self._goals):
            step = min(max(goal - self.openings[i], -most), most)
            resistance = self.forces[i]
            if resistance > 0.0 and step < 0.0:
                give = self._give(i, resistance)
                step = min(max(step, give), most) if abs(give) > _STILL else 0.0
            elif resistance < 0.0 and step > 0.0:
                give = self._give(i, -resistance)
                step = max(min(step, -give), -most) if abs(give) > _STILL else 0.0
            self.openings[i] = min(max(self.openings[i] + step, low), high)
        return tuple(self.openings) != before

    def _give(self, i: int, resistance: float) -> float:
        """How far a finger that presses against something gives way to it [m].

        Below zero it goes on, as far as the spring of the contact takes up its share of
        the force; it stands all that the other side can exert.
        """
        over = resistance - self.force / self.peers[i] - _EXTRA
        if over > 0.0:
            over = max(resistance - self.force - _EXTRA, 0.0)
        return over / self._config.contact_stiffness

    def _range(self) -> tuple[float, float]:
        shape = self.model.preshape(self.shape)
        return shape.narrowest, shape.widest

    def _refuses(self) -> bool:
        if not self._is_initialised:
            self._report("commanded before it was initialised")
        return not self._is_initialised

    def _report(self, message: str) -> None:
        device = f"gripper {self.name}"
        self._violations.append(Violation(self._timeline.now, device, message))
