"""Settings of the whole task."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from debrisgrasp._arrays import BoolArray, frozen, require_metres, require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp._words import arm_called
from debrisgrasp.control import (
    ControllerConfig,
    StabilityBound,
    WrenchFilter,
    contact_gain,
)
from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.geometry import Bounds
from debrisgrasp.io import Capture
from debrisgrasp.kinematics import DeflectionLimits

__all__ = ["TURN_STIFFNESS", "Marker", "TaskSettings"]

_FINGER_PERIOD = 0.04
"""Between two looks at the fingers while the arm moves, about [s]."""
TURN_STIFFNESS = 1e4
"""Of an arm against a turn of its hand [N m/rad]."""
_FARTHEST = 1.5
"""What is held is touched no farther from the hand [m]."""
_PERIODS = (5e-4, 0.01)
"""Of the control loop [s]."""

Marker = Callable[[Capture], BoolArray | None]
"""Says of a capture which pixels belong to the object of interest: a detector, or a
person, (height, width). Its pose is in the base frame of when the task began. None: it
is not in the picture. The task is done if something was removed before; else that is a
fault, ``empty_cloud``."""


def _beside() -> Mapping[str, tuple[float, float]]:
    return {"right": (0.25, -0.75), "left": (0.25, 0.75)}


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class TaskSettings:
    """What is to be done, and how carefully."""

    arms: tuple[str, ...] = ()
    """Arms in use; empty: all that the robot has."""
    max_removals: int | None = None
    """Stop after so many; None: when nothing that can be removed is left."""
    max_attempts: int = 120
    """Give up after so many tries in which an arm went to an object, or three times as
    many that ended with the plan."""
    tries: int = 3
    """At one object, before it is left."""
    workspace: tuple[tuple[float, float, float], tuple[float, float, float]] = (
        (0.45, -0.62, -0.1),
        (1.9, 0.62, 1.3),
    )
    """Box of the way that is to be cleared, lower and upper corner, base frame [m]; an
    array (2, 3) will do. Objects whose middle seems to be more than 5 cm outside are
    not in the way."""
    drop_off: Mapping[str, tuple[float, float]] = field(default_factory=_beside)
    """Where each arm puts things down: (x, y) in the base frame [m]."""
    drop_height: float = 0.04
    """Of an object's lowest seen point over the ground before it is lowered [m]."""
    drive_over: float = 0.10
    """Things that are lower than this need not be removed [m]: the tracks drive over
    them. Only what is lower by 1 cm, as it is measured, counts; up to 0.01, nothing."""
    max_mass: float = 8.0
    """Heavier things are not carried [kg]."""
    rest: str | None = None
    """Posture between removals; None: the arm's idle one."""
    look: Mapping[str, float] | None = None
    """Joints of the head for a capture; those not named are as the robot's file has
    them at rest."""
    lift: float = 0.15
    """How far an object is lifted before it is carried [m]."""
    load_share: float = 0.8
    """Share of the limits of force and torque at which a motion is stopped. The rest is
    for what the load grows by until the arm stands: at 3e4 N/m, 30 mm/s and 30 ms it
    is 27 N. With less, straight ways slow down, and much so what has nothing else to be
    stopped by, as before the sensor has a zero."""
    approach_speed: float = 0.0115
    """Of the hand, until it touches [m/s]."""
    lift_speed: float = 0.03
    """Of the hand wherever it, or what it holds, may touch something [m/s]."""
    carry_speed: float = 0.6
    """Share of the planned speed while something is carried."""
    compliance: tuple[float, float] = (5e-5, 3e-4)
    """How far the hand gives way while it lifts, [m/N] and [rad/(N m)]. The first stays
    below what would swing against the hardest thing: 1.16e-4 at a period of 0.004. The
    second stays below what would swing at the end of a long object: 4.1e-4."""
    clamp: DeflectionLimits = DeflectionLimits(translation=0.015, rotation=0.03)
    """How far at most; planned for, and given to the controller. At the largest load
    that a hand bears, 150 N and 40 N m, half of it is used."""
    empty_load: float = 6.0
    """A hand that carries less is empty [N], up to 50."""
    camera_shift: float = 0.02
    """A hand seen farther than this from where it must be means that the camera has
    moved [m]; 0.008 to 0.1, for a look at it errs by half of the first, and finds no
    hand that is farther away than the second."""
    max_dropout: float = 0.4
    """Share of the image of the workspace that may lack depth, 0.01 or more: at edges
    every camera loses some."""
    mark: Marker | None = None
    """Object-specific task: only what this marks is gripped, with the prototypes for
    special objects."""
    region: Bounds | None = None
    """Object-specific task: the object of interest lies in this box, in the base frame
    of when the task begins."""
    repositions: int = 6
    """So often the base may drive, by up to 35 cm, to where the arms reach better."""
    pushes: int = 20
    """So often a closed hand may push something out of the way that no hand can hold;
    0: never."""
    drag_distance: float = 0.5
    """How far the base pulls what can't be lifted [m]."""
    period: float = 0.004
    """Of the control loop [s]: that of the drives, 0.0005 to 0.01. The longer it is,
    the later a touch is felt, and the slower arms go where they may touch something."""

    def __post_init__(self) -> None:
        for name in ("max_attempts", "tries"):
            require_range(f"TaskSettings.{name}", getattr(self, name), 1, 10_000)
        if self.max_removals is not None:
            require_range("TaskSettings.max_removals", self.max_removals, 1, 10_000)
        for name in ("repositions", "pushes"):
            require_range(f"TaskSettings.{name}", getattr(self, name), 0, 100)
        require_range("TaskSettings.max_dropout", self.max_dropout, 0.01, 1.0)
        for name in ("drive_over", "drop_height"):
            require_range(f"TaskSettings.{name} [m]", getattr(self, name), 0.0, 1.0)
        for name in ("lift", "drag_distance"):
            require_range(f"TaskSettings.{name} [m]", getattr(self, name), 1e-3, 2.0)
        for name in ("approach_speed", "lift_speed"):
            require_range(f"TaskSettings.{name} [m/s]", getattr(self, name), 1e-3, 2.0)
        require_range("TaskSettings.carry_speed", self.carry_speed, 0.05, 1.0)
        require_range("TaskSettings.load_share", self.load_share, 0.1, 0.95)
        least, most = _PERIODS
        if not least <= self.period <= most:
            raise ConfigError(
                "TaskSettings.period [s]",
                got=self.period,
                expected=f"{least:g} to {most:g}",
                mend="250 Hz is 0.004. Slower loops feel a touch too late, and a hand "
                "that gives way swings: a driver of slower drives may take commands "
                "at 100 Hz, and pass on the latest.",
            )
        require_range("TaskSettings.max_mass [kg]", self.max_mass, 0.1, 1e3)
        low, high = np.array(self.workspace)
        require_metres("TaskSettings.workspace", (low, high))
        if not (low < high).all():
            raise ConfigError(
                "TaskSettings.workspace",
                got=self.workspace,
                expected="a lower corner below an upper one",
            )
        if self.region is not None:
            box = (self.region.lower, self.region.upper)
            require_metres("TaskSettings.region", box)
            if (box[0] >= high).any() or (box[1] <= low).any():
                got, expected = (
                    f"x {x0:g} to {x1:g}, y {y0:g} to {y1:g}, z {z0:g} to {z1:g} m"
                    for (x0, y0, z0), (x1, y1, z1) in (box, self.workspace)
                )
                raise ConfigError(
                    "TaskSettings.region",
                    got=f"{got}, where nothing is in the way",
                    expected=f"a box that meets {expected}",
                    mend="Move it into the way, or make the workspace larger.",
                )
        require_range("TaskSettings.empty_load [N]", self.empty_load, 1e-3, 50.0)
        require_range("TaskSettings.camera_shift [m]", self.camera_shift, 8e-3, 0.1)
        for part in self.compliance:
            require_range("TaskSettings.compliance", part, 0.0, 1.0)
        self._require_calm()
        for arm, place in self.drop_off.items():
            if not isinstance(arm, str):
                raise InputError(
                    "TaskSettings.drop_off", got=f"{arm!r}", expected="names of arms"
                )
            self._require_place(arm, place)

    def _require_calm(self) -> None:
        """Refuse a compliance with which a hand, or what it holds, may swing.

        `LegController.engage` begins no lift with more of the first. Far beside the
        hand a contact is softer, for it turns the arm as well.
        """
        usual, (shift, turn) = ControllerConfig(period=self.period), self.compliance
        wrench = WrenchFilter(tau=usual.tau, period=self.period)
        calm = StabilityBound(usual.arm, wrench).gain_safe
        give = 1.0 / usual.contact.effective_stiffness
        beside = contact_gain(np.diag((0.0,) * 3 + (turn,) * 3), usual.contact.levers)
        most_turn = calm * (give / _FARTHEST**2 + 1.0 / TURN_STIFFNESS)
        for unit, got, most in (
            ("rad/(N m)", turn, most_turn),
            ("m/N", shift, calm * give - beside),
        ):
            if got > most:
                raise ConfigError(
                    f"TaskSettings.compliance [{unit}]",
                    got=f"{got:g}",
                    expected=f"{most:.3g} or less at a period of {self.period:g} s",
                    mend="A hand that gives way more swings against hard things.",
                )

    def _require_place(self, arm: str, place: tuple[float, float]) -> None:
        what = f"drop-off of the {arm_called(arm)}"
        require_metres(what, frozen(place, what, (2,)))
        (x0, y0, _), (x1, y1, _) = self.workspace
        if x0 <= place[0] <= x1 and y0 <= place[1] <= y1:
            raise ConfigError(
                what,
                got=f"({place[0]:g}, {place[1]:g}), in the way that is to be cleared",
                expected=f"a place outside x {x0:g} to {x1:g}, y {y0:g} to {y1:g} m",
                mend="Put things down beside the robot, or make the workspace smaller.",
            )

    @property
    def finger_ticks(self) -> int:
        """Periods between two looks at the fingers while the arm moves."""
        return max(1, round(_FINGER_PERIOD / self.period))

    @property
    def bounds(self) -> Bounds:
        """The workspace as a box."""
        low, high = self.workspace
        return Bounds(np.array(low), np.array(high))

    @property
    def is_object_specific(self) -> bool:
        """Whether only a marked object is sought."""
        return self.mark is not None or self.region is not None
