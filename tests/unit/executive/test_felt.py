"""What an empty hand touched on its way, and no camera saw."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from debrisgrasp.executive.drive import Drive
from debrisgrasp.executive.felt import feel_out, touched_at
from debrisgrasp.executive.obstacles import space_of
from debrisgrasp.executive.perceive import capture, segment
from debrisgrasp.executive.result import FaultFound
from debrisgrasp.geometry import SE3, Box
from debrisgrasp.motion import UnknownSpace
from debrisgrasp.prototypes import load_grippers
from debrisgrasp.robot import HandReading
from debrisgrasp.robot.fake_hand import FakeGripper
from tests.unit.executive.rigs import before_a_brick, holding

BOX = Box(np.array([0.1, 0.06, 0.2]), SE3.from_parts(p=[0.01, -0.02, 0.05]))
unit = st.floats(-1.0, 1.0)


def load_at(point, force):
    return np.concatenate([force, np.cross(point, force)])


@example((0.0, 0.0, 0.0), (0.0, 0.5, 1.0), 12.0)
@given(st.tuples(unit, unit, unit), st.tuples(unit, unit, unit), st.floats(12.0, 150.0))
def test_a_contact_is_found_where_its_force_enters_the_hand(inside, way, size):
    way = np.array(way)
    assume(np.linalg.norm(way) > 0.1)
    way /= np.linalg.norm(way)
    inner = BOX.T_frame_solid.apply(0.45 * np.array(inside) * [0.1, 0.06, 0.2])
    outer = inner - way * np.linspace(0.0, 0.5, 5001)[:, None]
    contact = outer[np.abs(BOX.signed_distance(outer)).argmin()]
    found = touched_at(load_at(contact, size * way), [BOX])
    assert found is not None
    point, along = found
    assert along == pytest.approx(way)
    assert np.linalg.norm(point - contact) < 2.5e-3


@pytest.mark.parametrize("name", sorted(load_grippers()))
def test_noise_of_the_sensor_moves_it_by_little(name, rng):
    hand = load_grippers()[name]
    preshape = next(iter(hand.preshapes))
    solids = hand.solids(preshape, hand.preshape(preshape).widest)
    finger = max(solids, key=lambda solid: solid.bounds.upper[2])
    tip = finger.mesh()[0][finger.mesh()[0][:, 2].argmax()]
    force = np.array([0.0, 0.0, -45.0])
    for _ in range(20):
        noise = rng.normal(size=6) * np.repeat([0.5, 0.05], 3)
        found = touched_at(load_at(tip, force) + noise, solids)
        assert found is not None
        assert np.linalg.norm(found[0] - tip) < 0.02


@pytest.mark.parametrize(
    "load",
    [
        np.zeros(6),
        load_at(np.array([0.0, 0.0, 0.1]), np.array([5.0, 0.0, 0.0])),
        load_at(np.array([0.0, 0.3, 0.1]), np.array([45.0, 0.0, 0.0])),
        np.full(6, np.nan),
    ],
    ids=["none", "little", "beside the hand", "no numbers"],
)
def test_what_tells_of_no_contact_with_the_hand_leaves_none(load):
    assert touched_at(load, [BOX]) is None


def test_what_a_hand_met_is_an_obstacle_until_the_next_look(pipeline, monkeypatch):
    _, task = before_a_brick(pipeline)
    context = task.context
    limb, drive = context.limbs["right"], Drive(context, "right")
    T = limb.pose(context.posture(limb))
    drive.load = tuple(load_at(np.array([0.0, 0.0, 0.0]), np.array([0, 0, 40.0])))
    met = FaultFound("plan_collision", "touched", "right")
    monkeypatch.setattr(Drive, "_followed", lambda *_: met)
    assert drive.follow(None) is met
    (patch,) = context.memory.felt
    assert np.ptp(patch @ T.R[:, 2]) < 1e-6  # across the push
    assert np.linalg.norm(patch - T.p, axis=1).max() < 0.2
    space = space_of(context, unknown=UnknownSpace.IGNORED, with_guesses=False)
    assert space.measured.distance(patch).max() < 0.03  # cells of 2 cm
    moved = SE3.from_parts(p=[0.3, 0.0, 0.0])
    context.stands_elsewhere(moved)
    np.testing.assert_allclose(context.memory.felt[0], moved.apply(patch))
    capture(context)
    segment(context)
    assert context.memory.felt == []


def test_what_presses_on_a_load_is_not_taken_for_a_touch_of_the_hand(pipeline):
    _, task = before_a_brick(pipeline)
    context, drive = task.context, Drive(task.context, "right")
    drive.load = (0.0, 0.0, 40.0, 0.0, 0.0, 0.0)
    context.held = holding()
    feel_out(drive)
    assert context.memory.felt == []


def test_fingers_that_tell_no_numbers_do_not_keep_a_touch_from_being_felt(
    pipeline, monkeypatch
):
    _, task = before_a_brick(pipeline)
    drive = Drive(task.context, "right")
    drive.load = (0.0, 0.0, 40.0, 0.0, 0.0, 0.0)
    read = HandReading(0.0, (np.nan,) * 3, (0.0,) * 3)
    monkeypatch.setattr(FakeGripper, "read", lambda _: read)
    feel_out(drive)
    assert len(task.context.memory.felt) == 1
