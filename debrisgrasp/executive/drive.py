"""Control loops of one limb: every tick reads, judges, and only then commands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from debrisgrasp._arrays import FloatArray
from debrisgrasp.control import (
    CartesianLeg,
    Command,
    Compliance,
    ContactGuard,
    ControllerConfig,
    LegController,
    LegOutcome,
    LegState,
    Reading,
    RefusalCause,
    SafetyState,
    ServoConfig,
    Supervisor,
    TarePolicy,
)
from debrisgrasp.control._rigid import Wrench
from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import LimitSet, Trajectory

from .along import taken_along
from .felt import feel_out
from .noticed import OUTSIDE, cant_start, misplaced, refused
from .pacing import broken_by, careful, moving_points, paced
from .result import FaultFound, LegEnd
from .senses import SAFETY, Senses

__all__ = ["Drive"]

_TRUNK_STILL = ServoConfig(shared_cost=1e6)
"""Turned on, an arm that touches something would be pressed harder."""
_BRAKES_WITHIN = 0.03
"""Slower is a leg on which the joints need longer to stop [s]."""
_AT_START = 0.03
"""A trajectory begins where the arm stands, within this [rad or m]."""
_AT_REST = 1e-6
"""A joint that is slower stands [rad/s or m/s]."""
_BRAKING = 0.1
"""Most arms stand after so long [s]; one that does not is looked at again ..."""
_STILL = 0.02
"""... as often [s] ..."""
_CREEP = 0.01
"""... until its joints are slower than this [rad/s or m/s]."""
_STRIDE = 25
"""Every so many ticks a posture of the way is remembered."""
_RUN_OUT = 1.5
"""A leg that is done has come to rest within so long [s]."""
_ENGAGES_WITHIN = 0.5
"""[s]."""


_Begun = tuple[LegController, LegState]


class Drive(Senses):
    """Moves one limb; each method returns the fault that ended it, or what it did."""

    def engage(self) -> FaultFound | None:
        """Have the drives follow, and see that the arm may move from where it is."""
        fault = self.switch_on()
        if fault is not None:
            return fault
        q = np.asarray(self.read().q, dtype=np.float64)
        if self.limb.doubt is not None:
            return self._doubted(self.limb.doubt)
        return misplaced(q, self.limb.limits.controller, self.limb.name)

    def switch_on(self) -> FaultFound | None:
        """Have the drives follow, as a transaction: read back, or else undone."""
        arm, name = self.devices.arm, self.limb.name
        if arm.is_stopped:
            return FaultFound("controller_refuses", "a stop is latched", name)
        if not arm.is_engaged:
            arm.engage()
            end = self.clock.now() + _ENGAGES_WITHIN
            while not arm.is_engaged and self.clock.now() < end:
                self.context.wait(self.period)
        if not arm.is_engaged:
            arm.disengage()
            words = f"not engaged after {_ENGAGES_WITHIN:g} s; rolled back"
            return FaultFound("controller_refuses", words, name)
        return None

    def stand(
        self,
        seconds: float,
        until: Callable[[Wrench], bool] | None = None,
        *,
        at_least: int = 1,
    ) -> list[Reading] | FaultFound:
        """Stand, and return all readings, ``at_least`` so many.

        ``until`` ends it by the load.
        """
        supervisor, begun = self.supervised()
        if isinstance(begun, FaultFound):
            return begun
        state, q = begun, tuple(np.asarray(begun.q).tolist())
        readings = []
        for _ in range(max(int(np.ceil(seconds / self.period - 1e-9)), at_least)):
            # Without a command an arm holds by itself.
            fault, state, reading = self.ticked(supervisor, state, q, is_moving=False)
            if fault is not None:
                return fault
            readings.append(reading)
            if until is not None and until(self.load):
                break
        return readings

    def follow(self, trajectory: Trajectory, *, pace: float = 1.0) -> FaultFound | None:
        """Follow a planned motion at a share of its speed, supervised.

        It is slower than that where a touch could break the hand.
        """
        found = self._followed(trajectory, pace)
        if found and (found.fault, found.arm) == ("plan_collision", self.limb.name):
            feel_out(self)  # the next way leads around it
        return found

    def _followed(self, trajectory: Trajectory, pace: float) -> FaultFound | None:
        """Follow a motion until it ends, or meets something."""
        limits = self.limb.limits.planner
        if odd := _unfit(trajectory, limits):
            return FaultFound("limit_mismatch", odd, self.limb.name)
        engaged = self.engage()
        if engaged is not None:
            return engaged
        # Before the first baseline nobody knows what the sensor is worth.
        context = self.context
        is_free = context.held is None and self.limb.baseline_time > 0.0
        supervisor, begun = self.supervised(is_free=is_free, is_planned=True)
        if isinstance(begun, FaultFound):
            return begun
        state, gap = begun, float(np.abs(np.array(begun.q) - trajectory.q[0]).max())
        if gap > _AT_START:
            words = f"{gap:.3f} rad or m from the start of the motion"
            return FaultFound("plan_collision", words, self.limb.name)
        # The last leg may have commanded in this very tick.
        fault, state, now = self.ticked(supervisor, state, begun.q, is_moving=False)
        if fault is not None:
            return fault
        points, room = moving_points(context, self.limb), self.room(supervisor.config)
        paces = careful(context, self.limb, points, trajectory, pace, room)
        start = self._stands_at(now)
        path = paced(trajectory, paces, start, self.period, limits)
        if odd := broken_by(path, self.limb.limits.controller, self.period):
            words = f"a motion as it would be run: {odd}"
            return FaultFound("limit_mismatch", words, self.limb.name)
        rows, along = path.tolist(), taken_along(self, trajectory.q)
        for i, q in enumerate(rows):
            self._send(q)
            fault, state, _ = self.ticked(supervisor, state, q, is_moving=True)
            for other in along:
                fault = fault or other.met()
            if fault is not None:
                self._halt()
                self.limb.went(path[: i + 1 : _STRIDE])
                return fault
        self.limb.went(np.concatenate([path[::_STRIDE], path[-1:]]))
        return self._settle(supervisor, state, rows[-1])

    def _settle(
        self, supervisor: Supervisor, state: SafetyState, q: list[float]
    ) -> FaultFound | None:
        """Wait until the arm has come to where it was sent."""
        fault = None
        for _ in range(int(0.4 / self.period)):
            self._send(q)
            fault, state, _ = self.ticked(supervisor, state, q, is_moving=False)
            gap = max(abs(a - b) for a, b in zip(state.q, q, strict=True))
            if fault is not None or gap < 1e-3:
                return fault
        return None

    def leg(
        self,
        goal: SE3 | ArrayLike,
        *,
        speed: float,
        turn_rate: float = 0.2,
        guard: ContactGuard | None = None,
        compliance: Compliance | None = None,
        tare: TarePolicy = TarePolicy.MOTION,
        until: Callable[[Wrench], bool] | None = None,
        limits: LimitSet | None = None,
    ) -> LegEnd | FaultFound:
        """Go straight to a pose, or by an offset in base (3,) [m], until a touch.

        Parameters
        ----------
        speed
            Of the hand [m/s]; no more than `straight_speed`.
        turn_rate
            Of the hand, at most [rad/s].
        limits
            That hold on this leg; None: the controller's.
        until
            Ends the leg as a touch does, by what it is told of the load.
        """
        engaged = self.engage()
        if engaged is not None:
            return engaged
        along = taken_along(self)
        begin = partial(
            self._begun,
            goal,
            turn_rate=turn_rate,
            is_trunk_still=any(other.is_pressed for other in along),
            guard=guard,
            compliance=compliance,
            tare=tare,
            limits=limits,
        )
        found = _slow_enough(begin, min(speed, self.straight_speed))
        if isinstance(found, FaultFound):
            return found
        controller, state = found
        sent = self.limb.sent
        if sent is None or self.clock.now() > sent[0]:
            self._send(state.servo.q)  # speeds count from the tick of the last command
        self.limb.went(np.array([state.servo.q]))
        while True:
            done = self._stepped(controller, state)
            if isinstance(done, FaultFound):
                return done
            state, command = done
            fault = self._watched_fingers(command.load)
            for other in along:
                fault = fault or other.met()
            if fault is not None:
                self._halt()
                return fault
            if until is not None and until(command.load):
                state = state._replace(outcome=LegOutcome.CONTACT)
                break
            if command.outcome is not LegOutcome.RUNNING:
                break
        for _ in range(int(_RUN_OUT / self.period)):
            if not state.servo.is_moving:
                break
            done = self._stepped(controller, state)
            if isinstance(done, FaultFound):
                return done
            state, command = done
            if until is not None:
                until(command.load)  # it may have more to stop than this arm
        else:
            self._brake()
        return LegEnd(state.outcome, state.share, controller.leg.length)

    def _stepped(
        self, controller: LegController, state: LegState
    ) -> tuple[LegState, Command] | FaultFound:
        """Wait one period, read, judge, and command the next step of a leg."""
        self.clock.wait_until(self.clock.now() + self.period)
        reading = self.read()
        if self.limb.doubt is not None:
            return self._doubted(self.limb.doubt)
        state, command = controller.step(state, reading)
        self._note(reading.time, command.load)
        if command.stop is not None:
            return self._stopped(command.stop, reading)
        self._send(command.q)
        if not self._tick % _STRIDE:
            self.limb.went(np.array([command.q]))
        return state, command

    def _brake(self) -> None:
        """Let the drives brake by themselves, and wait until they have."""
        self.devices.arm.disengage()
        self.context.wait(_BRAKING)
        for _ in range(int(_RUN_OUT / _STILL)):
            before = self.read().q
            self.context.wait(_STILL)
            now = self.read().q
            if self.limb.doubt is not None:
                return
            gone = max(abs(a - b) for a, b in zip(now, before, strict=True))
            if gone <= _CREEP * _STILL:
                return

    def _begun(
        self,
        goal: SE3 | ArrayLike,
        speed: float,
        *,
        turn_rate: float,
        is_trunk_still: bool,
        guard: ContactGuard | None,
        compliance: Compliance | None,
        tare: TarePolicy,
        limits: LimitSet | None,
    ) -> _Begun | FaultFound:
        """Begin a leg where the arm stands; or why it is refused.

        Parameters
        ----------
        is_trunk_still
            Whether joints that turn other arms, too, are not moved.
        """
        limb = self.limb
        reading = self.read()
        q = self._stands_at(reading)
        try:
            start = limb.pose(q)
            if isinstance(goal, SE3):
                leg = CartesianLeg(start, goal)
            else:
                leg = CartesianLeg.along(start, goal)
            controller = LegController(
                limb.reach.chain,
                replace(limits or self.limits, deflection=self.context.settings.clamp),
                limb.loads,
                leg,
                ControllerConfig(
                    period=self.period,
                    speed=speed,
                    turn_rate=turn_rate,
                    tare=tare,
                    safety=SAFETY,
                    servo=_TRUNK_STILL if is_trunk_still else ServoConfig(),
                ),
                compliance=compliance,
                guard=guard,
                baseline_time=self.context.sure_since(limb),
            )
            engagement = controller.engage(reading._replace(q=q))
        except InputError as error:
            return cant_start(error, reading, limb.name)
        if engagement.state is None:
            return refused(engagement.refusals, reading, limb.name)
        return controller, engagement.state

    def _send(self, q: Sequence[float]) -> None:
        """Command a posture."""
        self.devices.arm.command(q)
        self.limb.sent = self.clock.now(), q

    def _stands_at(self, reading: Reading) -> FloatArray:
        """Where a motion goes on: as last commanded, if that was just now.

        Joints at the end of their range may read a little outside of it.
        """
        q, sent = np.asarray(reading.q, dtype=np.float64), self.limb.sent
        if sent is not None and len(q) == len(sent[1]):
            is_recent = reading.time - sent[0] <= 2.5 * self.period
            aim = np.asarray(sent[1], dtype=np.float64)
            if is_recent and np.abs(q - aim).max() < _AT_START:
                q = aim
        if len(q) != self.limits.n_joints:
            return q
        inside = np.clip(q, self.limits.lower, self.limits.upper)
        return inside if np.abs(inside - q).max() <= OUTSIDE else q


def _unfit(trajectory: Trajectory, limits: LimitSet) -> str:
    """Say why no arm may follow a motion; empty if it may."""
    try:
        trajectory.require_executable(limits)
    except ConfigError as error:
        return str(error)
    for dq, when in ((trajectory.dq[0], "begins"), (trajectory.dq[-1], "ends")):
        joint = int(np.abs(dq).argmax())
        if abs(dq[joint]) > _AT_REST:
            name = trajectory.joint_names[joint]
            return f"a motion {when} with {name} at {dq[joint]:.3g} rad/s or m/s, not 0"
    return ""


def _slow_enough(
    begin: Callable[[float], _Begun | FaultFound], speed: float
) -> _Begun | FaultFound:
    """Begin a leg at a speed [m/s], or slower, from which the joints soon brake."""
    for _ in range(4):
        found = begin(speed)
        if isinstance(found, FaultFound):
            if RefusalCause.BRAKING not in found.refused_for:
                break
            speed *= 0.5
            continue
        controller, state = found
        time = controller.braking_time(state.servo)
        if time <= _BRAKES_WITHIN:
            break
        speed *= max(0.95 * _BRAKES_WITHIN / time, 0.125)
    return found
