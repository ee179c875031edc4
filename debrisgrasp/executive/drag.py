"""Pull what can't be lifted out of the way with the tracks, the arm giving way."""

from __future__ import annotations

from math import hypot

import numpy as np

from debrisgrasp.control import Compliance, LegOutcome, TarePolicy
from debrisgrasp.control._rigid import Wrench
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import LimitSet
from debrisgrasp.robot import Base

from .context import Context
from .drive import Drive
from .relief import share_of
from .result import Done, FaultFound, StepResult
from .states import State

__all__ = ["drag", "drive_back"]

_SPEED = 0.03
"""Of the base while it pulls [m/s]."""
_RATE = 0.03
"""At which it turns what it pulls out of the way [rad/s]."""
_TURN = 0.6
"""By which it turns [rad]."""
_SHARE = 0.8
"""Share of the limits of the hand at which pulling ends."""
_CREEP = 1e-3
"""Way of the hand meanwhile: a leg of no length would be done at once [m]."""
_BRAKING = 1.5
"""Within which the base stands after a stop [s]."""


def drag(context: Context) -> StepResult:
    """Back off with the object in the hand, and turn it aside.

    The arm gives way to what resists; the base goes only as long as the hand bears it.
    """
    held, base = context.held, context.base
    assert held is not None
    if base is None:
        return FaultFound("too_heavy", "there is no base to drag with", held.arm)
    drive, settings = Drive(context, held.arm), context.settings
    side = -1.0 if held.arm == "right" else 1.0
    phases = [
        (-_SPEED, 0.0, settings.drag_distance / _SPEED),
        (0.0, side * _RATE, _TURN / _RATE),
    ]
    seconds = sum(phase[2] for phase in phases)
    begun = base.read()
    pull = _Pull(context, base, phases, drive.limits)
    translation, rotation = settings.compliance
    try:
        end = drive.leg(
            [0.0, 0.0, _CREEP],
            speed=_CREEP / (seconds + 1.0),
            compliance=Compliance.diagonal(translation, rotation),
            tare=TarePolicy.SESSION,
            until=pull,
        )
    finally:
        base.stop()  # also when an arm or a sensor answers no more
        context.forget()
        before = context.dragged or SE3.identity()
        stopped = _noted(context, base, begun)
        context.dragged = before @ begun.inverse() @ stopped
    context.wait(_BRAKING)
    context.dragged = before @ begun.inverse() @ _noted(context, base, stopped)
    if isinstance(end, FaultFound):
        return end
    facts = {
        "way": np.round(context.dragged.p[:2], 3).tolist(),
        "peak_force": round(pull.peak, 1),
    }
    if pull.is_too_much or end.outcome is not LegOutcome.CONTACT:
        way = np.linalg.norm(context.dragged.p[:2])
        words = f"{pull.peak:.0f} N and {pull.peak_torque:.0f} N m while it was "
        words += f"dragged by {way:.2f} m"
        return FaultFound("too_heavy", words, held.arm, {"force": pull.peak})
    return Done(facts, State.RELEASE)


class _Pull:
    """Sends the base through its phases, tick by tick; says when they are over."""

    def __init__(
        self,
        context: Context,
        base: Base,
        phases: list[tuple[float, float, float]],
        limits: LimitSet,
    ) -> None:
        self.peak = self.peak_torque = 0.0
        self.is_too_much = False
        self._context, self._base, self._limits = context, base, limits
        self._phases, self._until = list(phases), context.now()

    def __call__(self, load: Wrench) -> bool:
        """Whether to end, by the load on the hand; then the base has been stopped.

        Until the arm has come to rest it would pull on.
        """
        self.peak = max(self.peak, hypot(*load[:3]))
        self.peak_torque = max(self.peak_torque, hypot(*load[3:]))
        # What is dragged sideways bends the hand long before it pulls hard.
        self.is_too_much = share_of(np.array(load), self._limits) > _SHARE
        is_over = self._context.now() >= self._until
        if self.is_too_much or (is_over and not self._phases):
            self._base.stop()
            return True
        if not is_over:
            return False
        forward, turn, seconds = self._phases.pop(0)
        self._base.drive(forward, turn)
        self._until = self._context.now() + seconds
        return False


def _noted(context: Context, base: Base, before: SE3) -> SE3:
    """Take note of how the base has moved from a pose: where it stands now, in odom."""
    now = base.read()
    context.stands_elsewhere(now.inverse() @ before)
    return now


def drive_back(context: Context) -> FaultFound | None:
    """Bring the base back to where it was before it dragged something."""
    base, moved = context.base, context.dragged
    if base is None or moved is None:
        return None
    begun = base.read()
    yaw = float(np.arctan2(moved.R[1, 0], moved.R[0, 0]))
    distance = float(np.linalg.norm(moved.p[:2]))
    try:
        for forward, turn, seconds in (
            (0.0, -np.sign(yaw) * _RATE, abs(yaw) / _RATE),
            (_SPEED, 0.0, distance / _SPEED),
        ):
            base.drive(forward, float(turn))
            context.wait(seconds)
            base.stop()
            context.wait(_BRAKING)
    finally:
        base.stop()
        context.forget()
        now = _noted(context, base, begun)
        context.dragged = moved @ begun.inverse() @ now
    context.dragged = None
    return None
