"""Steps that do nothing, or what a test wants, in place of those of the task."""

from __future__ import annotations

from debrisgrasp.executive.result import Done, FaultFound


def choose(context):
    context.cycle.label, context.cycle.centroid = 1, (1.0, 0.0, 0.1)
    return Done()


def put_down(context):
    context.n_removed += 1
    context.cycle.is_removed = True
    return Done()


def failing(fault, times=99):
    left = [times]

    def step(_context):
        left[0] -= 1
        return FaultFound(fault, "as asked") if left[0] >= 0 else Done()

    return step


def raising(error):
    def step(*_):
        raise error

    return step
