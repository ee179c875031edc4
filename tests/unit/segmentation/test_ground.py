from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError
from debrisgrasp.geometry import SE3, Bounds, so3
from debrisgrasp.segmentation import GroundConfig
from debrisgrasp.segmentation.ground import find_ground

from .clouds import TWO_BOXES, box_at, cloud_of, plate, scene_cloud, truth_of

UP = np.array([0.0, 0.0, 1.0])
FLOOR = plate((0.4, 1.6), (-0.6, 0.6), z=0.0, spacing=0.01)


def pile_on(floor, size=0.3):
    """A box of 30 cm, its top and front, on a floor."""
    top = plate((0.9, 0.9 + size), (-size / 2, size / 2), z=size, spacing=0.01)
    front = top[:, [2, 1, 0]] * [0, 1, 1]
    front[:, 0] = 0.9
    front[:, 2] = np.linspace(0.02, size, len(front))
    normals = [
        np.tile(UP, (len(floor) + len(top), 1)),
        np.tile([-1.0, 0, 0], (len(front), 1)),
    ]
    return cloud_of(np.concatenate([floor, top, front]), np.concatenate(normals))


def test_floor_goes_and_objects_stay():
    cloud = scene_cloud(TWO_BOXES)
    truth = truth_of(cloud, TWO_BOXES)
    is_ground, report = find_ground(cloud, GroundConfig())
    assert report.status == "removed"
    assert report.n_removed == is_ground.sum()
    assert np.mean(is_ground[truth == 0]) > 0.999
    high = cloud.points[:, 2] > 0.02
    assert not is_ground[(truth > 0) & high].any()


@pytest.mark.parametrize(("height", "is_doubted"), [(0.0, True), (0.2, False)])
def test_ground_is_not_seen_from_a_viewpoint_on_it(height, is_doubted):
    cloud = replace(pile_on(FLOOR), viewpoint=np.array([0.0, 0.0, height]))
    _, report = find_ground(cloud, GroundConfig())
    assert report.status == "removed"
    assert ("viewpoint" in report.pose_doubt) == is_doubted


def test_a_small_pile_on_a_wide_floor_is_no_reason_to_refuse():
    brick = (box_at(1.0, 0.0, 0.03, (0.2, 0.1, 0.06)),)
    cloud = scene_cloud(brick)
    is_ground, report = find_ground(cloud, GroundConfig())
    assert report.status == "removed"
    assert is_ground.mean() > 0.95


@pytest.mark.parametrize("wide", [66.0, 66.08])
def test_ground_as_wide_as_a_lidar_sees_goes(wide):
    floor = plate((-wide / 2, wide / 2), (-wide / 2, wide / 2), z=0.0, spacing=0.4)
    cloud = pile_on(floor)
    is_ground, report = find_ground(cloud, GroundConfig())
    assert report.status == "removed"
    assert is_ground[: len(floor)].all()
    assert not is_ground[cloud.points[:, 2] > 0.1].any()


@pytest.mark.parametrize(
    ("move", "words"),
    [
        (SE3.from_parts(so3.from_rpy(np.array([0.0, 0.25, 0.0])), [0, 0, 0.25]), "deg"),
        (SE3.from_parts(np.eye(3), [0, 0, 0.06]), "mm from the expected"),
    ],
    ids=["tilted", "raised"],
)
def test_a_plane_that_is_not_where_it_is_expected_stays(move, words):
    cloud = pile_on(FLOOR).in_frame(move, "base")
    is_ground, report = find_ground(cloud, GroundConfig())
    assert report.status == "skipped"
    assert words in report.reason
    assert not is_ground.any()


def test_tilt_and_height_within_bounds_are_followed():
    move = SE3.from_parts(so3.from_rpy(np.array([0.03, 0.02, 0.0])), [0, 0, 0.02])
    cloud = pile_on(FLOOR).in_frame(move, "base")
    is_ground, report = find_ground(cloud, GroundConfig())
    assert report.status == "removed"
    assert report.tilt == pytest.approx(np.hypot(0.03, 0.02), abs=3e-3)
    assert is_ground[: len(FLOOR)].all()


@pytest.mark.parametrize("height", [0.02, 0.4])
def test_ground_on_a_slope_is_not_called_level(height):
    turn = so3.from_rpy(np.array([0.0, np.deg2rad(8.0), 0.0]))
    move = SE3.from_parts(turn, [0.0, 0.0, height + np.tan(np.deg2rad(8.0))])
    _, report = find_ground(pile_on(FLOOR).in_frame(move, "base"), GroundConfig())
    said = report.pose_doubt or report.reason
    assert "8 deg" in said
    assert "level" not in said


def test_uneven_ground_goes_too():
    x, y, _ = FLOOR.T
    floor = FLOOR.copy()
    floor[:, 2] = 0.022 * np.sin(2 * np.pi * x / 1.2) * np.cos(2 * np.pi * y / 1.4)
    is_ground, report = find_ground(pile_on(floor), GroundConfig())
    assert report.status == "removed"
    assert np.mean(is_ground[: len(floor)]) > 0.97


def test_low_things_do_not_lift_the_ground():
    board = plate((0.85, 1.15), (-0.3, 0.3), z=0.025, spacing=0.01)
    hidden = (np.abs(FLOOR[:, 1]) < 0.3) & (np.abs(FLOOR[:, 0] - 1.0) < 0.15)
    points = np.concatenate([FLOOR[~hidden], board])
    is_ground, report = find_ground(cloud_of(points, UP), GroundConfig())
    assert report.status == "removed"
    assert is_ground[-len(board) :].mean() < 0.05


@pytest.mark.parametrize("height", [0.08, 0.12])
def test_a_kerb_does_not_tilt_the_ground_beside_it(height):
    kerb = box_at(1.5, 1.3, height / 2, (4.0, 2.0, height))
    cloud = scene_cloud((*TWO_BOXES, kerb))
    is_ground, report = find_ground(cloud, GroundConfig())
    assert report.status == "removed"
    assert report.tilt < np.deg2rad(0.5)
    street = truth_of(cloud, (*TWO_BOXES, kerb)) == 0
    assert np.mean(is_ground[street]) > 0.99


def test_a_little_ground_is_not_enough_evidence():
    corner = FLOOR[(FLOOR[:, 0] < 0.6) & (FLOOR[:, 1] < 0.0)]
    high = plate((0.6, 1.6), (-0.6, 0.6), z=0.5, spacing=0.01)
    cloud = cloud_of(np.concatenate([corner, high]), UP)
    _, report = find_ground(cloud, GroundConfig())
    assert report.status == "skipped"
    assert "points lie on the ground" in report.reason


def test_a_little_ground_exactly_where_it_should_be_goes():
    # A field of blocks that leaves little of the floor to see.
    strip = FLOOR[FLOOR[:, 1] < -0.35]
    blocks = plate((0.4, 1.6), (-0.34, 0.6), z=0.3, spacing=0.007)
    cloud = cloud_of(np.concatenate([strip, blocks]), UP)
    is_ground, report = find_ground(cloud, GroundConfig())
    assert 0.1 < report.inlier_share < 0.25
    assert report.status == "removed"
    np.testing.assert_array_equal(np.flatnonzero(is_ground), np.arange(len(strip)))
    lifted = cloud_of(cloud.points + np.array([0.0, 0.0, 0.03]), UP)
    assert find_ground(lifted, GroundConfig())[1].status == "skipped"


def test_nothing_but_ground_stays():
    _, report = find_ground(cloud_of(FLOOR, UP), GroundConfig())
    assert report.status == "skipped"
    assert "would be left" in report.reason


def test_a_plane_that_eats_what_stands_on_it_stays(rng):
    # Rubble all over: specks that rise out of the slab everywhere.
    specks = FLOOR[rng.random(len(FLOOR)) < 0.2] + [0.0, 0.0, 0.05]
    cloud = cloud_of(np.concatenate([FLOOR, specks]), UP)
    coarse = GroundConfig(max_removed_share=0.5)
    region = Bounds(np.array([0.4, -0.6, -0.1]), np.array([1.6, 0.6, 0.3]))
    _, report = find_ground(cloud, coarse, inside=region.contains(cloud.points))
    assert report.status == "skipped"
    assert "region of interest" in report.reason


def test_cropped_clouds_keep_their_ground():
    _, report = find_ground(pile_on(FLOOR), GroundConfig(), is_cropped=True)
    assert report.status == "skipped"
    assert "cropped" in report.reason


def test_unknown_normals_do_not_hide_the_ground():
    cloud = pile_on(FLOOR)
    cloud = cloud_of(cloud.points)
    assert find_ground(cloud, GroundConfig())[1].status == "removed"


@pytest.mark.parametrize("thickness", [0.015, 0.025, 0.04])
@pytest.mark.parametrize("noise", [0.0, 0.004], ids=["clean", "noisy"])
@pytest.mark.parametrize("size", [(0.14, 0.4), (0.36, 0.8)], ids=["narrow", "wide"])
def test_thin_boards_that_lie_flat_stay(thickness, noise, size, rng):
    floor = plate((0.2, 1.8), (-0.8, 0.8), z=0.0, spacing=0.005)
    under = (np.abs(floor[:, :2] - [1.0, 0.0]) < np.array(size) / 2).all(axis=1)
    floor[under, 2] = thickness
    floor[:, 2] += rng.normal(0, noise, len(floor))
    is_ground, report = find_ground(
        cloud_of(np.concatenate([floor, box_points()]), UP), GroundConfig()
    )
    assert report.status == "removed"
    assert is_ground[: len(floor)][under].mean() < 0.2
    assert is_ground[: len(floor)][~under].mean() > 0.98


def test_a_lattice_of_thin_rods_does_not_keep_the_ground_under_it():
    # Rods of 2 cm seen from above, 15 cm apart: most of what lies in the blocks of
    # 4 cm that they run through is ground.
    floor = plate((0.4, 1.6), (-0.6, 0.6), z=0.0, spacing=0.004)
    from_rod = np.abs(floor[:, :2] % 0.15 - 0.075).min(axis=1)
    is_inside = (np.abs(floor[:, :2] - [1.0, 0.0]) < [0.3, 0.2]).all(axis=1)
    is_rod = is_inside & (from_rod < 0.008)
    floor[is_rod, 2] = 0.02
    is_ground, report = find_ground(cloud_of(floor, UP), GroundConfig())
    assert 0.6 < report.removed_share < 0.75
    assert report.status == "removed"
    assert is_ground[~is_rod].all()
    assert not is_ground[is_rod].any()


def test_a_thin_rod_alone_does_not_keep_the_floor_around_it():
    floor = plate((0.4, 1.6), (-0.6, 0.6), z=0.0, spacing=0.004)
    is_rod = (np.abs(floor[:, 1]) < 0.005) & (np.abs(floor[:, 0] - 1.0) < 0.4)
    floor[is_rod, 2] = 0.018
    cloud = cloud_of(floor, UP)
    is_ground, report = find_ground(cloud, GroundConfig(min_left=100))
    assert report.removed_share > 0.75
    assert report.status == "removed"
    np.testing.assert_array_equal(is_ground, ~is_rod)


def test_specks_that_rise_all_over_keep_the_plane_that_they_rise_from(rng):
    floor = plate((0.4, 1.6), (-0.6, 0.6), z=0.0, spacing=0.003)
    is_speck = rng.random(len(floor)) < 0.1
    floor[is_speck, 2] = 0.05
    is_ground, report = find_ground(cloud_of(floor, UP), GroundConfig())
    assert "region of interest" in report.reason
    assert not is_ground.any()


def box_points():
    """Top of something that stands beside."""
    return plate((0.4, 0.6), (-0.7, -0.5), z=0.2, spacing=0.005)


@pytest.mark.parametrize("least", [0.01, 0.03, 0.06])
def test_a_crop_that_left_only_the_pile_loses_nothing_of_it(least):
    # The fault of the paper's field test: without the floor in view, a plane fitted to
    # what is left goes through the pile, and takes it away.
    low = box_at(1.0, 0.0, 0.02, (0.5, 0.5, 0.04))
    solids = (low, box_at(1.0, 0.0, 0.14, (0.14, 0.14, 0.2), yaw=0.2))
    cloud = scene_cloud(solids)
    truth = truth_of(cloud, solids)
    pile = cloud.selected((truth > 0) & (cloud.points[:, 2] > least))
    is_ground, report = find_ground(pile, GroundConfig())
    assert report.status == "skipped"
    assert not is_ground.any()
    assert report.reason


@pytest.mark.parametrize(
    "settings",
    [
        {"max_tilt": 0.0},
        {"clearance": -1.0},
        {"min_inlier_share": 1.5},
        {"max_removed_share": -0.1},
        {"min_left": -1},
    ],
)
def test_settings_out_of_range_are_refused(settings):
    with pytest.raises(ConfigError):
        GroundConfig(**settings)
