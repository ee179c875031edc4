"""Ways in and out of grasps, against the hand's own solids; and the ledger."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError, UnknownNameError
from debrisgrasp.geometry import SE3, Bounds, PointCloud, so3
from debrisgrasp.geometry.sight import PanoramicSight
from debrisgrasp.planning.approach import ApproachConfig, Ways
from debrisgrasp.planning.hands import PackedHands
from debrisgrasp.planning.inspection import InspectionConfig, Inspector
from debrisgrasp.planning.ledger import Ledger, Rejections
from debrisgrasp.planning.scene import GraspScene, SceneConfig
from debrisgrasp.prototypes import PrototypeLibrary

CONFIG = ApproachConfig()
TOP_DOWN = so3.from_rpy(np.array([np.pi, 0.0, 0.0]))
GRIP = SE3.from_parts(TOP_DOWN, [0.0, 0.0, 0.30])
NAME = "cylinder_060_tip"


@pytest.fixture(scope="module")
def library() -> PrototypeLibrary:
    return PrototypeLibrary.load().select(names=[NAME])


@pytest.fixture(scope="module")
def hands(library) -> PackedHands:
    return PackedHands.pack(library, approach=0.12, tolerance=0.004)


def patch(center, size, spacing=0.008) -> np.ndarray:
    """Points of a level rectangle."""
    x, y = (np.arange(-s / 2, s / 2 + 1e-9, spacing) for s in size)
    grid = np.stack(np.meshgrid(x, y, [0.0], indexing="ij"), axis=-1)
    return grid.reshape(-1, 3) + center


def scene_with(*obstacles: np.ndarray) -> GraspScene:
    """A pipe along y under the palm, and other things."""
    angle = np.linspace(0, np.pi, 9)
    round_ = np.stack([0.03 * np.cos(angle), 0 * angle, 0.03 * np.sin(angle)], -1)
    along = np.arange(-0.2, 0.2, 0.008)[:, None, None] * np.array([0.0, 1.0, 0.0])
    pipe = (round_ + along).reshape(-1, 3) + np.array([0.0, 0.0, 0.16])
    points = np.concatenate([pipe, *obstacles])
    cloud = PointCloud(points, np.full(points.shape, np.nan), np.array([-1.0, 0, 1.0]))
    is_object = np.arange(len(points)) < len(pipe)
    region = Bounds.around(pipe, 0.05)
    sight = PanoramicSight.from_cloud(cloud)
    return GraspScene.build(cloud, is_object, region, sight, SceneConfig())


def way_of(scene, hands, config=CONFIG, T=GRIP) -> np.ndarray:
    ways = Ways(scene, hands, config, InspectionConfig())
    return ways.approaches(T.matrix[None], np.zeros(1, dtype=int))[0]


def test_a_stand_off_leaves_room_for_an_error_of_the_hand(hands):
    """A wall beside the way, near to the palm where it starts from."""
    ways = Ways(scene_with(), hands, CONFIG, InspectionConfig())
    poses, which = GRIP.matrix[None], np.zeros(1, dtype=int)
    free = ways.approaches(poses, which)
    assert np.allclose(ways.roomy(poses, which, free), free)
    side = np.array([[0.0, y, z] for y in np.arange(-0.1, 0.1, 0.004)
                     for z in np.arange(0.42, 0.6, 0.004)])  # fmt: skip
    for gap in np.arange(0.2, 0.0, -0.004):
        scene = scene_with(side + np.array([gap, 0.0, 0.0]))
        ways = Ways(scene, hands, CONFIG, InspectionConfig())
        beside = ways.approaches(poses, which)
        if not np.allclose(beside, free):
            break
        wide = ways.roomy(poses, which, beside)
    assert CONFIG.shortest <= np.linalg.norm(wide) < np.linalg.norm(free) - 0.01
    assert np.allclose(np.cross(wide, free), 0.0)


def touched(scene, library, offset, T=GRIP) -> int:
    """Points more than 6 mm inside the hand's solids anywhere on a way in."""
    prototype = library[NAME]
    hand = library.grippers[prototype.gripper]
    solids = hand.solids(prototype.preshape, prototype.opening)
    hits = set()
    for share in np.linspace(0, 1, 33):
        pose = SE3.from_parts(p=share * offset) @ T
        local = pose.inverse().apply(scene.cloud.points)
        depth = np.min([solid.signed_distance(local) for solid in solids], axis=0)
        hits |= set(np.flatnonzero(depth < -0.006).tolist())
    return len(hits)


def test_a_free_grasp_is_approached_straight_from_the_largest_stand_off(hands):
    assert way_of(scene_with(), hands) == pytest.approx([0.0, 0.0, CONFIG.longest])


def test_a_roof_over_the_hand_shortens_the_way(hands, library):
    roof = patch([0.0, 0.0, 0.53], (0.3, 0.3))
    scene = scene_with(roof)
    offset = way_of(scene, hands)
    assert offset[:2] == pytest.approx([0.0, 0.0])
    assert CONFIG.shortest <= offset[2] < CONFIG.longest
    assert touched(scene, library, offset) <= InspectionConfig().max_hits


def test_a_beam_over_one_side_makes_the_hand_come_from_the_other(hands, library):
    beam = patch([0.09, 0.0, 0.452], (0.1, 0.4))
    scene = scene_with(beam)
    assert touched(scene, library, np.array([0.0, 0.0, 0.06])) > 1
    offset = way_of(scene, hands)
    assert np.linalg.norm(offset) >= CONFIG.shortest - 1e-9
    assert offset[0] < 0
    assert touched(scene, library, offset) <= InspectionConfig().max_hits


def test_a_hand_that_is_locked_in_has_no_way(hands):
    roof = patch([0.0, 0.0, 0.448], (0.5, 0.5))
    assert not way_of(scene_with(roof), hands).any()


def test_the_inspection_forgives_a_blocked_approach_only_where_another_is_free(hands):
    Ts, which = GRIP.matrix[None], np.zeros(1, dtype=int)
    for obstacle, is_forgiven in (
        (patch([0.09, 0.0, 0.452], (0.1, 0.4)), True),
        (patch([0.0, 0.0, 0.448], (0.5, 0.5)), False),
    ):
        scene = scene_with(obstacle)
        look = Inspector(scene, hands)(Ts, which)
        assert look.reasons(InspectionConfig())["the approach is blocked"].all()
        assert look.amount("the approach is blocked") is look.approach_hits
        assert set(look.reasons(InspectionConfig())) >= {"the palm would hit something"}
        ways = Ways(scene, hands, CONFIG, InspectionConfig())
        reasons = ways.relieved(look, Ts, which).reasons(InspectionConfig())
        assert reasons["the approach is blocked"].all() != is_forgiven


@pytest.mark.parametrize("gap", [0.002, 0.009, 0.02, 0.06])
def test_the_margin_is_the_distance_to_the_nearest_thing(gap, hands, library):
    prototype = library[NAME]
    hand = library.grippers[prototype.gripper]
    solids = hand.solids(prototype.preshape, prototype.opening)
    side = max(solid.moved(GRIP).bounds.upper[0] for solid in solids)
    wall = patch([0.0, 0.0, 0.0], (0.6, 0.4))[:, [2, 1, 0]] + [side + gap, 0.0, 0.25]
    look = Inspector(scene_with(wall), hands)(GRIP.matrix[None], np.zeros(1, dtype=int))
    alone = Inspector(scene_with(), hands)(GRIP.matrix[None], np.zeros(1, dtype=int))
    # A solid counts from its tolerance on; cells and thinned points blur it.
    expected = min(gap + 0.004, alone.margin[0])
    assert look.margin[0] == pytest.approx(expected, abs=0.0065)


def test_ground_that_a_hand_comes_down_on_leaves_its_margin(hands):
    def margin(*floor: np.ndarray, T: SE3 = GRIP, height: float = 0.0) -> float:
        scene = scene_with(*floor)
        plane = np.array([0.0, 0.0, 1.0, -height])
        scene = replace(scene, ground_plane=plane if floor else None)
        look = Inspector(scene, hands)(T.matrix[None], np.zeros(1, dtype=int))
        return float(look.margin[0])

    low = 0.165
    floor = patch([0.0, 0.0, low], (0.5, 0.5))
    assert margin(floor, height=low) == margin()
    # The same points, but the ground lies far below them.
    assert margin(floor, height=-1.0) < margin()
    # Nor is it spared by a hand that comes along the ground.
    level = so3.from_rpy(np.array([0.0, np.pi / 2, 0.0]))
    along = SE3.from_parts(level, [-0.14, 0.0, 0.175])
    floor = patch([-0.1, 0.0, 0.09], (0.6, 0.5))
    beside = margin(floor, T=along, height=0.09)
    assert beside == margin(floor, T=along, height=-1.0) < margin(T=along)


def test_a_hand_that_comes_down_does_not_close_on_the_ground_between_its_fingers(hands):
    def look(height: float):
        # Right below the pipe, above the fingertips.
        low = 0.182
        scene = scene_with(patch([0.0, 0.0, low], (0.5, 0.5)))
        scene = replace(scene, ground_plane=np.array([0.0, 0.0, 1.0, -low - height]))
        return Inspector(scene, hands)(GRIP.matrix[None], np.zeros(1, dtype=int))

    ground, floor = look(0.0), look(-0.1)
    assert ground.foreign[0] == 0 < floor.foreign[0]
    assert ground.swept_hits[0] <= floor.swept_hits[0]
    # What the open fingers stand in counts all the same.
    assert ground.finger_hits[0] == floor.finger_hits[0] > 0


def test_a_neighbour_beside_the_hand_ends_its_retreat_there(hands):
    wall = patch([0.0, 0.0, 0.0], (0.3, 0.4))[:, [2, 1, 0]] + [0.25, 0.0, 0.25]
    ways = Ways(scene_with(wall), hands, CONFIG, InspectionConfig())
    directions = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    free = ways.retreats(GRIP.matrix[None], np.zeros(1, dtype=int), directions, 0.2)[0]
    assert free[0] < 0.2
    assert free[1:] == pytest.approx([0.2, 0.2])


def test_turning_scene_and_grasp_turns_the_way(hands):
    beam = patch([0.09, 0.0, 0.452], (0.1, 0.4))
    turn = SE3.from_parts(so3.from_rpy(np.array([0.0, 0.0, np.pi / 2])))
    here = scene_with(beam)
    cloud = here.cloud.in_frame(turn, "base")
    region = Bounds.around(cloud.points[here.is_target], 0.05)
    sight = PanoramicSight.from_cloud(cloud)
    there = GraspScene.build(cloud, here.is_target, region, sight, SceneConfig())
    offset = way_of(there, hands, T=turn @ GRIP)
    assert offset == pytest.approx(turn.rotate(way_of(here, hands)), abs=1e-6)


def test_settings_out_of_range_are_refused():
    with pytest.raises(ConfigError, match="longest"):
        ApproachConfig(longest=0.05, shortest=0.06)
    with pytest.raises(ConfigError, match="slants"):
        ApproachConfig(slants=(0.2, 2.0))


@pytest.mark.parametrize(
    ("word", "meant"),
    [("too hevy", "too heavy"), ("Palm would", "palm would"), ("nevr", "never")],
)
def test_a_misspelt_reason_is_no_empty_answer(word, meant):
    ledger, one = Ledger(), np.ones(1, dtype=bool)
    Ts, which = np.eye(4)[None], np.zeros(1, dtype=int)
    ledger.add("the palm would hit something", Ts, which, one)
    ledger.add("right_arm: too heavy", Ts, which, one)
    ledger.add("never", Ts, which, ~one)
    found = ledger.closed()
    with pytest.raises(UnknownNameError, match=f"'{word}'.*palm would.*mean '{meant}'"):
        found.because(word)
    # An arm that ruled out nothing, and a reason of an arm of one's own.
    for other in ("left_arm", "right_arm2", "singular"):
        assert len(found.because(other)) == 0
    assert len(Rejections().because(word)) == 0


def test_the_ledger_counts_what_was_noted_and_finds_it_again():
    ledger, Ts = Ledger(), np.tile(np.eye(4), (4, 1, 1))
    Ts[:, 0, 3] = range(4)
    which = np.array([7, 8, 9, 7])
    ledger.add("the palm would hit something", Ts, which, np.array([0, 0, 1, 1], bool))
    ledger.add("too heavy", Ts, which, np.array([1, 0, 0, 0], bool), 3.0 * which)
    ledger.add("the palm would hit something", Ts, which, np.array([0, 1, 0, 0], bool))
    ledger.add("never", Ts, which, np.zeros(4, bool))
    found = ledger.closed()
    assert found.counts() == {"the palm would hit something": 3, "too heavy": 1}
    (row,) = found.because("heavy")
    assert (found.prototype[row], found.amount[row]) == (7, 21.0)
    assert found.Ts[found.because("palm"), 0, 3].tolist() == [2, 3, 1]
    assert np.isnan(found.amount[found.because("palm")]).all()
    assert found.reasons[-1] == "never"
    assert len(found.because("never")) == 0
    assert len(Rejections()) == 0
    assert Ledger().closed().counts() == {}
