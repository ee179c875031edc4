from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path
from subprocess import PIPE
from types import SimpleNamespace

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError, InputError, MissingExtraError
from debrisgrasp.geometry import SE3, Box
from debrisgrasp.sim import (
    Physics,
    SettleConfig,
    _mujoco,
    build_model,
    let_fall,
    settle,
    settled_pile,
)
from debrisgrasp.worlds import (
    Body,
    Ground,
    PileConfig,
    World,
    come_to_rest,
    generate_pile,
    make_body,
    named_scene,
)

GRAVITY = 9.81


def box(name, half, mass, at=(0.0, 0.0, 0.0)):
    return Body(name, "box", (Box(np.array(half)),), mass, SE3.from_parts(p=at))


@pytest.fixture(autouse=True)
def _needs_mujoco(request):
    if "absent" not in request.node.name:
        pytest.importorskip("mujoco")


@pytest.fixture(scope="module")
def pile_at_rest():
    pytest.importorskip("mujoco")
    config = PileConfig(n_bodies=(6, 6), arrangements=("dropped",), uneven_share=0.0)
    return let_fall(generate_pile(rng=np.random.default_rng(12), config=config))


def test_a_box_comes_to_rest_on_the_floor_with_its_weight():
    result = let_fall(World((box("it", (0.2, 0.1, 0.05), 3.0),)))
    assert result.is_at_rest
    assert result.world.bodies[0].T_base_body.p[2] == pytest.approx(0.05, abs=1e-3)
    assert result.bearers("it") == {"ground": pytest.approx(3.0 * GRAVITY, rel=1e-3)}
    for contact in result.contacts:
        assert (contact.a, contact.b) == (-1, 0)
        np.testing.assert_allclose(contact.normal, [0, 0, 1], atol=1e-3)
        assert contact.point[2] == pytest.approx(0.0, abs=1e-3)


def test_a_beam_on_two_blocks_loads_each_with_half():
    world = World(
        (
            box("left", (0.05, 0.1, 0.1), 2.0, (-0.3, 0.0, 0.0)),
            box("right", (0.05, 0.1, 0.1), 2.0, (0.3, 0.0, 0.0)),
            box("beam", (0.5, 0.05, 0.02), 4.0),
        )
    )
    result = let_fall(world)
    half = pytest.approx(2.0 * GRAVITY, rel=0.02)
    assert result.bearers("beam") == {"left": half, "right": half}
    assert result.bearers("left") == {"ground": pytest.approx(4 * GRAVITY, rel=0.02)}
    assert result.loads == pytest.approx(-result.loads.T)


def test_a_block_without_support_falls_and_one_with_it_stays():
    world = World(
        (
            box("low", (0.2, 0.2, 0.1), 2.0, (0.0, 0.0, 0.1)),
            box("high", (0.1, 0.1, 0.1), 1.0, (0.0, 0.0, 0.3)),
        )
    )
    stays = settle(world).world
    assert stays.bodies[1].T_base_body.p[2] == pytest.approx(0.3, abs=2e-3)
    falls = settle(world.without("low")).world
    assert falls.bodies[0].T_base_body.p[2] == pytest.approx(0.1, abs=2e-3)


def test_every_body_of_a_pile_at_rest_is_carried_with_its_weight(pile_at_rest):
    assert pile_at_rest.is_at_rest
    weights = [GRAVITY * body.mass for body in pile_at_rest.world.bodies]
    np.testing.assert_allclose(pile_at_rest.loads[1:].sum(axis=1), weights, atol=0.3)
    assert -pile_at_rest.loads[0].sum() == pytest.approx(sum(weights), abs=0.3)


def test_bodies_at_rest_touch_but_do_not_interpenetrate(pile_at_rest):
    solids = [body.solids for body in pile_at_rest.world.bodies]
    for i, own in enumerate(solids):
        corners = np.concatenate([solid.mesh()[0] for solid in own])
        assert corners[:, 2].min() > -2e-3
        for other in solids[:i] + solids[i + 1 :]:
            gap = np.min([solid.signed_distance(corners) for solid in other], axis=0)
            assert gap.min() > -2e-3
    for contact in pile_at_rest.contacts:
        for index in (contact.a, contact.b):
            if index >= 0:
                gaps = [s.signed_distance(contact.point) for s in solids[index]]
                assert abs(min(gaps)) < 2e-3


def test_friction_stays_within_its_cone_and_pressure_points_from_a_to_b(pile_at_rest):
    for contact in pile_at_rest.contacts:
        sideways = contact.force - contact.normal_force * contact.normal
        assert contact.normal_force > 0.0
        assert np.linalg.norm(sideways) <= 0.6 * contact.normal_force + 1e-6
        assert contact.a < contact.b


def test_the_same_world_settles_the_same_way(pile_at_rest):
    config = PileConfig(n_bodies=(6, 6), arrangements=("dropped",), uneven_share=0.0)
    again = let_fall(generate_pile(rng=np.random.default_rng(12), config=config))
    for a, b in zip(pile_at_rest.world.bodies, again.world.bodies, strict=True):
        np.testing.assert_array_equal(a.T_base_body.matrix, b.T_base_body.matrix)


def test_uneven_ground_is_the_same_for_physics_and_for_the_camera(rng):
    ground = Ground.uneven(rng, peak_to_peak=0.04)
    ball = make_body("brick", {"length": 0.2, "width": 0.1, "height": 0.06}, 2.0)
    spot = SE3.from_parts(p=[1.45, 0.1, 0.0])
    result = let_fall(World((ball.at(spot),), ground))
    assert result.is_at_rest
    points = np.array([contact.point for contact in result.contacts])
    assert len(points) >= 3
    np.testing.assert_allclose(points[:, 2], ground.height(points[:, :2]), atol=2e-3)


def test_the_block_of_figure_7_bears_on_the_wood():
    result = let_fall(named_scene("block_on_wood"))
    assert result.is_at_rest
    assert result.bearers("cinder_block")["lumber_2x4"] > 10.0
    stack = let_fall(named_scene("wood_on_truss"))
    assert set(stack.bearers("lumber_2x4_1")) == {"truss_ladder"}


def test_the_constraint_jacobian_is_dense():
    mujoco = pytest.importorskip("mujoco")
    model = build_model(World((box("it", (0.1, 0.1, 0.1), 1.0),)), Physics())
    assert model.opt.jacobian == mujoco.mjtJacobian.mjJAC_DENSE


def test_the_model_has_the_masses_and_inertias_of_the_bodies():
    edges = {"length": 0.4, "width": 0.2, "height": 0.1}
    brick = make_body("brick", edges, 3.0)
    model = build_model(World((brick,)), Physics())
    assert model.body_mass[1] == pytest.approx(3.0)
    x, y, z = (edges[name] ** 2 for name in ("length", "width", "height"))
    expected = sorted(3.0 / 12 * np.array([y + z, x + z, x + y]))
    np.testing.assert_allclose(sorted(model.body_inertia[1]), expected, rtol=1e-6)


def test_the_missing_extra_is_named_when_mujoco_is_absent(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingExtraError, match=r"debrisgrasp\[sim\]"):
        let_fall(World((box("it", (0.1, 0.1, 0.1), 1.0),)))


@pytest.mark.parametrize("version", ["2.3.7", "3.17.0", "5.0.0rc1"])
def test_a_version_that_was_never_tried_is_told_like_one_absent(monkeypatch, version):
    monkeypatch.setitem(sys.modules, "mujoco", SimpleNamespace(__version__=version))
    told = rf"MuJoCo is {version}, from 4 to below 5 works.*debrisgrasp\[sim\]"
    with pytest.raises(MissingExtraError, match=told):
        let_fall(World((box("it", (0.1, 0.1, 0.1), 1.0),)))


def test_a_library_of_the_system_that_is_absent_is_told(monkeypatch, tmp_path):
    (tmp_path / "mujoco.py").write_text("raise ImportError('libGL.so.1: no such file')")
    monkeypatch.delitem(sys.modules, "mujoco", raising=False)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(MissingExtraError, match=r"can't be loaded: libGL\.so\.1"):
        let_fall(World((box("it", (0.1, 0.1, 0.1), 1.0),)))


def test_absent_is_what_the_extra_does_not_allow():
    pyproject = Path(__file__).parents[3] / "pyproject.toml"
    project = tomllib.loads(pyproject.read_text())["project"]
    allowed = f"mujoco>={_mujoco._FROM},<{_mujoco._BELOW}"
    assert project["optional-dependencies"]["sim"] == [allowed]


def test_settings_out_of_range_are_refused():
    with pytest.raises(ConfigError, match="time_step"):
        Physics(time_step=0.1)
    with pytest.raises(ConfigError, match="stiffness_time"):
        Physics(stiffness_time=0.001)
    with pytest.raises(ConfigError, match="rest_motion"):
        SettleConfig(rest_motion=0.0)


def test_drawn_piles_are_at_rest_together_and_carry_their_weight():
    config = PileConfig(n_bodies=(3, 4), uneven_share=0.0)
    pile = settled_pile(rng=np.random.default_rng(2), config=config)
    assert pile.is_at_rest
    assert 3 <= len(pile.world.bodies) <= 4
    weights = [GRAVITY * body.mass for body in pile.world.bodies]
    np.testing.assert_allclose(pile.loads[1:].sum(axis=1), weights, atol=0.3)
    offsets = [body.T_base_body.p[:2] - config.center for body in pile.world.bodies]
    assert np.linalg.norm(offsets, axis=1).max() < 1.0


def test_piles_that_cannot_come_to_rest_are_refused(monkeypatch):
    module = sys.modules["debrisgrasp.sim.piles"]
    monkeypatch.setattr(module, "_ATTEMPTS", 1)
    hasty = SettleConfig(interval=0.0, max_time=0.0)
    with pytest.raises(InputError, match="come to rest"):
        settled_pile(rng=np.random.default_rng(2), settling=hasty)


def test_what_physics_leaves_at_rest_also_rests_without_it(pile_at_rest):
    rested = come_to_rest(pile_at_rest.world)
    assert rested.is_at_rest
    for a, b in zip(rested.world.bodies, pile_at_rest.world.bodies, strict=True):
        shift = np.linalg.norm(a.T_base_body.p - b.T_base_body.p)
        assert shift < 0.01, a.name


def test_a_simulation_that_diverges_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # the engine leaves a log where it stands
    broken = let_fall(World((box("it", (0.1, 0.1, 0.1), 1.0),)))
    assert broken.is_at_rest
    run_type = sys.modules["debrisgrasp.sim.settle"]._Run
    run = run_type(broken.world, SettleConfig(max_time=0.1), n_released=1)
    run.data.qvel[:] = np.nan
    with pytest.raises(InputError, match="diverged"):
        run.finished()


@pytest.mark.parametrize("words", [["piles"], ["segmentation", "--piles", "1"]])
def test_a_benchmark_names_the_extra_that_is_absent_in_one_line(words):
    code = (
        "import runpy, sys\n"
        f"sys.modules['mujoco'], sys.argv = None, {words}\n"
        f"runpy.run_module('tests.benchmarks.{words[0]}', run_name='__main__')"
    )
    done = subprocess.run([sys.executable, "-c", code], stderr=PIPE, text=True)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].startswith("error: physics simulation needs")
    assert "Traceback" not in done.stderr
