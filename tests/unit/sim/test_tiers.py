from __future__ import annotations

import pickle
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError, InputError, UnknownNameError
from debrisgrasp.geometry import SE3, Box, so3
from debrisgrasp.sim import (
    TIERS,
    SceneConfig,
    let_fall,
    scene_of,
    seen_again,
    settle,
    tier_scene,
)
from debrisgrasp.worlds import Body, World

pytest.importorskip("mujoco")


@pytest.fixture(scope="module")
def scenes():
    return {tier: tier_scene(tier, 1) for tier in TIERS}


def test_every_tier_makes_a_scene_at_rest_and_in_sight(scenes):
    for tier, scene in scenes.items():
        assert scene.settled.is_at_rest, tier
        assert scene.labels.max() >= 1, tier
        assert np.isfinite(scene.depth).mean() > 0.5, tier


def test_the_same_seed_makes_the_same_scene(scenes):
    again = tier_scene("stacked", 1)
    np.testing.assert_array_equal(again.depth, scenes["stacked"].depth)
    other = tier_scene("stacked", 2)
    assert other.world.names != again.world.names or not np.array_equal(
        other.depth, again.depth, equal_nan=True
    )


def test_a_scene_can_be_sent_to_another_process(scenes):
    scene = scenes["stacked"]
    for other in (deepcopy(scene), pickle.loads(pickle.dumps(scene))):
        np.testing.assert_array_equal(other.depth, scene.depth)
        assert other.world.names == scene.world.names


def test_the_believed_camera_is_off_by_the_calibration_error(scenes):
    for scene in scenes.values():
        true, believed = scene.T_base_camera, scene.T_base_camera_believed
        assert np.linalg.norm(believed.p - true.p) == pytest.approx(0.005)
        turn = np.linalg.norm(so3.log(believed.R @ true.R.T))
        assert turn == pytest.approx(np.radians(0.5))


def test_errors_can_be_turned_off():
    config = SceneConfig(noise=False, calibration_shift=0.0, calibration_turn=0.0)
    scene = tier_scene("isolated", 1, config)
    np.testing.assert_allclose(
        scene.T_base_camera.matrix, scene.T_base_camera_believed.matrix, atol=1e-12
    )
    points = scene.T_base_camera.apply(scene.intrinsics.deproject(scene.depth))
    floor = points[(scene.labels == 0) & np.isfinite(scene.depth)]
    height = floor[:, 2] - scene.world.ground.height(floor[:, :2])
    assert np.abs(height).max() < 1e-4


def test_a_scene_is_seen_again_without_what_was_taken(scenes, rng):
    before = scenes["stacked"]
    bodies = before.world.bodies
    settled = settle(World(bodies[:-1], before.world.ground))
    after = seen_again(before, settled, rng=rng)
    assert after.world.names == before.world.names[:-1]
    assert len(bodies) in before.labels
    assert len(bodies) not in after.labels
    np.testing.assert_array_equal(
        after.T_base_camera_believed.matrix, before.T_base_camera_believed.matrix
    )
    assert 0.5 < np.isfinite(after.depth).mean() < 1.0
    marked = scenes["handle"]
    others = tuple(b for b in marked.world.bodies if b.name != marked.target)
    if others:
        gone = seen_again(marked, settle(World(others)), rng=rng)
        assert gone.mask is None


def own(x: float) -> World:
    crate = Body("crate", "own", (Box(np.array([0.1, 0.06, 0.05])),), 2.0)
    return World((crate.at(SE3.from_parts(p=[x, 0.0, 0.05])),))


def test_bodies_of_your_own_are_seen_as_those_of_a_tier():
    settled = let_fall(own(1.1))
    scene, again = (scene_of(settled, 3, name="crates") for _ in range(2))
    assert (scene.tier, scene.seed, scene.target) == ("crates", 3, None)
    np.testing.assert_array_equal(scene.depth, again.depth)
    on_top = scene.labels == 1
    points = scene.T_base_camera.apply(scene.intrinsics.deproject(scene.depth))
    assert np.nanmedian(points[on_top][:, 2].clip(0.0)) == pytest.approx(0.1, abs=0.01)
    marked = scene_of(settled, 3, target="crate")
    np.testing.assert_array_equal(marked.mask, marked.labels == 1)


def test_scenes_of_your_own_say_what_is_wrong_with_them():
    settled = let_fall(own(1.1))
    with pytest.raises(UnknownNameError, match="box"):
        scene_of(settled, 0, target="box")
    with pytest.raises(InputError, match="seed"):
        scene_of(settled, -1)
    with pytest.raises(InputError, match="settled"):
        scene_of(settled.world, 0)
    with pytest.raises(InputError, match="at rest"):
        scene_of(replace(settled, is_at_rest=False), 0)
    with pytest.raises(InputError, match="in sight"):
        scene_of(let_fall(own(30.0)), 0)


def test_bodies_are_as_many_as_the_tier_says(scenes):
    assert len(scenes["isolated"].world.bodies) == 1
    assert 2 <= len(scenes["stacked"].world.bodies) <= 3
    assert 3 <= len(scenes["pile"].world.bodies) <= 8
    assert len(scenes["hedgehog"].world.bodies) == 1


def test_something_heavy_bears_on_the_encumbered_candidate(scenes):
    settled = scenes["encumbered"].settled
    assert settled.bearers("load")["candidate"] >= 10.0
    assert settled.world.bodies[settled.world.index("load")].mass >= 6.0


def test_the_beam_rests_on_the_edge(scenes):
    assert scenes["beam_on_edge"].settled.bearers("beam")["block"] >= 2.0


def test_the_handle_is_marked_and_nothing_else_is(scenes):
    scene = scenes["handle"]
    assert scene.target == "target"
    assert scene.mask is not None
    assert scene.world.bodies[scene.world.index("target")].kind == "crate_handle"
    assert set(np.unique(scene.labels[scene.mask])) == {1}
    assert scenes["pile"].mask is None


def test_the_pipe_passes_through_the_frame(scenes):
    world = scenes["interlocked"].world
    frame, pipe = (world.bodies[world.index(name)] for name in ("truss", "pipe"))
    half = pipe.sizes["length"] / 2
    axis = pipe.parts[0].T_frame_solid.R[:, 2]
    line = np.linspace(-half, half, 200)[:, None] * axis
    inside = frame.T_base_body.inverse().apply(pipe.T_base_body.apply(line))
    reach = np.array([np.abs(part.bounds.lower) for part in frame.parts]).max(axis=0)
    assert (np.abs(inside) < reach).all(axis=1).any()


def test_what_is_unknown_or_impossible_is_refused(monkeypatch):
    for seed in (-1, "a", None, 1.0):
        with pytest.raises(InputError, match="seed"):
            tier_scene("isolated", seed)
    with pytest.raises(UnknownNameError, match="tier"):
        tier_scene("heap", 1)
    with pytest.raises(ConfigError, match="calibration_shift"):
        SceneConfig(calibration_shift=-1.0)
    monkeypatch.setattr("debrisgrasp.sim.tiers._ATTEMPTS", 0)
    with pytest.raises(InputError, match="scene of tier"):
        tier_scene("isolated", 1)
