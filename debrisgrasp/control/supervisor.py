"""Watches readings and loads, and stops the arm when they are not what they must be.

Every limit holds for the unfiltered, absolute load. A load that was tared before each
motion could grow by one threshold with each of them until the hand breaks; here the
tare has no way into the decision. A stop is latched: it stays until a new state is
made.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot, inf, isfinite

from debrisgrasp._words import shortened
from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.kinematics import LimitSet

from ._rigid import Wrench, floats_of, number_of
from .faults import Fault, Stop
from .filters import median
from .liveliness import Liveliness
from .loads import LoadModel
from .posture import PostureKinematics
from .readings import Reading, SafetyConfig, SafetyState, Verdict
from .refusals import RefusalCause, StartError

__all__ = ["Supervisor", "require_sensor_range"]

_CLOCK = 1e-6
"""Times closer than this are equal [s]."""
_HASTE = 1.05
"""Each tick moves the arm by one period; of a loop faster than this it is too much."""
_FARTHEST = 1.5
"""Whatever is touched is nearer to the hand than this [m]."""
_AHEAD = 1.0
"""A reading may be older by so much than the baseline that it was taken for [s]."""
_USABLE = 0.98
"""Share of a sensor's range up to which it is believed."""
_STAMP = (
    "Its time (WrenchReading.time of a driver) is when it was measured, by the clock "
    "of the loop: see that the driver hands on the latest, and stamps it so. Only for "
    "a sensor that is slower than that raise hold_after."
)
"""What to do about a wrench that is too old."""
_MUCH = 0.25
"""Share of a limit from which on it matters if an axis ends before its range."""


def require_sensor_range(loads: LoadModel, limits: LimitSet) -> None:
    """Raise `ConfigError` unless a sensor can feel the limits of an arm.

    Ask once, when a robot is put together. Within a motion the end of the range stops
    the arm in any case.
    """
    for name, end, limit, unit in zip(
        ("force", "torque"),
        loads.sensor_range,
        (limits.force, limits.torque),
        ("N", "N m"),
        strict=True,
    ):
        if not _USABLE * end > limit:
            raise ConfigError(
                f"{name} limit of an arm [{unit}]",
                got=f"{limit:g}",
                expected=f"below {_USABLE * end:g}: the sensor ends at {end:g} {unit}",
                mend=f"Lower limits.{name} in the robot's file, or give the range of "
                "the sensor's data sheet to LoadModel(sensor_range=...).",
            )


class Supervisor:
    """Decides for every reading whether the arm may go on."""

    def __init__(
        self,
        kinematics: PostureKinematics,
        limits: LimitSet,
        loads: LoadModel,
        period: float,
        config: SafetyConfig,
        baseline_time: float,
    ) -> None:
        """Prepare for one arm.

        Parameters
        ----------
        loads
            Sensor and tool; its bias is that of the last verified baseline.
        period
            Of the control loop [s].
        baseline_time
            When that baseline was taken, by the clock of the readings [s].
        """
        self.limits, self.loads = limits, loads
        self.config = config
        self.baseline_time = baseline_time
        self._kinematics, self._period = kinematics, period
        force, torque = loads.sensor_range
        self._range = (_USABLE * force,) * 3 + (_USABLE * torque,) * 3
        self._much = (_MUCH * limits.force,) * 3 + (_MUCH * limits.torque,) * 3
        self._speeds = tuple((2.0 * limits.velocity).tolist())

    def load_limits(self, now: float) -> tuple[float, float]:
        """Limits of force [N] and torque [N m], less what the bias may be wrong by."""
        force, torque = self.config.bias.at(now - self.baseline_time)
        return self.limits.force - force, self.limits.torque - torque

    def baseline_fault(self, now: float) -> str:
        """Say why no forceful motion may start before a new baseline, or nothing."""
        age = now - self.baseline_time
        if age < -_AHEAD:
            return (
                f"the baseline was taken {-age:.3g} s after the reading: give "
                "baseline_time by the clock of the readings"
            )
        bounds = self.config.bias.at(age)
        for name, bound, limit in zip(
            ("force", "torque"),
            bounds,
            (self.limits.force, self.limits.torque),
            strict=True,
        ):
            if not bound <= 0.2 * limit:
                return (
                    f"the bias of the {name} may be wrong by {bound:.3g}, over 20 % of "
                    f"its limit {limit:g}: take a new baseline in free space"
                )
        return ""

    def start(self, reading: Reading) -> SafetyState:
        """State at the begin of a motion.

        Raises
        ------
        InputError
            If the first reading is not finite.
        StartError
            If its wrench is too old.
        """
        q, raw = floats_of(reading.q), floats_of(reading.wrench_ft)
        now, stamp = number_of(reading.time), number_of(reading.wrench_time)
        is_whole = len(q) == self._kinematics.n_joints and len(raw) == 6
        if not is_whole or not isfinite(now):
            raise InputError(
                "first reading",
                got=f"joints {shortened(str(q))}, wrench {shortened(str(raw))}, "
                f"at {reading.time} s",
                expected=f"{self._kinematics.n_joints} and 6 finite numbers",
                mend="See why the driver sends none; nothing is moved without.",
            )
        age = now - stamp
        most = self.config.hold_after
        if not abs(age) <= most:
            raise StartError(
                RefusalCause.STALE,
                "age of the first wrench [s]",
                got=f"{age:.3g}",
                expected=f"at most {most:g} (SafetyConfig.hold_after)",
                mend=_STAMP,
            )
        R, _ = self._kinematics.pose(q)
        load = self.loads.load_ee(raw, R)
        recent, trend = (load, load), (stamp, load)
        lively = Liveliness((now,) * 6)
        return SafetyState(now, stamp, raw, lively, q, now, recent, load, trend)

    def step(
        self,
        state: SafetyState,
        reading: Reading,
        commanded: Sequence[float],
        reference: Wrench,
        *,
        is_moving: bool,
    ) -> tuple[SafetyState, Verdict]:
        """Judge one reading; after a stop nothing changes any more.

        Parameters
        ----------
        commanded
            Posture commanded last, d values.
        reference
            Load at the start of this motion; only for ``motion_force`` and
            ``motion_torque``.
        is_moving
            Whether the arm was commanded to move.
        """
        if state.stop is not None:
            return state, self._stale(state, may_advance=False)
        now, gap = self._advanced(state, number_of(reading.time))
        if gap > self.config.stop_after + _CLOCK:
            words = f"{1000 * gap:.0f} ms without a tick"
            if not isfinite(gap):
                words = f"a time of {reading.time}"
            return self._stopped(state, Fault.CLOCK_GAP, words, now)
        early = max(state.early + self._period - _HASTE * gap, 0.0)
        if early > self.config.stop_after:
            words = f"the last tick came after {1000 * gap:.3g} ms instead of "
            words += f"{1000 * self._period:.3g} (ControllerConfig.period)"
            return self._stopped(state, Fault.CLOCK_FAST, words, now)
        state = state._replace(early=early)
        q = floats_of(reading.q)
        fault, words, is_following = self._judged_joints(state, q, commanded, gap)
        if fault is not None:
            return self._stopped(state, fault, words, now)
        followed = now if is_following else state.followed
        if now - followed > self.config.following_time:
            state = state._replace(q=q)
            words = f"off by more than {self.config.following_error:g} for "
            words += f"{1000 * (now - followed):.0f} ms"
            return self._stopped(state, Fault.JOINT_STUCK, words, now)
        raw = floats_of(reading.wrench_ft)
        stamp = number_of(reading.wrench_time)
        # A NaN fails every comparison, and so is not fresh.
        is_fresh = (
            len(raw) == 6
            and state.wrench_time < stamp <= now + self._period
            and now - stamp <= self.config.hold_after + _CLOCK
        )
        if not is_fresh:
            return self._without_wrench(state, now, q, followed)
        return self._with_wrench(
            state, now, q, followed, raw, stamp, reference, is_moving
        )

    def _advanced(self, state: SafetyState, time: float) -> tuple[float, float]:
        """Time of this tick, and since the last; a standing clock is not believed."""
        if not isfinite(time):
            return state.time, inf
        if time > state.time:
            return time, time - state.time
        return state.time + self._period, self._period

    def _judged_joints(
        self,
        state: SafetyState,
        q: tuple[float, ...],
        commanded: Sequence[float],
        gap: float,
    ) -> tuple[Fault | None, str, bool]:
        if len(q) != len(state.q):
            return Fault.ENCODER_INVALID, "some are missing or not finite", False
        is_following, most = True, self.config.following_error
        for i, (value, last, wanted, speed) in enumerate(
            zip(q, state.q, commanded, self._speeds, strict=True)
        ):
            # Written so that NaN is a fault in each comparison, here and below.
            if not abs(value - last) <= speed * gap + 0.02:
                name = self.limits.joint_names[i]
                words = f"{name} from {last:.3f} to {value:.3f} in {1000 * gap:.0f} ms"
                return Fault.ENCODER_JUMP, words, False
            if not abs(value - wanted) <= most:
                is_following = False
        return None, "", is_following

    def _without_wrench(
        self, state: SafetyState, now: float, q: tuple[float, ...], followed: float
    ) -> tuple[SafetyState, Verdict]:
        age = now - state.wrench_time
        state = state._replace(time=now, q=q, followed=followed)
        if age >= self.config.stop_after - _CLOCK:
            words = f"the last one is {1000 * age:.0f} ms old; the limit is "
            words += f"{1000 * self.config.stop_after:g} (SafetyConfig.stop_after)"
            return self._stopped(state, Fault.WRENCH_LOST, words, now)
        may_advance = age <= self.config.hold_after + _CLOCK
        return state, self._stale(state, may_advance=may_advance)

    def _with_wrench(
        self,
        state: SafetyState,
        now: float,
        q: tuple[float, ...],
        followed: float,
        raw: Wrench,
        stamp: float,
        reference: Wrench,
        is_moving: bool,  # noqa: FBT001 - private; the public step has it by keyword
    ) -> tuple[SafetyState, Verdict]:
        R, p = self._kinematics.pose(q)
        latest = self.loads.load_ee(raw, R)
        older, last = state.recent
        load = median(older, last, latest)
        long = 0.5 * self.config.frozen_after
        lively = state.liveliness.followed(
            state.raw, raw, now, long, is_moving=is_moving
        )
        previous = state.load
        (since, earlier), ahead, trend = state.trend, 0.0, state.trend
        if stamp - since > self.config.trend - 0.5 * self._period:
            ahead = self.config.lead / max(self._period, stamp - since)
            trend = (stamp, load)
        state = SafetyState(
            *(now, stamp, raw, lively, q, followed, (last, latest), load, trend),
            early=state.early,
        )
        fault, words = self._judged_load(load, previous, reference, now, earlier, ahead)
        if fault is None:
            fault, words = self._judged_sensor(raw, lively, now)
        if fault is not None:
            return self._stopped(state, fault, words, now)
        return state, Verdict(load, True, True, (R, p))  # noqa: FBT003 - quicker

    def _judged_sensor(
        self, raw: Wrench, lively: Liveliness, now: float
    ) -> tuple[Fault | None, str]:
        if words := self._saturation(raw):
            return Fault.WRENCH_SATURATED, words
        equal_for, most = lively.equal_for(now), self.config.frozen_after
        if equal_for > most:
            return Fault.WRENCH_FROZEN, f"for {1000 * equal_for:.0f} ms"
        end = lively.ended(raw, self._much, now - most)
        if end is not None:
            words = f"{raw[end]:.4g} N or N m to the last digit for {1000 * most:.0f} "
            words += "ms, while others change: give LoadModel.sensor_range"
            return Fault.WRENCH_SATURATED, words
        return None, ""

    def _saturation(self, raw: Wrench) -> str:
        """Which axis is at the end of its range, or nothing."""
        for value, most in zip(raw, self._range, strict=True):
            if not -most < value < most:
                return f"{value:.4g} of {most / _USABLE:g} N or N m"
        return ""

    def sensor_fault(self, state: SafetyState) -> str:
        """Say why no forceful motion may start by such a wrench, or nothing."""
        words = self._saturation(state.raw)
        return f"{Fault.WRENCH_SATURATED.value}: {words}" if words else ""

    def _judged_load(
        self,
        load: Wrench,
        previous: Wrench,
        reference: Wrench,
        now: float,
        earlier: Wrench,
        ahead: float,
    ) -> tuple[Fault | None, str]:
        """Judge a load, and what it comes to if it grows by ``ahead`` times so much.

        So much as since the ``earlier`` load, at which growth was judged last.
        """
        most_force, most_torque = self.load_limits(now)
        a, b, c, d, e, f = load
        force, torque = hypot(a, b, c), hypot(d, e, f)
        if not torque < most_torque:
            words = f"torque {torque:.1f} of {most_torque:.1f} N m"
            return Fault.TORQUE_OVERLOAD, words
        if not force < most_force:
            return Fault.OVERLOAD, f"force {force:.0f} of {most_force:.0f} N"
        config = self.config
        p, q, r, s, t, u = previous
        jump, twist = hypot(a - p, b - q, c - r), hypot(d - s, e - t, f - u)
        if not (jump <= config.jump_force and twist <= config.jump_torque):
            words = f"by {jump:.0f} N, {twist:.1f} N m between two samples"
            return Fault.WRENCH_JUMP, words
        p, q, r, s, t, u = earlier
        grows, twists = force - hypot(p, q, r), torque - hypot(s, t, u)
        if config.motion_force is not None or config.motion_torque is not None:
            p, q, r, s, t, u = reference
            change, turn = hypot(a - p, b - q, c - r), hypot(d - s, e - t, f - u)
            most_change = config.motion_force or inf
            most_turn = config.motion_torque or inf
            if not (change < most_change and turn < most_turn):
                words = f"by {change:.0f} of {most_change:.0f} N and "
                words += f"{turn:.1f} of {most_turn:.1f} N m"
                is_swing = turn > _FARTHEST * change
                return Fault.SWING if is_swing else Fault.MOTION_OVERLOAD, words
        if not force + ahead * grows < most_force:
            words = f"force {force:.0f} of {most_force:.0f} N, growing by {grows:.0f} N"
            return Fault.OVERLOAD, words
        if not torque + ahead * twists < most_torque:
            words = f"torque {torque:.1f} of {most_torque:.1f} N m, growing by "
            return Fault.TORQUE_OVERLOAD, f"{words}{twists:.1f} N m"
        return None, ""

    def stopped(self, state: SafetyState, fault: Fault, message: str) -> SafetyState:
        """Latch a stop that was found elsewhere."""
        if state.stop is not None:
            return state
        return state._replace(stop=Stop(fault, message, state.time))

    def _stopped(
        self, state: SafetyState, fault: Fault, words: str, now: float
    ) -> tuple[SafetyState, Verdict]:
        stop = Stop(fault, f"{fault.value}: {words}", now)
        state = state._replace(time=now, stop=stop)
        return state, self._stale(state, may_advance=False)

    def _stale(self, state: SafetyState, *, may_advance: bool) -> Verdict:
        """Judge by what was known before."""
        measured = self._kinematics.pose(state.q)
        return Verdict(state.load, False, may_advance, measured)  # noqa: FBT003
