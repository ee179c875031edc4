"""An idle arm that another one takes along on the joints of a trunk they share."""

from __future__ import annotations

from math import hypot, isnan, nan

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.control._rigid import floats_of

from .result import FaultFound
from .senses import Senses, met_from

__all__ = ["Along", "taken_along"]

_IN_A_ROW = 2
"""So many times in a row it must bear more: one sample may be wrong."""
_PRESSED = 25.0
"""With so much on it a hand that should be empty touches something [N]."""
_SILENT = 0.04
"""For so long without a number nobody knows what it meets [s]."""


class Along:
    """Watches what an arm bears that does not move by itself."""

    def __init__(self, senses: Senses) -> None:
        self._senses = senses
        force, torque = self._bears()
        limits = senses.limits
        self.is_pressed = force > _PRESSED
        """Whether it touches something already."""
        most_force, most_torque = met_from(force, torque)
        self._force = min(most_force, limits.force)
        self._torque = min(most_torque, limits.torque)
        self._n_met = self._n_silent = 0
        self._most_silent = round(_SILENT / senses.period)

    def _bears(self) -> tuple[float, float]:
        """Force and torque on the hand [N, N m]; NaN if the sensor tells none."""
        senses = self._senses
        reading = senses.read()
        raw, q = floats_of(reading.wrench_ft), floats_of(reading.q)
        kinematics = senses.limb.kinematics
        if len(raw) != 6 or len(q) != kinematics.n_joints:
            return nan, nan
        R, _ = kinematics.pose(q)
        load = senses.limb.loads.load_ee(raw, R)
        return hypot(*load[:3]), hypot(*load[3:])

    def met(self) -> FaultFound | None:
        """Tell whether it touched something, or can't tell any more."""
        limb = self._senses.limb
        force, torque = self._bears()
        if limb.doubt is not None:
            return limb.doubt
        self._n_silent = self._n_silent + 1 if isnan(force) else 0
        if self._n_silent >= self._most_silent:
            words = "the sensor of an arm that is taken along tells no numbers"
            return FaultFound("wrench_nan", words, limb.name)
        is_met = force > self._force or torque > self._torque
        self._n_met = self._n_met + 1 if is_met else 0
        if self._n_met < _IN_A_ROW:
            return None
        words = "touched something as the other arm turned it: "
        words += f"{force:.0f} N, {torque:.1f} N m"
        return FaultFound("plan_collision", words, limb.name)


def taken_along(senses: Senses, way: FloatArray | None = None) -> list[Along]:
    """Other arms on joints that this one moves.

    Parameters
    ----------
    way
        Postures of its motion (n, d), if they are known before.
    """
    context, limb = senses.context, senses.limb
    is_shared = ~limb.is_own_joint
    if not is_shared.any():
        return []
    if way is not None and not np.ptp(way[:, is_shared], axis=0).any():
        return []
    others = [Senses(context, name) for name in context.limbs if name != limb.name]
    return [Along(other) for other in others if other.limb.baseline_time > 0.0]
