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
from debrisgrasp.planning.levers import GripLevers
from debrisgrasp.planning.load import LoadModel
from debrisgrasp.planning.mass import (
    Build,
    LoadConfig,
    ObjectMass,
    SeenSurface,
    likely_objects,
)
from debrisgrasp.prototypes import GripperModel, PrototypeLibrary
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
    objects = what if isinstance(what, tuple) else (what,)
    return LoadModel(objects, CONFIG)(Ts, np.full(len(Ts), hand), levers)


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
        expected, bounds = [], []
        for typical in ((0.5, 8.0), (1e-6, 1e6), (7.0, 7.1)):
            config = LoadConfig(typical=typical)
            what = ObjectMass.from_surface(
                points, normals, VIEW.p, config, spacing=0.01
            )
            assert what.mass[0] <= what.expected_mass <= what.mass[1]
            expected.append(what.expected_mass)
            bounds.append(what.mass)
        usual, free, sure = np.log(expected)
        middle = np.log(bounds[1]).mean()
        assert free == pytest.approx(middle, abs=0.2)
        assert abs(usual - np.log(2.0)) <= abs(middle - np.log(2.0)) + 1e-9
        assert sure == pytest.approx(np.log(np.clip(7.05, *what.mass)), abs=0.05)


@pytest.mark.parametrize(
    ("kind", "is_walled"), [("cinder_block", True), ("ladder", True), ("brick", False)]
)
def test_who_grips_a_thick_wall_expects_a_heavy_object(kind, is_walled, rng):
    robotiq = GripperModel.load("robotiq_3f")
    widths = (0.012, 0.035, 0.06, 0.12)  # the last is around the whole object
    levers = GripLevers.of([(robotiq, "basic", width) for width in widths], CONFIG)
    levers = replace(levers, lever=levers.lever[[0]].repeat(4, axis=0))
    _, points, normals = seen(kind, rng)
    T = SE3.from_parts(TOP_DOWN, [0.95, 0.0, 0.4]).matrix
    Ts, which = np.tile(T, (4, 1, 1)), np.arange(4)
    weights = []
    for mass in (None, 3.0):
        what = ObjectMass.from_surface(
            points, normals, VIEW.p, CONFIG, spacing=0.01, mass=mass
        )
        weights.append(LoadModel((what,), CONFIG)(Ts, which, levers).weight)
    unknown, known = weights
    assert (np.ptp(known, axis=0) == 0).all()
    assert (np.ptp(unknown[:, [0, 2]], axis=0) == 0).all()
    thin, thick, thickest, whole = unknown[:, 1]
    assert whole <= thin <= thick <= thickest
    assert (thickest > 1.5 * whole) == is_walled


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


def test_what_is_round_rolls_between_pads_unless_friction_holds_it():
    library = PrototypeLibrary.load()
    round_, flat = library["cylinder_020_tip"], library["bar_1x4_flat_tip"]
    on, hands = GripLevers.on(library, CONFIG), [p.name for p in library]
    of = GripLevers.of(
        [(library.grippers[p.gripper], p.preshape, p.width) for p in library], CONFIG
    )
    k, flat_k = hands.index(round_.name), hands.index(flat.name)
    # Two pads rub at the radius, each with the squeeze times the friction.
    rub = 2 * np.sqrt(0.4 * 0.8) * round_.width / 2
    assert on.lever[k] == pytest.approx([of.lever[k, 0], rub, of.lever[k, 2]])
    assert on.lever[flat_k] == pytest.approx(of.lever[flat_k])
    # So a rod beside the middle of mass loads more than it did, along it no more.
    across, along = (
        LoadModel((ball(com=com),), CONFIG) for com in ((0.1, 0, 0), (0, 0.1, 0))
    )
    T = SE3.from_parts(TOP_DOWN, [0.0, 0.0, 0.2]).matrix[None]
    which, hand = np.array([k]), SE3.from_matrix(T[0])
    assert abs(hand.R[1, 1]) == pytest.approx(1.0)
    demand = [
        [model(T, which, levers).demand[0, 1] for model in (across, along)]
        for levers in (of, on)
    ]
    assert demand[1][0] > 2 * demand[0][0]
    assert demand[1][1] < 1.3 * demand[0][1]


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


@given(poses, st.sampled_from([0, 1]), st.floats(0.0, 500.0))
@few
def test_bounds_are_in_order(levers, T, hand, walls):
    loads = loads_of(replace(ball(), walls=walls), T, levers, hand)
    for name in ("torque", "grip", "demand"):
        assert (np.diff(getattr(loads, name)) >= -1e-9).all()
    found = loads.forecast(0)
    assert found.margins[0] <= found.margin <= found.margins[1]


def plank(low: float, high: float) -> np.ndarray:
    """Points of a board along x, 1 cm apart [m]."""
    x, y = np.meshgrid(np.arange(low, high, 0.01), np.arange(0.0, 0.1, 0.01))
    return np.stack([x.ravel(), y.ravel(), np.full(x.size, 0.1)], axis=1)


def surface_of(*parts: tuple[np.ndarray, float]) -> SeenSurface:
    points = np.concatenate([own for own, _ in parts])
    belongs = np.concatenate([np.full(len(own), share) for own, share in parts])
    up = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    return SeenSurface(points, up, belongs, np.zeros(len(points), dtype=bool))


def likely(*parts: tuple[np.ndarray, float], mass: float | None = None):
    return likely_objects(
        surface_of(*parts), np.array([0.0, 0.0, 1.0]), CONFIG, spacing=0.01, mass=mass
    )


def test_an_object_may_be_more_than_its_segment():
    """Likelier parts join first, and what hardly belongs to it is left out."""
    own, near, far, strange = (plank(a, a + 0.2) for a in (0.0, 0.2, 0.4, 0.6))
    objects = likely((own, 1.0), (far, 0.25), (near, 0.75), (strange, 0.05))
    assert [each.probability for each in objects] == pytest.approx([0.25, 0.5, 0.25])
    assert [each.com[0] for each in objects] == pytest.approx([0.1, 0.2, 0.3], abs=0.01)
    masses = np.array([each.mass for each in objects])
    assert (np.diff(masses, axis=0) > 0).all()


def test_what_is_certain_is_one_object():
    (alone,) = likely((plank(0.0, 0.3), 1.0))
    whole = likely((plank(0.0, 0.2), 1.0), (plank(0.2, 0.3), 1.0))
    assert len(whole) == 1
    assert whole[0].probability == 1.0
    assert whole[0].mass == pytest.approx(alone.mass)
    with pytest.raises(InputError, match="certain"):
        likely((plank(0.0, 0.3), 0.9))


def test_an_end_that_is_hidden_draws_the_middle_of_mass_to_it():
    points = plank(0.0, 0.4)
    up, eye = np.tile([0.0, 0.0, 1.0], (len(points), 1)), np.array([0.2, 0.05, 1.0])
    is_right, is_left = points[:, 0] > 0.34, points[:, 0] < 0.05
    none, right, both = (
        ObjectMass.from_surface(points, up, eye, CONFIG, spacing=0.01, goes_on=goes_on)
        for goes_on in (None, is_right, is_right | is_left)
    )
    assert 0.02 < right.com[0] - none.com[0] < 0.08
    assert right.com[1:] == pytest.approx(none.com[1:], abs=1e-3)
    assert both.com == pytest.approx(none.com, abs=5e-3)
    assert none.com_error < right.com_error < both.com_error
    assert right.mass == none.mass


def test_a_known_mass_is_that_of_the_whole_object_whatever_it_is():
    objects = likely((plank(0.0, 0.2), 1.0), (plank(0.2, 0.4), 0.5), mass=3.0)
    assert [each.mass for each in objects] == [(3.0, 3.0)] * 2


def test_loads_are_the_mean_over_what_the_object_may_be(levers):
    here, there = ball((2.0, 2.0), spread=0.0), ball((6.0, 6.0), (0.9, 0.4, 0.2), 0.0)
    both = (replace(here, probability=0.75), replace(there, probability=0.25))
    T = SE3.from_parts(TOP_DOWN, [0.9, 0.0, 0.35])
    near, far, mean = (loads_of(what, T, levers) for what in ((here,), (there,), both))
    for name in ("torque", "grip", "weight", "mass"):
        alone, other, found = (
            np.atleast_2d(getattr(loads, name))[0] for loads in (near, far, mean)
        )
        assert found[0] == pytest.approx(min(alone[0], other[0]))
        assert found[1] == pytest.approx(0.75 * alone[1] + 0.25 * other[1])
        assert found[2] == pytest.approx(max(alone[2], other[2]))
    assert mean.lever[0] == pytest.approx(0.25 * 0.4)
    assert mean.lever_error == pytest.approx(0.4 * np.sqrt(0.75 * 0.25))
    assert mean.wrench == pytest.approx(0.75 * near.wrench + 0.25 * far.wrench)


@given(poses, st.sampled_from([0, 1]))
@few
def test_a_search_expects_the_same_loads_as_the_forecast(levers, T, hand):
    objects = (
        replace(ball(spread=0.05), probability=0.4, walls=150.0),
        replace(ball((3.0, 9.0), (0.6, 0.4, 0.1), 0.1), probability=0.6),
    )
    Ts, which = T.matrix[None], np.array([hand])
    model = LoadModel(objects, CONFIG)
    wrists = np.array([[150.0, 40.0], [100.0, 20.0]])
    loads = model(Ts, which, levers)
    limited = loads.limited(loads.weight, wrists[hand, 0], "wrist force")
    limited = limited.limited(loads.torque, wrists[hand, 1], "wrist torque")
    quick = model.expected_demand(Ts, which, levers, wrists)
    assert quick == pytest.approx(limited.demand[:, 1])
    assert model.distance(Ts, which, levers) == pytest.approx(loads.lever)


def test_an_uncertain_middle_of_mass_loads_like_its_standard_deviation(levers):
    T = SE3.from_parts(TOP_DOWN, [0.9, 0.0, 0.35])
    sure = ball(com=(0.9, 0.0, 0.2), spread=0.0)
    for axis in (0, 1):
        spread = np.zeros((3, 3))
        spread[axis, 0] = 0.2
        unsure = replace(sure, spread=spread)
        off = np.zeros(3)
        off[axis] = 0.1
        moved = replace(sure, com=sure.com + off)
        found, same = (loads_of(what, T, levers) for what in (unsure, moved))
        assert found.grip[0, 1] == pytest.approx(same.grip[0, 1])
        assert found.lever == pytest.approx(same.lever)


def test_what_leaves_no_body_between_outliers_still_has_a_mass():
    points = np.concatenate([np.diag([0.3, 0.2, 0.1]), -np.diag([0.3, 0.2, 0.1])])
    what = ObjectMass.from_surface(
        points, points, np.array([0.0, 0.0, 2.0]), CONFIG, spacing=0.01
    )
    assert 0.0 < what.mass[0] <= what.expected_mass <= what.mass[1]


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
