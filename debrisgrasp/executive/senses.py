"""What one limb feels while it moves: its load, its fingers, and what they tell."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import hypot

import numpy as np

from debrisgrasp._arrays import FloatArray
from debrisgrasp._physics import GRAVITY
from debrisgrasp.control import (
    FingerReading,
    GripCommand,
    GripPhase,
    LoadModel,
    Reading,
    SafetyConfig,
    SafetyState,
    Stop,
    Supervisor,
)
from debrisgrasp.control._rigid import Wrench
from debrisgrasp.control.grip import STILL_FELT
from debrisgrasp.errors import InputError

from .context import Context, Held
from .noticed import cant_start, fault_of_stop
from .result import FaultFound
from .states import State

__all__ = ["SAFETY", "Senses", "mean_wrench", "met_from"]

_ZERO: Wrench = (0.0,) * 6
SAFETY = SafetyConfig()
_CARRYING = replace(SAFETY, motion_force=30.0, motion_torque=8.0)
"""What is carried should touch nothing ..."""
_UNSURE_COM = 0.15
"""... but how high its centre of mass lies was only seen, to this [m]: as the hand
leans, the torque changes by so much times the weight."""
_TOUCH, _MORE = (25.0, 8.0), (15.0, 4.0)
"""An empty hand that is taken elsewhere touches something when it bears so much, or
more than at first by so much, whichever is more [N, N m]."""
_GROWTH, _SLOWEST = 900.0, 1e-3
"""What a touch of the hardest thing grows by until the arm stands, for each m/s of a
straight way [N s/m]: 3e4 N/m for 30 ms; and the least speed of one [m/s]."""
_CLOSING = (State.CLOSE, State.VERIFY_GRASP)
_SLACK = 10.0
"""With which fingers stay where they were stopped [N]."""
_LETS_GO = 0.15
"""Fingers that have lost what they held have closed within so long [s]."""


class Senses:
    """Reads one limb, and judges at each tick what it and its fingers feel."""

    def __init__(self, context: Context, arm: str) -> None:
        self.context, self.limb = context, context.limbs[arm]
        self.devices = self.limb.limb
        self.clock = context.robot.clock
        self.period = context.settings.period
        self._finger_ticks = context.settings.finger_ticks
        self.finger_period = self._finger_ticks * self.period
        """Between two looks at the fingers while the arm moves [s]."""
        self._tick = 0
        self._loaded: LoadModel | None = None
        self.limits = self.limb.limits.controller.scaled(
            load=context.settings.load_share
        )
        """At which a motion is stopped: what grows until the arm stands has room."""
        room = self.limb.limits.controller.force - self.limits.force
        self.straight_speed = max(room / _GROWTH, _SLOWEST)
        """Of a straight way, at most: a touch stays below the limits [m/s]."""
        self.load: Wrench = _ZERO
        """Latest load at the hand, absolute, in its axes [N, N m]."""

    def read(self) -> Reading:
        """Measure joints and wrench; `LimbState.doubt` says if they can't be true."""
        joints = self.devices.arm.read()
        wrench = self.devices.sensor.read()
        self.limb.feel(joints.q, wrench.wrench_ft)
        return Reading(self.clock.now(), joints.q, wrench.wrench_ft, wrench.time)

    def weighed(self) -> Wrench:
        """Measure the load on the hand, absolute, in its axes [N, N m]."""
        reading = self.read()
        raw = np.asarray(reading.wrench_ft, dtype=np.float64).tolist()
        R, _ = self.limb.kinematics.pose(np.asarray(reading.q, dtype=float).tolist())
        self.load = self.limb.loads.load_ee(raw, R)
        return self.load

    def mean_load(self, readings: list[Reading]) -> Wrench:
        """Mean load on the hand of an arm that stands, as `weighed` has it."""
        R, _ = self.limb.kinematics.pose(self.context.posture(self.limb).tolist())
        return self.limb.loads.load_ee(mean_wrench(readings).tolist(), R)

    def fingers(self) -> FingerReading:
        """Measure the fingers."""
        read = self.devices.gripper.read()
        # What is no number is the driver's fault, and told as such, not a lost grip.
        openings, forces = map(float, read.openings), map(float, read.forces)
        return FingerReading(tuple(openings), tuple(forces))

    def _expected(self, state: SafetyState) -> Wrench:
        """Load of what is carried, as the hand is turned now."""
        held = self.context.held
        if held is None or held.payload.mass <= 0.0:
            return _ZERO
        if self._loaded is None:
            self._loaded = self.limb.loads.with_payload(held.payload)
        return self._loaded.payload_ee(self.limb.kinematics.pose(state.q)[0])

    def _halt(self) -> None:
        """Stop the arm; fingers that were closing go on no more either."""
        self.devices.arm.stop()
        if self.context.state in _CLOSING:
            self.halt_fingers()

    def _doubted(self, why: FaultFound) -> FaultFound:
        """Stop, for nobody knows where the arm is, or what presses on it."""
        self._halt()
        return why

    def halt_fingers(self) -> None:
        """Leave the fingers where they are, with hardly any force."""
        self._stay(_SLACK)

    def _stay(self, force: float) -> None:
        """Leave the fingers where they are."""
        self.send_fingers(self.fingers().openings, force)

    def send_fingers(self, openings: Sequence[float], force: float) -> None:
        """Send each pad somewhere [m] with a force [N], within what the hand can do.

        What is read may lie beyond that: a drive tells less than nothing where a
        finger curls around what it holds.
        """
        hand = self.limb.hand
        shape = hand.preshape(self.limb.preshape)
        inside = [min(max(x, shape.narrowest), shape.widest) for x in openings]
        force = min(max(force, 0.0), hand.max_force)
        self.devices.gripper.command(GripCommand(tuple(inside), force))

    def _stopped(self, stop: Stop, reading: Reading) -> FaultFound:
        """Halt, and name the fault; fingers that hold something squeeze it on.

        Where those of one side have lost it they close no more: the others would press
        the hand off it.
        """
        self._halt()
        held = self.context.held
        if held is None or held.arm != self.limb.name:
            return self._fault(stop, reading)
        has_lost = held.grip.weakest(self.fingers().forces) < STILL_FELT
        # Sent to where they are, fingers whose joints tell that would let go.
        if has_lost and self.context.state not in _CLOSING:
            self._stay(held.grip.config.squeeze)
        return self._fault(stop, reading)

    def squeezed_on(self, seconds: float) -> FaultFound | None:
        """Let the arm stand, and notice when what it holds is lost.

        No load is judged.
        """
        for _ in range(max(int(np.ceil(seconds / self.period - 1e-9)), 1)):
            self.context.wait(self.period)
            self._note(self.clock.now(), self.weighed())
            if self.limb.doubt is not None:
                return self._doubted(self.limb.doubt)
            fault = self._watched_fingers(self.load)
            if fault is not None:
                return fault
        return None

    def _watched_fingers(self, load: tuple[float, ...]) -> FaultFound | None:
        """While something is held: go on squeezing, and notice when it is lost."""
        held = self.context.held
        if held is None or held.arm != self.limb.name or not held.is_watched:
            return None
        if self._tick % self._finger_ticks:
            return None
        fingers = self.fingers()
        carried = self.carried(load) if held.is_lifted else None
        held.state, command = held.watch.step(
            held.state, fingers._replace(carried=carried)
        )
        self.send_fingers(*command)
        if held.state.phase is GripPhase.SLIPPED and self._is_borne(held, fingers):
            # It lies on something, or something that lay on it is gone.
            held.state = held.state._replace(
                phase=GripPhase.HOLDING, most_carried=carried or 0.0, slipping=0.0
            )
            if self.context.state is not State.TRANSPORT:
                return None
            words = f"of what is carried {carried or 0.0:.0f} N are left: it touches "
            return FaultFound("plan_collision", words + "something", self.limb.name)
        if held.state.phase in (GripPhase.SLIPPED, GripPhase.LOST):
            if not held.is_lifted:
                # Nothing was lifted clear: closing on, they would push the hand off it.
                self.halt_fingers()
            what = held.state.phase.value
            words = f"{what}: fingers at "
            words += ", ".join(f"{1e3 * x:.0f}" for x in fingers.openings) + " mm"
            fault = "slip" if held.state.phase is GripPhase.SLIPPED else "finger_jammed"
            return FaultFound(fault, words, self.limb.name)
        return None

    @staticmethod
    def _is_borne(held: Held, fingers: FingerReading) -> bool:
        """Whether the hand lost weight, but its fingers still squeeze what they had."""
        travel = held.grip.travel(held.state.held_openings, fingers.openings)
        is_shut = travel >= 0.5 * held.grip.config.slip_travel
        return not is_shut and held.grip.weakest(fingers.forces) >= STILL_FELT

    def room(self, safety: SafetyConfig) -> tuple[float, float]:
        """From where a touch ends a planned motion to the limits [N, N m]."""
        most, stops = self.limb.limits.controller, self.limits
        return (
            most.force - min(safety.motion_force or np.inf, stops.force),
            most.torque - min(safety.motion_torque or np.inf, stops.torque),
        )

    def carried(self, load: tuple[float, ...]) -> float:
        """Weight that a load at the hand amounts to [N]."""
        R, _ = self.limb.kinematics.pose(self._q)
        return -(R[6] * load[0] + R[7] * load[1] + R[8] * load[2])

    @property
    def _q(self) -> list[float]:
        q: list[float] = np.asarray(self.devices.arm.read().q, dtype=float).tolist()
        return q

    def push(self, load: Wrench | None = None) -> FloatArray:
        """Force on the hand in the axes of base [N], shape (3,); None: the latest."""
        R, _ = self.limb.kinematics.pose(self._q)
        force = np.array((self.load if load is None else load)[:3])
        return np.asarray(np.reshape(R, (3, 3)) @ force)

    def against(self, way: FloatArray, most: float) -> Callable[[Wrench], bool]:
        """Tell, by the load, when a hand on its way (3,) is pushed by so much [N].

        What pushes it on its way counts not: that ends as it goes.
        """
        ahead = np.asarray(way) / max(float(np.linalg.norm(way)), 1e-9)

        def is_met(load: Wrench) -> bool:
            push = self.push(load)
            push = push - max(float(push @ ahead), 0.0) * ahead
            return float(np.linalg.norm(push)) > most

        return is_met

    def _safety(self, *, is_planned: bool) -> SafetyConfig:
        held = self.context.held
        is_carrying = is_planned or self.context.state is State.TRANSPORT
        if held is None or not held.is_lifted or not is_carrying:
            return SAFETY
        turn = GRAVITY * held.payload.mass * _UNSURE_COM
        return replace(_CARRYING, motion_torque=(_CARRYING.motion_torque or 0.0) + turn)

    def supervised(
        self, *, is_free: bool = False, is_planned: bool = False
    ) -> tuple[Supervisor, SafetyState | FaultFound]:
        """Begin to watch the arm: who watches, and its state, or why not.

        Parameters
        ----------
        is_free
            The hand is empty, and should touch nothing more than it does now.
        is_planned
            The motion is planned: what is carried should touch nothing either.
        """
        limb, reading = self.limb, self.read()
        safety = self._safety(is_planned=is_planned)
        if is_free:
            self.weighed()
            force, torque = met_from(hypot(*self.load[:3]), hypot(*self.load[3:]))
            safety = replace(safety, motion_force=force, motion_torque=torque)
        supervisor = Supervisor(
            limb.kinematics,
            self.limits,
            limb.loads,
            self.period,
            safety,
            self.context.sure_since(limb),
        )
        if limb.doubt is not None:
            return supervisor, self._doubted(limb.doubt)
        try:
            return supervisor, supervisor.start(reading)
        except InputError as error:
            return supervisor, cant_start(error, reading, limb.name)

    def ticked(
        self,
        supervisor: Supervisor,
        state: SafetyState,
        commanded: tuple[float, ...] | list[float],
        *,
        is_moving: bool,
        with_fingers: bool = True,
    ) -> tuple[FaultFound | None, SafetyState, Reading]:
        """Wait one period, read, and judge."""
        clock = self.clock
        clock.wait_until(clock.now() + self.period)
        reading = self.read()
        if self.limb.doubt is not None:
            return self._doubted(self.limb.doubt), state, reading
        state, verdict = supervisor.step(
            state, reading, commanded, self._expected(state), is_moving=is_moving
        )
        self._note(reading.time, verdict.load)
        if state.stop is not None:
            return self._stopped(state.stop, reading), state, reading
        if with_fingers:
            return self._watched_fingers(verdict.load), state, reading
        return None, state, reading

    def _note(self, time: float, load: tuple[float, ...]) -> None:
        self._tick += 1
        self.load = load
        cycle = self.context.cycle
        force, torque = hypot(*load[:3]), hypot(*load[3:])
        cycle.peak_force = max(cycle.peak_force, force)
        cycle.peak_torque = max(cycle.peak_torque, torque)
        trace = self.context.trace
        if not trace or not self._tick % self._finger_ticks:
            trace.append((time, force, torque))
        elif force > trace[-1][1] or torque > trace[-1][2]:
            begun, *most = trace[-1]  # what a plot shows at most was the most
            trace[-1] = begun, max(most[0], force), max(most[1], torque)

    def _fault(self, stop: Stop, reading: Reading) -> FaultFound:
        found = fault_of_stop(stop, reading, self.context.state, self.limb.name)
        lost = self._lost() if found.fault == "bias_jump" else ""
        return replace(found, fault="slip", message=lost) if lost else found

    def _lost(self) -> str:
        """Say that the fingers no longer hold what the hand had: the load changed."""
        held = self.context.held
        if held is None or held.arm != self.limb.name:
            return ""
        self.context.wait(_LETS_GO)
        fingers, before = self.fingers(), held.state.held_openings
        is_whole = len(before) == len(fingers.openings)
        travel = held.grip.travel(before, fingers.openings) if is_whole else 0.0
        if (
            travel < held.grip.config.slip_travel
            and held.grip.weakest(fingers.forces) >= STILL_FELT
        ):
            return ""
        return f"the load jumped as the fingers closed by {1e3 * travel:z.0f} mm"


def mean_wrench(readings: list[Reading]) -> FloatArray:
    """Mean of the raw wrenches, shape (6,)."""
    raw = np.array([np.asarray(r.wrench_ft, dtype=np.float64) for r in readings])
    mean: FloatArray = raw.mean(axis=0)
    return mean


def met_from(force: float, torque: float) -> tuple[float, float]:
    """From which load on an empty hand that bears so much it touches more [N, N m]."""
    return max(_TOUCH[0], force + _MORE[0]), max(_TOUCH[1], torque + _MORE[1])
