"""One leg of the hand, watched and, if wanted, compliant: the tick of the control loop.

`LegController.step` is a pure function of state and reading: no clock, no input or
output. It fits into anybody's loop at 250 Hz or 1 kHz.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

from debrisgrasp._arrays import FloatArray
from debrisgrasp._checked import checked
from debrisgrasp.kinematics import KinematicChain, LimitSet

from ._rigid import Rotation, Vector, Wrench, norm, parts, pose, share_within, six
from .compliance import Compliance, deflected, in_base_axes
from .contact import ContactGuard
from .faults import Fault
from .filters import ZERO_WRENCH, WrenchFilter, blended
from .leg_state import (
    Command,
    ControllerConfig,
    Engagement,
    LegOutcome,
    LegState,
    TarePolicy,
)
from .legs import CartesianLeg
from .loads import LoadModel
from .oscillation import OscillationGuard, OscillationState
from .readings import Reading, SafetyState, Verdict
from .refusals import RefusalCause, load_faults, refusals_of
from .servo import CartesianServo, ServoState, pose_error, stoppable
from .stability import StabilityBound, StabilityVerdict, contact_gain
from .supervisor import Supervisor

__all__ = ["LegController"]

_EASY, _CREEP = 0.5, 0.1
"""Up to this share of a limit a leg keeps its speed, at the limit this share of it."""

_ROOM = 0.6
"""Share of its limits to which the hand may be loaded already, where it gives way to
what comes on top."""

_RETURN = 0.125
"""Share of its rate at which a deflection goes back against what still pushes."""

_Sensed = tuple[Wrench, OscillationState, Compliance | None, LegOutcome]
"""Filtered reaction, swinging, compliance in force, and outcome after a load."""


class LegController:
    """Moves the hand along one leg: rigid, guarded, or giving way to a wrench."""

    @checked
    def __init__(
        self,
        chain: KinematicChain,
        limits: LimitSet,
        loads: LoadModel,
        leg: CartesianLeg,
        config: ControllerConfig | None = None,
        *,
        compliance: Compliance | None = None,
        guard: ContactGuard | None = None,
        baseline_time: float = 0.0,
    ) -> None:
        """Prepare one leg.

        Parameters
        ----------
        limits
            The controller's, of a `LimitFamily`.
        loads
            Sensor and tool, with the bias of the last verified baseline.
        compliance
            How the hand gives way; None: it doesn't.
        guard
            Ends the leg at a touch; None: only the limits stop it.
        baseline_time
            When the baseline was taken, by the clock of the readings [s].

        Raises
        ------
        ConfigError
            If a guarded leg is faster than its guard allows.
        """
        self.config = config = config or ControllerConfig()
        self.chain, self.limits, self.leg, self.guard = chain, limits, leg, guard
        self.compliance, self.loads = compliance, loads
        self._servo = CartesianServo(chain, limits, config.period, config.servo)
        self._supervisor = Supervisor(
            self._servo.kinematics,
            limits,
            loads,
            config.period,
            config.safety,
            baseline_time,
        )
        self.filter = WrenchFilter(tau=config.tau, period=config.period)
        self.bound = StabilityBound(config.arm, self.filter)
        if guard is not None:
            guard.require_speed(config.speed, limits)
        per_period = config.period * min(
            config.speed / max(leg.length, 1e-9),
            config.turn_rate / max(leg.angle, 1e-9),
        )
        self._pace = min(per_period, 1.0)
        self._pace_gain = self._pace * config.period / config.ramp
        self._alpha = self.filter.alpha
        self._swing = OscillationGuard(
            crossover=self.bound.crossover,
            force=0.05 * limits.force,
            torque=0.05 * limits.torque,
        )

    def __repr__(self) -> str:
        ways = ((self.compliance, "giving way"), (self.guard, "guarded"))
        how = ", ".join(words for given, words in ways if given) or "rigid"
        return f"<LegController of {self.chain} on {self.leg}, {how}>"

    def engage(
        self,
        reading: Reading,
        reference: Sequence[float] | FloatArray | None = None,
    ) -> Engagement:
        """Check everything that must hold before the arm moves by force.

        Parameters
        ----------
        reading
            The present one; the arm must stand at the start of the leg.
        reference
            Mean load at a standstill (`reference_wrench`) [N, N m], shape (6,), axes
            of the hand: a touch is a change from it, and with the policy ``motion``
            the hand gives way to what differs from it. None: the present load.
        """
        supervisor, guard = self._supervisor, self.guard
        safety = supervisor.start(reading)
        servo = self._servo.start(safety.q)
        now = safety.time
        braking = [guard.braking_fault(self.braking_time(servo))] if guard else []
        is_tared = self.config.tare is TarePolicy.MOTION
        share = _ROOM if is_tared else 1.0
        loaded = load_faults(safety.load, supervisor.load_limits(now), share)
        refusals = [
            *refusals_of(RefusalCause.SATURATED, [supervisor.sensor_fault(safety)]),
            *refusals_of(RefusalCause.BIAS, [supervisor.baseline_fault(now)]),
            *refusals_of(RefusalCause.LOADED, loaded),
            *refusals_of(RefusalCause.ELSEWHERE, [self._place_fault(servo)]),
            *refusals_of(RefusalCause.BRAKING, braking),
        ]
        warnings: tuple[str, ...] = ()
        if self.compliance is not None:
            verdict = self._stability(self.compliance, servo)
            refusals += refusals_of(RefusalCause.UNSTABLE, verdict.refusals)
            warnings = verdict.warnings
        if refusals:
            return Engagement(None, tuple(refusals), warnings)
        mean = six(safety.load if reference is None else reference, "reference")
        initial = tuple(mean.tolist())
        state = LegState(
            safety=safety,
            servo=servo,
            filtered=ZERO_WRENCH,
            deflection=ZERO_WRENCH,
            swing=OscillationState(slow=safety.load),
            compliance=self.compliance,
            initial=initial,
            reference=initial if is_tared else ZERO_WRENCH,
        )
        return Engagement(state, (), warnings)

    def _place_fault(self, servo: ServoState) -> str:
        """Why the hand is not where the leg begins."""
        measured = self._servo.kinematics.pose(servo.q)
        error = pose_error(*measured, *parts(self.leg.start))
        gap, angle = norm(error[:3]), norm(error[3:])
        if gap <= self.config.lag and angle <= 0.01:
            return ""
        return (
            f"the hand is {1000 * gap:.1f} mm and {angle:.3f} rad from the start of "
            "the leg"
        )

    def _stability(self, compliance: Compliance, servo: ServoState) -> StabilityVerdict:
        """Judge a compliance where the hand is now."""
        contact = self.config.contact
        tensor = compliance.tensor_at_hand(pose(*self._servo.kinematics.pose(servo.q)))
        return self.bound.verdict(
            contact_gain(tensor, contact.levers),
            contact,
            contact_gain(tensor, contact.mass_lever),
        )

    def braking_time(self, servo: ServoState) -> float:
        """How long the joints need to stop from the leg's speed where they are [s]."""
        begin, ahead = self.leg.at(0.0), self.leg.at(min(self._pace, 1.0))
        _, _, J = self._servo.kinematics.pose_and_jacobian(servo.q)
        step, _ = self._servo.solved(J, pose_error(*begin, *ahead))
        most = (self.limits.acceleration * self.config.period).tolist()
        return float(max(abs(d) / a for d, a in zip(step, most, strict=True)))

    def step(self, state: LegState, reading: Reading) -> tuple[LegState, Command]:
        """One tick: reading in, joint command out."""
        safety, verdict = self._supervisor.step(
            state.safety,
            reading,
            state.servo.q,
            state.initial,
            is_moving=state.servo.is_moving,
        )
        if safety.stop is not None:
            return self._stopped(state, safety)
        sensed = self._sensed(state, verdict, safety.time)
        if isinstance(sensed, str):
            latched = self._supervisor.stopped(safety, Fault.OSCILLATION, sensed)
            return self._stopped(state, latched)
        moved = self._moved(state, safety, verdict, sensed)
        if not isfinite(sum(moved.servo.q)):
            words = (
                f"{Fault.COMMAND_INVALID.value}: {100 * state.share:.0f} % of the leg"
            )
            latched = self._supervisor.stopped(safety, Fault.COMMAND_INVALID, words)
            return self._stopped(state, latched)
        return moved, Command(
            moved.servo.q,
            moved.outcome,
            moved.share,
            moved.deflection,
            verdict.load,
        )

    def _sensed(self, state: LegState, verdict: Verdict, now: float) -> _Sensed | str:
        """Take in a fresh load: smooth it, look for swinging, and for a touch.

        A string says why to stop.
        """
        compliance, outcome = state.compliance, state.outcome
        filtered, swing = state.filtered, state.swing
        if verdict.is_fresh:
            load = verdict.load
            if compliance is not None:
                filtered = blended(
                    filtered, self._reaction(state, verdict), self._alpha
                )
                swing, struck = self._swing.step(swing, now, self.config.period, load)
                if struck and swing.strikes > 1:
                    return "again after the compliance was halved"
                if struck:
                    compliance = compliance.scaled(0.5)
            if (
                self.guard is not None
                and outcome is LegOutcome.RUNNING
                and self.guard.is_touched(load, state.initial)
            ):
                outcome = LegOutcome.CONTACT
        return filtered, swing, compliance, outcome

    def _moved(
        self, state: LegState, safety: SafetyState, verdict: Verdict, sensed: _Sensed
    ) -> LegState:
        """Advance along the leg, give way, and let the joints follow."""
        filtered, swing, compliance, outcome = sensed
        share, pace, waited, deflection = state.share, 0.0, 0.0, state.deflection
        if outcome in (LegOutcome.CONTACT, LegOutcome.BLOCKED):
            servo = self._servo.braked(state.servo)
        else:
            share, pace, waited, outcome = self._advanced(state, verdict)
            R, p = self.leg.at(share)
            if compliance is not None:
                if verdict.is_fresh:
                    deflection = self._deflection(
                        deflection, compliance, filtered, verdict.measured, (R, p)
                    )
                R, p = deflected(R, p, deflection, compliance.mode)
            servo = self._servo.step(state.servo, R, p)
        return LegState(
            safety,
            servo,
            filtered,
            deflection,
            swing,
            compliance,
            state.initial,
            state.reference,
            share,
            pace,
            waited,
            outcome,
        )

    def _reaction(self, state: LegState, verdict: Verdict) -> Wrench:
        """Load less its reference: what the hand gives way to."""
        load, zero = verdict.load, state.reference
        if self.config.tare is TarePolicy.SESSION and self.loads.payload.mass > 0.0:
            zero = self.loads.payload_ee(verdict.measured[0])
        a, b, c, d, e, f = load
        p, q, r, s, t, u = zero
        return a - p, b - q, c - r, d - s, e - t, f - u

    def _advanced(
        self, state: LegState, verdict: Verdict
    ) -> tuple[float, float, float, LegOutcome]:
        """Share of the leg, its pace, time waited and outcome after this tick."""
        config, servo, outcome = self.config, state.servo, state.outcome
        if outcome is not LegOutcome.RUNNING:
            return state.share, 0.0, 0.0, outcome
        is_behind = servo.gap > config.lag or servo.turn > config.lag_turn
        left = 1.0 - state.share
        if is_behind or not verdict.may_advance:
            pace = max(state.pace - self._pace_gain, 0.0)
        else:
            most = self._pace * self._eased(verdict.load)
            pace = min(state.pace + self._pace_gain, most)
            pace = min(pace, max(stoppable(left, self._pace_gain), state.pace * 0.5))
        waited = state.waited + config.period if is_behind else 0.0
        if waited > config.patience:
            outcome = LegOutcome.BLOCKED
        if left - pace <= 1e-9:
            return 1.0, 0.0, waited, outcome if is_behind else LegOutcome.DONE
        return state.share + pace, pace, waited, outcome

    def _eased(self, load: Wrench) -> float:
        """Share of its speed that a leg keeps under a load.

        The load goes on growing until the arm stands, and the more so the faster that
        is: near its limit there is no room for that.
        """
        share = max(
            norm(load[:3]) / self.limits.force, norm(load[3:]) / self.limits.torque
        )
        return min(max((1.0 - share) / (1.0 - _EASY), _CREEP), 1.0)

    def _deflection(
        self,
        last: Wrench,
        compliance: Compliance,
        filtered: Wrench,
        measured: tuple[Rotation, Vector],
        nominal: tuple[Rotation, Vector],
    ) -> Wrench:
        """Twist of the hand: within its clamp, and no faster than it may change."""
        most = self.limits.deflection
        reaction = compliance.without_dead_band(filtered)
        target = compliance.deflection(
            in_base_axes(measured[0], reaction),
            measured,
            nominal,
            (most.translation, most.rotation),
        )
        period = self.config.period
        change = [a - b for a, b in zip(target, last, strict=True)]
        translation, rotation = most.translation_rate, most.rotation_rate
        # Back against what still pushes only slowly: the load grows on that way.
        pushed = sum(c * t for c, t in zip(change[:3], target[:3], strict=True))
        turned = sum(c * t for c, t in zip(change[3:], target[3:], strict=True))
        if pushed * rotation**2 + turned * translation**2 < 0.0:
            period *= _RETURN
        rate = share_within(change, translation * period, rotation * period)
        moved = target
        if rate < 1.0:
            moved = tuple([b + rate * c for b, c in zip(last, change, strict=True)])
        # About a distant pivot a small turn is a large shift: clamped as one screw.
        inside = share_within(moved, most.translation, most.rotation)
        if inside < 1.0:
            moved = tuple([inside * value for value in moved])
        return moved if isfinite(sum(moved)) else last

    def _stopped(
        self, state: LegState, safety: SafetyState
    ) -> tuple[LegState, Command]:
        """Hold where the joints were measured; a stop never commands a motion."""
        lower, upper = self.limits.lower.tolist(), self.limits.upper.tolist()
        q = tuple(
            [
                min(max(value, low), high)
                for value, low, high in zip(safety.q, lower, upper, strict=True)
            ]
        )
        servo = ServoState(q, (0.0,) * len(q))
        following = state._replace(
            safety=safety, servo=servo, pace=0.0, outcome=LegOutcome.STOPPED
        )
        command = Command(
            q=q,
            outcome=LegOutcome.STOPPED,
            share=state.share,
            deflection=state.deflection,
            load=safety.load,
            stop=safety.stop,
        )
        return following, command
