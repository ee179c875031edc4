"""The states of a removal, in the order in which they are passed."""

from __future__ import annotations

from enum import Enum

__all__ = ["STAGES", "State"]


class State(Enum):
    """What the robot is busy with."""

    SELF_TEST = "self_test"
    CALIB_CHECK = "calib_check"
    CAPTURE = "capture"
    SEGMENT = "segment"
    SELECT = "select"
    PLAN_GRASP = "plan_grasp"
    PLAN_MOTION = "plan_motion"
    PREGRASP = "pregrasp"
    SWITCH = "switch"
    APPROACH = "approach"
    CLOSE = "close"
    VERIFY_GRASP = "verify_grasp"
    LIFT = "lift"
    VERIFY_HOLD = "verify_hold"
    TRANSPORT = "transport"
    RELEASE = "release"
    VERIFY_RELEASE = "verify_release"
    RETREAT = "retreat"
    PUSH = "push"
    RECOVER = "recover"
    SAFE_STOP = "safe_stop"
    ABORT = "abort"
    CLEARED = "cleared"


STAGES = tuple(list(State)[: list(State).index(State.PUSH)])
"""States that a removal passes, first to last. What no hand can hold is pushed instead;
the rest are ways out of a try."""
