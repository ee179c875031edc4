"""How stiff, how strong and how heavy the joints of a simulated robot are."""

from __future__ import annotations

from dataclasses import dataclass

from debrisgrasp._arrays import require_range
from debrisgrasp.sim import HandPhysics, Physics

__all__ = ["RobotPhysics"]


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotPhysics:
    """Settings of the physics of a `SimRobot`; docs/physics.md gives the sources."""

    physics: Physics = Physics()
    """Step and contacts of debris; the servo of the joints runs at every step."""
    hand: HandPhysics = HandPhysics()
    rotor_inertia: float = 1.0
    """Of a drive, as its joint feels it through the gear [kg m^2]."""
    natural_frequency: float = 8.0
    """Of a joint on its servo [Hz]; stiffer follows better and pushes harder on what
    it meets."""
    damping_ratio: float = 1.0
    """Of that joint."""
    integral_time: float = 0.5
    """In which the servo makes up for a lasting error, for instance of an unknown
    weight [s]."""

    def __post_init__(self) -> None:
        require_range("RobotPhysics.rotor_inertia", self.rotor_inertia, 1e-4, 100.0)
        require_range(
            "RobotPhysics.natural_frequency", self.natural_frequency, 0.5, 50.0
        )
        require_range("RobotPhysics.damping_ratio", self.damping_ratio, 0.1, 3.0)
        require_range("RobotPhysics.integral_time", self.integral_time, 0.05, 1e6)
