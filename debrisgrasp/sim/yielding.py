"""A lift that gives way to the wrench on the hand."""

from __future__ import annotations

from typing import Any

import numpy as np

from debrisgrasp._arrays import FloatArray

from .flight import FlightConfig
from .wrist import Wrist

__all__ = ["Yielding"]

_MOST_TURN = 1.2
"""A lift that yields turns the hand no farther [rad]: at a right angle two joints of
the wrist fall into one axis."""
_SMOOTHING = 0.05
"""Weight of a wrench reading at each step in the compliance's filter."""


class Yielding:
    """Moves the target of the hand as a compliance asks; or not at all without one.

    It gives way to all that the hand bears, not to what came in since the lift began:
    a squeeze leaves a torque in a wrist that is held stiffly, which a lift that took it
    for its zero would keep up.
    """

    def __init__(self, config: FlightConfig, wrist: Wrist) -> None:
        self.compliance, self.wrist = config.compliance, wrist
        self.smoothing = _SMOOTHING
        if config.compliance is not None:
            # Deflection unloads the wrist's own spring: a loop of this gain.
            softness = np.diag(config.compliance.tensor)
            gain = 1.0 + float((softness * np.repeat(config.wrist.stiffness, 3)).max())
            self.smoothing = min(_SMOOTHING, 0.25 / gain)
        self.filtered = np.zeros(6)

    def deflected(self, nominal: FloatArray, data: Any) -> FloatArray:
        """Target for a nominal displacement (6,)."""
        if self.compliance is None:
            return nominal
        self.filtered += self.smoothing * (-self.wrist.wrench - self.filtered)
        measured = self.wrist.pose(data)
        force = measured.R.T @ self.filtered[:3]
        torque = self.filtered[3:]
        turn = float(np.linalg.norm(self.compliance.tensor[3:, 3:] @ torque))
        torque = torque * (_MOST_TURN / max(turn, _MOST_TURN))
        wrench = self.compliance.without_dead_band((*force, *torque))
        return self.wrist.displacement_of(
            self.compliance.deflected_pose(
                wrench, measured, self.wrist.pose_at(nominal)
            )
        )
