"""What each state does."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from .aside import push_aside
from .calibrated import calib_check
from .carrying import lift, transport, verify_hold
from .choose import select
from .choose_grasp import plan_grasp, plan_motion
from .closing import close, verify_grasp
from .context import Context
from .grasping import approach, pregrasp, switch
from .perceive import capture, segment
from .prepare import self_test
from .releasing import release, retreat, verify_release
from .result import StepResult
from .states import State

__all__ = ["STEPS"]

STEPS: Mapping[State, Callable[[Context], StepResult]] = {
    State.SELF_TEST: self_test,
    State.CALIB_CHECK: calib_check,
    State.CAPTURE: capture,
    State.SEGMENT: segment,
    State.SELECT: select,
    State.PLAN_GRASP: plan_grasp,
    State.PLAN_MOTION: plan_motion,
    State.PREGRASP: pregrasp,
    State.SWITCH: switch,
    State.APPROACH: approach,
    State.CLOSE: close,
    State.VERIFY_GRASP: verify_grasp,
    State.LIFT: lift,
    State.VERIFY_HOLD: verify_hold,
    State.TRANSPORT: transport,
    State.RELEASE: release,
    State.VERIFY_RELEASE: verify_release,
    State.RETREAT: retreat,
    State.PUSH: push_aside,
}
"""Step function of each state."""
