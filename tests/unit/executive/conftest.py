"""The planner that all tests share, and a task whose steps are replaced."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.executive import STAGES, Executive, MemoryRecord, State, TaskSettings
from debrisgrasp.executive import steps as module
from debrisgrasp.executive.result import Done
from debrisgrasp.pipeline import Pipeline
from tests.unit.executive.rigs import brick_at, task_before
from tests.unit.executive.stepped import choose, put_down


@pytest.fixture(scope="session")
def pipeline():
    """Plan for all tasks; it remembers nothing."""
    return Pipeline()


@pytest.fixture
def fake(pipeline):
    return task_before(pipeline, brick_at(1.0))[0]


@pytest.fixture
def run(fake, pipeline, monkeypatch):
    """Run with all steps replaced: by nothing, or by what a test wants."""

    def go(steps, settings=None, *, observers=(), record=None):
        for state in STAGES:
            monkeypatch.setitem(module.STEPS, state, lambda _context: Done())
        monkeypatch.setitem(module.STEPS, State.SELECT, choose)
        monkeypatch.setitem(module.STEPS, State.VERIFY_RELEASE, put_down)
        for state, step in steps.items():
            monkeypatch.setitem(module.STEPS, state, step)
        record = record or MemoryRecord()
        executive = Executive(
            fake.robot,
            settings or TaskSettings(max_removals=2),
            pipeline=pipeline,
            observers=observers,
            record=record,
            rng=np.random.default_rng(0),
        )
        return executive.run(), record

    return go
