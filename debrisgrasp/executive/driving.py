"""Drive the base as far as is asked by its own odometry, and no farther."""

from __future__ import annotations

from math import atan2, hypot

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp.geometry import SE3
from debrisgrasp.robot import Base

from .context import Context
from .result import FaultFound, FaultRaised

__all__ = ["AGAIN", "driven", "halted", "noted", "require_moved", "ways_gone"]

AGAIN = 0.1
"""A base that goes is told so again, and asked where it is, as often [s]."""
_SLACK = (0.15, 0.2)
"""Tracks slip, and go on after a stop: by so much what is told may differ from what was
asked [m, rad], or from what was told last."""
_PATIENCE, _BEGINS = 2.0, 20
"""It may take so many times as long as was asked, and so many looks more."""
_BRAKING = 1.5
"""Within which the base stands after a stop [s]."""


def driven(
    context: Context, base: Base, pace: float, *, ahead: float = 0.0, turn: float = 0.0
) -> SE3:
    """Drive straight ahead, or turn on the spot, and stand; take note of it.

    Parameters
    ----------
    pace
        Speed [m/s], or rate [rad/s].
    ahead, turn
        How far [m, rad]; one of them is 0.

    Returns
    -------
    SE3
        How far the base went by its odometry, ``T_before_now``.

    Raises
    ------
    FaultRaised
        If the odometry jumps or is no number, or the base does not go as it is told.
    """
    begun, wanted = base.read(), np.array([ahead, turn])
    along = int(np.abs(wanted).argmax())
    size = float(abs(wanted[along]))
    speeds = pace * np.sign(wanted)
    most = int(np.ceil(_PATIENCE * size / (pace * AGAIN))) + _BEGINS
    context.wait(AGAIN)  # a clock that is wrong is found out before anything moves
    # No time that is told while the base drives makes any later wait longer.
    until, last = context.now(), np.zeros(2)
    try:
        for _ in range(most):
            if size - np.sign(wanted[along]) * last[along] <= 0.5 * pace * AGAIN:
                break
            base.drive(*speeds.tolist())
            until += AGAIN
            context.robot.clock.wait_until(until)
            gone = ways_gone(begun.inverse() @ base.read())
            _require_followed(gone, last, wanted)
            last = gone
        else:
            words = f"the base went {last[0]:.2f} m and turned {last[1]:.2f} rad of "
            words += f"{ahead:.2f} m and {turn:.2f} rad in {most * AGAIN:.0f} s"
            raise FaultRaised(FaultFound("joint_stuck", words))
    finally:
        stopped = halted(context, base, begun, abs(ahead), abs(turn))
    context.wait(_BRAKING)
    stands = noted(context, base, stopped, 0.0, 0.0)
    return begun.inverse() @ stands


def halted(context: Context, base: Base, before: SE3, way: float, turn: float) -> SE3:
    """Stop the base, and take note of how it has moved, as `noted` does.

    Raises
    ------
    FaultRaised
        Also if it does not obey: it may go on.
    """
    try:
        base.stop()
    except Exception as error:
        words = f"the base does not obey a stop: {error}"
        raise FaultRaised(FaultFound("joint_stuck", words)) from error
    return noted(context, base, before, way, turn)


def noted(context: Context, base: Base, before: SE3, way: float, turn: float) -> SE3:
    """Take note of how the base has moved from a pose: where it stands now, in odom.

    Parameters
    ----------
    way, turn
        It was asked for so much at most [m, rad].

    Raises
    ------
    FaultRaised
        If it can't be: nobody knows then where the base stands.
    """
    context.forget()  # also if it is not known what has been seen from where
    try:
        now = base.read()
    except Exception as error:
        words = f"nobody knows where the base has gone: {error}"
        raise FaultRaised(FaultFound("encoder_jump", words)) from error
    moved = before.inverse() @ now
    require_moved(moved, way, turn)
    context.stands_elsewhere(moved.inverse())
    return now


def require_moved(moved: SE3, way: float, turn: float) -> None:
    """Raise `FaultRaised` if the base can't have moved so: farther than was asked.

    Parameters
    ----------
    moved
        ``T_before_now`` by the odometry.
    way, turn
        What was asked for at most [m, rad].
    """
    far, yaw = hypot(*moved.p[:2]), float(ways_gone(moved)[1])
    is_near = far <= way + _SLACK[0] and abs(yaw) <= turn + _SLACK[1]
    if is_near and np.isfinite(moved.matrix).all():
        return
    words = f"by its odometry the base went {far:.2f} m and turned {yaw:.2f} rad; at "
    words += f"most {way:.2f} m and {turn:.2f} rad were asked for"
    raise FaultRaised(FaultFound("encoder_jump", words))


def ways_gone(moved: SE3) -> FloatArray:
    """How far a base went ahead, and turned [m, rad], shape (2,)."""
    return np.array([moved.p[0], atan2(moved.R[1, 0], moved.R[0, 0])])


def _require_followed(gone: FloatArray, last: FloatArray, wanted: FloatArray) -> None:
    """Raise `FaultRaised` if a base jumped, or goes another way than it was told.

    Parameters
    ----------
    gone, last
        How far it went by now, and by the last look [m, rad], each shape (2,).
    wanted
        How far it is to go, shape (2,).
    """
    is_near = np.abs(gone - last) <= _SLACK
    low, high = np.minimum(wanted, 0.0), np.maximum(wanted, 0.0)
    is_on_way = (gone >= low - _SLACK) & (gone <= high + _SLACK)
    if (is_near & is_on_way).all():
        return
    words = f"by its odometry the base went from {last.round(2).tolist()} m and rad to "
    words += f"{gone.round(2).tolist()} in {AGAIN:g} s; {wanted.round(2).tolist()} was "
    words += "asked for"
    raise FaultRaised(FaultFound("encoder_jump", words))
