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
from .driving import AGAIN, driven, halted, noted, require_moved, ways_gone
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
    before = context.dragged or SE3.identity()
    # One that was kept from dragging on has gone a part of it.
    way = max(settings.drag_distance - float(np.linalg.norm(before.p[:2])), 0.0)
    turn = max(_TURN - abs(float(ways_gone(before)[1])), 0.0)
    side = float(np.sign(settings.drop_off[held.arm][1])) or 1.0
    phases = [(-_SPEED, 0.0, way / _SPEED), (0.0, side * _RATE, turn / _RATE)]
    seconds = sum(phase[2] for phase in phases)
    begun = base.read()
    pull = _Pull(context, base, phases, drive.limits)
    translation, rotation = settings.compliance
    context.dragged = before
    try:
        end = drive.leg(
            [0.0, 0.0, _CREEP],
            speed=_CREEP / (seconds + 1.0),
            compliance=Compliance.diagonal(translation, rotation),
            tare=TarePolicy.SESSION,
            until=pull,
        )
    finally:
        # Also when an arm or a sensor answers no more.
        stopped = halted(context, base, begun, way, turn)
    context.wait(_BRAKING)
    noted(context, base, stopped, 0.0, 0.0)
    if isinstance(end, FaultFound):
        return end
    facts = {
        "way": np.round(context.dragged.p[:2], 3).tolist(),
        "peak_force": round(pull.peak, 1),
    }
    if pull.is_too_much or end.outcome is not LegOutcome.CONTACT:
        far = np.linalg.norm(context.dragged.p[:2])
        words = f"{pull.peak:.0f} N and {pull.peak_torque:.0f} N m while it was "
        words += f"dragged by {far:.2f} m"
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
        self._going, self._again = (0.0, 0.0), self._until

    def __call__(self, load: Wrench) -> bool:
        """Whether to end, by the load on the hand; then the base has been stopped.

        Until the arm has come to rest it would pull on.
        """
        self.peak = max(self.peak, hypot(*load[:3]))
        self.peak_torque = max(self.peak_torque, hypot(*load[3:]))
        # What is dragged sideways bends the hand long before it pulls hard. It is too
        # much also if it gets less as the base stands.
        share = float(share_of(np.array(load), self._limits))
        self.is_too_much = self.is_too_much or share > _SHARE
        now = self._context.now()
        is_over = now >= self._until
        if self.is_too_much or (is_over and not self._phases):
            self._base.stop()
            return True
        if is_over:
            forward, turn, seconds = self._phases.pop(0)
            self._going = forward, turn
            self._until, self._again = now + seconds, now
        if now >= self._again:
            self._base.drive(*self._going)
            self._again = now + AGAIN
        return False


def drive_back(context: Context) -> None:
    """Bring the base back to where it was before it dragged something.

    Raises
    ------
    FaultRaised
        If by its odometry it is farther away than it was told to drag, or the odometry
        jumps: it would drive who knows where.
    """
    base, moved = context.base, context.dragged
    if base is None or moved is None:
        return
    require_moved(moved, context.settings.drag_distance, _TURN)
    moved = moved @ driven(context, base, _RATE, turn=-float(ways_gone(moved)[1]))
    driven(context, base, _SPEED, ahead=-float(moved.p[0]))
    context.dragged = None
