"""What lifting an object with one grasp will demand of hand and arm."""

from __future__ import annotations

from dataclasses import dataclass

from debrisgrasp._words import in_kilograms

from .mass import Interval

__all__ = ["LoadForecast"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadForecast:
    """What lifting the object will demand of hand and arm; (least, greatest) each."""

    build: str
    """``solid``, ``hollow`` or ``sheet``."""
    mass: Interval
    """[kg]."""
    force: Interval
    """Weight at the wrist [N]."""
    torque: Interval
    """Moment of the weight about the palm [N m]."""
    grip: Interval
    """Squeeze that holds it [N]; the least trusts in fingers that reach around it."""
    lever: float
    """Horizontal distance from the middle of the grip to the centre of mass [m]."""
    lever_error: float
    """How far that may be off [m]."""
    tilt: float
    """Angle between the palm's axis and the vertical [rad]; 0 grips from above."""
    margin: float
    """Smallest limit over its load, at the mass expected: below 1 is too heavy."""
    margins: Interval
    """The same at worst and at best."""
    limit: str
    """What limits it: ``grip``, ``wrist force``, ``wrist torque`` or
    ``joint torque``."""

    @property
    def is_mass_known(self) -> bool:
        """Whether somebody said what the object weighs."""
        return self.mass[0] == self.mass[1]

    @property
    def is_overloaded(self) -> bool:
        """Whether it is beyond a limit at a mass that is known."""
        return self.is_mass_known and self.margin < 1.0

    @property
    def in_words(self) -> str:
        """Say what is known of the object's weight."""
        low, high = self.mass
        if self.is_mass_known:
            return f"the object weighs {low:.6g} kg, as stated"
        return f"the object looks {self.build}: {in_kilograms(low, high)}"
