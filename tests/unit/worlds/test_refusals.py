"""What the public functions of worlds refuse, and in which words."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.errors import DebrisGraspError
from debrisgrasp.geometry import SE3, Box
from debrisgrasp.worlds import (
    Body,
    Ground,
    PileConfig,
    RestConfig,
    StereoNoise,
    World,
    come_to_rest,
    draw_body,
    draw_intrinsics,
    draw_view,
    first_hits,
    generate_pile,
    let_down,
    look_at,
    make_body,
    named_scene,
    prism,
    render,
    staves,
    volume_and_centroid,
)

RNG = np.random.default_rng(0)
BRICK = make_body("brick", {"length": 0.2, "width": 0.1, "height": 0.06}, 2.0)
WORLD = World((BRICK,))
CAMERA = draw_intrinsics(RNG)
VIEW = look_at((0.0, 0.0, 1.2), (1.0, 0.0, 0.0))
SHAPE = (CAMERA.height, CAMERA.width)


def brick(**sizes):
    return make_body("brick", {"length": 0.2, "width": 0.1, "height": 0.06, **sizes}, 2)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: World(None), ["bodies", "None", "a tuple"]),
        (lambda: World((1,)), ["bodies[0]", "a Body"]),
        (lambda: WORLD.placed([VIEW, VIEW]), ["poses", "one for each of 1"]),
        (lambda: Body("a", "b", (Box(np.ones(3)),), np.nan), ["mass", "nan"]),
        (lambda: volume_and_centroid(None), ["part", "a Box"]),
        (lambda: first_hits(None, np.zeros(3), np.eye(3)), ["part", "a Box"]),
        (lambda: PileConfig(n_bodies=4), ["n_bodies", "4", "a tuple of 2"]),
        (lambda: PileConfig(n_bodies=(3, 10**6)), ["n_bodies", "1 to 1000"]),
        (lambda: PileConfig(spread=np.nan), ["spread", "nan"]),
        (lambda: PileConfig(spread=-1.0), ["spread", "-1"]),
        (lambda: PileConfig(center=(1450, 0)), ["center", "1450", "millimetres"]),
        (lambda: PileConfig(heavy_share=2), ["heavy_share", "0 to 1"]),
        (lambda: generate_pile(rng=3), ["rng", "default_rng"]),
        (lambda: let_down(3), ["world", "a World"]),
        (lambda: come_to_rest(WORLD, fixed="brick"), ["fixed", "a sequence"]),
        (lambda: come_to_rest(WORLD, RestConfig), ["config", "a RestConfig"]),
        (lambda: draw_body("brick", rng=None), ["rng", "default_rng"]),
        (lambda: draw_body("brick", rng=RNG, mass=-1.0), ["mass", "more than 0"]),
        (lambda: brick(length=200), ["length of a brick", "200", "0.001 to 5"]),
        (lambda: brick(length=np.nan), ["length of a brick", "nan"]),
        (lambda: brick(length="long"), ["length of a brick", "long"]),
        (lambda: make_body("brick", None, 2.0), ["sizes", "a dictionary"]),
        (
            lambda: make_body("ladder", {"length": 1, "width": 0.3, "rungs": 3.5}, 3),
            ["rungs of a ladder", "3.5", "a count"],
        ),
        (
            lambda: make_body(
                "pipe_wide", {"length": 1, "radius": 0.1, "wall": 0.2}, 3
            ),
            ["sizes of a pipe_wide", "fit together", "radii"],
        ),
        (lambda: staves((0.1, 0.2), (0.1, 0.2), 0, 1, count=7), ["staves", "7"]),
        (lambda: prism(3, 1.0), ["profile"]),
        (lambda: render(WORLD, np.eye(3), VIEW), ["intrinsics", "from_matrix"]),
        (lambda: render(WORLD, CAMERA, np.eye(4)), ["T_base_camera", "from_matrix"]),
        (lambda: render(WORLD, CAMERA, VIEW, extra=[3]), ["extra[0]", "a Solid"]),
        (lambda: StereoNoise(sigma="low"), ["sigma", "a finite number"]),
        (
            lambda: StereoNoise().noisy(np.full(SHAPE, 1200.0), CAMERA, rng=RNG),
            ["depth", "1200", "0 to 100"],
        ),
        (
            lambda: StereoNoise().noisy(-np.ones(SHAPE), CAMERA, rng=RNG),
            ["depth", "-1"],
        ),
        (lambda: draw_view((1.0, 0.0), rng=RNG), ["target", "3"]),
        (lambda: draw_view((1, 0, 0), rng=RNG, height=2), ["height", "a tuple of 2"]),
        (lambda: draw_view((1, 0, 0), rng=RNG, tilt=(50, 40)), ["tilt", "40"]),
        (lambda: look_at(None, (0, 0, 0)), ["eye"]),
        (lambda: Ground.uneven(RNG, size=1e9), ["size", "0.5 to 50"]),
        (lambda: named_scene(3), ["name", "a text"]),
    ],
)
def test_what_makes_no_sense_is_named(call, words):
    with pytest.raises(DebrisGraspError) as refused:
        call()
    for word in words:
        assert word in str(refused.value)


def test_lists_and_whole_numbers_are_fine():
    assert World([BRICK]).names == ("brick",)
    assert PileConfig(n_bodies=[3, 4], spread=1).n_bodies == (3, 4)
    assert Body("a", "b", [Box(np.ones(3))], 1).parts[0].bounds.upper[0] == 1.0
    assert World((BRICK.at(SE3.identity()),)).placed((VIEW,)).names == ("brick",)


def test_what_is_not_finite_was_not_measured():
    depth = np.full(SHAPE, np.nan)
    depth[:, ::2] = np.inf
    assert not StereoNoise().noisy(depth, CAMERA, rng=RNG).depth.any()
