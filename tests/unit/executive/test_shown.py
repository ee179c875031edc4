"""The way is clear only where somebody has looked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.executive import SimulatedTask, TaskSettings
from debrisgrasp.executive.choose import select
from debrisgrasp.executive.gaze import look_towards
from debrisgrasp.executive.perceive import capture, image
from debrisgrasp.executive.result import Done, FaultFound
from debrisgrasp.executive.shown import _is_in, never_shown, was_shown
from debrisgrasp.executive.states import State
from debrisgrasp.geometry import SE3
from debrisgrasp.worlds import make_body
from tests.unit.executive.rigs import look, task_before


def looking(pipeline, *bodies, **settings):
    settings = TaskSettings(**{"repositions": 0, **settings})
    _, task = task_before(pipeline, *bodies, settings=settings)
    return task.context


def looked(context):
    look(context)
    return select(context)


def block(x, y):
    sizes = {"length": 0.2, "width": 0.14, "height": 0.16}
    return make_body("brick", sizes, 2.0).at(SE3.from_parts(p=[x, y, 0.08]))


def test_the_strip_before_the_tracks_is_looked_at_before_the_way_counts_as_clear(
    pipeline,
):
    context = looking(pipeline, block(0.98, 1.2))  # beside the way
    found = looked(context)
    assert found.next is State.CAPTURE
    assert len(context.shown) == 1
    x, _, _ = context.cycle.gaze
    assert x < 0.8
    for _ in range(3):
        found = looked(context)
        if found.next is State.CLEARED:
            break
    assert found.next is State.CLEARED
    assert 2 <= len(context.shown) <= 4


def test_what_lies_there_is_found(pipeline):
    context = looking(pipeline, block(0.6, 0.0))
    found = looked(context)
    if found.next is State.CAPTURE:
        found = looked(context)
    assert found.next is None
    assert np.hypot(*(np.array(found.facts["centroid"]) - [0.6, 0, 0.08])[:2]) < 0.1


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_both_sides_of_a_wide_way_are_looked_at(pipeline, side):
    wide = ((0.45, -2.0, -0.1), (1.9, 2.0, 1.3))
    context = looking(pipeline, block(1.0, side * 1.8), workspace=wide)
    for _ in range(4):
        found = looked(context)
        if found.next is not State.CAPTURE:
            break
    assert found.next is None
    assert found.facts["centroid"][1] == pytest.approx(side * 1.8, abs=0.15)


def test_all_ground_is_looked_at_to_which_the_head_turns(pipeline):
    context = looking(pipeline, block(0.98, 1.2))
    while looked(context).next is State.CAPTURE:
        assert len(context.shown) < 6
    # Right before the tracks it can't look down far enough: 10 % by a grid of looks.
    assert 0.05 < never_shown(context).share < 0.11


def test_where_a_picture_has_no_depth_it_shows_nothing(pipeline):
    context = looking(pipeline, block(0.98, 1.2))
    looked(context)
    (sight,), place = context.shown, np.array([1.0, 0.0, 0.0])
    place = place[None]
    assert was_shown([sight], place)
    blind = replace(sight, depth=np.full_like(sight.depth, np.nan))
    assert not was_shown([blind], place)
    assert was_shown([blind, sight], place)


def test_a_way_of_which_a_fixed_camera_shows_little_is_not_clear(pipeline):
    wide = ((0.45, -2.0, -0.1), (1.9, 2.0, 1.3))
    context = looking(pipeline, block(0.98, 2.3), workspace=wide)
    context.robot = replace(context.robot, head=None)
    found = looked(context)
    assert isinstance(found, FaultFound)
    assert found.fault == "empty_cloud"
    assert "in no picture" in found.message


def test_a_camera_that_looks_elsewhere_is_told_with_where_it_looks(pipeline):
    context = looking(pipeline, block(0.98, 1.2))
    found = image(context, "", {"ptu_tilt_joint": -0.5})
    assert isinstance(found, FaultFound)
    assert found.fault == "empty_cloud"
    assert "nothing of the workspace is in the picture" in found.message
    T_base_camera = context.model.T_base_camera({"ptu_tilt_joint": -0.5})
    up = T_base_camera.matrix[2, 2]
    assert f"looks along (0.{round(100 * (1 - up**2) ** 0.5)}, 0.00, {up:.2f})" in (
        found.message.replace("-0.00", "0.00")
    )


def test_from_elsewhere_all_is_looked_at_anew(pipeline):
    context = looking(pipeline, block(0.98, 1.2))
    looked(context)
    assert context.cycle.gaze is not None
    context.stands_elsewhere(SE3.from_parts(p=[-0.2, 0.0, 0.0]))
    assert context.cycle.gaze is None
    assert isinstance(capture(context), Done)
    assert len(context.shown) == 1
    assert never_shown(context).middle is not None


def test_ground_that_the_robot_itself_hides_is_looked_at_in_vain(pipeline):
    """Pile 10525: from ahead, ground of the way was left beside the robot's hand."""
    context = looking(pipeline, block(0.98, 1.2))
    context.stands_elsewhere(SE3.from_parts(p=[-0.7, 0.0, 0.0]))
    looked(context)
    place = np.array([-0.25, -0.27, 0.0])
    context.cycle.gaze = context.T_base_way.inverse().apply(place)
    found = image(context, "", look_towards(context, place))
    assert isinstance(found, FaultFound)
    assert found.fault == "depth_dropout"
    assert isinstance(capture(context), Done)
    assert len(context.shown) == 2
    assert never_shown(context).middle is None


def test_no_pile_lies_where_the_robot_stands():
    """Seed 5020 drew a cone between the tracks."""
    world = SimulatedTask(seed=5020).world()
    low = min(solid.bounds.lower[0] for body in world.bodies for solid in body.solids)
    assert low == pytest.approx(0.5, abs=1e-9)


def test_what_the_border_of_a_picture_cut_off_is_judged_by_the_next(pipeline):
    """Cut to a strip of 2 cm, a block is too small to count."""
    context = looking(pipeline, block(0.98, 1.2))
    looked(context)
    sight = context.shown[0]
    places = np.stack([np.arange(0.3, 1.0, 0.005), *np.zeros((2, 140))], axis=1)
    places[:, 2] = 0.16
    border = places[_is_in(sight, places)][0, 0]
    grid = np.arange(-0.1, 0.1, 0.01)
    top = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    corner = np.array([border - 0.08, 0.0])
    cut = np.column_stack([top + corner, np.full(len(top), 0.16)])
    whole = cut + np.array([0.2, 0.0, 0.0])
    assert not was_shown([sight], cut)
    assert was_shown([sight], whole)


def test_what_lies_right_before_the_tracks_is_seen_from_farther_back(pipeline):
    """Its top is below the lower border of every picture."""
    context = looking(pipeline, block(0.52, 0.0), repositions=2)
    found = looked(context)
    while found.next is State.CAPTURE and context.n_moves == 0:
        found = looked(context)
    assert context.n_moves == 1
    assert context.T_base_way.p[0] == pytest.approx(0.3, abs=0.02)
    found = looked(context)
    assert found.next is None
    assert found.facts["centroid"][0] == pytest.approx(0.52 + 0.3, abs=0.1)


def test_a_base_drives_back_only_as_long_as_that_shows_more(pipeline):
    context = looking(pipeline, block(0.98, 1.4), repositions=5)
    found = looked(context)
    for _ in range(12):
        if found.next is State.CLEARED:
            break
        found = looked(context)
    assert found.next is State.CLEARED
    assert context.n_moves <= 2
    assert never_shown(context).share < 0.02
