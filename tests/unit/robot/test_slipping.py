"""Bodies that slip, and turn, in fingers that hold them too weakly."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from debrisgrasp.control import GripCommand
from debrisgrasp.geometry import so3
from debrisgrasp.robot import FakeConfig
from debrisgrasp.robot.holding import Grip
from debrisgrasp.robot.slipping import Leaning, slip_of
from debrisgrasp.robot.springs import Spring
from tests.unit.robot.rigs import GRIPPERS, PERIOD, Rig, beam

CONFIG = FakeConfig()
HAND = GRIPPERS["robotiq_3f"]
FRICTION = 0.6
CENTRE = np.array([0.0, 0.01, 0.1])
OFF = np.array([0.03, 0.0, 0.0])

forces = st.tuples(*[st.floats(-200.0, 200.0)] * 3)
moments = st.tuples(*[st.floats(-60.0, 60.0)] * 3)
places = st.lists(st.tuples(*[st.floats(-0.8, 0.8)] * 3), max_size=4)


def grip_of(squeeze: float) -> Grip:
    """Two fingers that press from both sides, at 3 cm from `CENTRE`."""
    contacts = [
        Spring(1, 0, CENTRE + OFF, np.array([squeeze, 0.0, 0.0]), 1e-3),
        Spring(2, 0, CENTRE - OFF, np.array([-squeeze, 0.0, 0.0]), 1e-3),
    ]
    sides = [contacts[0]], [contacts[1]]
    return Grip(contacts, sides, squeeze, 0.0, [squeeze, squeeze, 0.0])


def slipped(force, moment, squeeze, held_at, *, before=(0.0, 0.0, 0.0)):
    load, leaning = (*force, *moment), Leaning(held_at, 1.0, before)
    return slip_of(load, grip_of(squeeze), leaning, FRICTION, HAND, CONFIG)


@given(forces, moments, st.floats(0.5, 60.0), places)
def test_what_friction_keeps_stays_and_all_else_gives_way(
    force, moment, squeeze, held_at
):
    kept = 2.0 * FRICTION * squeeze
    aside = float(np.hypot(force[1], force[2]))
    slip = slipped(force, moment, squeeze, held_at)
    assert (slip is None) == (aside <= kept)
    if slip is None:
        return
    # Along the fingers' closing nothing slips; aside it goes where it is pushed.
    assert slip.way[0] == 0.0
    assert np.dot(slip.way, force) >= 0.0
    # It never goes past where friction would hold it.
    assert slip.distance * CONFIG.stiffness <= aside - kept + 1e-6
    turn = np.array(slip.turn)
    angle = float(np.linalg.norm(turn))
    bent = np.array(moment) - np.cross(CENTRE, force)
    assert turn @ bent >= -1e-12
    if angle > 1e-9 and held_at:
        arms = np.cross(turn / angle, np.array(held_at) - CENTRE)
        eased = CONFIG.stiffness * float((arms**2).sum()) * angle
        assert eased <= np.linalg.norm(bent) * (1.0 + 1e-6) + 1e-6


FAR = [(0.0, 0.5, 0.1)]
BENT = ((0.0, 0.0, 60.0), (8.0, 0.0, 0.0), 10.0)
"""Force, moment and squeeze of a body that leans far out."""


def test_what_leans_far_out_turns_until_the_fingers_keep_the_rest():
    slip = slipped(*BENT, FAR, before=(1e-3, 0.0, 0.0))
    bent = 8.0 - CENTRE[1] * 60.0
    excess = bent - 2.0 * FRICTION * 10.0 * 0.05
    expected = excess / (CONFIG.stiffness * (0.5 - CENTRE[1]) ** 2)
    assert slip.turn == pytest.approx([expected, 0.0, 0.0], rel=1e-3)


@pytest.mark.parametrize("before", [(0.0, 0.0, 0.0), (-1e-3, 0.0, 0.0)])
@pytest.mark.parametrize("points", [[], FAR], ids=["free", "leaning"])
def test_what_begins_to_turn_strikes_nothing(points, before):
    """Nothing of it gets farther than what slips does."""
    turn = np.linalg.norm(slipped(*BENT, points, before=before).turn)
    assert 0.0 < turn * 1.0 <= 0.05 * CONFIG.period * (1.0 + 1e-9)


def test_a_bar_that_leans_on_another_turns_in_a_grip_that_eases():
    """Its far end lies on the other: sliding alone would never ease what bends it."""
    rest = beam("rest", 8.0, (1.28, 0.1, 0.0445), yaw=np.pi / 2)
    bar = beam("bar", 3.0, (1.03, -0.3, 0.0445), length=0.7)
    rig = Rig([bar, rest])
    sensor = rig.fake.sensors["right"]
    assert rig.grip(squeeze=60.0) == "HOLDING"
    assert rig.move(0.0, 0.0, 0.14)
    assert rig.move(0.0, 0.3, 0.0)

    def bent() -> float:
        return float(np.linalg.norm(sensor.load_ee[3:]))

    def in_hand() -> np.ndarray:
        return rig.chain.fk(rig.arm.read().q).R.T @ rig.body("bar").R

    assert not rig.move(0.0, 0.0, -0.2, speed=0.02, until=lambda: bent() > 24.0)
    before, R_before = bent(), in_hand()
    openings = [opening - 0.02 for opening in rig.hand.read().openings]
    rig.hand.command(GripCommand(tuple(openings), 16.0))
    seen = []
    for _ in range(50):
        rig.wait(PERIOD)
        seen.append(bent())
    assert rig.fake.truth().held == {"right": "bar"}
    assert max(seen) <= before + 0.1
    assert seen[-1] < 0.6 * before
    assert np.linalg.norm(so3.log(R_before.T @ in_hand())) > 1e-4
