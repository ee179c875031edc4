"""The base drives to where the arms reach better."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.executive import Executive, TaskSettings
from debrisgrasp.executive.perceive import capture, segment
from debrisgrasp.executive.reposition import repositioned
from debrisgrasp.executive.result import Done, FaultFound
from debrisgrasp.geometry import SE3
from debrisgrasp.robot import fake_robot
from debrisgrasp.worlds import World
from tests.unit.executive.rigs import (
    PERIOD,
    before_a_brick,
    brick_at,
    look,
    task_before,
)


def test_a_base_drives_to_where_the_arms_reach_and_takes_along_what_it_knows(pipeline):
    fake, task = before_a_brick(pipeline)
    context = task.context
    look(context)
    place, beside = np.array([1.3, 0.0, 0.05]), np.array([0.25, 0.75, 0.1])
    failed = FaultFound("unreachable", "no arm gets there")
    context.marks.add(place, failed, n_changes=0, is_search=True)
    context.memory.dropped.append(beside[None])
    border = np.array([1.89, 0.0, 0.0])
    assert context.is_in_way(border)
    moved = repositioned(context, [place])
    assert moved == pytest.approx(0.35, abs=0.03)
    assert fake.base.T_odom_base.p[0] == pytest.approx(moved, abs=1e-6)
    shift = np.array([moved, 0.0, 0.0])
    assert context.marks.of(place - shift).searches == 1
    assert not context.marks.why_left(place - shift, context.n_changes, tries=1)
    np.testing.assert_allclose(context.memory.dropped[0][0], beside - shift, atol=1e-6)
    assert not context.is_in_way(border)
    assert context.is_in_way(border - shift)
    assert fake.truth().violations == ()


def test_a_base_tries_other_distances_and_goes_nowhere_twice(pipeline):
    fake, task = before_a_brick(pipeline)
    context = task.context
    place, stood = np.array([0.98, 0.0, 0.1]), [0.98]

    def moved():
        look(context)
        way = repositioned(context, [place])
        place[0] -= way
        stood.append(float(place[0]))
        return way

    assert moved() > 0.0
    assert moved() < 0.0
    assert np.allclose(stood[1:], [0.8, 1.1], atol=0.03)
    assert moved() == 0.0
    context.n_removed += 1  # with one less, another distance may do
    assert moved() != 0.0
    assert fake.truth().violations == ()


def test_a_base_stays_where_something_stands_before_it(pipeline):
    fake, task = before_a_brick(pipeline)
    context = task.context
    look(context)
    n = len(context.cycle.seen.cloud.points)
    context.memory.fallen.append(np.tile([[0.5, 0.1, 0.2]], (n // 20, 1)))
    assert repositioned(context, [np.array([1.3, 0.0, 0.1])]) == 0.0
    assert np.linalg.norm(fake.base.T_odom_base.p) == 0.0


@pytest.mark.parametrize("drives", [True, False])
def test_a_robot_whose_file_says_that_it_stands_fast_never_drives(pipeline, drives):
    world = World((brick_at(1.3),))
    model = replace(pipeline.robot, drives=drives)
    fake = fake_robot(model, world, rng=np.random.default_rng(0))
    assert (fake.robot.base is not None) is drives
    # Nor does one that has a base all the same.
    robot = replace(fake.robot, base=fake.base)
    context = Executive(robot, pipeline=pipeline, rng=np.random.default_rng(0)).context
    look(context)
    assert (repositioned(context, [np.array([1.8, 0.0, 0.2])]) > 0.0) is drives
    assert context.n_moves == drives
    assert bool(np.linalg.norm(fake.base.T_odom_base.p) > 0.05) is drives


@pytest.mark.parametrize("ahead", [0.0, 0.3])
def test_the_room_ahead_begins_at_the_front_of_the_base(pipeline, monkeypatch, ahead):
    _, task = before_a_brick(pipeline, settings=TaskSettings())
    context = task.context
    look(context)
    n = len(context.cycle.seen.cloud.points)
    context.memory.fallen.append(np.tile([[0.95, 0.1, 0.2]], (n // 20, 1)))
    moved = SE3.from_parts(p=[ahead, 0.0, 0.0])
    solids = [solid.moved(moved) for solid in context.model.fixed_solids]
    monkeypatch.setitem(vars(context.model), "fixed_solids", solids)
    way = repositioned(context, [np.array([1.8, 0.0, 0.2])])
    assert way == pytest.approx(min(0.35, 0.95 - 0.43 - 0.08 - ahead), abs=0.01)


@pytest.mark.parametrize("changed", ["n_removed", "n_pushed", "n_moves"])
def test_a_drop_off_that_was_free_at_first_is_not_said_to_lie_in_the_pile(
    pipeline, changed
):
    """A base that drives on takes its drop-offs along, past what was pushed aside."""
    drop_off = {"right": (0.7, -0.7), "left": (0.25, 0.75)}
    settings = TaskSettings(period=PERIOD, drop_off=drop_off)
    brick = brick_at(0.75)
    beside = brick.at(SE3.from_parts(p=[0.75, -0.66, 0.03]))
    context = task_before(pipeline, beside, settings=settings)[1].context
    assert isinstance(capture(context), Done)
    assert "lies in the pile" in segment(context).message
    setattr(context, changed, 1)
    assert isinstance(segment(context), Done)
