"""Mass from what is seen, and the loads that follow: closed forms, laws, bad input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.geometry import SE3, Intrinsics, so3, voxel_downsample
from debrisgrasp.io import Capture
from debrisgrasp.planning.load import GripLevers, LoadModel
from debrisgrasp.planning.mass import Build, LoadConfig, ObjectMass
from debrisgrasp.prototypes import GripperModel
from debrisgrasp.worlds import World, draw_body, look_at, render
from tests.strategies import poses

CONFIG = LoadConfig()
CAMERA = Intrinsics(fx=180.0, fy=180.0, cx=119.5, cy=89.5, width=240, height=180)
VIEW = look_at([0.1, 0.0, 1.2], [0.95, 0.0, 0.1])
TOP_DOWN = so3.from_rpy(np.array([np.pi, 0.0, 0.0]))
few = settings(max_examples=25)
masses = st.floats(0.05, 60.0)


@pytest.fixture(scope="module")
def levers() -> GripLevers:
    robotiq, claw = GripperModel.load("robotiq_3f"), GripperModel.load("camhand")
    claw_shape = next(iter(claw.preshapes))
    return GripLevers.of([(robotiq, "basic", 0.05), (claw, claw_shape, 0.1)], CONFIG)


def seen(kind: str, rng):
    """What the camera sees of one body on the ground, one point for each cell."""
    body = draw_body(kind, rng=rng)
    turn = so3.from_rpy(np.array([0.0, 0.0, rng.uniform(0, 2 * np.pi)]))
    lowest = (body.mesh()[0] @ turn.T)[:, 2].min()
    body = body.at(SE3.from_parts(turn, [0.95, 0.0, -lowest]))
    picture = render(World((body,)), CAMERA, VIEW)
    capture = Capture(
        depth=picture.depth, intrinsics=CAMERA, T_base_camera=VIEW, name=kind
    )
    cloud = capture.cloud()
    own = np.flatnonzero(picture.labels.ravel()[cloud.pixels] == 1)
    own = own[voxel_downsample(cloud.points[own], 0.01)]
    return body, cloud.points[own], cloud.normals[own]


def ball(mass=(2.0, 8.0), com=(0.9, 0.0, 0.2), spread=0.02) -> ObjectMass:
    return ObjectMass(
        build=Build.SOLID,
        mass=mass,
        expected_mass=float(np.sqrt(mass[0] * mass[1])),
        com=np.array(com),
        spread=spread * np.eye(3),
    )


def loads_of(what, T, levers, hand=0):
    Ts = np.atleast_3d(T.matrix).reshape(-1, 4, 4)
    return LoadModel(what, CONFIG)(Ts, np.full(len(Ts), hand), levers)


def test_true_masses_and_centres_lie_within_the_bounds(rng):
    kinds = ["lumber_2x4", "lumber_4x4", "board", "pipe", "bucket", "cinder_block"]
    kinds += ["ladder", "truss_ladder", "crate", "pallet", "brick", "jersey"]
    within, inside, ratio = [], [], []
    for kind in kinds:
        body, points, normals = seen(kind, rng)
        what = ObjectMass.from_surface(points, normals, VIEW.p, CONFIG, spacing=0.01)
        low, high = what.mass
        within.append(low <= body.mass <= high)
        ratio.append(what.expected_mass / body.mass)
        com = body.T_base_body.apply(body.center_of_mass)
        inside.append(np.linalg.norm(np.linalg.solve(what.spread, com - what.com)))
    assert np.mean(within) >= 0.9
    assert np.mean(np.array(inside) <= 1.0) >= 0.85
    assert np.exp(np.abs(np.log(ratio)).mean()) < 3.0


@pytest.mark.parametrize(
    ("kind", "build"),
    [
        ("brick", Build.SOLID),
        ("lumber_4x4", Build.SOLID),
        ("board", Build.SHEET),
        ("ladder", Build.HOLLOW),
        ("truss_triangle", Build.HOLLOW),
    ],
)
def test_how_an_object_is_made_shows_on_its_surface(kind, build, rng):
    _, points, normals = seen(kind, rng)
    what = ObjectMass.from_surface(points, normals, VIEW.p, CONFIG, spacing=0.01)
    assert what.build is build


@given(poses)
@few
def test_moving_object_and_camera_moves_the_estimate_with_them(T):
    rng = np.random.default_rng(5)
    points = rng.uniform(-1, 1, (200, 3)) * [0.3, 0.1, 0.05]
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    eye = np.array([0.2, -0.3, 1.1])
    here = ObjectMass.from_surface(points, normals, eye, CONFIG, spacing=0.01)
    there = ObjectMass.from_surface(
        T.apply(points), T.rotate(normals), T.apply(eye), CONFIG, spacing=0.01
    )
    assert there.build is here.build
    assert there.mass == pytest.approx(here.mass, rel=1e-4)
    assert there.com == pytest.approx(T.apply(here.com), abs=1e-6)
    assert there.com_error == pytest.approx(here.com_error)


def test_a_known_mass_replaces_the_bounds():
    points = np.random.default_rng(0).uniform(-0.1, 0.1, (60, 3))
    what = ObjectMass.from_surface(
        points, np.full((60, 3), np.nan), np.ones(3), CONFIG, spacing=0.01, mass=4.0
    )
    assert what.mass == (4.0, 4.0)
    assert what.expected_mass == pytest.approx(4.0)


def test_the_expected_mass_is_drawn_to_what_most_pieces_weigh(rng):
    for kind in ("crate", "pallet", "brick"):
        _, points, normals = seen(kind, rng)
        expected = []
        for typical in ((0.5, 8.0), (1e-6, 1e6), (7.0, 7.1)):
            config = LoadConfig(typical=typical)
            what = ObjectMass.from_surface(
                points, normals, VIEW.p, config, spacing=0.01
            )
            assert what.mass[0] <= what.expected_mass <= what.mass[1]
            expected.append(what.expected_mass)
        usual, free, sure = np.log(expected)
        middle = np.log(what.mass).mean()
        assert free == pytest.approx(middle, abs=0.2)
        assert abs(usual - np.log(2.0)) <= abs(middle - np.log(2.0)) + 1e-9
        assert sure == pytest.approx(np.log(np.clip(7.05, *what.mass)), abs=0.05)


@pytest.mark.parametrize("n", [1, 2, 3, 40])
def test_degenerate_surfaces_still_have_finite_loads(n, levers):
    line = np.linspace([0.8, 0.0, 0.1], [0.9, 0.0, 0.1], n)
    what = ObjectMass.from_surface(
        line, np.full((n, 3), np.nan), np.zeros(3), CONFIG, spacing=0.01
    )
    assert 0 < what.mass[0] <= what.mass[1] < 50
    found = loads_of(what, SE3.from_parts(TOP_DOWN, [0.9, 0, 0.2]), levers).forecast(0)
    assert np.isfinite([*found.force, *found.torque, *found.grip, found.margin]).all()


def test_a_ball_hung_under_the_palm_weighs_on_the_wrist_without_torque(levers):
    what = ball(mass=(3.0, 3.0), spread=0.0)
    T = SE3.from_parts(TOP_DOWN, [0.9, 0.0, 0.35])
    loads = loads_of(what, T, levers)
    found = loads.forecast(0)
    assert found.force == pytest.approx((3 * 9.81, 3 * 9.81))
    assert found.torque == pytest.approx((0.0, 0.0), abs=1e-9)
    assert found.lever == pytest.approx(0.0, abs=1e-9)
    assert found.tilt == pytest.approx(0.0, abs=1e-9)
    # Friction alone: half the weight on each side, over the middle coefficient.
    middle = np.sqrt(0.4 * 0.8)
    need = 3 * 9.81 / (2 * middle)
    assert (found.limit, found.margin) == ("grip", pytest.approx(60.0 / need))
    weak = loads.limited(loads.weight, 40.0, "wrist force").forecast(0)
    assert (weak.limit, weak.margin) == ("wrist force", pytest.approx(40 / 29.43))


def test_a_lever_of_half_a_metre_adds_the_torque_of_the_weight(levers):
    what = ball(mass=(2.0, 2.0), com=(0.9, 0.5, 0.2), spread=0.0)
    T = SE3.from_parts(TOP_DOWN, [0.9, 0.0, 0.35])
    loads = loads_of(what, T, levers)
    assert loads.torque[0] == pytest.approx(np.full(3, 0.5 * 2 * 9.81))
    torque_hand = loads.wrench[0, 3:]
    assert np.linalg.norm(torque_hand) == pytest.approx(0.5 * 2 * 9.81)
    assert T.rotate(loads.wrench[0, :3]) == pytest.approx([0, 0, -2 * 9.81])


@given(poses, masses, masses, st.sampled_from([0, 1]))
@few
def test_the_margin_falls_with_the_mass(levers, T, one, other, hand):
    light, heavy = sorted((one, other))
    margins = [
        loads_of(ball(mass=(m, m)), T, levers, hand).forecast(0).margin
        for m in (light, heavy)
    ]
    assert margins[0] >= margins[1] * (1 - 1e-12)
    assert np.isfinite(margins).all()


@given(poses, st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.sampled_from([0, 1]))
@few
def test_the_margin_falls_with_the_lever(levers, T, one, other, hand):
    near, far = sorted((one, other))
    grip = T.apply(levers.middle[hand])
    away = np.array([0.6, -0.5, 0.3])
    loads = [
        loads_of(ball(com=grip + share * away), T, levers, hand)
        for share in (near, far)
    ]
    assert (loads[0].demand <= loads[1].demand * (1 + 1e-9) + 1e-12).all()


@given(poses, st.floats(-3.1, 3.1), st.floats(-1, 1), st.floats(-1, 1))
@few
def test_turning_about_the_vertical_and_moving_change_no_load(levers, T, yaw, x, y):
    what = ball()
    move = SE3.from_parts(so3.from_rpy(np.array([0.0, 0.0, yaw])), [x, y, 0.3])
    moved = replace(what, com=move.apply(what.com), spread=move.rotate(what.spread.T).T)
    here, there = (
        loads_of(w, pose, levers) for w, pose in ((what, T), (moved, move @ T))
    )
    for name in ("torque", "grip", "demand", "lever", "tilt", "wrench"):
        assert getattr(there, name) == pytest.approx(getattr(here, name), abs=1e-6)


@given(poses, st.sampled_from([0, 1]))
@few
def test_bounds_are_in_order(levers, T, hand):
    loads = loads_of(ball(), T, levers, hand)
    for name in ("torque", "grip", "demand"):
        assert (np.diff(getattr(loads, name)) >= -1e-9).all()
    found = loads.forecast(0)
    assert found.margins[0] <= found.margin <= found.margins[1]


def test_bad_masses_and_settings_are_refused():
    points = np.zeros((5, 3))
    for mass in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(InputError, match="mass"):
            ObjectMass.from_surface(
                points, points, np.ones(3), CONFIG, spacing=0.01, mass=mass
            )
    with pytest.raises(InputError, match="points"):
        ObjectMass.from_surface(
            points[:0], points[:0], np.ones(3), CONFIG, spacing=0.01
        )
    with pytest.raises(ConfigError, match="friction"):
        LoadConfig(friction=(0.8, 0.4))
    with pytest.raises(ConfigError, match="density"):
        LoadConfig(density=(0.0, 100.0))
