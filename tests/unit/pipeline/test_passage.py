"""Hand and held object against everything else, in scenes with known answers."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.geometry import SE3, so3
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.pipeline import Passage
from debrisgrasp.pipeline.executable import _on_robot
from debrisgrasp.prototypes import load_grippers
from tests.grasps import grasp_at

GRIPPERS = load_grippers()
TOP_DOWN = so3.from_rpy(np.array([np.pi, 0.0, 0.0]))
GRIP = SE3.from_parts(TOP_DOWN, [0.0, 0.0, 0.30])
GRASP = grasp_at(GRIP, SE3.from_parts(p=[0.0, 0.0, 0.15]) @ GRIP)


def block(center, size, spacing=0.01) -> np.ndarray:
    """Points that fill a box."""
    axes = [np.arange(-s / 2, s / 2 + 1e-9, spacing) for s in size]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return grid.reshape(-1, 3) + np.array(center)


BAR = block([0.0, 0.0, 0.20], (0.04, 0.5, 0.04))


def way(offset, n=31) -> SE3:
    """Palm poses from the grip along an offset."""
    share = np.linspace(0.0, 1.0, n)[:, None]
    return SE3.from_parts(p=share * np.array(offset)) @ GRIP


def coming_in() -> SE3:
    return way([0.0, 0.0, 0.15])[::-1]


@pytest.fixture(scope="module")
def alone() -> Passage:
    return Passage(BAR, BAR, GRIPPERS)


def test_the_object_itself_is_not_in_the_way(alone):
    assert alone.approach_fault(GRASP, coming_in()) == ""
    assert alone.lift_fault(GRASP, way([0.0, 0.0, 0.3])) == ""


def test_a_shelf_above_stops_the_hand_on_its_way_in():
    shelf = block([0.05, 0.0, 0.40], (0.1, 0.1, 0.02))
    passage = Passage(np.concatenate([BAR, shelf]), BAR, GRIPPERS)
    fault = passage.approach_fault(GRASP, coming_in())
    assert "the hand hits something" in fault
    x, y, z = map(float, fault.split("(")[1].split(")")[0].split(","))
    assert 0.0 <= x <= 0.1
    assert abs(y) <= 0.05
    assert 0.39 <= z <= 0.41


def test_a_beam_over_the_end_of_the_bar_stops_the_bar_and_not_the_hand():
    beam = block([0.0, 0.22, 0.30], (0.3, 0.04, 0.04))
    passage = Passage(np.concatenate([BAR, beam]), BAR, GRIPPERS)
    assert passage.approach_fault(GRASP, coming_in()) == ""
    fault = passage.lift_fault(GRASP, way([0.0, 0.0, 0.15]))
    assert "the held object hits something at (0.00, 0.22, 0.28) m" in fault
    # The beam's underside is 6 cm over the bar's top: 40 % of the way.
    share = float(fault.split("after ")[1].rstrip("%"))
    assert 33 <= share <= 45
    assert passage.lift_fault(GRASP, way([0.0, -0.15, 0.01])) == ""


def test_what_is_likely_one_with_the_bar_goes_along_and_still_stops_the_hand():
    handle = block([0.0, 0.22, 0.30], (0.3, 0.04, 0.04))
    shelf = block([0.05, 0.0, 0.40], (0.1, 0.1, 0.02))
    points = np.concatenate([BAR, handle, shelf])
    passage = Passage(points, BAR, GRIPPERS, along=np.concatenate([handle, shelf]))
    assert passage.lift_fault(GRASP, way([0.0, 0.0, 0.15])) == ""
    assert "the hand hits something" in passage.approach_fault(GRASP, coming_in())
    apart = Passage(points, BAR, GRIPPERS, along=shelf)
    assert "the held object" in apart.lift_fault(GRASP, way([0.0, 0.0, 0.15]))


def test_a_neighbour_that_touches_from_the_start_does_not_forbid_the_lift():
    below = block([0.0, 0.1, 0.15], (0.3, 0.05, 0.05))
    passage = Passage(np.concatenate([BAR, below]), BAR, GRIPPERS)
    assert passage.lift_fault(GRASP, way([0.0, 0.0, 0.15])) == ""


def test_single_points_in_the_air_are_forgiven():
    stray = np.array([[0.05, 0.0, 0.42]])
    passage = Passage(np.concatenate([BAR, stray]), BAR, GRIPPERS)
    assert passage.approach_fault(GRASP, coming_in()) == ""


def test_points_that_stand_alone_stop_no_object_but_a_rod_of_them_does(rng):
    """Flying pixels over the ends of a bar of 50 cm, and as many in rows along it."""
    half = np.arange(0.12, 0.251, 0.01)
    along = np.concatenate([-half, half])
    zero, floor = 0.0 * along, block([0.0, 0.0, 0.0], (0.5, 0.5, 0.0))
    rod = np.stack([zero, along, zero + 0.3], axis=1)
    heights = 0.27 + 0.04 * (np.arange(len(along)) % 3)
    strays = np.stack([zero, along, heights + rng.uniform(0.0, 0.005, len(along))], 1)

    def fault(points: np.ndarray, spacing: float) -> str:
        far = spacing / 0.01 * floor + [5.0, 0.0, 0.0]
        passage = Passage(np.concatenate([BAR, points, far]), BAR, GRIPPERS)
        return passage.lift_fault(GRASP, way([0.0, 0.0, 0.2], n=101))

    assert fault(strays, 0.01) == ""
    assert "the held object hits" in fault(rod, 0.01)
    # Seen from farther away, all is as sparse.
    assert "the held object hits" in fault(rod[::2], 0.02)


@pytest.mark.parametrize("points", [BAR, np.zeros((0, 3))])
def test_an_unknown_object_and_an_empty_scene_are_no_trouble(points):
    passage = Passage(points, np.zeros((0, 3)), GRIPPERS)
    assert isinstance(passage.lift_fault(GRASP, way([0.0, 0.0, 0.1])), str)
    empty = Passage(np.zeros((0, 3)), BAR, GRIPPERS)
    assert empty.lift_fault(GRASP, way([0.0, 0.0, 0.1])) == ""


def test_turning_everything_changes_no_verdict():
    turn = SE3.from_parts(so3.from_rpy(np.array([0.4, -0.3, 1.1])), [0.5, 0.1, 0.2])
    beam = block([0.0, 0.22, 0.30], (0.3, 0.04, 0.04))
    points = np.concatenate([BAR, beam])
    here = Passage(points, BAR, GRIPPERS)
    there = Passage(turn.apply(points), turn.apply(BAR), GRIPPERS)
    lift = way([0.0, 0.0, 0.15])
    assert ("held object" in here.lift_fault(GRASP, lift)) == (
        "held object" in there.lift_fault(GRASP, turn @ lift)
    )


def test_the_fingers_of_a_preshape_get_the_names_of_the_robot(alone):
    robot = RobotModel.load("roman")
    fingers = alone.finger_joints(GRASP)
    held = _on_robot(fingers, robot, "right")
    assert len(held) == len(fingers)
    assert all(name.startswith("right_robotiq_finger_") for name in held)
    assert _on_robot({"no_such_joint": 1.0}, robot, "right") == {}
