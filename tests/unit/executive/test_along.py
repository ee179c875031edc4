"""An idle arm that another one takes along on the joints of their trunk."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.control import LegOutcome
from debrisgrasp.executive.along import Along
from debrisgrasp.executive.drive import Drive
from debrisgrasp.executive.moves import planned
from debrisgrasp.executive.obstacles import space_of
from debrisgrasp.executive.states import State
from debrisgrasp.motion import UnknownSpace
from tests.unit.executive.rigs import before_a_brick


def test_a_push_on_the_other_arm_ends_a_motion_of_the_trunk(pipeline, monkeypatch):
    _, task = before_a_brick(pipeline)
    context = task.context
    limb, drive = context.limbs["right"], Drive(context, "right")
    away = context.posture(limb).copy()
    away[0] += 0.8
    space = space_of(context, unknown=UnknownSpace.IGNORED)
    trajectory = planned(context, limb, away, space).trajectory
    for each in context.limbs.values():
        each.baseline_time = 1.0
    loads = iter([0.0, 10.0, 20.0, 61.0, np.nan, 61.0, 61.0, 500.0])

    def bears(_):
        force = next(loads)
        return force, force / 10.0

    monkeypatch.setattr(Along, "_bears", bears)
    fault = drive.follow(trajectory)
    assert (fault.fault, fault.arm) == ("plan_collision", "left")
    assert next(loads) == 500.0


@pytest.mark.parametrize(
    ("force", "torque", "fault"),
    [
        (24.0, 1.0, None),
        (130.0, 1.0, "plan_collision"),
        (10.0, 9.0, "plan_collision"),
        (np.nan, np.nan, "wrench_nan"),
    ],
)
def test_an_arm_that_is_taken_along_is_watched_within_its_limits(
    pipeline, monkeypatch, force, torque, fault
):
    _, task = before_a_brick(pipeline)
    drive = Drive(task.context, "left")
    begun = 0.0 if force < 100.0 else 125.0  # what it bears already allows no more
    monkeypatch.setattr(Along, "_bears", lambda _: (begun, 0.0))
    along = Along(drive)
    monkeypatch.setattr(Along, "_bears", lambda _: (force, torque))
    found = [each.fault for each in (along.met() for _ in range(12)) if each]
    assert set(found) == ({fault} if fault else set())


@pytest.mark.parametrize(("force", "turns"), [(0.0, True), (40.0, False)])
def test_a_leg_does_not_turn_an_arm_that_touches_something(
    pipeline, monkeypatch, force, turns
):
    _, task = before_a_brick(pipeline)
    context = task.context
    context.state = State.RETREAT
    limb, drive = context.limbs["right"], Drive(context, "right")
    for each in context.limbs.values():
        each.baseline_time = 1.0
    monkeypatch.setattr(Along, "_bears", lambda _: (force, 0.0))
    before = context.posture(limb)
    place = limb.pose(before).p
    end = drive.leg([0.05, 0.05, 0.0], speed=0.05)
    assert end.outcome is LegOutcome.DONE
    after = context.posture(limb)
    assert limb.pose(after).p - place == pytest.approx([0.05, 0.05, 0.0], abs=2e-3)
    assert bool(abs(after[0] - before[0]) > 1e-3) is turns
