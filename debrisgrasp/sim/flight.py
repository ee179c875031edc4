"""How a grasp is flown, and what became of it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np

from debrisgrasp._arrays import require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp.control import Compliance
from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import SE3, Solid
from debrisgrasp.worlds import World

from .fingers import HandPhysics
from .model import Physics
from .wrist import WristConfig

__all__ = ["Flight", "FlightConfig", "FlownGrasp", "Moment", "Verdict"]


class Verdict(Enum):
    """How a grasp ended."""

    HELD = "held"
    """The object rose with the hand and was still in it after the hold."""
    PULLED_CLEAR = "pulled_clear"
    """It was still in the hand, did not rise so far, as what hangs by an end, and was
    pulled out of the scene."""
    MISSED = "missed"
    """The fingers closed on nothing."""
    PUSHED_AWAY = "pushed_away"
    """The fingers closed on nothing, because the object had been moved before."""
    COLLISION_ON_APPROACH = "collision_on_approach"
    """The hand met resistance before its place, and did not hold the object."""
    SLIPPED = "slipped"
    """The object was in the hand, and left it or did not follow it."""
    TOO_HEAVY = "too_heavy"
    """The object alone needs more than the wrist has."""
    STUCK = "stuck"
    """The wrist gave way, though the object alone is not too heavy."""


class FlownGrasp(Protocol):
    """What a flight needs of a grasp; `debrisgrasp.planning.Grasp` has it."""

    @property
    def T_base_hand(self) -> SE3:
        """Palm pose when the fingers close."""
        ...

    @property
    def T_base_pregrasp(self) -> SE3:
        """Palm pose at which the straight approach starts."""
        ...

    @property
    def preshape(self) -> str:
        """Name of the preshape."""
        ...

    @property
    def opening(self) -> float:
        """Distance between the pads on the approach [m]."""
        ...

    @property
    def width(self) -> float:
        """Distance between the pads on the object [m]."""
        ...


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class FlightConfig:
    """How a grasp is flown, and what counts as held."""

    physics: Physics = Physics()
    hand: HandPhysics = HandPhysics()
    wrist: WristConfig = WristConfig()
    compliance: Compliance | None = None
    """How the hand gives way to the wrench before and during the lift; None lifts
    stiffly."""
    approach_speed: float = 0.15
    """[m/s]."""
    contact_force: float = 40.0
    """Force on the hand at which the approach ends [N]."""
    resistance: float = 10.0
    """Force of the fingers of a side until all have met something [N]."""
    closing_time: float = 3.6
    """Longest time for that [s]."""
    squeeze_time: float = 0.5
    """Time with the full force before the lift [s]."""
    settle_time: float = 1.0
    """Time in which a hand with a compliance gives way to what the squeeze left in it,
    before the lift [s]."""
    lift: tuple[float, float, float] = (0.0, 0.0, 0.25)
    """Way of the hand after it has gripped, base frame [m]."""
    lift_time: float = 2.0
    """[s]."""
    hold_time: float = 2.0
    """[s]."""
    least_rise: float = 0.15
    """How far the centre of mass must have moved along the lift at the end [m]."""
    pull: tuple[float, float, float] = (-0.5, 0.0, 0.0)
    """Way of the hand with what it still holds then but did not raise so far, base
    frame [m]."""
    pull_speed: float = 0.15
    """Greatest speed on that way [m/s]."""
    deepest: float = 0.002
    """Interpenetration of hand and object that is reported as gripping through [m]."""

    def __post_init__(self) -> None:
        require_range("approach_speed", self.approach_speed, 0.01, 2.0)
        require_range("pull_speed", self.pull_speed, 0.01, 2.0)
        require_range("length of pull", float(np.linalg.norm(self.pull)), 0.05, 5.0)
        require_range("resistance", self.resistance, 0.1, 1e4)
        require_range("least_rise", self.least_rise, 0.0, 5.0)
        require_range("deepest", self.deepest, 0.0, 1.0)
        for phase in ("closing", "squeeze", "settle", "lift", "hold"):
            name = f"{phase}_time"
            require_range(name, getattr(self, name), 0.05, 60.0)
        require_range("contact_force", self.contact_force, 1.0)
        length = float(np.linalg.norm(self.lift))
        if not self.least_rise < length:
            raise ConfigError(
                "lift", got=f"{length:g} m", expected="more than least_rise"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """Where all was at the end of a phase."""

    phase: str
    """start, approach, closing, squeeze, lift, hold or pull."""
    world: World
    hand: tuple[Solid, ...]
    """Palm and fingers in the base frame."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Flight:
    """What became of a grasp."""

    verdict: Verdict
    held: str | None
    """Body in the hand after the squeeze, or the last one in it."""
    rise: float
    """Way of that body's centre of mass along the lift [m]."""
    pulled: float
    """Way of its centre of mass along the pull [m]; 0 if it was not pulled."""
    turn: float
    """Angle by which it turned in the hand from the squeeze to the end [rad]."""
    slide: float
    """Way of its centre of mass in the hand in that time [m]."""
    short_of_goal: float
    """How far the approach ended before its goal [m]."""
    shift_before: float
    """How far the intended body had moved when the fingers met it [m]."""
    peak_force: float
    """Largest force of the wrist from the squeeze on [N]."""
    peak_torque: float
    """Largest torque of the wrist [N m]."""
    deepest: float
    """Deepest interpenetration of hand and bodies while gripping [m]."""
    is_through: bool
    """Whether that is more than physics allows: the verdict means little."""
    moved_others: int
    """Bodies beside the held one that moved by 2 cm or more."""
    seconds: float
    """Simulated time [s]."""
    moments: tuple[Moment, ...]
    """Where all was at the end of each phase."""
