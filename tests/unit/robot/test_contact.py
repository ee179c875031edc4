"""Springs against statics worked out by hand: signs, frames, magnitudes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from debrisgrasp.control import GripCommand
from debrisgrasp.geometry import SE3, Box, Capsule, Cylinder, so3
from debrisgrasp.robot import FakeConfig
from debrisgrasp.robot.drives import Timeline
from debrisgrasp.robot.fake_hand import FakeGripper
from debrisgrasp.robot.places import Places, Sides
from debrisgrasp.robot.shapes import BodyShape, HandShape, planes_of, ways_out
from debrisgrasp.robot.springs import GROUND, HELD, PALM, Near, yielded
from debrisgrasp.robot.touch import Touch
from debrisgrasp.worlds import Body, Ground, make_body
from tests.unit.robot.rigs import FAR, GRIPPERS, Rig, beam, downwards, turned

K = FakeConfig().stiffness
SURFACES, ARM = FakeConfig().contact_stiffness, FakeConfig().arm_stiffness
TURN, HERE = FakeConfig().turn_stiffness, np.zeros(3)


@pytest.mark.parametrize(
    "solid",
    [
        Box(np.array([0.1, 0.2, 0.05]), downwards(0.1, 0.2, 0.3, 0.4)),
        Cylinder(0.05, 0.3, downwards(0.0, -0.2, 0.1, 1.0)),
        Capsule(0.02, 0.3, downwards(0.0, -0.2, 0.1, 1.0)),
    ],
    ids=["box", "cylinder", "capsule"],
)
def test_planes_bound_the_solid(solid, rng):
    normals, offsets = planes_of(solid)
    points = rng.uniform(solid.bounds.lower, solid.bounds.upper, (2000, 3))
    by_planes = (points @ normals.T - offsets).max(axis=1)
    exact = solid.signed_distance(points)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0)
    # Flat sides touch or cut a round solid by less than 1 % of its radius.
    inside = exact < 0.0
    assert np.allclose(by_planes[inside], exact[inside], atol=6e-4)


@pytest.mark.parametrize("name", sorted(GRIPPERS))
@pytest.mark.parametrize("opening", [0.0603, 0.1, 0.1497])
def test_points_lie_on_the_solids_of_the_hand(name, opening):
    hand = GRIPPERS[name]
    for preshape in hand.preshapes:
        shape = HandShape(hand)
        points = shape.points(preshape, [opening] * len(hand.fingers))
        solids = hand.solids(preshape, opening)
        nearest = np.min([np.abs(s.signed_distance(points)) for s in solids], axis=0)
        assert nearest.max() < 5e-4
        for k, finger in enumerate(hand.fingers, start=1):
            rows = points[shape.owned[k]]
            values = hand.preshape(preshape).values(
                hand.opening_to_command(preshape, opening)
            )
            own = np.concatenate([s.mesh()[0] for s in finger.solids(values)])
            assert np.allclose(rows.min(axis=0), own.min(axis=0), atol=2e-3)
            assert np.allclose(rows.max(axis=0), own.max(axis=0), atol=2e-3)


def fingertips(rig: Rig) -> list[float]:
    """Lowest point of each finger [m], from the model's own solids."""
    hand, T = rig.hand.model, rig.chain.fk(rig.arm.read().q)
    values = hand.preshape(rig.hand.shape).values(
        hand.opening_to_command(rig.hand.shape, rig.hand.read().openings[0])
    )
    return [
        min(s.moved(T).bounds.lower[2] for s in finger.solids(values))
        for finger in hand.fingers
    ]


def test_fingers_that_press_on_the_ground_are_pushed_up():
    rig = Rig([FAR], turn_stiffness=1e9)
    rig.move(0.0, 0.0, -0.1, speed=0.02, until=lambda: min(fingertips(rig)) < -4e-4)
    rig.wait(0.1)
    tips = np.array(fingertips(rig))
    # Three contacts side by side, and the arm that bends behind all of them.
    config = FakeConfig()
    bend = brentq(
        lambda u: (
            config.contact_stiffness * np.maximum(-tips - u, 0.0).sum()
            - config.arm_stiffness * u
        ),
        0.0,
        -tips.min(),
    )
    force = config.arm_stiffness * bend
    assert force > 10.0
    # The palm looks down: up is -z of the hand.
    true = rig.fake.sensors["right"].load_ee
    assert true[2] == pytest.approx(-force, rel=1e-3)
    assert np.abs(true[:2]).max() < 0.02 * force
    assert rig.load[2] == pytest.approx(-force, abs=1.5)
    assert rig.fake.truth().peak_force["right"] >= force * 0.999


@given(
    st.floats(-0.01, 0.01), st.floats(-0.01, 0.01), st.floats(1e-4, 3e-3),
    st.floats(-3.1, 3.1),
)  # fmt: skip
@settings(max_examples=15)
def test_a_post_under_the_palm_pushes_and_turns_it(x, y, depth, yaw):
    top = 0.3
    post = Body(
        "post", "post", (Box(np.array([0.01, 0.01, top / 2])),), 50.0,
        SE3.from_parts(p=[0.8 + x, 0.1 + y, top / 2]),
    )  # fmt: skip
    touch = _touch(FakeConfig(turn_stiffness=1e9))
    T = downwards(0.8, 0.1, top - depth, yaw)
    springs = touch.springs(T.R, T.p, _shapes(post), ())
    assert {spring.body for spring in springs} == {0}
    force = np.sum([spring.force for spring in springs], axis=0)
    moment = np.sum([np.cross(s.point - T.p, s.force) for s in springs], axis=0)
    assert np.allclose(force, [0.0, 0.0, K * depth], atol=1e-6)
    lever = np.array([x, y, 0.0])
    # The pressed area is that of the post: its centre is met to some millimetres.
    assert np.allclose(moment, np.cross(lever, force), atol=0.008 * K * depth)


def test_a_hand_pressed_into_a_thin_wall_does_not_come_out_at_its_back():
    half, top = 0.005, 0.3
    wall = Body(
        "wall", "wall", (Box(np.array([0.3, 0.3, half])),), 50.0,
        SE3.from_parts(p=[0.8, 0.1, top - half]),
    )  # fmt: skip
    # An arm that hardly bends, or fingers in the wall would keep the palm off.
    config = FakeConfig(stiffness=K, contact_stiffness=1.002 * K)
    touch, shapes = _touch(config), _shapes(wall)
    for depth in np.linspace(1e-3, 1.8 * half, 40):
        T = downwards(0.8, 0.1, top - depth, 0.0)
        palm = [s for s in touch.springs(T.R, T.p, shapes, ()) if s.owner == PALM]
        assert palm[0].force[2] == pytest.approx(K * depth, rel=0.04)


@pytest.mark.parametrize("seed", [4, 5])
def test_the_load_goes_over_from_one_part_of_a_body_to_another_bit_by_bit(seed):
    rng = np.random.default_rng(seed)
    sizes = {"length": 0.9, "depth": 0.2, "radius": 0.014, "bays": 4}
    lies = make_body("truss_ladder", sizes, 3.0, name="lies")
    held = make_body("truss_ladder", sizes, 3.0, name="held")
    touch = _touch(FakeConfig(), Ground(np.full((2, 2), -5.0)))
    shapes = _shapes(held, lies.at(SE3.from_parts(p=[0.8, 0.1, 0.05])))
    turn = so3.from_rpy(np.array([0.0, 0.0, rng.uniform(-3.0, 3.0)]))
    touch.hold(0, shapes[0], turn, np.array([0.0, 0.0, 0.1]))
    T, loads, places, most = downwards(0.85, 0.1, 0.18, 0.0), [], {}, 0.0
    for k in range(100):
        p = T.p - [0.0, 0.0, 1.2e-4 * k]
        springs = touch.springs(T.R, p, shapes, ())
        # Deeper than this no hand gets that is stopped at its limit.
        if max((spring.depth for spring in springs), default=0.0) > 4e-3:
            break
        pushes = [[*s.force, *np.cross(s.point - p, s.force)] for s in springs]
        loads.append(np.sum([np.zeros(6), *pushes], axis=0))
        now = {key: point for key, (_, _, point) in touch._pushed.items()}
        for key, point in now.items():
            gone = float(np.linalg.norm(point - places.get(key, point)))
            most = max(most, gone)
        places = now
    assert places
    assert most < 0.004 + 1e-6
    steps = np.abs(np.diff(loads, axis=0)).max(axis=0)
    assert loads[-1][2] > 60.0
    assert steps[:3].max() < 6.0
    assert steps[3:].max() < 3.0


def test_moving_everything_together_changes_nothing(rng):
    config, bar = FakeConfig(), beam("bar", 3.0, (0.8, 0.1, 0.0445), yaw=0.3)
    T = downwards(0.81, 0.12, 0.05, 1.0)
    touch = _touch(config, Ground(np.full((2, 2), -5.0)))
    springs = touch.springs(T.R, T.p, _shapes(bar), ())
    assert springs
    move = SE3.from_parts(turned(0.7), rng.uniform(-1, 1, 3) * [1, 1, 0.1])
    again = _touch(config, Ground(np.full((2, 2), -5.0)))
    moved = move @ T
    shapes = _shapes(bar.at(move @ bar.T_base_body))
    others = again.springs(moved.R, moved.p, shapes, ())
    assert {(s.owner, s.body) for s in springs} == {(s.owner, s.body) for s in others}
    for a, b in zip(
        sorted(springs, key=lambda s: s.owner),
        sorted(others, key=lambda s: s.owner),
        strict=True,
    ):
        assert np.allclose(move.rotate(a.force), b.force, atol=1e-6)
        assert np.allclose(move.apply(a.point), b.point, atol=1e-9)


def test_a_watch_never_overlooks_a_contact(rng):
    bar = beam("bar", 3.0, (0.8, 0.1, 0.0445), yaw=0.3)
    config = FakeConfig(turn_stiffness=1e9)  # levers of contacts lag a little
    shapes, touch = _shapes(bar), _touch(config)
    T = downwards(0.8, 0.1, 0.35, 1.0)
    n_touching = 0
    for _ in range(80):
        twist = rng.normal(0, 1, 6) * [0.006, 0.006, 0.006, 0.02, 0.02, 0.02]
        T = T @ SE3.exp(twist)
        pull = 0.03 * (np.array([0.8, 0.1, 0.16]) - T.p)
        T = SE3.from_parts(T.R, T.p + pull)
        watched = touch.springs(T.R, T.p, shapes, ())
        anew = _touch(config).springs(T.R, T.p, shapes, ())
        assert [s[:2] for s in watched] == [s[:2] for s in anew]
        assert np.allclose(
            [s.force for s in watched], [s.force for s in anew], atol=1e-6
        )
        for a, b in zip(watched, anew, strict=True):
            assert a.depth == pytest.approx(b.depth, abs=1e-9)
            ways = (s.force / np.linalg.norm(s.force) for s in (a, b))
            assert np.allclose(*ways, atol=1e-6)
        n_touching += bool(anew)
        flat = tuple(T.R.ravel()), tuple(T.p)
        assert not (touch.is_clear(*flat) and anew)
    assert n_touching > 10


def test_uneven_ground_is_met_where_it_is(rng):
    ground = Ground.uneven(rng, peak_to_peak=0.05, center=(0.8, 0.1))
    touch = _touch(FakeConfig(), ground)
    points = touch.shape.points("basic", [0.155] * 3)
    T = downwards(0.8, 0.1, 0.12, 0.4)
    where = T.apply(points)
    deepest = (ground.height(where[:, :2]) - where[:, 2]).max()
    T = SE3.from_parts(T.R, T.p - [0.0, 0.0, 1e-3 - deepest])
    springs = touch.springs(T.R, T.p, [], ())
    depth = max(spring.depth for spring in springs)
    assert all(spring.body == GROUND for spring in springs)
    assert 0.0 < depth < 3e-3


def test_a_finger_stops_at_a_surface_while_the_others_close():
    stump = Body(
        "stump", "stump", (Box(np.array([0.03, 0.01, 0.06])),), 200.0,
        SE3.from_parts(p=[0.8, -0.33, 0.06]),
    )  # fmt: skip
    rig = Rig([stump], place=(0.8, -0.3, 0.16))
    rig.hand.command(GripCommand((0.05,) * 3, 30.0))
    rig.wait(2.5)
    thumb, *pair = rig.hand.read().openings
    assert thumb > 0.07
    assert max(pair) == pytest.approx(0.05, abs=1e-6)
    assert rig.hand.read().forces[0] == pytest.approx(30.0, abs=0.5)
    assert rig.hand.read().forces[1:] == (0.0, 0.0)


def test_the_fingers_of_a_side_share_a_commanded_force():
    rig = Rig([beam("bar", 200.0, (0.8, -0.3, 0.0445))])
    for force in (10.0, 25.0, 50.0):
        rig.hand.command(GripCommand((0.0,) * 3, force))
        rig.wait(1.5)
        thumb, *pair = rig.hand.read().forces
        assert thumb == pytest.approx(force, abs=0.5)
        assert pair == pytest.approx([0.5 * force] * 2, abs=1.0)


@pytest.mark.parametrize("is_closing", [True, False])
def test_a_finger_presses_with_its_share_and_stands_what_a_side_exerts(is_closing):
    sign = 1.0 if is_closing else -1.0
    for pressed, way in ((10.0, -1.0), (20.0, 0.0), (40.0, 1.0)):
        hand = FakeGripper(
            GRIPPERS["robotiq_3f"], Timeline(0.004), FakeConfig(is_initialised=True), []
        )
        hand.openings = [0.1] * 3
        hand.command(GripCommand((0.05 if is_closing else 0.15,) * 3, 30.0))
        hand.forces = [0.0, sign * pressed, 0.0]  # one of the pair meets something
        hand.advance()
        assert np.sign(np.round(hand.openings[1] - 0.1, 9)) == sign * way


def _touch(config: FakeConfig, ground: Ground | None = None) -> Touch:
    hand = FakeGripper(GRIPPERS["robotiq_3f"], Timeline(0.004), config, [])
    return Touch(hand, ground or Ground.level(), config)


def _shapes(*bodies: Body):
    return [BodyShape(body) for body in bodies]


def _near(*pushes: tuple[float, float, float]) -> list[Near]:
    """Places that would push with these forces [N] if the arm did not bend."""
    sizes = np.linalg.norm(pushes, axis=1)
    return [
        Near(PALM, i, np.zeros(3), np.array(push) / size, size / SURFACES)
        for i, (push, size) in enumerate(zip(pushes, sizes, strict=True))
    ]


def test_one_contact_is_felt_through_the_arm():
    (spring,) = yielded(_near((0.0, 0.0, 100.0)), HERE, FakeConfig())
    assert np.allclose(spring.force, [0.0, 0.0, K * spring.depth])


@given(
    st.lists(st.tuples(*[st.floats(-200.0, 200.0)] * 3), min_size=1, max_size=5).filter(
        lambda rows: min(np.linalg.norm(rows, axis=1)) > 1.0
    ),
    st.lists(st.tuples(*[st.floats(-1.0, 1.0)] * 3), min_size=5, max_size=5),
    st.floats(0.0, 0.003),
)
def test_an_arm_bends_until_it_and_all_that_is_touched_are_in_balance(
    pushes, points, gap
):
    near = [
        place._replace(point=np.array(point))
        for place, point in zip(_near(*pushes), points, strict=False)
    ]
    near[-1] = near[-1]._replace(depth=near[-1].depth - gap)
    felt = {spring.body: spring for spring in yielded(near, HERE, FakeConfig())}
    bend = sum((s.force for s in felt.values()), np.zeros(3)) / ARM
    moments = (np.cross(s.point, s.force) for s in felt.values())
    turn = sum(moments, np.zeros(3)) / TURN
    for place in near:
        gone = bend + np.cross(turn, place.point)
        left = SURFACES * (place.depth - place.normal @ gone)
        if place.body in felt:
            assert np.allclose(felt[place.body].force, left * place.normal, atol=1e-6)
        else:
            assert left < 1e-6


def test_far_beside_the_hand_a_contact_is_felt_softer():
    """By that much the far end of a beam goes back as the hand turns."""
    far, force = 1.0, []
    for place in (np.zeros(3), np.array([far, 0.0, 0.0])):
        near = [Near(HELD, 0, place, np.array([0.0, 0.0, 1.0]), 1e-3)]
        (spring,) = yielded(near, HERE, FakeConfig())
        force.append(spring.force[2])
    assert force[0] == pytest.approx(K * 1e-3)
    assert 1e-3 / force[1] == pytest.approx(1.0 / K + far**2 / TURN)


def test_what_squeezes_the_hand_from_both_sides_does_not_bend_the_arm():
    felt = yielded(_near((50.0, 0.0, 0.0), (-50.0, 0.0, 0.0)), HERE, FakeConfig())
    assert np.allclose([s.force for s in felt], [[50.0, 0, 0], [-50.0, 0, 0]])


def test_what_a_hand_is_bent_against_goes_on_pushing_where_it_would_just_not_touch():
    """Between two walls, past the middle, nothing jumps as the far one is left."""
    last = None
    for off in np.linspace(-0.002, 0.002, 81):
        near = _near((100.0, 0.0, 0.0), (-100.0, 0.0, 0.0))
        near = [
            place._replace(depth=place.depth + sign * off)
            for place, sign in zip(near, (1.0, -1.0), strict=True)
        ]
        force = sum((s.force[0] for s in yielded(near, HERE, FakeConfig())), 0.0)
        assert last is None or abs(force - last) < 1.01 * 5e-5 * ARM
        last = force


def test_what_pushes_from_behind_all_at_once_was_there_before():
    """A beam jammed between the slats of a pallet: its upper side, then its lower."""
    touch, up = _touch(FakeConfig()), np.array([0.0, 0.0, 1.0])
    key, place = (HELD, 3), np.array([0.4, 0.1, 0.2])
    touch._pushed, touch._net = {key: (up, 3.3e-3, place)}, {key: 8e-4}
    touch._at_rest = {key: 2.5e-3}
    (kept,) = touch._eased({key: Near(*key, place, up, 3.3e-3)})
    assert kept.depth == pytest.approx(8e-4)
    (turned,) = touch._eased({key: Near(*key, place, -up, 3.2e-3)})
    assert turned.depth == pytest.approx(0.0)
    touch._pushed = {key: (-up, 3.2e-3, place)}
    (deeper,) = touch._eased({key: Near(*key, place, -up, 3.4e-3)})
    assert deeper.depth == pytest.approx(2e-4)


def test_each_part_of_what_is_held_touches_by_itself():
    """Of a ladder set down on a beam every rung is borne, and no load jumps over."""
    rungs = tuple(
        Box(np.array([0.03, 0.3, 0.03]), SE3.from_parts(p=[x, 0.0, 0.0]))
        for x in (-0.4, 0.0, 0.4)
    )
    ladder = BodyShape(Body("ladder", "ladder", rungs, 3.0))
    assert set(ladder.part_of_points.tolist()) == {0, 1, 2}
    touch = _touch(FakeConfig(), Ground(np.full((2, 2), -5.0)))
    shapes = _shapes(beam("bar", 60.0, (0.8, 0.1, 0.0445), length=1.2))
    touch.hold(1, ladder, np.eye(3), np.array([0.0, 0.0, 0.3]))
    T, place = downwards(0.8, 0.1, 0.0, 0.0), np.array([0.8, 0.1, 0.089 + 0.33])
    for up in np.arange(2e-3, -1e-3, -5e-5):
        springs = touch.springs(T.R, np.add(place, [0.0, 0.0, up]), shapes, ())
    assert sorted(s.point[0] for s in springs) == pytest.approx(
        [0.4, 0.8, 1.2], abs=0.02
    )
    assert {spring.owner for spring in springs} == {HELD}
    force = np.sum([spring.force for spring in springs], axis=0)
    assert force[2] == pytest.approx(ARM * 9.5e-4, rel=0.2)
    p, last = place - [0.0, 0.0, 9.5e-4], np.zeros(3)
    for tilt in np.arange(0.0, 2e-3, 5e-5):
        R = T.R @ so3.exp(np.array([0.0, tilt, 0.0]))
        springs = touch.springs(R, p, shapes, ())
        torque = np.sum([np.cross(s.point - p, s.force) for s in springs], axis=0)
        assert np.linalg.norm(torque - last) < 2.0
        last = torque
    assert np.linalg.norm(last) > 10.0


def test_only_what_lies_straight_ahead_of_a_side_is_bent_against():
    places = Places({})
    (shape,) = _shapes(beam("bar", 60.0, (0.8, 0.1, 0.0445), length=0.2))
    (part,) = shape.parts
    sides = Sides(shape.normals[part], shape.is_covered[part])
    for point, is_near in (
        ((0.8, 0.1, 0.0915), True),
        ((0.8, 0.1, 0.0935), False),
        ((0.8, 0.1455, 0.0915), False),
    ):
        where = np.array([point])
        beyond = where @ sides.normals.T - shape.offsets[part]
        places.found.clear()
        places.add((PALM, 0), where, beyond, sides, 1.0)
        assert bool(places.found) == is_near


@pytest.mark.parametrize(("deeper", "is_other"), [(4e-4, False), (6e-4, True)])
def test_a_place_pushes_on_until_another_is_clearly_deeper(deeper, is_other):
    """Two that take turns would shake what leans on them."""
    up, aside = np.array([[0.0, 0.0, 1.0]]), np.array([[1.0, 0.0, 0.0]])
    for first, second in ((up, aside), (aside, up)):
        places = Places({(1, 0): (up[0], 1e-3, HERE)})
        for way in (first, second):
            depth = 1e-3 + deeper * (way is aside)
            sides = Sides(way, np.array([False]))
            places.add((1, 0), HERE[None], np.array([[-depth]]), sides, 1.0)
        found = places.found[1, 0]
        assert np.allclose(found.normal, aside[0] if is_other else up[0])
        assert found.depth == pytest.approx(1e-3 + deeper * is_other)


def test_a_hand_is_pushed_out_at_the_same_side_as_it_lets_go():
    """Deep in a thin wall, it does not come out at the back as it opens."""
    board = beam("board", 60.0, (0.8, 0.1, 0.0445), length=0.2)
    wall = Body("wall", "wall", (Box(np.array([0.2, 0.2, 0.012])),), 5.0)
    touch = _touch(FakeConfig(), Ground(np.full((2, 2), -5.0)))
    shapes = _shapes(wall, board)
    lowest = float(
        touch.shape.points(touch.gripper.shape, touch.gripper.openings)[:, 2].max()
    )
    R = downwards(0.0, 0.0, 0.0).R

    def push(depth: float) -> float:
        p = np.array([0.0, 0.0, 0.006 - depth + lowest])
        springs = touch.springs(R, p, shapes, ())
        return float(np.sum([spring.force for spring in springs], axis=0)[2])

    touch.hold(1, shapes[1], np.eye(3), np.array([0.0, 0.0, 5.0]))
    pushes = [push(depth) for depth in np.arange(2e-4, 6.6e-3, 2e-4)]
    touch.hold(None, None, np.eye(3), np.zeros(3))
    assert min(pushes) > 0.0
    assert push(6.6e-3) > pushes[-1]


@pytest.mark.parametrize("gap", [-5e-4, 0.0, 1e-3, 3e-3])
def test_a_hand_that_is_bent_against_a_pipe_feels_no_facets(gap):
    normals, offsets = planes_of(Cylinder(0.05, 0.5))
    sides = Sides(normals, np.zeros(len(offsets), dtype=bool))
    last = None
    for turn in np.arange(-0.4, 0.4, 1e-3):
        point = (0.05 + gap) * np.array([[np.cos(turn), np.sin(turn), 0.0]])
        places = Places({})
        places.add((1, 0), point, point @ normals.T - offsets, sides, 1.0)
        pushed = Near(0, 1, np.zeros(3), np.array([-1.0, 0.0, 0.0]), 0.006)
        springs = yielded([*places.found.values(), pushed], HERE, FakeConfig())
        force = np.sum([spring.force for spring in springs], axis=0)
        assert len(springs) == 2
        assert last is None or np.linalg.norm(force - last) < 2.0
        last = force


@given(st.integers(0, 10_000))
@settings(max_examples=15)
def test_no_push_turns_or_grows_at_once_as_a_hand_slides_over_a_body(seed):
    rng = np.random.default_rng(seed)
    bar = beam("bar", 60.0, (0.8, 0.1, 0.0445), length=0.2, yaw=0.3)
    touch, shapes = _touch(FakeConfig(), Ground(np.full((2, 2), -5.0))), _shapes(bar)
    way = rng.normal(size=3)
    way *= 5e-5 / np.linalg.norm(way)
    T, last = (
        downwards(0.8, 0.1, 0.09 + rng.uniform(0.0, 0.1), rng.uniform(-3, 3)),
        None,
    )
    p = T.p + np.append(rng.uniform(-0.08, 0.08, 2), 0.0)
    for _ in range(200):
        p = p + way
        springs = touch.springs(T.R, p, shapes, ())
        # Deeper than this no hand gets that is stopped at its limit.
        if not springs or max(spring.depth for spring in springs) > 4e-3:
            last = None
            continue
        force = np.sum([spring.force for spring in springs], axis=0)
        if last is not None:
            assert np.linalg.norm(force - last) < 30.0
        last = force


@pytest.mark.parametrize("off_seam", [5e-4, 0.05, 0.1])
def test_a_wall_of_several_parts_pushes_out_at_its_seams_as_elsewhere(off_seam):
    sizes = {"length": 0.4, "radius": 0.1, "wall": 0.012}
    shape = BodyShape(make_body("pipe_wide", sizes, 2.0))
    is_outer = (shape.offsets > 0.09) & (np.abs(shape.normals[:, 0]) < 0.1)
    normals, offsets = shape.normals[is_outer], shape.offsets[is_outer]
    seams = shape.normals[shape.is_covered]
    assert len(seams) == 2 * len(shape.parts)
    for turn in np.arctan2(seams[:, 2], seams[:, 1]) + np.pi / 2.0 + off_seam:
        point = 0.096 * np.array([0.0, np.cos(turn), np.sin(turn)])
        depths = []
        for part in shape.parts:
            beyond = (shape.normals[part] @ point - shape.offsets[part])[None]
            if beyond.max() < 0.0:
                depths.append(-ways_out(beyond, shape.is_covered[part]).max())
        assert max(depths) == pytest.approx((offsets - normals @ point).min())


def test_where_a_part_lies_against_a_larger_one_no_push_jumps_from_one_to_the_other():
    post = Box(np.array([0.02, 0.02, 0.1]), SE3.from_parts(p=[0.0, 0.0, -0.1]))
    slat = Box(np.array([0.2, 0.05, 0.01]), SE3.from_parts(p=[0.0, 0.0, 0.01]))
    assert not BodyShape(Body("rack", "rack", (post, slat), 1.0)).is_covered.any()
    half = Box(np.array([0.02, 0.02, 0.1]), SE3.from_parts(p=[0.0, 0.0, 0.1]))
    both = BodyShape(Body("post", "post", (post, half), 1.0))
    assert both.is_covered.sum() == 2


@given(st.integers(0, 10_000))
@settings(max_examples=10)
def test_what_can_not_be_touched_yet_is_only_not_looked_at(seed):
    rng = np.random.default_rng(seed)
    sizes = {"length": 0.4, "width": 0.3, "height": 0.2, "wall": 0.01}
    crate = make_body("crate", sizes, 2.0).at(SE3.from_parts(p=[0.8, 0.1, 0.1]))
    quick, slow = _touch(FakeConfig()), _touch(FakeConfig())
    shapes = _shapes(crate)
    T = downwards(0.8, 0.1, 0.3, rng.uniform(-3.0, 3.0))
    p, way = T.p + np.append(rng.uniform(-0.2, 0.2, 2), 0.0), np.zeros(3)
    turn = np.zeros(3)
    for k in range(150):
        way = 0.9 * way + rng.normal(scale=3e-4, size=3) - [0.0, 0.0, 1e-4]
        turn = turn + rng.normal(scale=2e-3, size=3)
        p = p + way
        R = so3.exp(turn) @ T.R
        for touch in (quick, slow):
            touch.gripper.openings = [0.1 + 2e-4 * k] * 3
        if k % 40 == 39:
            shapes[0].shift(rng.normal(scale=1e-3, size=3))
            quick.shifted(2e-3)
            slow.shifted(2e-3)
        for watch in slow._watches:
            watch.free_until = -np.inf
        found, expected = (t.springs(R, p, shapes, ()) for t in (quick, slow))
        assert [s.owner for s in found] == [s.owner for s in expected]
        for one, other in zip(found, expected, strict=True):
            assert one.depth == other.depth
            assert one.force.tolist() == other.force.tolist()
