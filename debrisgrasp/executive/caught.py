"""Out of what an open hand is caught in, as a person feels the way out of a crate."""

from __future__ import annotations

from math import hypot

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.control import LegOutcome

from .context import Context
from .drive import Drive
from .fingers import draw_in, give_way
from .folding import straight
from .moves import pull_of
from .relief import relieve
from .result import FaultFound, LegEnd

__all__ = ["felt_out", "nudged", "pushed_to"]

_EASED = 0.3
"""Share of a limit above which it gives way before it is moved on."""
_OUT = 0.12
"""So far back it is out [m]."""
_ASIDE = 0.03
"""Where something is in the way it goes so far aside, and tries again [m]."""
_ON = 0.01
"""It came on if it got so much farther [m]; then all sides are worth another try."""
_LEGS = 32
_AGREES = 0.2
"""A wrist that is off by less than this share of what the fingers feel does not lie."""
_LEAST = 2e-3
"""A shorter leg is none [m]."""


def pushed_to(drive: Drive, way: FloatArray, most: float) -> LegEnd | FaultFound:
    """Move an open hand slowly by an offset (3,) [m], until it is pushed so hard."""
    speed = 0.5 * drive.context.settings.lift_speed
    return straight(drive, way, most, speed=speed, least=_LEAST)


def nudged(drive: Drive, way: FloatArray) -> LegEnd | FaultFound:
    """Move a hand that is caught by an offset (3,) [m], until it is pushed harder."""
    return pushed_to(drive, way, pull_of(drive))


def felt_out(context: Context, arm: str) -> FaultFound | None:
    """Draw an open hand back; where something is in the way, around that.

    A touch ends each way. Then the hand gives way, goes to one side after the other,
    and tries again from there. At last its fingers are drawn in, for they may have
    opened behind something.
    """
    limb, drive = context.limbs[arm], Drive(context, arm)
    R = limb.pose(context.posture(limb)).R
    back, sides = -R[:, 2], _sides(R)
    left, shift, is_drawn_in = _OUT, np.zeros(3), False
    for _ in range(_LEGS):
        end = _eased_by(context, drive, left * back)
        if isinstance(end, FaultFound):
            return end
        if end.outcome is LegOutcome.BLOCKED:
            return draw_in(drive)  # the arm gets no farther: the fingers may
        if end.outcome is not LegOutcome.CONTACT:
            return None
        done = end.share * end.length
        left -= done
        if done > _ON:
            sides, shift = _sides(R), np.zeros(3)
        if not sides:
            if is_drawn_in:
                break
            fault = draw_in(drive)
            if fault is not None:
                return fault
            sides, shift, is_drawn_in = _sides(R), np.zeros(3), True
            continue
        goal = sides.pop(0) - shift
        end = _eased_by(context, drive, goal)
        if isinstance(end, FaultFound):
            return end
        shift = shift + end.share * end.length / float(np.linalg.norm(goal)) * goal
    words = f"{hypot(*drive.weighed()[:3]):.0f} N on a hand that comes out no way"
    return FaultFound("not_released", words, arm)


def _sides(R: FloatArray) -> list[FloatArray]:
    """Offsets in base [m] to the sides of a hand (3, 3), each (3,)."""
    return [_ASIDE * way for way in (R[:, 1], -R[:, 1], R[:, 0], -R[:, 0])]


def _eased_by(context: Context, drive: Drive, way: FloatArray) -> LegEnd | FaultFound:
    """Give way to what presses, then move by an offset (3,) [m] as far as that goes."""
    fault = _yielded(drive) or relieve(context, drive.limb.name, _EASED)
    fault = fault or _yielded(drive)
    return nudged(drive, way) if fault is None else fault


def _yielded(drive: Drive) -> FaultFound | None:
    """Let fingers yield, and notice that they still bear more than the hand may.

    The wrist is believed then only if it tells of what they add up to: its sensor may
    lie by just as much as the hand is pushed.
    """
    fault = give_way(drive)
    if fault is not None:
        return fault
    forces = drive.fingers().forces
    felt = sum(abs(force) for force in forces)
    if felt <= drive.limits.force:
        return None
    fingers = zip(drive.limb.hand.fingers, forces, strict=False)
    aside = sum(force if finger.side > 0 else -force for finger, force in fingers)
    told = drive.weighed()
    if abs(told[0] - aside) < _AGREES * felt:
        return None
    words = f"the fingers of an open hand bear {felt:.0f} N, and the wrist tells of "
    words += f"{hypot(*told[:3]):.0f} N: nothing is known that eases it"
    return FaultFound("ratchet", words, drive.limb.name, {"force": felt})
