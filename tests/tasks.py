"""Whole tasks on the robot in memory, struck by faults, or ended by a person."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from debrisgrasp.executive import Executive, RunResult, State, steps
from debrisgrasp.executive.record import MemoryRecord
from debrisgrasp.executive.result import Done
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.robot import FakeConfig, FakeRobot, fake_robot, inject
from debrisgrasp.worlds import World, let_down, make_body

PERIOD = 0.008
"""Of the robot that faults strike [s]: twice as long as by default, as some arms have
it, and so in half the time."""


def one_beam(mass=2.0):
    """A sturdy beam that lies straight ahead."""
    sizes = {"length": 0.5, "width": 0.089, "height": 0.089}
    turn = so3.from_rpy(np.array([0.0, 0.0, 0.4]))
    beam = make_body("lumber_4x4", sizes, mass, name="beam")
    return let_down(World((beam.at(SE3.from_parts(turn, [0.95, -0.1, 0.3])),))).world


@dataclass(frozen=True, eq=False)
class Struck:
    """A run, its robot, and what was done to it."""

    result: RunResult
    fake: FakeRobot
    record: MemoryRecord
    happened: tuple[str, ...]
    was_stopped: bool
    """Whether the right arm was stopped when a person ended the run."""


class Watch:
    """Tells faults which state begins; ends a run that would recover from one."""

    def __init__(self, injected, record, ends_after, arm):
        self.injected, self.record, self.arm = injected, record, arm
        self.ends_after = ends_after
        self.was_stopped = False

    def on_state(self, state):
        is_over = state in (State.SAFE_STOP, State.ABORT)
        found = {event.get("fault") for event in self.record.events}
        if not is_over and not found.isdisjoint(self.ends_after):
            self.was_stopped = self.arm.is_stopped
            raise KeyboardInterrupt
        self.injected.on_state(state.value)


def trust_the_camera(monkeypatch):
    """Leave out the check of a camera that is as it was built.

    To see that takes longer than all the rest.
    """
    monkeypatch.setitem(steps.STEPS, State.CALIB_CHECK, lambda _context: Done())


def run_struck(pipeline, world, settings, faults=(), *, ends_after=(), change=None):
    """Run a task that faults strike.

    Parameters
    ----------
    ends_after
        Faults; a person ends the run once one of them was noticed.
    change
        Makes another robot of the one in memory, and of its present state.
    """
    fake = fake_robot(
        pipeline.robot,
        world,
        rng=np.random.default_rng(1),
        config=FakeConfig(is_initialised=True, period=PERIOD),
    )
    record = MemoryRecord()
    injected = inject(
        fake.robot,
        faults,
        states=[state.value for state in State],
        rng=np.random.default_rng(2),
        world=fake,
    )
    watch = Watch(injected, record, ends_after, fake.arms["right"])
    robot = injected.robot if change is None else change(injected.robot, record)
    executive = Executive(
        robot,
        replace(settings, period=PERIOD),
        pipeline=pipeline,
        observers=(watch,),
        record=record,
        rng=np.random.default_rng(3),
    )
    result = executive.run()
    return Struck(result, fake, record, injected.happened, watch.was_stopped)
