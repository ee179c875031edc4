"""Fingers: take the preshape, close until they meet resistance, hold on, notice a loss.

As everywhere in control, a step is a pure function: measurement in, command out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from math import exp, isfinite
from typing import NamedTuple

from debrisgrasp._arrays import require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp.errors import ConfigError

from ._rigid import floats_of, number_of

__all__ = [
    "STILL_FELT",
    "FingerReading",
    "GripCommand",
    "GripConfig",
    "GripController",
    "GripPhase",
    "GripState",
]


class GripPhase(Enum):
    """How a grip stands."""

    PRESHAPING = "taking the preshape"
    READY = "the fingers stand as for the approach"
    CLOSING = "closing"
    HOLDING = "holding"
    EMPTY = "nothing between the fingers"
    SLIPPED = "the object slips"
    JAMMED = "a finger does not move"
    LOST = "no usable reading of the fingers"


_CROSSED, _WIDEST = 0.02, 1.0
"""Fingers that pass each other are so far below zero at most, and no hand opens farther
than this: beyond it a length was meant in millimetres [m]."""
_PRESSES, _SHUT = 0.5, 0.8
"""While the weaker side feels so much of the squeeze, or the wrist bears all the
weight, fingers that close slowly by up to so much of the way to each other have only
found a better hold: those that curl around something close, too."""
STILL_FELT = 1.0
"""Both sides feel at least so much of what is between them [N]."""
_SLOWLY = 0.4
"""Time constant over which held fingers are followed [s]: those that get ahead of that
are leaving their object, however hard they press."""
_FELT = 0.8
"""A finger that exerts its share of the resistance may feel so much of that only: the
rest goes into its joints, or into pushing the object along."""
_SPIKE = 2.0
"""Of its share of the resistance; no more is believed of one reading."""
_SHORTEST = 1e-6
"""Fingers do move, and time passes [m/s and s]."""
_POSITIVE = ("speed", "period", "timeout")
_LENGTHS = ("opening", "width", "empty_margin", "tolerance", "slip_travel")
_ENDED = (GripPhase.EMPTY, GripPhase.SLIPPED, GripPhase.JAMMED, GripPhase.LOST)


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class GripConfig:
    """One grip, taken from the prototype that the planner chose."""

    opening: float
    """Distance between the pads during the approach: the preshape [m]."""
    width: float
    """Distance at which the object is expected [m]."""
    resistance: float = 20.0
    """Of the fingers of one side together [N], the preset of the task: a finger that
    feels most of its share of it stops closing. Lower is gentler on what is fragile;
    too low stops at friction in the joints."""
    tau: float = 0.0
    """Time constant over which what closing fingers feel is smoothed [s]: one that
    exerts its share stops after 1.6 of it, and no spike stops one for good. 0: one
    reading does, as where a driver smooths. At 0.05 and 250 Hz, noise may be as
    large as a share."""
    squeeze: float = 40.0
    """Of one side, held from then on [N]; more holds heavier things, up to what the
    hand can."""
    speed: float = 0.05
    """At which the pads close [m/s]."""
    empty_margin: float = 0.015
    """Closed by more than this beyond ``width`` without resistance, the hand counts as
    empty [m]."""
    tolerance: float = 0.003
    """At which the preshape counts as taken [m]."""
    timeout: float = 4.0
    """For preshape and closing each [s]."""
    slip_travel: float = 0.005
    """Fingers that close so much while holding have lost their object [m]; if they do
    so within some 0.4 s, in any case. More slowly they may close by 0.8 of the way to
    each other while both sides press at least half as hard as they should, or the
    wrist bears the weight. Those of a side that have shut, and feel nothing, have lost
    it at once."""
    slip_load: float = 0.3
    """So does a carried load that falls by this share."""
    slip_time: float = 0.05
    """For so long, before it counts [s]."""
    sides: tuple[int, ...] = (-1, 1)
    """Of each finger -1 or 1, as `Finger.side`: those with the same number press the
    same way. Each side must feel the object, and both together must close for a slip.
    By default one finger on each."""
    period: float = 0.004
    """Of the control loop [s]."""
    max_force: float = 60.0
    """Of one side of the hand [N]; `squeeze` may not be more."""

    def __post_init__(self) -> None:
        for name in self.__slots__:
            if name == "sides":
                continue
            most = _WIDEST if name in _LENGTHS else 1e4
            most = 1.0 if name in ("slip_load", "tau") else most
            least = _SHORTEST if name in _POSITIVE else 0.0
            require_range(f"GripConfig.{name}", getattr(self, name), least, most)
        sides = self.sides if isinstance(self.sides, tuple) else ()
        if any(x not in (-1, 1) for x in sides) or not {-1, 1} <= set(sides):
            raise ConfigError(
                "GripConfig.sides",
                got=repr(self.sides),
                expected="a tuple of -1 or 1 for each finger, and both of them",
            )
        if not self.resistance <= self.squeeze <= self.max_force:
            raise ConfigError(
                "forces of a grip [N]",
                got=f"resistance {self.resistance:g}, squeeze {self.squeeze:g}",
                expected=f"resistance <= squeeze <= {self.max_force:g}",
            )
        if not self.width <= self.opening:
            raise ConfigError(
                "opening of a grip [m]",
                got=f"{self.opening:g}",
                expected=f"at least the width {self.width:g}",
            )


class FingerReading(NamedTuple):
    """What the hand measured."""

    openings: Sequence[float]
    """Of each finger: distance of its pad from the opposing one [m], f of them."""
    forces: Sequence[float]
    """Resistance that each finger feels [N], f of them."""
    carried: float | None = None
    """Weight that the wrist carries for the object [N]; None: not known."""


class GripState(NamedTuple):
    """What passes from one tick to the next."""

    phase: GripPhase
    targets: tuple[float, ...]
    """Where each pad is sent [m]."""
    is_stopped: tuple[bool, ...]
    """Which fingers have met resistance."""
    elapsed: float = 0.0
    """In this phase [s]."""
    felt: tuple[float, ...] = ()
    """Smoothed force of each finger since it began to close [N]; empty: none yet."""
    held_openings: tuple[float, ...] = ()
    """When holding began [m]."""
    recent_openings: tuple[float, ...] = ()
    """Smoothed since then [m]; empty: no look yet."""
    most_carried: float = 0.0
    """Largest weight carried so far, by two looks in a row [N]."""
    slipping: float = 0.0
    """How long there have been signs of slip [s]."""
    carried: float = 0.0
    """Weight carried at the last look [N]."""

    def held_from(self, openings: tuple[float, ...]) -> GripState:
        """Count as closing only what fingers at these openings [m] do from now on."""
        return self._replace(held_openings=openings, recent_openings=())


class GripCommand(NamedTuple):
    """What the hand is to do."""

    openings: tuple[float, ...]
    """Where each pad should go [m]."""
    force: float
    """Largest force of the fingers of one side together [N], of which each exerts an
    equal share."""


class GripController:
    """Runs one grip of a hand with any number of fingers."""

    def __init__(self, config: GripConfig) -> None:
        self.config = config
        sides = config.sides
        self._groups = [
            [i for i, other in enumerate(sides) if other == side]
            for side in sorted(set(sides))
        ]
        self._shares = [config.resistance / sides.count(side) for side in sides]
        is_smooth = config.tau > 0.0
        self._alpha = 1.0 - exp(-config.period / config.tau) if is_smooth else 1.0
        self._beta = 1.0 - exp(-config.period / _SLOWLY)

    def preshape(self) -> GripState:
        """Begin to take the preshape."""
        n = len(self.config.sides)
        return GripState(GripPhase.PRESHAPING, (self.config.opening,) * n, (False,) * n)

    def close(self, state: GripState) -> GripState:
        """Begin to close; only from a preshape that was taken.

        Raises
        ------
        ConfigError
            If the fingers do not stand ready.
        """
        if state.phase is not GripPhase.READY:
            raise ConfigError(
                "phase of the grip before closing",
                got=state.phase.value,
                expected=GripPhase.READY.value,
            )
        return state._replace(phase=GripPhase.CLOSING, elapsed=0.0)

    def travel(self, before: Sequence[float], now: Sequence[float]) -> float:
        """How far fingers have closed upon each other [m].

        Parameters
        ----------
        before, now
            Their openings [m], f of them each.
        """
        closed = [a - b for a, b in zip(before, now, strict=True)]
        means = [sum(closed[i] for i in group) / len(group) for group in self._groups]
        return sum(means) / len(means)

    def weakest(self, forces: Sequence[float]) -> float:
        """Force of the side whose fingers feel least together [N]."""
        return min(self.pressed(forces))

    def pressed(self, forces: Sequence[float]) -> list[float]:
        """Sum up what the fingers of each side feel against their closing [N]."""
        return [sum(max(forces[i], 0.0) for i in group) for group in self._groups]

    def step(
        self, state: GripState, reading: FingerReading
    ) -> tuple[GripState, GripCommand]:
        """One tick; a phase that ended without a grip keeps the fingers where they are.

        A lost reading, like a slip, goes on squeezing: letting go is worse. An opening
        below zero by more than 2 cm, or above 1 m, is no reading. No pad is sent beyond
        zero or the opening of the preshape.
        """
        config = self.config
        reading = _plain(reading)
        if not self._is_usable(reading, len(state.targets)):
            if state.phase not in _ENDED:
                state = state._replace(phase=GripPhase.LOST)
        elif state.phase is GripPhase.PRESHAPING:
            state = self._preshaping(state, reading)
        elif state.phase is GripPhase.CLOSING:
            state = self._closing(state, reading)
        elif state.phase is GripPhase.HOLDING:
            state = self._holding(state, reading)
        targets = tuple([min(max(x, 0.0), config.opening) for x in state.targets])
        state = state._replace(elapsed=state.elapsed + config.period, targets=targets)
        is_squeezing = any(state.is_stopped) or state.phase is GripPhase.SLIPPED
        force = config.squeeze if is_squeezing else config.resistance
        return state, GripCommand(state.targets, force)

    def _is_usable(self, reading: FingerReading, n: int) -> bool:
        """Whether all fingers are there, with numbers that a hand can have."""
        return len(reading.openings) == len(reading.forces) == n and all(
            -_CROSSED <= opening <= _WIDEST for opening in reading.openings
        )

    def _preshaping(self, state: GripState, reading: FingerReading) -> GripState:
        gap = max(abs(x - self.config.opening) for x in reading.openings)
        if gap <= self.config.tolerance:
            return state._replace(phase=GripPhase.READY, elapsed=0.0)
        if state.elapsed > self.config.timeout:
            return state._replace(phase=GripPhase.JAMMED)
        return state

    def _closing(self, state: GripState, reading: FingerReading) -> GripState:
        config = self.config
        step = config.speed * config.period
        before = state.felt or (0.0,) * len(self._shares)
        felt = tuple(
            was + self._alpha * (min(force, _SPIKE * share) - was)
            for was, force, share in zip(
                before, reading.forces, self._shares, strict=True
            )
        )
        stopped = tuple(
            was or force >= _FELT * share
            for was, force, share in zip(
                state.is_stopped, felt, self._shares, strict=True
            )
        )
        targets = tuple(
            opening if is_stopped else max(target - step, 0.0)
            for opening, target, is_stopped in zip(
                reading.openings, state.targets, stopped, strict=True
            )
        )
        state = state._replace(targets=targets, is_stopped=stopped, felt=felt)
        least = max(config.width - config.empty_margin, 0.0)
        is_through = [
            not was and (x < least or (least == 0.0 and x <= config.tolerance))
            for x, was in zip(reading.openings, stopped, strict=True)
        ]
        have_ended = all(a or b for a, b in zip(stopped, is_through, strict=True))
        if have_ended and all(any(stopped[i] for i in side) for side in self._groups):
            # Squeezing sends the pads beyond the surface and lets the force decide.
            beyond = tuple(max(x - config.empty_margin, 0.0) for x in reading.openings)
            return state._replace(
                phase=GripPhase.HOLDING,
                targets=beyond,
                held_openings=tuple(reading.openings),
                elapsed=0.0,
            )
        is_empty = any(all(is_through[i] for i in side) for side in self._groups)
        # A side that is still on its way may yet move the object to the other.
        if is_empty and have_ended:
            return state._replace(
                phase=GripPhase.EMPTY, targets=tuple(reading.openings)
            )
        if state.elapsed > config.timeout:
            return state._replace(phase=GripPhase.JAMMED)
        return state

    def _holding(self, state: GripState, reading: FingerReading) -> GripState:
        config, now = self.config, reading.openings
        travel = self.travel(state.held_openings, now)
        recent = state.recent_openings or tuple(now)
        is_fast = self.travel(recent, now) >= config.slip_travel
        carried, most, last = reading.carried, state.most_carried, state.carried
        is_held = self.weakest(reading.forces) >= _PRESSES * config.squeeze
        has_fallen, most_travel = False, config.slip_travel
        if carried is not None and isfinite(carried):
            # Half a kilogram is where a share of the load rises above the noise.
            is_known = most > 5.0
            has_fallen = is_known and carried < (1.0 - config.slip_load) * most
            is_held = is_held or (is_known and not has_fallen)
            # One spike is no weight that could be lost.
            most, last = max(most, min(carried, last)), carried
        if is_held and not is_fast:
            shut = (0.0,) * len(config.sides)
            way = self.travel(state.held_openings, shut)
            most_travel = max(most_travel, _SHUT * way)
        is_past = self._is_past_a_side(reading)
        is_slipping = travel >= most_travel or has_fallen or is_past
        slipping = state.slipping + config.period if is_slipping else 0.0
        phase = GripPhase.SLIPPED if slipping > config.slip_time else state.phase
        recent = tuple(
            was + self._beta * (x - was) for was, x in zip(recent, now, strict=True)
        )
        return state._replace(
            recent_openings=recent,
            most_carried=most,
            slipping=slipping,
            carried=last,
            phase=phase,
        )

    def _is_past_a_side(self, reading: FingerReading) -> bool:
        """Whether fingers have shut on nothing: the others hook what they all held."""
        return any(
            all(
                reading.openings[i] <= self.config.tolerance
                and reading.forces[i] < STILL_FELT
                for i in side
            )
            for side in self._groups
        )


def _plain(reading: FingerReading) -> FingerReading:
    """Return the same as plain floats: none of a hand that tells no forces."""
    openings, forces = floats_of(reading.openings), floats_of(reading.forces)
    return FingerReading(openings, forces, number_of(reading.carried))
