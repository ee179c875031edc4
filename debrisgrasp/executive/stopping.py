"""Stops of all arms and the base: latched at once, ended when the arms stand."""

from __future__ import annotations

import numpy as np

from debrisgrasp._words import arm_called
from debrisgrasp.robot import Arm

from .context import Context
from .result import FaultFound, FaultRaised

__all__ = ["reset_stops", "stop_all"]

_STANDS_WITHIN, _STILL = 2.0, 0.05
"""Within which an arm stands, and between two looks at whether it does [s]."""
_CREEP = 5e-4
"""By more no joint of an arm that stands differs between two looks [rad or m]."""
_ANYTHING = (Exception, KeyboardInterrupt, SystemExit)
"""What keeps one device from being stopped must not keep the others."""


def stop_all(context: Context) -> list[str]:
    """Latch a stop on every arm and the base; returns what did not answer, or obey.

    Also on arms that the task does not use: they stand on the same robot. The drives of
    an arm that is not stopped then are asked to hold by themselves. Nor does a second
    Ctrl-C keep any of them from being stopped.
    """
    silent = []
    for name, limb in context.robot.limbs.items():
        words = _stopped(limb.arm)
        if words:
            silent.append(f"{arm_called(name)}: {words}")
    if context.robot.base is not None:
        try:
            context.robot.base.stop()
        except _ANYTHING as error:
            silent.append(f"base: {error!r}")
    return silent


def _stopped(arm: Arm) -> str:
    """Stop an arm; if it does not, ask its drives to hold by themselves, and say so."""
    words = ""
    try:
        arm.stop()
        if arm.is_stopped:
            return ""
    except _ANYTHING as error:
        words = f" ({error!r})"
    try:
        arm.disengage()
    except _ANYTHING as error:
        return f"it does not stop{words}, nor hold by itself ({error!r})"
    return f"it does not stop{words}; its drives were asked to hold by themselves"


def reset_stops(context: Context) -> None:
    """End latched stops, once the arms stand: the answer says to go on.

    Raises
    ------
    FaultRaised
        If an arm is not seen to stand: its joints move on, or read no numbers.
    """
    for name, limb in context.robot.limbs.items():
        arm = limb.arm
        if not arm.is_stopped:
            continue
        _see_it_stand(context, arm, name)
        arm.reset()


def _see_it_stand(context: Context, arm: Arm, name: str) -> None:
    """Wait until two looks at an arm's joints are the same."""
    q = np.asarray(arm.read().q, dtype=np.float64)
    for _ in range(int(_STANDS_WITHIN / _STILL)):
        before = q
        context.wait(_STILL)
        q = np.asarray(arm.read().q, dtype=np.float64)
        is_known = np.isfinite(q).all() and np.isfinite(before).all()
        if is_known and np.abs(q - before).max() <= _CREEP:
            return
    if is_known:
        moved = float(np.abs(q - before).max())
        words = f"stopped {_STANDS_WITHIN:g} s ago, and still moves by {moved:.2g} rad "
        words += f"or m in {_STILL:g} s"
        raise FaultRaised(FaultFound("joint_stuck", words, name))
    words = f"joints read {q.tolist()} after a stop"
    raise FaultRaised(FaultFound("encoder_jump", words, name))
