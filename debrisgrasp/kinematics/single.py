"""Descent of one pose on floats, which for a few poses beats arrays by far."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from debrisgrasp._arrays import FloatArray

from .chain import KinematicChain
from .descent import STALL_INTERVAL, STALL_RATIO
from .formulas import AxisGoals
from .ik_types import IkConfig

__all__ = ["PoseByPose", "Posture"]

_TURN = 2.0 * math.pi
_NEAR = 1.0
"""Distance [m] and angle [rad] from which a descent with all joints is worth while."""

Posture = tuple[list[float], float, float]
"""Joint values, distance [m] and angle [rad] left."""


class PoseByPose:
    """Descents of one chain.

    Parameters
    ----------
    chain
        The chain.
    config
        Tolerances and budget.
    """

    def __init__(self, chain: KinematicChain, config: IkConfig) -> None:
        self._formulas, self._config = chain.formulas(config.freedom), config
        self._form = chain.form
        self._limits = list(
            zip(
                chain.is_revolute.tolist(),
                chain.middle.tolist(),
                chain.lower.tolist(),
                chain.upper.tolist(),
                strict=True,
            )
        )
        self._enough = config.last_step_error**2
        self._last_offset = float(chain.form.offsets[-1])

    def goal(self, T_base_tip: FloatArray) -> list[float]:
        """Twelve numbers of the `Goals` columns of a target (4, 4)."""
        form = self._form
        T: FloatArray = form.T_first_base @ T_base_tip @ form.T_tip_last
        numbers: list[float] = T[:3].T.ravel().tolist()
        return numbers

    def from_any(
        self, goal: Sequence[float], starts: Iterable[Sequence[float]]
    ) -> Posture | None:
        """Descend from middle joints until one of the ``starts`` succeeds."""
        aim, _, _ = AxisGoals.of_one(goal)
        for start in starts:
            found = self.from_middle(goal, aim, start)
            if found is not None:
                return found
        return None

    def from_middle(
        self, goal: Sequence[float], aim: Sequence[float], start: Sequence[float]
    ) -> Posture | None:
        """Descend with the joints between first and last; None if that fails.

        Parameters
        ----------
        goal
            The twelve numbers of the target's `Goals` columns.
        aim
            Its rows of `AxisGoals`, five numbers.
        start
            Values of the joints between first and last.
        """
        config, step = self._config, self._formulas.middle_step_of_one
        weights = (config.rotation_weight, config.damping)
        q, reference, has_come = start, math.inf, False
        for age in range(config.max_iterations):
            size, *q = step(*q, *aim, *weights)
            if size < self._enough:
                whole, distance, angle = self._measured(self._completed(q, goal), goal)
                if self._is_solved(distance, angle):
                    return whole, distance, angle
                if has_come:
                    # An outer joint stands beyond its limit; the others can give way.
                    is_near = distance < _NEAR and angle < _NEAR
                    return self.from_posture(goal, whole) if is_near else None
                has_come = True
            elif age % STALL_INTERVAL == 0:
                if size > STALL_RATIO**2 * reference:
                    return None
                reference = size
        return None

    def from_posture(
        self, goal: Sequence[float], start: Sequence[float]
    ) -> Posture | None:
        """Descend with all joints from values within the limits; None if that fails."""
        config, step = self._config, self._formulas.step_of_one
        weights = (config.rotation_weight, config.damping)
        q, reference = start, math.inf
        for age in range(config.max_iterations):
            size, *q = step(*q, *goal, *weights)
            if size < self._enough:
                posture = self._measured(q, goal)
                if self._is_solved(*posture[1:]):
                    return posture
            if age % STALL_INTERVAL == 0:
                if size > STALL_RATIO**2 * reference:
                    return None
                reference = size
        return None

    def _completed(self, middle: list[float], goal: Sequence[float]) -> list[float]:
        """Set first and last joint for the target."""
        ends = self._formulas.ends_of_one(*middle, *goal)
        first, last = math.atan2(*ends[:2]), math.atan2(*ends[2:])
        return [first, *middle, last - self._last_offset]

    def _measured(self, q: list[float], goal: Sequence[float]) -> Posture:
        """Bring a posture within the limits and say what it leaves."""
        within = []
        for value, (turns, middle, lower, upper) in zip(q, self._limits, strict=True):
            if turns:
                value -= _TURN * round((value - middle) / _TURN)
            within.append(min(max(value, lower), upper))
        square, sine_square, cosine = self._formulas.proof_of_one(*within, *goal)
        angle = math.atan2(math.sqrt(sine_square), cosine)
        return within, math.sqrt(square), angle

    def _is_solved(self, distance: float, angle: float) -> bool:
        config = self._config
        return (
            distance <= config.position_tolerance and angle <= config.rotation_tolerance
        )
