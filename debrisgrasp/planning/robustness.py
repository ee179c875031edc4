"""Quality expected when the hand ends up a little beside the pose that was planned.

Calibration, kinematics and the bending of the arm add up to about a centimetre and two
degrees. A grasp that needs better than that is a poor one, however well it fits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray, require_range
from debrisgrasp.geometry import SE3

__all__ = ["PoseUncertainty", "expected_quality"]


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
        """Sixteen equally likely errors with this covariance, and mean zero.

        One standard deviation along every axis at once, with the signs of a fractional
        factorial design (2^(6-2), resolution IV): exact for any quality that is a
        quadratic of the error, and no point sits on the peak in most directions, as
        those of a cubature rule on the axes would.
        """
        bits = (np.arange(16)[:, None] >> np.arange(4)) & 1
        a, b, c, d = (1.0 - 2.0 * bits).T
        signs = np.stack([a, b, c, d, a * b * c, b * c * d], axis=-1)
        spread = np.repeat([self.position, self.rotation], 3)
        return SE3.exp(signs * spread)


def expected_quality(
    quality: Callable[[FloatArray, IntArray], FloatArray],
    uncertainty: PoseUncertainty,
    Ts_base_hand: FloatArray,
    prototype: IntArray,
) -> FloatArray:
    """Mean quality over the errors, shape (k,).

    Parameters
    ----------
    quality
        Maps poses (n, 4, 4) and prototypes (n,) to Q-hat (n,).
    Ts_base_hand, prototype
        Poses (k, 4, 4), and the prototype that each places (k,).
    """
    offsets = uncertainty.offsets().matrix
    moved = (Ts_base_hand[:, None] @ offsets).reshape(-1, 4, 4)
    values = quality(moved, np.repeat(prototype, len(offsets)))
    mean: FloatArray = values.reshape(len(prototype), len(offsets)).mean(axis=1)
    return mean
