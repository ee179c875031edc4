from __future__ import annotations

import pickle
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError, UnknownNameError
from debrisgrasp.worlds import (
    ARRANGEMENTS,
    KINDS,
    SCENES,
    PileConfig,
    generate_pile,
    named_scene,
)


@pytest.mark.parametrize("arrangement", ARRANGEMENTS)
def test_every_arrangement_holds_the_number_of_bodies_asked_for(arrangement, rng):
    for n in (3, 6, 10):
        config = PileConfig(n_bodies=(n, n), arrangements=(arrangement,))
        world = generate_pile(rng=rng, config=config, name="pile 7")
        assert len(world.bodies) == n
        assert world.name == f"pile 7 {arrangement}"
        offsets = [body.T_base_body.p[:2] - (1.45, 0.0) for body in world.bodies]
        assert np.abs(offsets).max() < 0.8


def test_the_same_seed_gives_the_same_pile_and_another_seed_another():
    first, again, other = (
        generate_pile(rng=np.random.default_rng(seed)) for seed in (4, 4, 5)
    )
    assert first.names == again.names != other.names
    for a, b in zip(first.bodies, again.bodies, strict=True):
        np.testing.assert_array_equal(a.T_base_body.matrix, b.T_base_body.matrix)
        assert a.mass == b.mass
        assert a.sizes == b.sizes


def test_a_world_is_the_same_as_a_copy_and_in_another_process(rng):
    world = generate_pile(rng=rng)
    for other in (deepcopy(world), pickle.loads(pickle.dumps(world))):
        assert other.names == world.names
        for a, b in zip(world.bodies, other.bodies, strict=True):
            np.testing.assert_array_equal(a.T_base_body.matrix, b.T_base_body.matrix)
            assert a.sizes == b.sizes


def test_the_sizes_of_a_body_are_its_own(rng):
    body = generate_pile(rng=rng).bodies[0]
    sizes = dict(body.sizes)
    body = replace(body, sizes=sizes)
    sizes.clear()
    assert body.sizes


def test_all_kinds_occur_and_heavy_ones_on_demand(rng):
    worlds = [generate_pile(rng=rng) for _ in range(60)]
    assert {body.kind for world in worlds for body in world.bodies} == set(KINDS)
    assert max(body.mass for world in worlds for body in world.bodies) <= 8.0
    assert 0 < sum(not world.ground.is_level for world in worlds) < 40
    heavy = generate_pile(rng=rng, config=PileConfig(heavy_share=1.0))
    assert all(10.0 <= body.mass <= 25.0 for body in heavy.bodies)


def test_named_scenes_are_built_and_unknown_ones_name_the_known():
    for name in SCENES:
        assert named_scene(name).name == name
    with pytest.raises(UnknownNameError, match="hedgehog"):
        named_scene("hedgehogs")


def test_settings_that_make_no_pile_are_refused():
    with pytest.raises(ConfigError, match="n_bodies"):
        PileConfig(n_bodies=(0, 3))
    with pytest.raises(ConfigError, match="n_bodies"):
        PileConfig(n_bodies=(5, 3))
    with pytest.raises(UnknownNameError, match="dropped"):
        PileConfig(arrangements=("droped",))
