"""A controller with an arm and a sensor that tests may break."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from debrisgrasp.control import (
    Body,
    CartesianLeg,
    Compliance,
    Contact,
    ContactGuard,
    ControllerConfig,
    LegController,
    LegState,
    LoadModel,
    PostureKinematics,
    Reading,
)
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.kinematics import RobotModel

PERIOD = 0.004
ROMAN = RobotModel.load("roman")
CHAIN = ROMAN.chain("right", {"torso_joint": 0.0})
LIMITS = ROMAN.limits("right", CHAIN).controller
READY = CHAIN.vector(ROMAN.posture("right", "ready"))


SOFT = Compliance.diagonal(1e-4, 1e-3)


def rpy(*angles: float) -> np.ndarray:
    return so3.from_rpy(np.array(angles))


T_EE_FT = SE3.from_parts(rpy(0.1, 0.2, -0.6), [0.0, 0.02, -0.14])
TO_SENSOR = T_EE_FT.adjoint().T
"""Wrench at the sensor of one at the hand: what power demands."""
KINEMATICS = PostureKinematics(CHAIN)


class Rig:
    """RoMan's right arm at a leg, with a sensor whose contact wrench tests give."""

    def __init__(
        self,
        compliance: Compliance | None = None,
        guard: ContactGuard | None = None,
        offset: Sequence[float] = (0.0, 0.0, 0.1),
        config: ControllerConfig | None = None,
        loads: LoadModel | None = None,
        limits=LIMITS,
        baseline_time: float = 0.0,
    ) -> None:
        self.chain, self.limits = CHAIN, limits
        self.q_start = tuple(READY.tolist())
        self.T_start = CHAIN.fk(READY)
        self.loads = loads or LoadModel(
            T_ee_ft=T_EE_FT,
            tool=Body(2.1, np.array([0.004, -0.006, 0.085])),
            bias=np.array([6.0, -3.0, 12.0, 0.2, -0.1, 0.05]),
        )
        self.controller = LegController(
            CHAIN,
            limits,
            self.loads,
            CartesianLeg.along(self.T_start, offset),
            config or ControllerConfig(contact=Contact(stiffness=1e3)),
            compliance=compliance,
            guard=guard,
            baseline_time=baseline_time,
        )

    def raw(self, q: Sequence[float], wrench_ee: Sequence[float]) -> tuple[float, ...]:
        """Reading of the sensor for a contact wrench at the hand, in its axes."""
        loads = self.loads
        R_base_ft = np.reshape(KINEMATICS.pose(tuple(q))[0], (3, 3)) @ T_EE_FT.R
        f = loads.tool.mass * R_base_ft.T @ loads.gravity
        total = TO_SENSOR @ np.asarray(wrench_ee, dtype=float) + loads.bias
        total[:3] += f
        total[3:] += so3.hat(loads.tool.com) @ f
        return tuple((loads.wrench_sign * total).tolist())

    def reading(
        self, tick: int, q: Sequence[float], wrench_ee: Sequence[float]
    ) -> Reading:
        now = tick * PERIOD
        return Reading(now, q, self.raw(q, wrench_ee), now)

    def engaged(self, wrench_ee: Sequence[float] = (0.0,) * 6) -> LegState:
        found = self.controller.engage(self.reading(0, self.q_start, wrench_ee))
        assert found.state is not None, found.refusals
        return found.state


def broken_stream(
    rig: Rig, n: int, *, rng: np.random.Generator
) -> Iterator[tuple[float, np.ndarray, float, np.ndarray]]:
    """Time, wrench, time of the wrench and error of the encoders, tick by tick.

    Every stream draws some of: NaN, frozen, spikes, sign flips, drift, gaps, noise,
    stamps out of order, clocks that stand or jump, encoders that jump.
    """
    kinds = set(rng.choice(10, size=rng.integers(1, 5), replace=False).tolist())
    base = rig.raw(rig.q_start, (0.0,) * 6)
    drift = rng.normal(0.0, 400.0, 6) / n if 0 in kinds else np.zeros(6)
    wave = rng.normal(0.0, 30.0, 6) * np.repeat([1.0, 0.1], 3)
    frequency = rng.uniform(0.1, 12.0)
    now, last = 0.0, np.array(base)
    for k in range(n):
        now += PERIOD
        wrench = np.array(base) + wave * np.sin(6.28 * frequency * now) + drift * k
        wrench += rng.normal(0.0, 0.3, 6) * np.repeat([1.0, 0.03], 3)
        stamp, encoder = now, np.zeros(7)
        hit = rng.random(10) < 0.08
        if 1 in kinds and hit[1]:
            wrench[rng.integers(6)] = rng.choice([np.nan, np.inf, -np.inf])
        if 2 in kinds and k > n // 3:
            wrench = last
        if 3 in kinds and hit[3]:
            wrench = wrench + rng.normal(0.0, 500.0, 6)
        if 4 in kinds and (k // 20) % 2:
            wrench = -wrench
        if 5 in kinds and hit[5]:
            now += rng.choice([0.004, 0.02, 0.1, 1e6])
        if 6 in kinds and hit[6]:
            stamp = now + rng.choice([-0.02, -1.0, 0.5, np.nan])
        if 7 in kinds and hit[7]:
            encoder[rng.integers(7)] = rng.choice([1e-3, 0.05, 1.0, np.nan])
        if 8 in kinds and hit[8]:
            now -= rng.choice([0.004, 0.1])
        if 9 in kinds and k > n // 4 and k % 7:
            stamp = -1.0
        last = wrench
        yield now, wrench, stamp, encoder


def fault_of_stream(
    rig: Rig, stream: Iterator[tuple[float, np.ndarray, float, np.ndarray]]
) -> tuple[str, int, bool]:
    """First limit that a command breaks, number of commands, and whether it stopped."""
    limits, state = rig.limits, rig.engaged()
    q, step, held = np.array(rig.q_start), np.zeros(7), None
    n = 0
    for now, wrench, stamp, encoder in stream:
        reading = Reading(now, q + encoder, wrench, stamp)
        state, command = rig.controller.step(state, reading)
        n += 1
        goal = np.array(command.q)
        if held is not None:
            if command.stop is None or not np.array_equal(goal, held):
                return "moved after a stop", n, True
            continue
        if command.is_stop:
            held = goal
            fault = limits.violation(goal)
            # A stop holds where the arm was measured, not where it was sent.
            if fault or np.abs(goal - q).max() > 0.1:
                return fault or "stop far from the arm", n, True
            continue
        speed = (goal - q) / PERIOD
        change = (goal - q - step) / PERIOD**2
        fault = limits.violation(goal, speed, change, tolerance=1e-6)
        size = np.linalg.norm(command.deflection[:3])
        most = limits.deflection
        if size > most.translation + 1e-9:
            fault = fault or "deflection beyond its clamp"
        if np.linalg.norm(command.deflection[3:]) > most.rotation + 1e-9:
            fault = fault or "deflection beyond its clamp"
        if fault:
            return fault, n, False
        q, step = goal, goal - q
    return "", n, held is not None


def pushed(rig: Rig, wrenches, *, rng=None, state=None, start=1):
    """Run ticks with contact wrenches at the hand; returns states and commands."""
    rng = rng or np.random.default_rng(0)
    state = state or rig.engaged()
    q, seen = state.servo.q, []
    for k, wrench in enumerate(wrenches, start):
        noise = rng.normal(0.0, 0.1, 6) * np.repeat([1.0, 0.05], 3)
        state, command = rig.controller.step(
            state, rig.reading(k, q, np.asarray(wrench) + noise)
        )
        q = command.q
        seen.append(command)
    return state, seen


def wrench(*force: float) -> np.ndarray:
    return np.array([*force, 0.0, 0.0, 0.0])
