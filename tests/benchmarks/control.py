"""Control: time of a tick and of a leg, stability in contact, and broken sensors.

``python -m tests.benchmarks.control [--json FILE]`` on RoMan's right arm, seven joints.
Times are CPU times of the thread, which other processes don't lengthen much.
"""

from __future__ import annotations

import gc
import sys
import time

import numpy as np

from debrisgrasp.control import (
    ArmResponse,
    Compliance,
    LegPlanner,
    Reading,
    StabilityBound,
    WrenchFilter,
    press,
)
from debrisgrasp.geometry import SE3
from tests.benchmarks.report import arguments, publish
from tests.unit.control.rigs import PERIOD, Rig, broken_stream, fault_of_stream

TARGETS = {
    "tick_us_median": "40 or less",
    "tick_us_p99": "150 or less",
    "tick_growth_blocks": "no growth over 1e6 ticks",
    "leg_ms_median": "10 or less",
    "stable_share": "1",
    "limit_over_bound_max": "2.5 or less",
    "streams_violating": "0 of 1e4",
}
STIFFNESSES = (1e3, 1e4, 1e5)
ARMS = (
    (0.01, ArmResponse(frequency=8.0, damping=0.7, delay=2)),
    (0.01, ArmResponse(frequency=4.0, damping=0.5, delay=2)),
    (0.01, ArmResponse(frequency=4.0, damping=0.5, delay=5)),
    (0.05, ArmResponse(frequency=8.0, damping=0.7, delay=2)),
    (0.2, ArmResponse(frequency=8.0, damping=0.7, delay=2)),
)


def ticks(n: int) -> dict[str, float]:
    """CPU time of single ticks: wrench in, joint command out, compliant leg."""
    rig = Rig(compliance=Compliance.diagonal(1e-4, 1e-3), offset=(0.0, 0.0, 0.15))
    state = rig.engaged()
    rng = np.random.default_rng(3)
    forces = np.cumsum(rng.normal(0.0, 0.05, (n, 6)), axis=0) * 0.5
    forces = (20.0 * np.sin(forces)).clip(-60.0, 60.0) + rng.normal(0, 0.3, (n, 6))
    forces[:, 3:] *= 0.05
    # Made beforehand, so that a tick is not measured with the caches of the test.
    raw = [rig.raw(rig.q_start, row) for row in forces]
    q, spent, clock = rig.q_start, np.empty(n), np.empty(n)
    gc.collect()
    for k, wrench in enumerate(raw):
        now = (k + 1) * PERIOD
        reading = Reading(now, q, wrench, now)
        idle = time.thread_time_ns()
        begin = time.thread_time_ns()
        state, command = rig.controller.step(state, reading)
        spent[k] = time.thread_time_ns() - begin
        clock[k] = begin - idle
        q = command.q
    assert not command.is_stop, command.stop
    # Asking for the time of the thread takes a system call, which is taken off again.
    spent = (spent[200:] - np.median(clock)) / 1e3
    return {
        "tick_us_median": float(np.median(spent)),
        "tick_us_p99": float(np.quantile(spent, 0.99)),
        "tick_us_p95": float(np.quantile(spent, 0.95)),
        "tick_us_min": float(spent.min()),
    }


def growth(n: int) -> float:
    """Blocks of memory allocated between a tenth of n ticks and all of them."""
    rig = Rig(compliance=Compliance.diagonal(1e-4, 1e-3), offset=(0.0, 0.0, 0.15))
    state, q, before = rig.engaged(), rig.q_start, 0
    noise = np.random.default_rng(0).normal(0, 1, (997, 6)) * np.repeat([1, 0.05], 3)
    raw = [rig.raw(rig.q_start, row) for row in noise]
    for k in range(n):
        now = (k + 1) * PERIOD
        state, command = rig.controller.step(
            state, Reading(now, q, raw[k % len(raw)], now)
        )
        q = command.q
        if k == n // 10:
            gc.collect()
            before = sys.getallocatedblocks()
    gc.collect()
    assert not command.is_stop, command.stop
    return float(sys.getallocatedblocks() - before)


def legs() -> dict[str, float]:
    """CPU time to plan straight legs of 0.2 m."""
    rig = Rig()
    planner = LegPlanner(rig.chain, rig.limits)
    T, milliseconds, done = rig.chain.fk(rig.q_start), [], 0
    for direction in np.vstack([np.eye(3), -np.eye(3)]):
        goal = SE3.from_parts(p=0.2 * direction) @ T
        times = []
        for _ in range(9):
            begin = time.thread_time()
            plan = planner.plan(rig.q_start, goal)
            times.append(time.thread_time() - begin)
        milliseconds.append(1e3 * float(np.median(times)))
        done += plan.is_done
    return {
        "leg_ms_median": float(np.median(milliseconds)),
        "leg_ms_max": max(milliseconds),
        "legs_done_of_6": float(done),
    }


def contact() -> dict[str, float]:
    """Is the enforced bound calm everywhere, and how far from the true limit."""
    ratios, calm, cases = [], 0, 0
    for a, arm in ARMS:
        smoothing = WrenchFilter(tau=float(-0.004 / np.log(1.0 - a)))
        bound = StabilityBound(arm, smoothing)
        for stiffness in STIFFNESSES:
            safe = bound.gain_safe / stiffness
            low, high = safe, 8.0 * safe
            cases += 1
            calm += press(safe, stiffness, arm, smoothing).is_calm
            for _ in range(12):
                middle = 0.5 * (low + high)
                if press(middle, stiffness, arm, smoothing, duration=40.0).is_calm:
                    low = middle
                else:
                    high = middle
            ratios.append(low / safe)
    return {
        "stable_share": calm / cases,
        "limit_over_bound_min": min(ratios),
        "limit_over_bound_max": max(ratios),
    }


def streams(n: int, n_ticks: int = 150) -> dict[str, float]:
    """Random broken sensors: commands outside a limit, and how many streams stop."""
    rig = Rig(compliance=Compliance.diagonal(1e-4, 1e-3), offset=(0.03, 0.0, 0.1))
    violating = stopped = commands = 0
    for seed in range(n):
        rng = np.random.default_rng(seed)
        fault, n_commands, is_stopped = fault_of_stream(
            rig, broken_stream(rig, n_ticks, rng=rng)
        )
        violating += bool(fault)
        stopped += is_stopped
        commands += n_commands
    return {
        "streams": float(n),
        "streams_violating": float(violating),
        "streams_stopped": float(stopped),
        "streams_commands": float(commands),
    }


def main() -> None:
    options = arguments(__doc__ or "")
    figures = ticks(20_000) | {"tick_growth_blocks": growth(1_000_000)}
    figures |= legs() | contact() | streams(10_000)
    publish(figures, options.json)
    for name, target in TARGETS.items():
        print(f"{name}: {figures[name]:.4g} (target {target})")


if __name__ == "__main__":
    main()
