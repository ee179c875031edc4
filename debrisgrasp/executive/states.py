"""The states of a removal, in the order in which they are passed."""

from __future__ import annotations

from enum import Enum

from debrisgrasp.errors import UnknownNameError

from .faults import LISTED_BY

__all__ = ["STAGES", "State", "state_named"]


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


def state_named(name: str) -> State:
    """Look a state up, or raise `UnknownNameError`."""
    known = {state.value: state for state in State}
    if name not in known:
        raise UnknownNameError("state", name, known, listed_by=LISTED_BY)
    return known[name]
