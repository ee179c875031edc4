"""The executive: runs the states, answers faults, and always comes to an end."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Protocol

import numpy as np

from debrisgrasp._arrays import Rng
from debrisgrasp._checked import checked_fields
from debrisgrasp.control import FaultClass
from debrisgrasp.errors import InputError
from debrisgrasp.pipeline import Pipeline, with_hands
from debrisgrasp.pipeline.inputs import require_generic
from debrisgrasp.prototypes import with_shipped
from debrisgrasp.robot import Robot

from .context import Context, Cycle, Recorder
from .faults import Action, fault_named
from .guarded import guarded
from .limbs import limbs_of, require_devices
from .outcome import Attempt, FaultEvent, RunEnd, RunResult
from .record import NoRecord
from .recover import clear_up, recover
from .result import Done, FaultFound, StepResult
from .settings import TaskSettings
from .stances import planning_around, standing
from .states import State
from .steady import SteadyClock
from .steps import STEPS
from .stopping import reset_stops, stop_all
from .table import FOLLOWING, Answer, answer_to
from .tries import remember

__all__ = ["Executive", "Observer"]

_RECOVERIES = 4
"""So many times an arm is brought out of the pile and to rest, before the run ends."""
_PLANS = 3
"""Tries that end with the plan may be so many times as many as others."""
_OF_THE_PILE = (FaultClass.BAD_GRASP, FaultClass.PLANNING)


class Observer(Protocol):
    """Hears which state the task is in."""

    def on_state(self, state: State) -> None:
        """Take note of the state that begins."""
        ...


@checked_fields
class Executive:
    """Clears a pile with a robot, or says why not.

    Parameters
    ----------
    robot
        Devices; see `debrisgrasp.robot.Robot`.
    settings
        What is to be done.
    pipeline
        Plans the grasps; None: one for the robot's model. Of one that plans for further
        arms than `TaskSettings.arms` the grasps of those are left out.
    observers
        Hear of every state.
    record
        Takes down every decision; see `RunRecord`.
    rng
        The same state, and the same robot, give the same run.

    Raises
    ------
    UnknownNameError
        If an arm, its posture of rest, or a joint of the look is not the robot's.
    InputError
        If the robot has no arm in use, a drop-off is out of reach, the pipeline plans
        for another robot, or something is not what its annotation says.
    """

    def __init__(
        self,
        robot: Robot,
        settings: TaskSettings | None = None,
        *,
        pipeline: Pipeline | None = None,
        observers: Sequence[Observer] = (),
        record: Recorder | None = None,
        rng: Rng,
    ) -> None:
        settings = settings or TaskSettings()
        clock, model = SteadyClock(robot.clock), standing(robot, settings)
        robot = replace(robot, clock=clock, model=model)
        if pipeline is None:
            arm = settings.arms[0] if len(settings.arms) == 1 else None
            pipeline = Pipeline(robot=robot.model, arm=arm)
        pipeline = planning_around(pipeline, model)
        if settings.mark is None and settings.region is None:
            require_generic(pipeline.library)
        hands = with_shipped(pipeline.grippers)
        model = with_hands(robot.model, hands)
        model.joint_values(settings.look)
        require_devices(robot, settings.look or {})
        limbs = limbs_of(robot, settings, model, hands)
        self.context = Context(
            robot=robot,
            model=model,
            settings=settings,
            pipeline=pipeline,
            record=record or NoRecord(),
            rng=rng,
            limbs=limbs,
        )
        self._observers = tuple(observers)
        self._used: Counter[tuple[State, str]] = Counter()
        self._attempts: list[Attempt] = []
        self._faults: list[FaultEvent] = []
        self._of_attempt = 0
        self._silent: tuple[str, ...] = ()

    def run(self) -> RunResult:
        """Run to an end, once; raises nothing, whatever the robot does.

        A `KeyboardInterrupt` in any state stops the arms and ends the run in order.
        What an observer or the record raises is passed on, once the arms are stopped.
        A second run is refused (`InputError`): what is known is of the first.
        """
        if self.context.begun is not None:
            raise InputError(
                "run of an Executive",
                got="a second one",
                expected="one",
                mend="Make another Executive of the same robot, pipeline and settings.",
            )
        self.context.begun = self.context.now()
        try:
            end = self._run()
        except KeyboardInterrupt:
            self._stop("interrupted")
            end = RunEnd.INTERRUPTED
        except BaseException as error:
            for silent in stop_all(self.context):  # nobody watches the arms any more
                error.add_note(f"NOT STOPPED: {silent}")
            raise
        return self._result(end)

    def _run(self) -> RunEnd:
        state = State.SELF_TEST
        while True:
            if state is State.CAPTURE and self._is_enough():
                return RunEnd.FINISHED
            if state in FOLLOWING and self._has_tried_enough(state):
                self.context.cycle = Cycle(number=self.context.cycle.number)
                self._note(State.SELECT, _given_up(self.context), Action.ABORT)
                state = State.ABORT
            self._enter(state)
            if state is State.CLEARED:
                return RunEnd.CLEARED
            if state is State.SAFE_STOP:
                return self._stopped()
            if state is State.ABORT:
                return self._aborted()
            result = self._stepped(state)
            self._flush_trace(state)
            if isinstance(result, FaultFound):
                state = self._answered(state, result)
                continue
            self._write("done", {"state": state.value, **result.facts})
            if state is State.RETREAT:
                self._forgive()
                self._finish_attempt()
            state = result.next or FOLLOWING[state]

    def _is_enough(self) -> bool:
        most = self.context.settings.max_removals
        return most is not None and self.context.n_removed >= most

    def _has_tried_enough(self, state: State) -> bool:
        """Whether arms went to objects as often as allowed, or plans led nowhere.

        A look may still tell that the way is clear.
        """
        n_most, n_tried = self.context.settings.max_attempts, len(self._attempts)
        n_gone = sum(attempt.has_set_out for attempt in self._attempts)
        is_next = state in (State.PLAN_GRASP, State.PUSH)
        return (is_next and n_gone >= n_most) or n_tried - n_gone >= _PLANS * n_most

    def _enter(self, state: State) -> None:
        context = self.context
        context.state = state
        if state in FOLLOWING:
            context.cycle.reached.append(state)
        self._write("state", {"state": state.value, "time": round(context.now(), 4)})
        for observer in self._observers:
            observer.on_state(state)

    def _stepped(self, state: State) -> StepResult:
        """Run one step; whatever it raises becomes a fault."""
        return guarded(self.context, lambda: STEPS[state](self.context))

    def _answered(self, state: State, found: FaultFound) -> State:
        """Do what the table says about a fault; returns where to go on."""
        context = self.context
        used = self._used[state, found.fault]
        self._used[state, found.fault] += 1
        answer = answer_to(state, found.fault, used)
        too_many = 10 * context.settings.max_attempts
        if len(self._faults) >= too_many and answer.action is not Action.STOP:
            answer = replace(answer, action=Action.ABORT)  # nothing goes round for ever
        event = self._note(state, found, answer.action)
        if answer.action is Action.STOP:
            return State.SAFE_STOP
        if answer.action is Action.ABORT:
            return State.ABORT
        if answer.action in (Action.NEXT, Action.RETRY):
            remember(context, state, found)
        if answer.action is Action.SKIP:
            assert answer.resume is not None
            return answer.resume
        self._enter(State.RECOVER)
        carried_out = self._recovered(event, answer)
        if isinstance(carried_out, State):
            return carried_out
        resume = carried_out.resume or state
        self._write("recovered", {"resume": resume.value})
        is_new = resume in (State.SELECT, State.CAPTURE, State.SELF_TEST)
        if is_new and context.cycle.label is not None:
            self._finish_attempt(keeps_look=resume is State.SELECT)
        return resume

    def _forgive(self) -> None:
        """After a removal, retries of what has to do with the pile begin anew."""
        for state, fault in list(self._used):
            if fault_named(fault).fault_class in _OF_THE_PILE:
                del self._used[state, fault]

    def _recovered(self, event: FaultEvent, answer: Answer) -> State | Answer:
        """Carry an answer out; a state if that failed, and the run must end there.

        Who can't go on with what is in the hand puts it down, and looks anew.
        """
        context = self.context
        for n_left in reversed(range(_RECOVERIES)):
            result = guarded(context, partial(recover, context, event, answer))
            self._flush_trace(State.RECOVER)
            if not isinstance(result, FaultFound):
                break
            again = answer_to(State.RECOVER, result.fault)
            is_stop = again.action is Action.STOP
            is_lost = result.fault == "connection_lost"
            # Who was asked again and did not answer is not asked once more.
            is_silent = is_lost and event.fault == "connection_lost"
            if is_stop or n_left == 0 or is_silent:
                action = Action.STOP if is_stop else Action.ABORT
                self._note(State.RECOVER, result, action)
                return State.SAFE_STOP if is_stop else State.ABORT
            noted = self._note(State.RECOVER, result, Action.RETRY)
            if is_lost:
                event = noted
            elif context.held is not None and not answer.is_cleared_up:
                answer = answer.putting_down()  # what slips will not calm down, either
        return answer

    def _stopped(self) -> RunEnd:
        """Latch the stop, and move nothing any more."""
        self._stop("safe stop")
        return RunEnd.STOPPED

    def _stop(self, why: str) -> None:
        """Stop everything, and keep what does not."""
        self._silent = tuple(stop_all(self.context))
        self._write("stop", {"why": why, "silent": list(self._silent)})

    def _aborted(self) -> RunEnd:
        """End in order, as far as the robot lets us."""
        context = self.context
        last = self._faults[-1] if self._faults else None
        if last is not None and last.fault == "connection_lost":
            return self._stopped()
        if context.held is None and context.is_in_pile is None:
            return RunEnd.LEFT if _is_nothing_more(last) else RunEnd.ABORTED
        result = guarded(context, lambda: _cleared_up(context))
        self._flush_trace(State.ABORT)
        if isinstance(result, FaultFound):
            # The class of the run is that of what it was aborted for.
            event = self._event(State.ABORT, result, Action.STOP)
            self._write("fault", event.facts())
            return self._stopped()
        return RunEnd.ABORTED

    def _note(self, state: State, found: FaultFound, action: Action) -> FaultEvent:
        event = self._event(state, found, action)
        self._faults.append(event)
        self._write("fault", event.facts())
        return event

    def _event(self, state: State, found: FaultFound, action: Action) -> FaultEvent:
        return FaultEvent(
            time=self.context.now(),
            state=state,
            fault=found.fault,
            message=found.message,
            action=action,
            arm=found.arm,
            values=dict(found.values),
        )

    def _finish_attempt(self, *, keeps_look: bool = False) -> None:
        """Close the present attempt, and begin the next."""
        cycle = self.context.cycle
        faults = tuple(self._faults[self._of_attempt :])
        if cycle.label is None and not faults:
            return
        motion = cycle.motion
        attempt = Attempt(
            number=len(self._attempts) + 1,
            reached=tuple(dict.fromkeys(cycle.reached)),
            is_removed=cycle.is_removed,
            pushed=cycle.pushed,
            faults=faults,
            object_label=cycle.label,
            look=cycle.look,
            centroid=cycle.centroid,
            arm=motion.arm if motion else None,
            prototype=motion.grasp.prototype if motion else None,
            score=float(motion.grasp.score) if motion else None,
            peak_force=cycle.peak_force,
            peak_torque=cycle.peak_torque,
        )
        self._attempts.append(attempt)
        self._of_attempt = len(self._faults)
        self._write("attempt", attempt.facts())
        following = Cycle(number=len(self._attempts) + 1)
        if keeps_look:
            following.capture, following.seen = cycle.capture, cycle.seen
        self.context.cycle = following

    def _flush_trace(self, state: State) -> None:
        trace = self.context.trace
        if trace:
            rows = np.round(np.array(trace), 3).tolist()
            self._write("trace", {"state": state.value, "rows": rows})
            trace.clear()

    def _write(self, kind: str, facts: Mapping[str, object]) -> None:
        self.context.record.write(kind, facts)

    def _result(self, end: RunEnd) -> RunResult:
        if self.context.cycle.reached:
            self._finish_attempt()
        result = RunResult(
            end=end,
            attempts=tuple(self._attempts),
            faults=tuple(self._faults),
            left=dict(self.context.left),
            duration=self.context.now() - (self.context.begun or 0.0),
            silent=self._silent,
            holding=held.arm if (held := self.context.held) else None,
        )
        first = result.first_fault
        self._write(
            "end",
            {
                "end": end.value,
                "removed": result.n_removed,
                "pushed": result.n_pushed,
                "class": result.counted_as,
                "first_fault": first.fault if first else None,
                "left": dict(result.left),
                "holding": result.holding,
                "time": round(self.context.now(), 4),
            },
        )
        return result


def _is_nothing_more(last: FaultEvent | None) -> bool:
    """Whether a run ends because no object that is left is worth another try."""
    return last is not None and last.state is State.SELECT and last.fault == "no_grasp"


def _cleared_up(context: Context) -> StepResult:
    reset_stops(context)
    return clear_up(context) or Done()


def _given_up(context: Context) -> FaultFound:
    n = context.settings.max_attempts
    return FaultFound("no_grasp", f"{n} attempts were made, as many as allowed")
