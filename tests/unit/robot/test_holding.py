"""Bodies that are gripped, lifted, pushed, dropped, and lain upon."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from debrisgrasp.control import GripCommand
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.robot import FakeConfig
from debrisgrasp.robot.burden import load_of
from debrisgrasp.robot.drives import Timeline
from debrisgrasp.robot.fake_hand import FakeGripper
from debrisgrasp.robot.holding import Hold, is_enclosed
from debrisgrasp.robot.pushing import Push, Pushes, Yielding
from debrisgrasp.robot.rubble import Rubble
from debrisgrasp.robot.settling import Settling
from debrisgrasp.robot.springs import GROUND, HELD, PALM, Spring
from debrisgrasp.robot.touch import Touch
from debrisgrasp.worlds import Ground, World, make_body
from tests.unit.robot.rigs import FAR, GRIPPERS, Rig, beam, drive

BAR = (0.8, -0.3, 0.0445)
G = 9.81


def test_a_bar_is_gripped_lifted_carried_and_put_down():
    rig = Rig([beam("bar", 2.5, BAR)], removed_beyond=0.1)
    assert rig.grip() == "HOLDING"
    assert rig.fake.truth().held == {"right": "bar"}
    assert np.abs(rig.load[:3]).max() < 2.0  # the ground still carries it
    assert rig.move(0.0, 0.0, 0.1)
    assert rig.body("bar").p[2] == pytest.approx(0.1445, abs=1e-3)
    # Gravity points out of a palm that looks down: +z of the hand.
    assert np.allclose(rig.load[:3], [0.0, 0.0, 2.5 * G], atol=1.5)
    assert rig.move(0.0, 0.12, 0.0)
    assert rig.move(0.0, 0.0, -0.099)
    rig.open()
    truth = rig.fake.truth()
    assert truth.held == {}
    assert truth.removed == ("bar",)
    assert truth.violations == ()
    assert np.allclose(rig.body("bar").p, [0.8, -0.18, 0.0445], atol=3e-3)
    assert np.abs(rig.fake.sensors["right"].load_ee).max() < 1e-9


def test_a_bar_held_beside_its_middle_turns_the_wrist():
    rig = Rig([beam("bar", 2.0, (0.9, -0.3, 0.0445))])
    assert rig.grip(squeeze=60.0) == "HOLDING"
    assert rig.move(0.0, 0.0, 0.03)
    hand, bar = rig.chain.fk(rig.arm.read().q), rig.body("bar")
    weight = np.array([0.0, 0.0, -2.0 * G])
    moment = np.cross(bar.p - hand.p, weight)
    expected = np.concatenate([hand.R.T @ weight, hand.R.T @ moment])
    assert np.allclose(rig.fake.sensors["right"].load_ee, expected, atol=0.02)
    assert np.linalg.norm(expected[3:]) == pytest.approx(2.0 * G * 0.1, rel=0.02)


def test_what_is_too_heavy_for_the_squeeze_slips_out():
    rig = Rig([beam("bar", 5.0, BAR)])
    assert rig.grip(squeeze=20.0) == "HOLDING"
    rig.move(0.0, 0.0, 0.08)
    rig.wait(1.0)
    assert rig.fake.truth().held == {}
    assert rig.body("bar").p[2] == pytest.approx(0.0445, abs=2e-3)
    # 2 x 0.6 x 20 N is what friction keeps; the wrist never felt the whole weight.
    assert rig.fake.truth().peak_force["right"] < 0.75 * 5.0 * G
    # The fingers go on to where they were sent.
    assert max(rig.hand.read().forces) == 0.0


def test_a_stronger_squeeze_carries_the_same_bar():
    rig = Rig([beam("bar", 5.0, BAR)])
    assert rig.grip(squeeze=60.0) == "HOLDING"
    rig.move(0.0, 0.0, 0.08)
    assert rig.fake.truth().held == {"right": "bar"}
    assert rig.body("bar").p[2] == pytest.approx(0.1245, abs=2e-3)


def test_a_dropped_bar_falls_to_what_is_beneath():
    rig = Rig([beam("bar", 2.0, BAR), beam("other", 4.0, (0.8, -0.12, 0.0445))])
    assert rig.grip() == "HOLDING"
    rig.move(0.0, 0.0, 0.2)
    rig.move(0.0, 0.18, 0.0)
    rig.open()
    assert rig.body("bar").p[2] == pytest.approx(0.1335, abs=4e-3)
    assert np.allclose(rig.body("other").p, [0.8, -0.12, 0.0445], atol=2e-3)


def test_bodies_that_lose_their_support_sink():
    on_top = beam("top", 1.0, (0.95, -0.3, 0.1335), yaw=np.pi / 2)
    rig = Rig([beam("bar", 2.0, (0.95, -0.3, 0.0445)), on_top], place=(0.8, -0.3, 0.13))
    assert rig.grip(squeeze=60.0) == "HOLDING"
    rig.move(0.0, 0.0, 0.06)
    # It rides on the bar, and the wrist feels both.
    assert rig.body("top").p[2] == pytest.approx(0.1935, abs=3e-3)
    assert rig.load[2] == pytest.approx(3.0 * G, abs=2.0)
    rig.open()
    assert rig.fake.truth().held == {}
    assert rig.body("bar").p[2] == pytest.approx(0.0445, abs=2e-3)
    assert rig.body("top").p[2] == pytest.approx(0.1335, abs=4e-3)


def test_what_lies_under_too_much_overloads_the_wrist():
    on_top = beam("top", 30.0, (1.0, -0.3, 0.1335), yaw=np.pi / 2)
    bar = beam("bar", 2.0, (0.95, -0.3, 0.0445))
    rig = Rig([bar, on_top], place=(0.8, -0.3, 0.13), friction=3.0)
    assert rig.grip(squeeze=60.0) == "HOLDING"
    rig.move(0.0, 0.0, 0.02)
    assert rig.fake.truth().peak_force["right"] > 150.0
    assert rig.fake.truth().overloads == ("right",)


NEXT = (0.8, -0.09, 0.0445)
"""Beside a bar that is pushed."""


def pushed(mass: float) -> tuple[Rig, np.ndarray]:
    """Push a bar by 0.12 m, unless the wrist feels too much; how far it went."""
    bar = beam("bar", mass, (0.8, -0.19, 0.0445))
    rig = Rig([bar], place=(0.8, -0.3, 0.16, 0.0))
    rig.move(0.0, 0.12, 0.0, speed=0.05, until=lambda: abs(rig.load[1]) > 120.0)
    return rig, rig.body("bar").p - bar.T_base_body.p


def test_a_pushed_bar_slides_with_the_force_of_its_friction():
    rig, way = pushed(1.0)
    assert way[1] > 0.02
    assert np.abs(way[2]) < 1e-9
    # It comes to lie against both fingers, one of which stands farther back.
    one, other = (s.point for s in rig.fake._stage._hands["right"].springs)
    x, y, _ = (other - one) / np.linalg.norm(other - one)
    assert abs(x * rig.body("bar").R[1, 0] - y * rig.body("bar").R[0, 0]) < 0.03
    assert abs(way[0]) < 0.02
    # In one period the hand gets up to 0.2 mm deeper than friction alone explains.
    excess = 0.2e-3 * FakeConfig().contact_stiffness
    assert rig.fake.truth().peak_force["right"] < 0.6 * 1.0 * G + 1.5 * excess


def lying_bar() -> Rubble:
    """A bar of 2 kg along x."""
    bar = beam("bar", 2.0, (0.8, -0.3, 0.0445))
    return Rubble(World((bar,), Ground.level()), FakeConfig())


def yielding(points, forces, friction=0.6) -> Yielding | None:
    """How the bar gives way to forces (n, 3) on it [N]."""
    rubble = lying_bar()
    springs = [
        Spring(1, 0, np.add((0.8, -0.3, 0.0445), p), -np.array(f, float), 1e-4)
        for p, f in zip(points, forces, strict=True)
    ]
    config = FakeConfig(friction=friction)
    push = Push()
    push.take({0}, rubble)
    return push.wanted(springs, config)


def test_a_push_through_the_middle_turns_nothing_and_a_couple_shifts_nothing():
    straight = yielding([(0.0, -0.04, 0.0)], [(0.0, 20.0, 0.0)])
    assert straight.turn == 0.0
    assert straight.way[1] > 0.0
    couple = yielding(
        [(0.2, -0.04, 0.0), (-0.2, 0.04, 0.0)], [(0.0, 15.0, 0.0), (0.0, -15.0, 0.0)]
    )
    np.testing.assert_allclose(couple.way, 0.0, atol=1e-12)
    assert couple.turn > 0.0


def test_a_bar_turns_where_less_would_not_shift_it():
    """At its end a bar gives way to less than its friction of 0.6 x 2 kg."""
    assert yielding([(0.0, -0.04, 0.0)], [(0.0, 10.0, 0.0)]) is None
    end = yielding([(0.25, -0.04, 0.0)], [(0.0, 10.0, 0.0)])
    assert end.turn > 0.0
    assert yielding([(0.25, -0.04, 0.0)], [(0.0, 4.0, 0.0)]) is None


@given(
    points=arrays(float, (3, 3), elements=st.floats(-0.2, 0.2)),
    forces=arrays(float, (3, 3), elements=st.floats(-30.0, 30.0)),
    friction=st.sampled_from([0.0, 0.6]),
)
def test_a_body_gives_way_to_what_pushes_it_and_not_too_fast(points, forces, friction):
    pressed = np.linalg.norm(forces, axis=1) > 0.1
    points, forces = points[pressed], forces[pressed]
    if not len(forces):
        return
    by = yielding(points, forces, friction)
    if by is None:
        return
    moment = np.cross(points, forces)[:, 2].sum()
    assert by.way @ forces.sum(axis=0) + by.turn * moment > 0.0
    moved = by.way[:2] + by.turn * np.column_stack([-points[:, 1], points[:, 0]])
    assert np.linalg.norm(moved, axis=1).max() < 0.31 * FakeConfig().period


@pytest.mark.parametrize(
    ("step", "expected"),
    [
        (lambda _: Yielding(np.array([8e-4, 0.0, 0.0]), 0.01), False),
        (lambda i: Yielding(np.array([0.0, 8e-4 * (-1) ** i, 0.0])), True),
        (lambda i: Yielding(np.zeros(3), 3e-3 * (-1) ** i), True),
        (lambda i: Yielding(np.array([8e-4 * (-1) ** (i // 10), 0.0, 0.0])), False),
        (lambda i: Yielding(np.array([3e-4, 0.0, 0.0]), 1e-3 * (-1) ** i), False),
    ],
)
def test_what_is_pushed_by_turns_from_two_sides_is_wedged(step, expected):
    """But not what goes on, though it sways, nor what is pushed back after some way."""
    rubble = lying_bar()
    push = Push()
    push.take({0}, rubble)
    for i in range(40):
        push.move(step(i), rubble)
        if not push.is_stuck:
            assert push.met(rubble) == set()
    assert push.is_stuck is expected


@pytest.mark.parametrize(
    ("growth", "gives_way"), [(10.0, False), (1.0, True), (-10.0, True)]
)
def test_what_presses_harder_as_it_gives_way_is_wedged(growth, gives_way):
    """It turns onto what pushes it; that would bear hundreds of newtons."""
    rubble, config = lying_bar(), FakeConfig()
    pushes, moved = Pushes(rubble, config), []
    for i in range(8):
        force = -np.array([0.0, 100.0 + growth * i, 0.0])
        spring = Spring(1, 0, rubble.shapes[0].com, force, 3e-3)
        moved.append(pushes.push({0: [spring]}, lambda _: False))
    assert all(moved[:3])
    assert all(moved) is gives_way


def test_a_body_turns_about_a_point():
    rubble = lying_bar()
    com = rubble.shapes[0].com.copy()
    rubble.turn(0, 0.3, com)
    np.testing.assert_allclose(rubble.shapes[0].com, com, atol=1e-12)
    rubble.turn(0, -0.3, np.add(com, (0.1, 0.0, 0.0)))
    assert rubble.shapes[0].com[1] - com[1] == pytest.approx(0.1 * np.sin(0.3))
    rubble.turn(0, 0.3, np.add(com, (0.1, 0.0, 0.0)))
    turned = so3.exp(np.array([0.0, 0.0, 0.3]))
    np.testing.assert_allclose(rubble.shapes[0].R, turned, atol=1e-12)
    np.testing.assert_allclose(rubble.world.bodies[0].T_base_body.R, turned, atol=1e-12)


def test_a_heavy_bar_cannot_be_pushed():
    rig, way = pushed(200.0)
    assert np.abs(way).max() < 1e-9
    assert rig.fake.truth().peak_force["right"] > 100.0


def test_a_pushed_bar_stops_at_what_is_in_its_way():
    wall = beam("wall", 80.0, (0.8, -0.08, 0.0445))
    rig = Rig(
        [beam("bar", 1.0, (0.8, -0.19, 0.0445)), wall], place=(0.8, -0.3, 0.16, 0.0)
    )
    went = rig.move(
        0.0, 0.15, 0.0, speed=0.05, until=lambda: np.abs(rig.load[:3]).max() > 100
    )
    assert not went
    bar, _ = rig.fake.truth().world.bodies
    gap = -0.08 - 0.0445 - max(solid.bounds.upper[1] for solid in bar.solids)
    assert abs(gap) < 6e-3
    assert np.abs(rig.body("wall").p - [0.8, -0.08, 0.0445]).max() < 1e-3


def test_a_bar_pushes_along_what_is_in_its_way():
    """With the friction of both, and of what lies on the farther one."""
    bars = [beam("near", 1.0, (0.8, -0.19, 0.0445)), beam("far", 1.0, NEXT)]
    on_it = beam("on it", 0.5, np.add(NEXT, (0.0, 0.0, 0.089)))
    rig = Rig([*bars, on_it], place=(0.8, -0.3, 0.16, 0.0))
    rig.move(0.0, 0.15, 0.0, speed=0.05)
    far = rig.body("far").p
    assert far[1] > NEXT[1] + 0.02
    assert far[2] == pytest.approx(NEXT[2], abs=1e-9)
    friction = 0.6 * (1.0 + 1.0 + 2.0 * 0.5) * G
    excess = 0.2e-3 * FakeConfig().contact_stiffness
    assert rig.fake.truth().peak_force["right"] < friction + 2.0 * excess
    gap = far[1] - rig.body("near").p[1] - 0.089
    assert gap == pytest.approx(0.0, abs=7e-3)


def test_what_a_held_bar_lifts_is_lifted_with_all_that_lies_on_it():
    """A bar beside the held one lies over its end: a hand feels their weights."""
    under = beam("bar", 2.0, BAR)
    over = beam("over", 1.0, (1.0, -0.3, 0.16), yaw=np.pi / 2)
    on_it = beam("on it", 1.0, (1.0, -0.3, 0.249), yaw=np.pi / 2)
    rig = Rig([under, over, on_it])
    assert rig.grip(squeeze=60.0) == "HOLDING"
    rig.move(0.0, 0.0, 0.06)
    rose = [rig.body(name).p[2] for name in ("over", "on it")]
    assert rose[0] > 0.16 + 0.02
    assert rose[1] - rose[0] == pytest.approx(0.089, abs=3e-3)
    assert rig.fake.truth().overloads == ()
    assert rig.fake.truth().peak_force["right"] < (2.0 + 1.0 + 1.0) * G + 25.0


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 3), st.floats(-60, 60)), max_size=40))
def test_each_pushed_body_moves_with_one_push(steps):
    """However they meet each other, and whichever of them is pushed."""
    row = [beam(f"bar {i}", 1.0, (0.8, 0.091 * i, 0.0445)) for i in range(4)]
    rubble = Rubble(World(tuple(row), Ground.level()), FakeConfig())
    pushes = Pushes(rubble, FakeConfig())
    for body, force in steps:
        at = rubble.shapes[body].com
        spring = Spring(1, body, at, -np.array([0.0, force, 0.0]), 1e-3)
        before = [shape.p.copy() for shape in rubble.shapes]
        way = pushes.push({body: [spring]}, lambda other: other == 3)
        moved = [
            float(np.linalg.norm(shape.p - p))
            for shape, p in zip(rubble.shapes, before, strict=True)
        ]
        assert max(moved) <= way + 1e-12
        assert way <= 0.31 * FakeConfig().period
        if body != 3:
            assert moved[3] == 0.0
    found = [body for push in pushes.ended((), lambda _: False) for body in push.bodies]
    assert len(found) == len(set(found))
    assert len(pushes) == 0


def test_a_held_bar_that_is_set_on_another_is_felt():
    rig = Rig([beam("bar", 2.0, BAR), beam("table", 50.0, (0.8, -0.12, 0.0445))])
    assert rig.grip(squeeze=60.0) == "HOLDING"
    rig.move(0.0, 0.0, 0.15)
    rig.move(0.0, 0.18, 0.0)
    before = rig.load[2]
    went = rig.move(0.0, 0.0, -0.15, speed=0.03, until=lambda: rig.load[2] < -20.0)
    assert before == pytest.approx(2.0 * G, abs=2.0)
    assert not went
    assert rig.body("bar").p[2] == pytest.approx(0.1335, abs=4e-3)


def test_a_bar_too_heavy_to_lift_is_dragged_by_the_base():
    rig = Rig([beam("bar", 5.0, BAR)])
    assert rig.grip(squeeze=60.0) == "HOLDING"
    drive(rig.robot, -0.1, 0.0, 2.0)
    # Friction of 0.6 x 5 kg on the ground pulls the hand forwards.
    pull = rig.chain.fk(rig.arm.read().q).R @ rig.load[:3]
    assert pull[0] == pytest.approx(0.6 * 5.0 * G, abs=3.0)
    rig.robot.base.stop()
    rig.wait(1.0)
    way = rig.robot.base.read().p[0]
    assert way < -0.15
    assert rig.body("bar").p[0] - 0.8 == pytest.approx(way, abs=3e-3)


def test_nothing_is_held_that_only_one_side_touches():
    rig = Rig([beam("bar", 60.0, (0.8, -0.3, 0.0445))], place=(0.8, -0.275, 0.16))
    rig.hand.command(GripCommand((0.0, 0.15, 0.15), 30.0))
    rig.wait(2.0)
    assert rig.hand.read().forces[0] == pytest.approx(30.0, abs=0.5)
    assert rig.fake.truth().held == {}


def test_a_hand_as_wide_open_as_it_goes_holds_nothing(monkeypatch):
    rig = Rig([beam("bar", 2.5, BAR)])
    hand = rig.hand
    assert hand.is_wide_open
    assert rig.grip() == "HOLDING"
    assert not hand.is_wide_open
    # What is as wide as the hand opens would still touch both sides.
    monkeypatch.setattr(FakeGripper, "is_wide_open", property(lambda _: True))
    assert rig.move(0.0, 0.0, 0.03)
    assert rig.fake.truth().held == {}
    assert rig.body("bar").p[2] == pytest.approx(0.0445, abs=2e-3)


def _spring(owner, point, force):
    return Spring(owner, 0, np.array(point), np.array(force, dtype=float), 1e-3)


@pytest.mark.parametrize(
    ("angle", "holds"), [(0.0, True), (0.5, True), (0.6, False), (1.2, False)]
)
def test_contacts_hold_within_their_friction_cones(angle, holds):
    # Friction 0.6 carries up to atan(0.6) = 0.54 rad.
    push = 10.0 * np.array([np.cos(angle), np.sin(angle), 0.0])
    thumb = [_spring(1, (-0.05, 0, 0), -push)]
    pair = [_spring(2, (0.05, 0, 0), push * [1, -1, 1])]
    assert is_enclosed(thumb, pair, FakeConfig().friction) is holds


def test_a_pipe_in_curled_fingers_is_kept_without_friction():
    sizes = {"radius": 0.03, "length": 0.5}
    pipe = make_body("pipe", sizes, 2.0, name="pipe")
    lying = SE3.from_parts(None, [0.8, -0.3, 0.1])
    lying = lying @ SE3.exp([0, 0, 0, 0, np.pi / 2, 0]) if _is_upright(pipe) else lying
    rig = Rig([pipe.at(lying), FAR], place=(0.8, -0.3, 0.17), friction=0.3)
    assert rig.grip(width=0.04, squeeze=30.0) == "HOLDING"
    rig.move(0.0, 0.0, 0.05)
    assert rig.fake.truth().held == {"right": "pipe"}


def _is_upright(body) -> bool:
    box = body.mesh()[0]
    return bool(np.ptp(box[:, 2]) > np.ptp(box[:, 0]))


def test_pads_that_meet_a_little_apart_hold_and_far_apart_do_not():
    push = np.array([10.0, 0.0, 0.0])
    for offset, holds in ((0.03, True), (0.06, False)):
        thumb = [_spring(1, (-0.015, 0, offset), -push)]
        pair = [_spring(2, (0.015, 0, 0), push)]
        assert is_enclosed(thumb, pair, FakeConfig().friction) is holds


def test_rounding_does_not_add_up_in_what_rides_on_what_is_carried():
    """Each period its rotation follows from the last two of what bears it."""
    bar, rider = (
        beam(name, 3.0, (0.8, 0.1, z)) for name, z in (("a", 0.1), ("b", 0.2))
    )
    rubble = Rubble(World((bar, rider), Ground.level()), FakeConfig())
    turn, drift = so3.exp(np.array([1e-3, 2e-3, -1e-3])), np.eye(3) + 1e-9
    for _ in range(2000):
        before = rubble.shapes[0].R
        rubble.place(0, turn @ before @ drift, rubble.shapes[0].p)
        by = rubble.shapes[0].R @ before.T
        rubble.place(1, by @ rubble.shapes[1].R, rubble.shapes[1].p)
    for shape in rubble.shapes:
        assert np.allclose(shape.R.T @ shape.R, np.eye(3), atol=1e-12)


def test_what_lies_on_a_held_bar_loads_the_wrist_as_far_as_it_was_lifted():
    on_top = beam("top", 3.0, (0.95, -0.3, 0.1335), yaw=np.pi / 2)
    rig = Rig([beam("bar", 2.0, (0.95, -0.3, 0.0445)), on_top], place=(0.8, -0.3, 0.13))
    assert rig.grip(squeeze=60.0) == "HOLDING"
    felt = [rig.load[2]]

    def noted() -> bool:
        felt.append(rig.load[2])
        return False

    rig.move(0.0, 0.0, 0.06, speed=0.03, until=noted)
    assert felt[-1] == pytest.approx(5.0 * G, abs=3.0)
    # 30 mm/s on springs of 3e4 N/m are 4 N in a period; all of it at once would be 29.
    assert np.abs(np.diff(felt)).max() < 20.0


def test_what_slips_in_the_fingers_takes_on_nothing_more():
    on_top = beam("top", 3.0, (0.95, -0.3, 0.1335), yaw=np.pi / 2)
    rig = Rig([beam("bar", 2.0, (0.95, -0.3, 0.0445)), on_top], place=(0.8, -0.3, 0.13))
    assert rig.grip(squeeze=60.0) == "HOLDING"
    high = rig.body("bar").p[2] + 5.2e-3
    rig.move(0.0, 0.0, 0.06, speed=5e-3, until=lambda: rig.body("bar").p[2] > high)
    before, height, felt = rig.load[2], rig.body("bar").p[2], []
    assert before < 4.5 * G  # of the five that it will be
    while rig.body("bar").p[2] > height - 3e-3 and len(felt) < 500:
        if rig.body("bar").p[2] > height - 1e-4:
            openings = tuple(x + 5e-5 for x in rig.hand.read().openings)
            rig.hand.command(GripCommand(openings, 60.0))
        rig.wait(0.004)
        felt.append(rig.load[2])
    assert rig.fake.truth().held == {"right": "bar"}
    assert rig.body("bar").p[2] <= height - 3e-3
    assert max(felt) < before + 1.0


def test_a_held_body_is_pushed_where_it_is_touched_though_the_hand_feels_that_later():
    """Else a beam that comes down on its other end is turned deeper into the ground."""
    hold = Hold(0, np.eye(3), np.zeros(3), None, np.zeros(3), np.zeros(3), set())
    turn = so3.exp(np.array([0.0, 0.0, 0.7]))
    felt_at, touched_at = np.array([0.3, 0.1, 0.0]), np.array([-0.4, 0.2, 0.0])
    up, pressed = np.array([0.0, 0.0, 50.0]), np.array([7.0, 0.0, 0.0])
    springs = [
        Spring(HELD, GROUND, felt_at, up, 1e-3, touched_at - felt_at),
        Spring(PALM, GROUND, felt_at, pressed, 1e-3, touched_at - felt_at),
    ]
    hand = SimpleNamespace(hold=hold, springs=springs)
    body = SimpleNamespace(mass=2.0, com=np.array([0.0, 0.05, 0.0]))
    on_body, on_hand = load_of(hand, [body], tuple(turn.ravel()), (0.0, 0.0, 0.0))
    weight = np.array([0.0, 0.0, -2.0 * G])
    hung = np.cross(body.com, weight)
    np.testing.assert_allclose(on_body[:3], (up + weight) @ turn)
    np.testing.assert_allclose(on_body[3:], (hung + np.cross(touched_at, up)) @ turn)
    felt = hung + np.cross(felt_at, up + pressed)
    np.testing.assert_allclose(on_hand[:3], (up + weight + pressed) @ turn)
    np.testing.assert_allclose(on_hand[3:], felt @ turn, atol=1e-12)


def test_a_hand_feels_pushes_that_change_at_once_bit_by_bit_what_it_holds_at_once():
    hold = Hold(0, np.eye(3), np.zeros(3), None, np.zeros(3), np.zeros(3), set())
    R, p = so3.exp(np.array([0.3, 0.2, 1.1])), np.array([1.0, 0.1, 0.2])
    at = p + np.array([0.4, 0.2, -0.3])
    before = [
        Spring(HELD, 1, at, np.array([5.0, 0.0, -110.0]), 1e-3),
        Spring(PALM, 1, at, np.array([0.0, 3.0, -40.0]), 1e-3),
        Spring(HELD, GROUND, p - at, np.array([0.0, 0.0, 60.0]), 1e-3),
    ]
    after = [Spring(HELD, GROUND, p - at, np.array([0.0, 0.0, 4.0]), 1e-3)]

    def loads(springs: list[Spring]) -> list[np.ndarray]:
        hand = SimpleNamespace(hold=hold, springs=springs)
        body = SimpleNamespace(mass=2.0, com=at)
        return [
            np.array(load)
            for load in load_of(hand, [body], tuple(R.ravel()), tuple(p.tolist()))
        ]

    then, now = loads(before), loads(after)
    hold.feel(
        [spring.seen_from(R, p) for spring in before],
        [spring.seen_from(R, p) for spring in after],
        1e-4,
        FakeConfig(),
    )
    for n in range(20):
        on_body, felt = loads(after)
        np.testing.assert_array_equal(on_body, now[0])
        np.testing.assert_allclose(felt, now[1] + 0.9**n * (then[1] - now[1]))
        assert hold.is_loading
        hold.fade(0.1)
    for _ in range(60):
        hold.fade(0.1)
    assert not hold.is_loading
    np.testing.assert_array_equal(loads(after), now)


@pytest.mark.parametrize(
    ("force", "lever", "moved", "is_sudden"),
    [
        (35.0, 0.0, 1.2e-3, False),  # 30 N/mm
        (45.0, 0.0, 1.2e-3, True),
        (20.0, 0.5, 1.2e-3, False),  # 8.7 N m/mm
        (30.0, 0.5, 1.2e-3, True),
        (4.0, 0.3, 0.0, False),
        (10.0, 0.0, 0.0, True),
    ],
)
def test_pushes_follow_what_moved_at_once(force, lever, moved, is_sudden):
    hold = Hold(0, np.eye(3), np.zeros(3), None, np.zeros(3), np.zeros(3), set())
    at = np.array([lever, 0.0, 0.0])
    one = Spring(HELD, GROUND, at, np.array([0.0, 0.0, 50.0]), 1e-3)
    other = one._replace(force=one.force + np.array([0.0, 0.0, force]))
    for before, after in ((one, other), (other, one)):
        hold.fading = []
        hold.feel([before], [after], moved, FakeConfig())
        assert bool(hold.fading) is is_sudden
    hold.fading = []
    hold.feel([], [], 0.0, FakeConfig())
    assert not hold.fading


def test_a_body_that_is_let_go_comes_to_lie_on_the_hand_and_not_in_it():
    rig = Rig(
        [beam("bar", 4.0, (0.95, -0.3, 0.0445), yaw=0.0)], place=(0.8, -0.3, 0.13)
    )
    assert rig.grip(squeeze=60.0) == "HOLDING"
    rig.move(0.0, 0.0, 0.05, speed=0.05)
    rig.open()
    rig.move(0.0, 0.0, 0.1, speed=0.05)
    assert rig.fake.truth().peak_force["right"] < 1.5 * 4.0 * G
    assert rig.body("bar").p[2] == pytest.approx(0.0445, abs=4e-3)


def test_fingers_that_open_push_no_harder_than_they_were_told():
    wall = beam("wall", 200.0, (0.8, -0.14, 0.0445))
    rig = Rig([wall, beam("far", 1.0, (2.0, 0.0, 0.0445))], place=(0.8, -0.3, 0.13))
    n = len(rig.hand.read().openings)
    rig.hand.command(GripCommand((0.02,) * n, 30.0))
    rig.wait(1.0)
    rig.move(0.0, 0.05, 0.0, speed=0.05)
    before = rig.fake.truth().peak_force["right"]
    rig.hand.command(GripCommand((0.15,) * n, 30.0))
    rig.wait(2.0)
    assert before < 30.0
    assert min(rig.hand.read().openings) < 0.15 - 5e-3
    assert rig.fake.truth().peak_force["right"] < 80.0


def test_a_body_that_appears_in_a_hand_lies_against_it_and_does_not_strike():
    rig = Rig([FAR])
    bar = beam("bar", 3.0, (0.8, -0.3, 0.0445))
    rig.fake.change_world(lambda world: World((*world.bodies, bar)))
    rig.wait(0.1)
    overlapping = beam("other", 3.0, (0.8, -0.3, 0.1))
    rig.fake.change_world(lambda world: World((*world.bodies, overlapping)))
    rig.wait(0.1)
    assert rig.fake.truth().peak_force["right"] < 1.0


def test_what_is_moved_behind_the_robots_back_began_there():
    rig = Rig([FAR])
    shift = SE3.from_parts(p=[0.4, 0.0, 0.0])
    rig.fake.change_world(
        lambda world: world.placed([shift @ b.T_base_body for b in world.bodies])
    )
    truth = rig.fake.truth()
    (begun,), (now,) = truth.begun.bodies, truth.world.bodies
    np.testing.assert_allclose(begun.T_base_body.p, shift.apply(FAR.T_base_body.p))
    np.testing.assert_allclose(now.T_base_body.p[:2], begun.T_base_body.p[:2])


def test_a_joint_jumps_out_of_its_limits_only_away_from_bodies():
    near, away = Rig([beam("bar", 3.0, (0.8, -0.3, 0.0445))]), Rig([FAR])
    before = tuple(near.arm.read().q)
    assert not near.fake.misplace(0.01, "right")
    assert tuple(near.arm.read().q) == before
    assert away.fake.misplace(0.01, "right")
    assert tuple(away.arm.read().q) != before


@pytest.mark.parametrize("name", ["robotiq_3f", "camhand"])
def test_fingers_feel_what_their_links_sweep_against(name):
    config = FakeConfig()
    hand = FakeGripper(GRIPPERS[name], Timeline(0.004), config, [])
    touch = Touch(hand, Ground.level(), config)
    preshape, opening = hand.shape, 0.6 * hand.openings[0]
    hand.openings = [opening] * len(hand.openings)
    here = touch.shape.points(preshape, hand.openings)
    wider = touch.shape.points(preshape, [x + 1e-3 for x in hand.openings])
    for finger in range(len(hand.openings)):
        rows = touch.shape.owned[finger + 1]
        moves = (wider - here)[rows]
        fastest = int(np.linalg.norm(moves, axis=1).argmax())
        way = moves[fastest] / np.linalg.norm(moves[fastest])
        felt = touch.felt(finger + 1, here[rows][fastest], 10.0 * way)
        assert felt == pytest.approx(10.0, abs=0.5)


def test_what_opening_fingers_lose_in_the_air_has_not_slipped_past_them(monkeypatch):
    """Held ever less, it slides by a hair before it is lost: the hand is in its way."""
    past, settle = [], Settling.settle

    def settled(own, loose, held, passed=None):
        past.append(passed is not None)
        return settle(own, loose, held, passed)

    monkeypatch.setattr(Settling, "settle", settled)
    rig = Rig(
        [beam("bar", 3.0, (0.95, -0.3, 0.0445), yaw=0.0)], place=(0.8, -0.3, 0.13)
    )
    assert rig.grip(squeeze=60.0) == "HOLDING"
    rig.move(0.0, 0.0, 0.05, speed=0.05)
    rig.open()
    assert rig.fake.truth().held == {}
    assert past
    assert not any(past)


def test_fingers_that_open_take_hold_of_nothing(monkeypatch):
    """From inside they press what they are in, as those of a hand do in a pallet."""
    monkeypatch.setattr("debrisgrasp.robot.stage.is_enclosed", lambda *_: True)
    wall = beam("wall", 200.0, (0.8, -0.14, 0.0445))
    rig = Rig([wall, FAR], place=(0.8, -0.3, 0.13))
    n = len(rig.hand.read().openings)
    rig.hand.command(GripCommand((0.05,) * n, 30.0))
    rig.wait(1.0)
    rig.move(0.0, 0.07, 0.0, speed=0.05)
    assert rig.fake.truth().held == {}
    rig.hand.command(GripCommand((0.15,) * n, 30.0))
    rig.wait(1.0)
    assert rig.fake.truth().held == {}
    assert rig.fake.truth().peak_force["right"] > 5.0


def test_what_no_longer_rides_on_what_is_carried_falls_when_that_has_gone(monkeypatch):
    """It may hang on a side too steep to bear it, as a pipe around a cone does."""
    on_top = beam("top", 3.0, (0.95, -0.3, 0.1335), yaw=np.pi / 2)
    rig = Rig([beam("bar", 2.0, (0.95, -0.3, 0.0445)), on_top], place=(0.8, -0.3, 0.13))
    assert rig.grip(squeeze=60.0) == "HOLDING"
    rig.move(0.0, 0.0, 0.28, speed=0.1)
    assert rig.body("top").p[2] > 0.3
    monkeypatch.setattr(Rubble, "riders", lambda *_: {})
    for _ in range(2):
        rig.move(0.0, 0.2, 0.0, speed=0.1)
    assert rig.fake.truth().held == {"right": "bar"}
    assert rig.body("top").p[2] == pytest.approx(0.0445, abs=4e-3)
