"""The robot in memory: what a period, an image and a conformance check cost.

``python -m tests.benchmarks.robot [--json FILE]`` with RoMan's right arm. Times are CPU
times of the thread, which other processes don't lengthen much; medians over periods.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from debrisgrasp.robot import FakeConfig, check_robot, fake_robot
from debrisgrasp.worlds import World, let_down, named_scene
from tests.benchmarks.report import arguments, publish
from tests.unit.robot.rigs import FAR, GRIPPERS, PERIOD, ROMAN, Rig, beam

TARGETS = {
    "tick_free_us": "60 or less",
    "tick_contact_us": "300 or less",
    "tick_carry_us": "300 or less",
    "tick_grip_us": "300 or less",
}
BAR = beam("bar", 2.5, (0.8, -0.3, 0.0445))


def timed(rig: Rig, action: Callable[[], object]) -> list[float]:
    """CPU time of every period that passes during an action [us]."""
    clock, spent = rig.robot.clock, []
    wait = rig.wait

    def measured(seconds: float) -> None:
        for _ in range(max(round(seconds / PERIOD), 1)):
            begin = time.thread_time_ns()
            clock.wait_until(clock.now() + PERIOD)
            spent.append((time.thread_time_ns() - begin) / 1e3)

    rig.wait = measured  # type: ignore[method-assign]
    action()
    rig.wait = wait  # type: ignore[method-assign]
    return spent


def ticks() -> dict[str, float]:
    """Periods of standing, moving, gripping, carrying and pressing."""
    figures = {}
    rig = Rig([FAR], place=(0.8, -0.3, 0.3))
    idle = timed(rig, lambda: rig.wait(4.0))
    free = timed(rig, lambda: [rig.move(0.0, 0.0, z, speed=0.1) for z in (0.1, -0.1)])
    figures |= {"tick_idle_us": np.median(idle), "tick_free_us": np.median(free)}
    figures["tick_free_us_p95"] = np.quantile(free, 0.95)

    rig = Rig([BAR, FAR])
    near = timed(
        rig, lambda: [rig.move(0.0, 0.0, z, speed=0.05) for z in (0.03, -0.03)]
    )
    grip = timed(rig, lambda: rig.grip())
    carry = timed(rig, lambda: rig.move(0.0, 0.0, 0.1, speed=0.1))
    figures["tick_near_us"] = np.median(near)
    figures["tick_grip_us"] = np.median(grip)
    figures["tick_carry_us"] = np.median(carry)
    release = timed(rig, rig.open)
    figures["release_ms_max"] = max(release) / 1e3

    pushed = Rig([beam("bar", 3.0, (0.8, -0.19, 0.0445))], place=(0.8, -0.3, 0.16, 0.0))
    contact = timed(pushed, lambda: pushed.move(0.0, 0.12, 0.0, speed=0.05))
    figures["tick_contact_us"] = np.median(contact[len(contact) // 3 :])
    figures["tick_contact_us_p95"] = np.quantile(contact[len(contact) // 3 :], 0.95)
    return {name: float(value) for name, value in figures.items()}


def images() -> dict[str, float]:
    """Images of a scene, with and without the robot's own links."""
    world = let_down(named_scene("block_on_wood")).world
    figures = {}
    for name, config in (
        ("capture_ms", FakeConfig()),
        ("capture_ms_without_robot", FakeConfig(sees_itself=False)),
    ):
        fake = fake_robot(
            ROMAN, world, rng=np.random.default_rng(0), config=config, grippers=GRIPPERS
        )
        spent = []
        for _ in range(7):
            begin = time.thread_time()
            fake.robot.camera.capture()
            spent.append(time.thread_time() - begin)
        figures[name] = 1e3 * float(np.median(spent))
    return figures


def checks() -> dict[str, float]:
    """Make a robot, and run every check on it."""
    begin = time.thread_time()
    fake = fake_robot(ROMAN, World((FAR, BAR)), rng=np.random.default_rng(0))
    made = time.thread_time()
    report = check_robot(fake.robot, motion=True)
    return {
        "make_ms": 1e3 * (made - begin),
        "check_s": time.thread_time() - made,
        "check_findings": float(len(report.findings)),
        "faster_than_real_time": fake.robot.clock.now() / (time.thread_time() - made),
    }


def main() -> None:
    options = arguments(__doc__ or "")
    figures = ticks() | images() | checks()
    publish(figures, options.json)
    for name, target in TARGETS.items():
        print(f"{name}: {figures[name]:.4g} (target {target})")


if __name__ == "__main__":
    main()
