"""Quality expected when the hand ends up a little beside the pose that was planned.

Calibration, kinematics and the bending of the arm add up to about a centimetre and two
degrees. A grasp that needs better than that is a poor one, however well it fits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray, require_range
from debrisgrasp.geometry import SE3

__all__ = ["PoseUncertainty"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseUncertainty:
    """Standard deviation of where the hand ends up, in its own frame."""

    position: float = 0.01
    """Per axis [m]; 0 trusts the calibration."""
    rotation: float = 0.035
    """Per axis [rad]."""

    def __post_init__(self) -> None:
        require_range("PoseUncertainty.position", self.position, 0.0, 0.1)
        require_range("PoseUncertainty.rotation", self.rotation, 0.0, 0.5)

    def offsets(self) -> SE3:
        """Sixteen equally likely errors in the palm frame, with this covariance.

        One standard deviation along every axis at once, with the signs of a fractional
        factorial design (2^(6-2), resolution IV): exact for any quality that is a
        quadratic of the error, and no point sits on the peak in most directions, as
        those of a cubature rule on the axes would.
        """
        a, b, c, d = _signs(4)
        return self._spread(a, b, c, d, a * b * c, b * c * d)

    def few_offsets(self) -> SE3:
        """Eight of that kind, palm frame: exact for any quadratic, but no cubic."""
        a, b, c = _signs(3)
        return self._spread(a, b, c, a * b, a * c, b * c)

    def _spread(self, *signs: FloatArray) -> SE3:
        spread = np.repeat([self.position, self.rotation], 3)
        return SE3.exp(np.stack(signs, axis=-1) * spread)


def _signs(n: int) -> FloatArray:
    """All combinations of n signs, shape (n, 2^n)."""
    bits = (np.arange(2**n)[:, None] >> np.arange(n)) & 1
    return np.asarray((1.0 - 2.0 * bits).T, dtype=np.float64)
