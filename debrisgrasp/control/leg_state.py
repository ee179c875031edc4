"""Settings of a leg, what passes from tick to tick, and what comes out."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from debrisgrasp._arrays import require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp.errors import InputError

from ._rigid import Wrench
from .compliance import Compliance
from .faults import Stop
from .oscillation import OscillationState
from .readings import SafetyConfig, SafetyState
from .refusals import Refusal
from .servo import ServoConfig, ServoState
from .stability import ArmResponse, Contact

__all__ = [
    "Command",
    "ControllerConfig",
    "Engagement",
    "LegOutcome",
    "LegState",
    "TarePolicy",
]

_MOST = {
    "ramp": 60.0,
    "tau": 60.0,
    "lag": 0.1,
    "lag_turn": 0.5,
    "patience": 60.0,
}
"""A leg that waits for no hand would begin far from it; units of `ControllerConfig`."""


class TarePolicy(Enum):
    """Where the reaction is measured from; it never touches the limits."""

    SESSION = "session"
    """The last verified baseline in free space: the hand yields to all load, the weight
    of what it holds included, unless that is in the load model."""
    MOTION = "motion"
    """The load at the start of each motion, as in the paper."""


class LegOutcome(Enum):
    """How a leg stands."""

    RUNNING = "running"
    DONE = "done"
    CONTACT = "touched something"
    BLOCKED = "the arm gets no farther"
    STOPPED = "stopped"


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerConfig:
    """Settings of a leg."""

    period: float = 0.004
    """Of the control loop [s], up to `SafetyConfig.stop_after`."""
    speed: float = 0.03
    """Of the hand along the leg [m/s], up to `ServoConfig.max_speed`."""
    turn_rate: float = 0.2
    """Of the hand along the leg [rad/s], up to `ServoConfig.max_turn_rate`."""
    ramp: float = 0.3
    """Time to come up to speed [s]."""
    tau: float = 0.398
    """Time constant of the smoothing [s]; see `WrenchFilter`."""
    tare: TarePolicy = TarePolicy.SESSION
    arm: ArmResponse = ArmResponse()
    contact: Contact = Contact()
    """What the compliant hand may touch."""
    safety: SafetyConfig = SafetyConfig()
    servo: ServoConfig = ServoConfig()
    lag: float = 0.005
    """The leg waits when the hand is farther behind than this [m]."""
    lag_turn: float = 0.03
    """[rad]."""
    patience: float = 1.0
    """After waiting for so long the leg counts as blocked [s]."""

    def __post_init__(self) -> None:
        # A tick that comes later than that stops the arm.
        longest = self.safety.stop_after
        require_range("ControllerConfig.period [s]", self.period, 1e-4, longest)
        servo = self.servo
        most_of = _MOST | {"speed": servo.max_speed, "turn_rate": servo.max_turn_rate}
        for name, most in most_of.items():
            require_range(f"ControllerConfig.{name}", getattr(self, name), 1e-6, most)


class LegState(NamedTuple):
    """Everything that passes from one tick to the next."""

    safety: SafetyState
    servo: ServoState
    filtered: Wrench
    """Smoothed reaction at the hand, in its axes."""
    deflection: Wrench
    """Of the hand from its nominal pose, axes of base."""
    swing: OscillationState
    compliance: Compliance | None
    """In force; the oscillation guard may have made it stiffer."""
    initial: Wrench
    """Load at engagement, in the axes of the hand: changes count from it."""
    reference: Wrench
    """Load to which the hand doesn't give way, by the `TarePolicy`, in its axes."""
    share: float = 0.0
    """How much of the leg is done, in [0, 1]."""
    pace: float = 0.0
    """Change of the share in one period."""
    waited: float = 0.0
    """How long the leg has been waiting [s]."""
    outcome: LegOutcome = LegOutcome.RUNNING


class Command(NamedTuple):
    """What the robot is to do now, and how things stand."""

    q: tuple[float, ...]
    """Posture to go to [rad or m]; after a stop, the measured one."""
    outcome: LegOutcome
    share: float
    """How much of the leg is done, in [0, 1]."""
    deflection: Wrench
    """Of the hand from its nominal pose, axes of base [m, rad]."""
    load: Wrench
    """Absolute, unfiltered load at the hand, in its axes [N, N m]."""
    stop: Stop | None = None
    """Why it stopped."""

    @property
    def is_stop(self) -> bool:
        """Stop by the quickest means there is, and hold; ``q`` is not a motion."""
        return self.stop is not None


@dataclass(frozen=True, slots=True, eq=False)
class Engagement:
    """Answer to the wish to start a leg."""

    state: LegState | None
    """To begin with; None if refused."""
    refusals: tuple[Refusal, ...] = ()
    """Why not."""
    warnings: tuple[str, ...] = ()

    @property
    def is_engaged(self) -> bool:
        """Whether the leg may begin."""
        return self.state is not None

    def require(self) -> LegState:
        """State to begin with, or `InputError` with all reasons for the refusal."""
        if self.state is None:
            raise InputError(
                "engagement of the controller",
                got="; ".join(map(str, self.refusals)),
                expected="nothing in the way",
            )
        return self.state
