from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from debrisgrasp.errors import ConfigError, UnknownNameError
from debrisgrasp.geometry import SE3, Box, Cylinder, so3
from debrisgrasp.worlds import (
    Body,
    Ground,
    PileConfig,
    RestConfig,
    World,
    come_to_rest,
    generate_pile,
    let_down,
    prism,
)


def box(name, half, at=(0.0, 0.0, 0.0), rpy=(0.0, 0.0, 0.0)):
    pose = SE3.from_parts(so3.from_rpy(np.array(rpy)), at)
    return Body(name, "box", (Box(np.array(half)),), 2.0, pose)


def height(rested, name):
    return rested.world.bodies[rested.world.index(name)].T_base_body.p[2]


@given(
    rpy=st.tuples(st.floats(-3, 3), st.floats(-1.5, 1.5), st.floats(-3, 3)),
    xy=st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
)
@settings(max_examples=15)
def test_a_box_in_any_attitude_ends_on_one_of_its_faces(rpy, xy):
    half = (0.2, 0.1, 0.05)
    rested = come_to_rest(World((box("it", half, (*xy, 0.4), rpy),)))
    pose = rested.world.bodies[0].T_base_body
    assert rested.is_at_rest
    # Balanced on an edge or a corner it may stay; otherwise a face lies flat.
    upright = np.abs(pose.R[2]).max()
    if upright > 0.999:
        axis = int(np.abs(pose.R[2]).argmax())
        assert pose.p[2] == pytest.approx(half[axis], abs=1.5e-3)
    corners = pose.apply(box("", half).mesh()[0])
    assert corners[:, 2].min() == pytest.approx(0.0, abs=1e-3)
    level = (np.abs(corners[:, 2]) < 2e-3).sum()
    assert level >= 4 or upright < 0.999


def test_a_beam_lies_across_two_blocks_and_tips_off_one():
    blocks = (
        box("left", (0.05, 0.1, 0.1), (-0.3, 0.0, 0.1)),
        box("right", (0.05, 0.1, 0.1), (0.3, 0.0, 0.1)),
    )
    beam = box("beam", (0.5, 0.05, 0.02), (0.0, 0.0, 0.3))
    both = come_to_rest(World((*blocks, beam)))
    assert both.moved == ("beam",)
    assert height(both, "beam") == pytest.approx(0.22, abs=5e-4)
    tipped = come_to_rest(both.world.without("right"))
    # One end on the floor, resting on the inner edge of the block that is left.
    corners = tipped.world.bodies[1].solids[0].mesh()[0]
    assert corners[:, 2].min() == pytest.approx(0.0, abs=1e-3)
    assert corners[:, 2].max() > 0.2


def test_what_stood_on_a_removed_body_sinks_and_the_rest_stays():
    tower = tuple(
        box(f"b{k}", (0.1, 0.1, 0.05), (0.0, 0.0, 0.05 + 0.1 * k)) for k in range(4)
    )
    beside = box("beside", (0.1, 0.1, 0.05), (0.5, 0.0, 0.05))
    whole = World((*tower, beside))
    assert come_to_rest(whole).moved == ()
    rested = come_to_rest(whole.without("b1"))
    assert set(rested.moved) == {"b2", "b3"}
    assert [height(rested, name) for name in ("b0", "b2", "b3")] == pytest.approx(
        [0.05, 0.15, 0.25], abs=2e-3
    )


def test_friction_decides_whether_a_box_slides_down_a_slope():
    slope = np.tan(np.radians(20.0))
    wedge = prism([(0.0, 0.0), (1.0, 0.0), (1.0, slope)], 0.6)
    ramp = Body("ramp", "ramp", (wedge,), 50.0)
    turn = so3.from_rpy(np.array([np.radians(20.0), 0.0, 0.0]))
    normal = turn @ np.array([0.0, 0.0, 1.0])
    foot = np.array([0.0, 0.7, 0.7 * slope])
    load = box("load", (0.1, 0.1, 0.05)).at(SE3.from_parts(turn, foot + 0.05 * normal))
    stays = come_to_rest(World((ramp, load)), RestConfig(friction=0.6))
    assert stays.moved == ()
    slides = come_to_rest(World((ramp, load)), RestConfig(friction=0.1))
    assert slides.moved == ("load",)
    assert height(slides, "load") < 0.15


def test_a_body_that_is_held_stays_in_the_air_and_carries_others():
    world = World(
        (
            box("held", (0.1, 0.1, 0.05), (0.0, 0.0, 0.5)),
            box("on top", (0.05, 0.05, 0.05), (0.0, 0.0, 0.7)),
        )
    )
    rested = come_to_rest(world, fixed=["held"])
    assert height(rested, "held") == 0.5
    assert height(rested, "on top") == pytest.approx(0.6, abs=5e-4)
    with pytest.raises(UnknownNameError):
        come_to_rest(world, fixed=["hold"])


def test_a_pipe_lies_in_the_gap_between_two_bars():
    bars = (
        box("a", (0.3, 0.05, 0.05), (0.0, -0.09, 0.05)),
        box("b", (0.3, 0.05, 0.05), (0.0, 0.09, 0.05)),
    )
    lying = SE3.from_parts(so3.from_rpy(np.array([0.0, np.pi / 2, 0.0])), [0, 0, 0.3])
    pipe = Body("pipe", "pipe", (Cylinder(0.05, 0.5),), 1.0, lying)
    rested = come_to_rest(World((*bars, pipe)))
    assert rested.moved == ("pipe",)
    # It touches both inner edges, 4 cm from the middle: sqrt(5^2 - 4^2) cm above.
    assert height(rested, "pipe") == pytest.approx(0.1 + 0.03, abs=2e-3)


def test_bodies_come_to_rest_on_uneven_ground(rng):
    ground = Ground.uneven(rng, peak_to_peak=0.04)
    rested = let_down(World((box("it", (0.15, 0.1, 0.02), (1.4, 0.2, 0.0)),), ground))
    assert rested.is_at_rest
    edge = rested.world.bodies[0].solids[0].mesh()[0]
    gaps = edge[:, 2] - ground.height(edge[:, :2])
    assert gaps.min() > -0.003
    assert np.sort(gaps)[2] < 0.02


def test_a_pile_that_is_let_down_does_not_overlap_and_is_deterministic():
    config = PileConfig(n_bodies=(4, 4), arrangements=("stacked",), uneven_share=0.0)
    world = generate_pile(rng=np.random.default_rng(1), config=config)
    rested, again = let_down(world), let_down(world)
    for i, body in enumerate(rested.world.bodies):
        same = again.world.bodies[i].T_base_body.matrix
        np.testing.assert_array_equal(body.T_base_body.matrix, same)
        corners = body.T_base_body.apply(body.mesh()[0])
        assert corners[:, 2].min() > -2e-3
        for other in rested.world.bodies[:i] + rested.world.bodies[i + 1 :]:
            gaps = [solid.signed_distance(corners) for solid in other.solids]
            assert np.min(gaps) > -4e-3


def test_steps_that_run_out_are_reported():
    rested = come_to_rest(
        World((box("it", (0.1, 0.1, 0.1), (0.0, 0.0, 5.0)),)),
        RestConfig(max_steps=3, max_rounds=1),
    )
    assert not rested.is_at_rest
    assert rested.moved == ("it",)


def test_settings_out_of_range_are_refused():
    with pytest.raises(ConfigError, match="step"):
        RestConfig(step=0.0)
    with pytest.raises(ConfigError, match="friction"):
        RestConfig(friction=-0.1)
