from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from debrisgrasp.control import Compliance
from debrisgrasp.errors import ConfigError, InputError, UnknownNameError
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.prototypes import GripperModel
from debrisgrasp.sim import FlightConfig, HandPhysics, Verdict, WristConfig, fly
from debrisgrasp.sim.yielding import Yielding
from debrisgrasp.trials import YIELD
from debrisgrasp.worlds import World

from ._grasps import TIP, box, downwards, flown

pytest.importorskip("mujoco")

HAND = GripperModel.load("robotiq_3f")
GRAVITY = 9.81


@pytest.mark.parametrize("friction", [0.6, 0.8])
def test_two_kilograms_gripped_in_the_middle_hold(friction):
    flight = flown(hand=HandPhysics(friction=friction))
    assert flight.verdict is Verdict.HELD
    assert flight.held == "it"
    assert flight.rise == pytest.approx(0.25, abs=0.01)
    assert flight.turn < 0.05
    assert flight.slide < 0.005
    assert not flight.is_through


def test_eight_kilograms_half_a_metre_aside_do_not_hold():
    flight = flown((0.06, 1.2, 0.06), 8.0, aside=(0.0, 0.5))
    assert flight.verdict in (Verdict.SLIPPED, Verdict.TOO_HEAVY, Verdict.STUCK)


def test_what_friction_can_not_carry_slips():
    # Both sides press with 60 N: 0.1 of 120 N is less than the weight of 2 kg.
    flight = flown(hand=HandPhysics(friction=0.1))
    assert flight.verdict is Verdict.SLIPPED
    assert flight.rise < 0.15


def test_a_weaker_grip_slips_where_a_stronger_one_holds():
    # 2 x 15 N x 0.7 = 21 N carries 1 kg but not 4 kg.
    weak = HandPhysics(grip_force=15.0)
    assert flown(mass=1.0, hand=weak).verdict is Verdict.HELD
    assert flown(mass=4.0, hand=weak).verdict is Verdict.SLIPPED
    assert flown(mass=4.0).verdict is Verdict.HELD


def test_the_wrist_feels_the_weight_and_no_more_than_its_limit():
    flight = flown(mass=3.0)
    assert flight.peak_force == pytest.approx(3.0 * GRAVITY, rel=0.4)
    heavy = flown(mass=60.0, hand=HandPhysics(grip_force=600.0, friction=1.0))
    assert heavy.verdict is Verdict.TOO_HEAVY
    assert heavy.peak_force <= 150.0 + 1e-6
    assert heavy.peak_torque <= 40.0 + 1e-6


def test_closing_beside_the_object_is_missed():
    flight = flown(aside=(0.3, 0.0))
    assert flight.verdict is Verdict.MISSED
    assert flight.rise == pytest.approx(0.0, abs=0.002)


def test_fingers_that_come_down_on_the_object_collide():
    flight = flown((0.2, 0.2, 0.06), 2.0)
    assert flight.verdict is Verdict.COLLISION_ON_APPROACH
    assert flight.short_of_goal > 0.02


def test_a_hand_that_starts_inside_something_has_collided():
    world = World((box("it", (0.3, 0.3, 0.3), 2.0),))
    flight = fly(world, HAND, downwards([0.0, 0.0, 0.1]), intended="it")
    assert flight.verdict is Verdict.COLLISION_ON_APPROACH
    assert flight.seconds == 0.0


def test_what_is_wedged_is_stuck():
    held_down = box("load", (0.1, 0.1, 0.1), 30.0)
    load = held_down.at(SE3.from_parts(p=[0.0, 0.25, 0.11]))
    plank = box("plank", (0.06, 0.7, 0.06), 2.0)
    flight = fly(
        World((plank, load)),
        HAND,
        downwards([0.0, -0.2, 0.03 + TIP]),
        intended="plank",
        config=FlightConfig(hand=HandPhysics(grip_force=300.0)),
    )
    assert flight.verdict in (Verdict.STUCK, Verdict.SLIPPED)


def test_what_hangs_by_an_end_is_pulled_clear():
    # The middle of a beam of 1 m, gripped 10 cm from its end, rises 25 cm * 5 / 9.
    strong = HandPhysics(grip_force=200.0)
    flight = flown((0.06, 1.0, 0.06), 4.0, aside=(0.0, 0.4), hand=strong)
    assert flight.verdict is Verdict.PULLED_CLEAR
    assert flight.rise == pytest.approx(0.25 * 5 / 9, abs=0.02)
    assert 0.4 <= flight.pulled <= 0.51
    assert [moment.phase for moment in flight.moments][-2:] == ["hold", "pull"]


def test_what_is_pulled_with_something_on_it_is_not_clear():
    beam = box("beam", (0.06, 1.0, 0.06), 4.0)
    rider = box("rider", (0.3, 0.3, 0.02), 1.0)
    flight = fly(
        World((beam, rider.at(SE3.from_parts(p=[0.0, -0.2, 0.0705])))),
        HAND,
        downwards([0.0, 0.4, 0.03 + TIP]),
        intended="beam",
        config=FlightConfig(hand=HandPhysics(grip_force=200.0)),
    )
    assert flight.verdict is Verdict.SLIPPED
    assert flight.pulled > 0.4


def test_a_yielding_lift_strains_the_hand_less():
    # A beam lifted at its end turns about its far edge.
    hand = HandPhysics(grip_force=200.0, torsion=0.02)
    size, aside = (0.06, 1.0, 0.06), (0.0, 0.4)
    stiff = flown(size, 4.0, aside=aside, hand=hand)
    soft = flown(size, 4.0, aside=aside, hand=hand, compliance=YIELD)
    assert soft.peak_torque < 0.25 * stiff.peak_torque
    assert soft.peak_force < stiff.peak_force


def turned_by(torque):
    """A wrist that bears a torque about y, and stays where it is."""
    return SimpleNamespace(
        wrench=np.array([0.0, 0.0, 0.0, 0.0, torque, 0.0]),
        pose=lambda _: SE3.identity(),
        pose_at=lambda _: SE3.identity(),
        displacement_of=lambda T_base_hand: so3.log(T_base_hand.R),
    )


def test_a_yielding_hand_gives_way_to_what_the_squeeze_left_in_it():
    # The wrist bears a torque already when the lift begins.
    wrist = turned_by(2.0)
    yielding = Yielding(FlightConfig(compliance=YIELD), wrist)
    for _ in range(20000):
        turn = yielding.deflected(np.zeros(6), None)
    np.testing.assert_allclose(turn, [0.0, -0.8, 0.0], atol=0.01)


@pytest.mark.parametrize("torque", [2.0, 40.0])
def test_a_yielding_hand_turns_less_than_a_right_angle(torque):
    wrist = turned_by(0.0)
    yielding = Yielding(
        FlightConfig(compliance=Compliance.diagonal([1e-4] * 3, [0.15] * 3)), wrist
    )
    wrist.wrench[4] = torque
    for _ in range(5000):
        turn = np.linalg.norm(yielding.deflected(np.zeros(6), None))
    assert turn == pytest.approx(min(0.15 * torque, 1.2), rel=0.05)


def test_equal_flights_are_equal():
    a, b = flown(), flown()
    assert a.rise == b.rise
    assert a.peak_force == b.peak_force
    last = a.moments[-1], b.moments[-1]
    for one, other in zip(*(m.world.bodies for m in last), strict=True):
        np.testing.assert_array_equal(one.T_base_body.matrix, other.T_base_body.matrix)


def test_phases_are_kept_in_their_order():
    phases = [moment.phase for moment in flown().moments]
    assert phases == ["start", "approach", "closing", "squeeze", "lift", "hold"]


def test_bad_input_is_refused():
    world = World((box("it", (0.06, 0.2, 0.06), 2.0),))
    grasp = downwards([0.0, 0.0, 0.142])
    with pytest.raises(UnknownNameError, match="body"):
        fly(world, HAND, grasp, intended="them")
    with pytest.raises(UnknownNameError, match="preshape"):
        fly(world, HAND, replace(grasp, preshape="fist"))
    with pytest.raises(InputError, match="opening"):
        fly(world, HAND, replace(grasp, opening=0.5))
    broken = SE3(np.full((4, 4), np.nan))
    with pytest.raises(InputError, match="T_base_hand"):
        fly(world, HAND, replace(grasp, T_base_hand=broken))


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: FlightConfig(lift=(0.0, 0.0, 0.1)), "lift"),
        (lambda: FlightConfig(approach_speed=0.0), "approach_speed"),
        (lambda: HandPhysics(friction=-1.0), "friction"),
        (lambda: HandPhysics(grip_force=0.0), "grip_force"),
        (lambda: WristConfig(limits=(0.0, 40.0)), "limits"),
    ],
)
def test_settings_that_make_no_sense_are_refused(make, said):
    with pytest.raises(ConfigError, match=said):
        make()
