"""From what control noticed to the faults of the task."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._words import arm_called
from debrisgrasp.control import (
    Fault,
    Reading,
    Refusal,
    RefusalCause,
    StartError,
    Stop,
)
from debrisgrasp.errors import InputError
from debrisgrasp.kinematics import LimitSet

from .result import FaultFound
from .states import State

__all__ = ["OUTSIDE", "cant_start", "fault_of_stop", "misplaced", "refused"]

_NAMES = {
    Fault.WRENCH_FROZEN: "wrench_frozen",
    Fault.WRENCH_SATURATED: "sensor_saturated",
    Fault.WRENCH_JUMP: "bias_jump",
    Fault.JOINT_STUCK: "joint_stuck",
    Fault.ENCODER_JUMP: "encoder_jump",
    Fault.ENCODER_INVALID: "encoder_jump",
    Fault.CLOCK_GAP: "clock_disorder",
    Fault.CLOCK_FAST: "clock_disorder",
    Fault.COMMAND_INVALID: "encoder_jump",
    Fault.OSCILLATION: "oscillation",
}
_REFUSED = {
    RefusalCause.STALE: "clock_disorder",
    RefusalCause.OUTSIDE: "start_outside_limits",
    RefusalCause.SATURATED: "sensor_saturated",
    RefusalCause.BIAS: "bias_drift",
    RefusalCause.LOADED: "ratchet",
}
"""Of several causes the first counts; of others, no more is known."""
OUTSIDE = 1e-3
"""So far outside its limits a joint may read [rad or m]."""
_TURN = 2.0 * np.pi
"""No joint is so far outside, if it reads radians [rad or m]."""
_EMPTY_HANDED = (
    State.PREGRASP,
    State.SWITCH,
    State.APPROACH,
    State.CLOSE,
    State.PUSH,
)


def fault_of_stop(stop: Stop, reading: Reading, state: State, arm: str) -> FaultFound:
    """Name what stopped a motion."""
    if stop.fault is Fault.WRENCH_LOST:
        is_number = np.isfinite(np.asarray(reading.wrench_ft, dtype=np.float64)).all()
        name = "clock_disorder" if is_number else "wrench_nan"
    elif stop.fault in (Fault.OVERLOAD, Fault.TORQUE_OVERLOAD):
        name = _overload(stop, state)
    elif stop.fault is Fault.SWING and state is State.TRANSPORT:
        name = "object_swings"
    elif stop.fault in (Fault.MOTION_OVERLOAD, Fault.SWING):
        name = "plan_collision"  # hand, or what is carried, touched something
    else:
        name = _NAMES[stop.fault]
    words = stop.message
    if name == "plan_collision":
        words = f"touched something that no plan knew: {words}"
    return FaultFound(name, words, arm, {"time": stop.time})


def _overload(stop: Stop, state: State) -> str:
    """Tell why the limit was met, by the state."""
    if state in _EMPTY_HANDED:
        return "early_contact"
    if state is State.TRANSPORT and stop.fault is Fault.TORQUE_OVERLOAD:
        return "object_swings"
    return "too_heavy"


def misplaced(q: FloatArray, limits: LimitSet, arm: str) -> FaultFound | None:
    """Name why no motion may begin where the joints (d,) are said to be."""
    if q.shape != (limits.n_joints,) or not np.isfinite(q).all():
        return FaultFound("encoder_jump", f"joints read {q.tolist()}", arm)
    broken = limits.violation(q, tolerance=OUTSIDE)
    if broken and limits.violation(q, tolerance=_TURN):
        broken += "; radians or metres, not degrees or millimetres?"
    return FaultFound("start_outside_limits", broken, arm) if broken else None


def cant_start(error: InputError, reading: Reading, arm: str) -> FaultFound:
    """Name why there is no state to begin a motion with."""
    name = "controller_refuses"
    if isinstance(error, StartError):
        name = _REFUSED.get(error.cause, name)
    return _misread(reading, arm) or FaultFound(name, str(error), arm)


def refused(refusals: Sequence[Refusal], reading: Reading, arm: str) -> FaultFound:
    """Name why a motion was refused before it began."""
    causes = {refusal.cause for refusal in refusals}
    names = (name for cause, name in _REFUSED.items() if cause in causes)
    name, words = next(names, "controller_refuses"), "; ".join(map(str, refusals))
    found = FaultFound(name, words, arm, refused_for=frozenset(causes))
    return _misread(reading, arm) or found


def _misread(reading: Reading, arm: str) -> FaultFound | None:
    """Name what of a reading is no number."""
    q = np.asarray(reading.q, dtype=np.float64)
    wrench = np.asarray(reading.wrench_ft, dtype=np.float64)
    if not np.isfinite(wrench).all():
        words = f"the wrist of the {arm_called(arm)} reads {wrench}"
        return FaultFound("wrench_nan", words, arm)
    if not np.isfinite(q).all():
        words = f"the joints of the {arm_called(arm)} read {q}"
        return FaultFound("encoder_jump", words, arm)
    return None
