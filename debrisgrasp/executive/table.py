"""The task as data: which state follows which, and what is done about each fault.

Nothing here moves anything. `Executive` looks up where to go, `recover` carries an
answer out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

from .faults import Action, fault_named
from .states import STAGES, State

__all__ = ["ANSWERS", "FOLLOWING", "HOLDING", "Answer", "answer_to"]

FOLLOWING: Mapping[State, State] = {
    **dict(pairwise(STAGES)),
    State.RETREAT: State.CAPTURE,
    State.PUSH: State.RETREAT,
}
"""The state after each one that went well; each removal begins with a new capture."""

HOLDING = (
    State.LIFT,
    State.VERIFY_HOLD,
    State.TRANSPORT,
    State.RELEASE,
    State.VERIFY_RELEASE,
)
"""States in which the hand may hold an object."""

_IN_THE_PILE = (
    State.PREGRASP,
    State.SWITCH,
    State.APPROACH,
    State.CLOSE,
    State.VERIFY_GRASP,
    State.PUSH,
)


@dataclass(frozen=True, slots=True)
class Answer:
    """What is done about a fault."""

    action: Action
    budget: int = 0
    """So many times in one run; then `then`. 0: `action` is final."""
    then: Action = Action.ABORT
    resume: State | None = None
    """Where to go on after a retry, a hold or a skip; None: by the state."""
    is_cleared_up: bool = False
    """Whether the hand first puts down what it has, backs out and goes to rest."""

    def putting_down(self) -> Answer:
        """Put down what is held instead, at once, and look anew."""
        return replace(
            self, action=Action.RETRY, is_cleared_up=True, resume=State.CAPTURE
        )


def _default_resume(state: State, action: Action) -> State:
    """Where to go on if nothing else is said."""
    if action is Action.SKIP:
        return FOLLOWING[state]
    if action is Action.NEXT and state is State.RETREAT:
        return state  # the object is gone: only the arm was not back
    if action is Action.NEXT:
        is_planning = state in (State.SELECT, State.PLAN_GRASP, State.PLAN_MOTION)
        return State.SELECT if is_planning else State.CAPTURE
    if state in (State.SEGMENT, State.SELECT, State.PLAN_GRASP, State.PLAN_MOTION):
        return State.CAPTURE
    return State.RELEASE if state is State.VERIFY_RELEASE else state


_AGAIN = Answer(Action.RETRY, 1, Action.NEXT, State.CAPTURE, is_cleared_up=True)
_BASELINE = Answer(Action.RETRY, 1, Action.ABORT, State.SELF_TEST, is_cleared_up=True)
_SHAKEN = Answer(Action.RETRY, 3, Action.STOP, State.SELF_TEST, is_cleared_up=True)

ANSWERS: Mapping[tuple[State, str], Answer] = {
    **{(state, "early_contact"): _AGAIN for state in _IN_THE_PILE},
    **{(state, "slip"): _AGAIN for state in (*_IN_THE_PILE, *HOLDING)},
    **{(state, "finger_jammed"): replace(_AGAIN, then=Action.ABORT)
       for state in _IN_THE_PILE},
    **{(state, "bias_drift"): _BASELINE for state in (*_IN_THE_PILE, *HOLDING)},
    # Rubble that slides off, or knocks, is felt as a jump and as a swing. The stop is
    # ended, and what the sensor is worth is seen by a new baseline.
    **{(state, fault): _SHAKEN for state in (State.CLOSE, State.VERIFY_GRASP, *HOLDING)
       for fault in ("bias_jump", "oscillation")},
    # So is what others hold down: it is too heavy, once the zero was right thrice.
    (State.LIFT, "oscillation"): replace(_SHAKEN, then=Action.NEXT),
    # What a plan could not foresee may be otherwise after another look.
    (State.PREGRASP, "plan_collision"): replace(_AGAIN, budget=3),
    (State.TRANSPORT, "plan_collision"): Answer(
        Action.RETRY, 3, Action.NEXT, State.LIFT
    ),
    # An object may lie where things are to be put down: nobody can put more there.
    (State.SEGMENT, "plan_collision"): Answer(Action.ABORT),
    # Without an object in sight there is no next one.
    (State.CAPTURE, "depth_dropout"): Answer(Action.RETRY, 2),
    # Objects are left, and none is worth another try.
    (State.SELECT, "no_grasp"): Answer(Action.ABORT),
    (State.SELF_TEST, "plan_collision"): Answer(Action.ABORT),
    # The hand shows itself elsewhere once it is clear of what it met; without a way it
    # does not, and the ground alone tells of the camera.
    (State.CALIB_CHECK, "plan_collision"): replace(
        _AGAIN, budget=2, resume=State.CALIB_CHECK
    ),
    (State.SELF_TEST, "unreachable"): Answer(Action.ABORT),
    (State.RETREAT, "plan_collision"): Answer(Action.RETRY, 2, Action.NEXT),
    # Felt out and seen to be empty, the hand takes the next; else that is a fault.
    (State.VERIFY_RELEASE, "not_released"): Answer(Action.RETRY, 1, Action.NEXT),
    # A jammed finger that holds something is not opened by trying harder.
    (State.RELEASE, "finger_jammed"): Answer(Action.RETRY, 1),
    # In free space; later, who can't trust the sensor puts nothing down.
    (State.SELF_TEST, "wrench_sign"): Answer(Action.ABORT),
    # Whoever touches something at rest, or carries it, can't do without a stop.
    (State.SELF_TEST, "too_heavy"): Answer(Action.STOP),
    (State.RETREAT, "too_heavy"): Answer(Action.STOP),
}  # fmt: skip
"""Answers that depend on the state; all others are those of `FAULTS`."""


def answer_to(state: State, fault: str, used: int = 0) -> Answer:
    """Answer to a fault in a state, complete.

    Parameters
    ----------
    used
        How often the same fault was answered in the same state before.

    Raises
    ------
    UnknownNameError
        If there is no such fault.
    """
    spec = fault_named(fault)
    answer = ANSWERS.get((state, fault))
    if answer is None:
        answer = Answer(spec.action, spec.budget, spec.then)
    if answer.budget and used >= answer.budget:
        answer = Answer(answer.then)
    is_final = answer.action in (Action.STOP, Action.ABORT)
    if state is State.PUSH and not is_final and answer.resume is not State.SELF_TEST:
        answer = Answer(Action.NEXT)  # it may lie elsewhere now: only a look helps
    has_moved = state in (*_IN_THE_PILE, *HOLDING, State.RETREAT, State.CALIB_CHECK)
    if answer.action is Action.NEXT and has_moved:
        answer = replace(answer, is_cleared_up=True)
    if answer.resume is None and state in FOLLOWING:
        answer = replace(answer, resume=_default_resume(state, answer.action))
    return answer
