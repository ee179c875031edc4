"""One run of the whole task with the robot in memory, and what is true of it."""

from __future__ import annotations

import re
import time
import traceback
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from debrisgrasp.executive import (
    STAGES,
    RunEnd,
    RunResult,
    Simulated,
    SimulatedTask,
    State,
    TaskSettings,
    simulate,
)
from debrisgrasp.geometry import Bounds
from debrisgrasp.pipeline import Pipeline
from debrisgrasp.robot import FakeTruth
from debrisgrasp.settings import Settings
from debrisgrasp.worlds import Body, World

from .in_the_way import account, box_around, is_in_the_way, to_remove
from .record import SUCCESS, RunRecord
from .specs import MARKED, RunSpec, fake_world

__all__ = [
    "Watch",
    "handle_of",
    "pipeline_of",
    "record_of",
    "run_fake",
    "settings_of",
    "unclassified",
]

_LEFT_AT = re.compile(r"at \((-?[\d.]+), (-?[\d.]+), (-?[\d.]+)\)")
"""How the task names the place of an object that it leaves."""
_DRIVE_OVER = 0.05
"""Boards on the ground are no obstacle; all else is to be removed [m]."""
_NEAR = 0.1
"""A place that is nearer than this to a body's box is the body's [m]."""
_MARGIN = 0.02
"""How much larger the box is that says where the object of interest lies [m]."""


class Watch:
    """Hears of every state, and ends a run that may not recover."""

    def __init__(self, *, recovery: bool) -> None:
        self.reached: list[str] = []
        self._recovery = recovery

    def on_state(self, state: State) -> None:
        """Take note of the state that begins."""
        if state is State.RECOVER and not self._recovery:
            # As a person would who stands beside the robot.
            raise KeyboardInterrupt
        self.reached.append(state.value)


@cache
def pipeline_of(site: str | None) -> Pipeline:
    """Load the planner of a site once in each process; it remembers nothing of runs.

    Raises
    ------
    ConfigError, UnknownNameError
        As `Settings.load` and `Pipeline.from_settings` do.
    """
    return Pipeline.from_settings(Settings() if site is None else Settings.load(site))


def run_fake(spec: RunSpec) -> RunRecord:
    """Clear a scene once, with the faults of the spec.

    Raises
    ------
    UnknownNameError
        If there is no such tier.
    """
    start = time.thread_time()
    rng = np.random.default_rng(spec.seed)
    world = fake_world(spec.tier, rng.spawn(1)[0])
    pipeline = pipeline_of(spec.site)
    watch, settings = Watch(recovery=spec.recovery), settings_of(spec, pipeline)
    if spec.tier in MARKED:
        settings = replace(settings, region=handle_of(world.bodies[0]))
    try:
        done = simulate(
            world,
            settings,
            spec.faults,
            pipeline=pipeline,
            observers=(watch,),
            rng=rng,
        )
    except Exception:  # noqa: BLE001 - nothing was removed, but there was something
        return unclassified(spec, world, settings)
    return record_of(spec, done, watch, settings, time.thread_time() - start)


def settings_of(spec: RunSpec, pipeline: Pipeline) -> TaskSettings:
    """Return the settings of the task in a run of a campaign."""
    task = SimulatedTask(
        site=spec.site, max_removals=spec.max_removals, drive_over=_DRIVE_OVER
    )
    return replace(task.settings(pipeline), max_attempts=spec.max_attempts)


def unclassified(spec: RunSpec, world: World, settings: TaskSettings) -> RunRecord:
    """Keep the exception that is being handled, and what was to be removed."""
    return RunRecord.unclassified(
        spec.name,
        spec.to_json(),
        traceback.format_exc(),
        n_objects=len(to_remove(world, settings)),
    )


def handle_of(crate: Body) -> Bounds:
    """Box around what stands above the rim of a crate, base frame."""
    low, high = box_around(crate)
    low[2] = high[2] - crate.sizes["rise"]
    return Bounds.around([low, high], _MARGIN)


def record_of(
    spec: RunSpec,
    done: Simulated,
    watch: Watch,
    settings: TaskSettings,
    seconds: float,
) -> RunRecord:
    """Put together what a run leaves behind; ``seconds`` of computing."""
    result, truth = done.result, done.truth
    failure = result.fault_class
    last = result.faults[-1] if result.faults else None
    first = result.first_fault
    reached = tuple(stage.value for stage in STAGES if stage.value in watch.reached)
    failed_stage = None
    if failure is not None:
        at_last = [name for name in watch.reached if name in reached]
        is_stage = last is not None and last.state in STAGES
        failed_stage = last.state.value if last and is_stage else at_last[-1]
    overlooked = [
        body.name
        for body in truth.world.bodies
        if is_in_the_way(body, settings) and not _is_named(body, result)
    ]
    objects = account(truth, settings)
    is_cleared = result.end is RunEnd.CLEARED
    must_stand = result.end in (RunEnd.STOPPED, RunEnd.INTERRUPTED)
    return RunRecord(
        name=spec.name,
        spec=spec.to_json(),
        outcome=SUCCESS if failure is None else failure.value,
        reached=reached,
        failed_stage=failed_stage,
        fault=None if failure is None or last is None else last.fault,
        first_fault=None if first is None else first.fault,
        end=result.end.value,
        faults=tuple(event.fault for event in result.faults),
        injected=done.happened,
        n_objects=len(objects.gone) + len(objects.kept),
        n_removed=len(objects.gone),
        checks={
            "uncaught": sum(e.fault == "software_error" for e in result.faults),
            "commands_outside_limits": len(truth.violations),
            "wrenches_above_limits": len(truth.overloads),
            "false_cleared": int(is_cleared and bool(overlooked)),
            "stops_not_latched": int(must_stand and not done.is_latched),
        },
        seconds=round(seconds, 3),
        details=_details(result, truth, overlooked),
    )


def _details(
    result: RunResult, truth: FakeTruth, overlooked: list[str]
) -> dict[str, Any]:
    """Evidence, for those who look into a run."""
    return {
        "faults": [
            {
                "state": event.state.value,
                "fault": event.fault,
                "action": event.action.value,
                "message": event.message,
            }
            for event in result.faults
        ],
        "left": dict(result.left),
        "removed": list(truth.removed),
        "overlooked": overlooked,
        "violations": [
            f"{v.time:.3f} s {v.device}: {v.message}" for v in truth.violations
        ][:5],
        "peak_force": {k: round(v, 1) for k, v in truth.peak_force.items()},
        "peak_torque": {k: round(v, 2) for k, v in truth.peak_torque.items()},
        "robot_seconds": round(result.duration, 2),
    }


def _is_named(body: Body, result: RunResult) -> bool:
    """Whether the task says of a body that it stays."""
    low, high = box_around(body)
    for words in result.left:
        found = _LEFT_AT.search(words)
        if found:
            place = np.array([float(value) for value in found.groups()])
            if (place > low - _NEAR).all() and (place < high + _NEAR).all():
                return True
    return False
