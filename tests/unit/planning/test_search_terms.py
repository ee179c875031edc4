"""S and C on exact scenes: known answers, laws, and the traps of the paper's terms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from debrisgrasp.errors import (
    CaptureError,
    ConfigError,
    FrameMismatchError,
    InputError,
    ShapeError,
)
from debrisgrasp.geometry import SE3, Bounds, Box, DepthSight, PointCloud, so3
from debrisgrasp.io import Capture
from debrisgrasp.planning import PlannerConfig
from debrisgrasp.planning.approach import ApproachConfig
from debrisgrasp.planning.clearance import ClearanceConfig, HandClearance
from debrisgrasp.planning.hand_space import HandSpace
from debrisgrasp.planning.hands import PackedHands
from debrisgrasp.planning.inspection import InspectionConfig, Inspector
from debrisgrasp.planning.scene import GraspScene, SceneConfig
from debrisgrasp.planning.similarity import ShapeSimilarity, SimilarityConfig
from debrisgrasp.planning.surfaces import VisibleSurfaces
from debrisgrasp.planning.tools import blurred
from debrisgrasp.prototypes import PrototypeLibrary
from tests.scenes import CAMERA, LOOKING_DOWN_AND_AHEAD, capture_of, lying_pipe

few = settings(max_examples=8, deadline=None)
seeds = st.integers(0, 2**32 - 1)
PIPE = lying_pipe()
TOP_DOWN = SE3.from_parts(so3.from_rpy(np.array([np.pi, 0.0, 0.0])))
"""Palm facing down, fingers spread along -y of the base: across no pipe along y."""


@pytest.fixture(scope="module")
def library() -> PrototypeLibrary:
    return PrototypeLibrary.load().select(names=["cylinder_060_tip"])


@pytest.fixture(scope="module")
def hands(library) -> PackedHands:
    return PackedHands.pack(library, approach=0.12, tolerance=0.004)


def scene_of(capture, is_object=None, belongs=None) -> GraspScene:
    cloud = capture.cloud()
    sight = DepthSight(capture.depth.astype(np.float32), CAMERA, capture.T_base_camera)
    if is_object is None:
        is_object = cloud.points[:, 2] > 0.02
    region = Bounds.around(cloud.points[is_object], 0.05)
    floor = np.array([0.0, 0.0, 1.0, 0.0])
    return GraspScene.build(
        *(cloud, is_object, region, sight, SceneConfig()),
        ground_plane=floor,
        belongs=belongs,
    )


@pytest.fixture(scope="module")
def capture() -> Capture:
    return capture_of([PIPE])


@pytest.fixture(scope="module")
def scene(capture) -> GraspScene:
    return scene_of(capture)


def good_pose(library, along: float = 0.0) -> SE3:
    """Palm above the pipe, so that the prototype's cylinder lies on the pipe's axis."""
    prototype = next(iter(library))
    depth = prototype.definition.T_hand_shape.p[2]
    return SE3.from_parts(TOP_DOWN.R, [0.9, along, 0.2 + depth])


def similarity_of(scene, library, Ts: SE3) -> np.ndarray:
    surfaces = VisibleSurfaces.pack(library.packed(), 80)
    S = ShapeSimilarity(scene, surfaces, SimilarityConfig())
    matrices = np.atleast_3d(Ts.matrix).reshape(-1, 4, 4)
    return S(matrices, np.zeros(len(matrices), dtype=int))[0]


def test_prototype_on_its_own_shape_scores_high(scene, library):
    assert similarity_of(scene, library, good_pose(library))[0] > 0.85


def test_similarity_falls_as_the_prototype_leaves_the_surface(scene, library):
    good = good_pose(library)
    lifted = [
        good.matrix + 0.01 * k * np.eye(4)[2][:, None] * np.eye(4)[3] for k in range(6)
    ]
    scores = similarity_of(scene, library, SE3(np.array(lifted)))
    assert (np.diff(scores) < 0).all()
    assert scores[-1] < 0.2


def test_a_pose_that_nothing_is_seen_of_scores_zero(scene, library):
    behind_the_camera = SE3.from_parts(TOP_DOWN.R, [-2.0, 0.0, 3.0])
    assert similarity_of(scene, library, behind_the_camera)[0] == 0.0


def test_seen_through_space_counts_against_a_match(scene, library):
    """Half beyond the end of the pipe, half of the points hang in free space."""
    middle, end = good_pose(library), good_pose(library, along=0.3)
    scores = similarity_of(scene, library, SE3(np.stack([middle.matrix, end.matrix])))
    assert scores[1] < 0.75 * scores[0]


def test_points_of_other_objects_do_not_match(library):
    capture = capture_of([PIPE])
    nothing_marked_there = capture.cloud().points[:, 1] > 0.25
    scene = scene_of(capture, nothing_marked_there)
    assert similarity_of(scene, library, good_pose(library))[0] < 0.05


@given(
    turn=st.floats(-np.pi, np.pi),
    shift=st.tuples(*(st.floats(-2.0, 2.0) for _ in range(3))),
)
@few
def test_moving_scene_and_camera_together_changes_no_score(
    capture, scene, library, turn, shift
):
    motion = SE3.from_parts(so3.from_rpy(np.array([0.0, 0.0, turn])), shift)
    pose = good_pose(library, 0.05)
    cloud = capture.cloud()
    moved = PointCloud(
        motion.apply(cloud.points),
        motion.rotate(cloud.normals),
        motion.apply(cloud.viewpoint),
        pixels=cloud.pixels,
        image_shape=cloud.image_shape,
    )
    is_object = cloud.points[:, 2] > 0.02
    sight = DepthSight(
        capture.depth.astype(np.float32), CAMERA, motion @ capture.T_base_camera
    )
    region = Bounds.around(moved.points[is_object], 0.05)
    elsewhere = GraspScene.build(moved, is_object, region, sight, SceneConfig())
    here = similarity_of(scene, library, pose)
    there = similarity_of(elsewhere, library, motion @ pose)
    # The grid stands still while the scene turns in it: thinning keeps other points.
    assert there == pytest.approx(here, abs=0.08)


@given(seeds)
@few
def test_order_of_the_points_is_irrelevant(capture, scene, library, seed):
    cloud = capture.cloud()
    order = np.random.default_rng(seed).permutation(len(cloud))
    sight = DepthSight(capture.depth.astype(np.float32), CAMERA, capture.T_base_camera)
    is_object = cloud.points[:, 2] > 0.02
    region = Bounds.around(cloud.points[is_object], 0.05)
    shuffled = GraspScene.build(
        cloud.selected(order), is_object[order], region, sight, SceneConfig()
    )
    poses = SE3(np.stack([good_pose(library, y).matrix for y in (-0.1, 0.0, 0.1)]))
    expected = similarity_of(scene, library, poses)
    # Among points of one cell the first is looked up, and that is another one now.
    assert similarity_of(shuffled, library, poses) == pytest.approx(expected, abs=0.04)


@given(seeds, st.lists(st.integers(0, 64), max_size=6))
@few
def test_scores_of_a_batch_are_those_of_its_parts(scene, hands, library, seed, cuts):
    twists = np.random.default_rng(seed).normal(0, 0.05, (64, 6))
    Ts = (good_pose(library) @ SE3.exp(twists)).matrix
    C = HandClearance(scene, hands, ClearanceConfig())
    inspector = Inspector(scene, hands)

    def scores(some):
        which = np.zeros(len(some), dtype=int)
        look = inspector(some, which)
        return np.stack(
            [
                similarity_of(scene, library, SE3(some)),
                C(some, which, np.zeros(len(some))),
                look.margin,
                look.palm_hits,
                look.finger_hits,
                look.approach_hits,
                look.held,
            ]
        )

    parts = [part for part in np.split(Ts, sorted(cuts)) if len(part)]
    together = scores(Ts)
    assert np.array_equal(together, np.concatenate(list(map(scores, parts)), axis=1))
    assert ((together[:2] >= 0) & (together[:2] <= 1)).all()


def clearance_of(scene, hands, pose: SE3) -> float:
    C = HandClearance(scene, hands, ClearanceConfig(unknown_cost=0.0))
    return float(C(pose.matrix[None], np.zeros(1, dtype=int), np.zeros(1))[0])


def test_open_hand_around_the_pipe_is_clear(scene, hands, library):
    assert clearance_of(scene, hands, good_pose(library)) > 0.9


def test_hand_in_the_floor_collides(scene, hands):
    sunk = SE3.from_parts(TOP_DOWN.R, [0.72, 0.0, 0.05])
    assert clearance_of(scene, hands, sunk) == 0.0


def test_a_wall_in_the_way_in_blocks_an_approach_that_ends_clear(hands):
    sideways = so3.from_rpy(np.array([0.0, np.pi / 2, 0.0]))
    pose = SE3.from_parts(sideways, [0.75, 0.0, 0.5])
    # The palm stands 0.11 m behind its face and comes from 0.12 m farther back.
    wall = Box(np.array([0.004, 0.06, 0.06]), SE3.from_parts(p=[0.56, 0.0, 0.5]))
    free = capture_of([PIPE], has_floor=False)
    blocked = capture_of([PIPE, wall], has_floor=False)
    assert clearance_of(scene_of(free), hands, pose) > 0.9
    only_pipe = PIPE.signed_distance(blocked.cloud().points) < 0.01
    scene = scene_of(blocked, only_pipe)
    assert clearance_of(scene, hands, pose) < 0.5
    look = Inspector(scene, hands)(pose.matrix[None], np.zeros(1, dtype=int))
    assert look.approach_hits[0] > 20
    assert look.palm_hits[0] + look.finger_hits[0] == 0


def test_inspection_names_what_is_wrong(scene, hands, library):
    good = good_pose(library)
    lowered, beside, above = (
        SE3.from_parts(good.R, good.p + np.array(shift))
        for shift in ((0, 0, -0.1), (0.07, 0, 0), (0, 0, 0.3))
    )
    Ts = np.stack([pose.matrix for pose in (good, lowered, beside, above)])
    look = Inspector(scene, hands)(Ts, np.zeros(4, dtype=int))
    reasons = look.reasons(InspectionConfig())
    assert not any(applies[0] for applies in reasons.values())
    assert reasons["the palm would hit something"][1]
    assert reasons["an open finger would hit something"][2]
    assert reasons["nothing is between the fingers"][3]
    assert sum(applies.astype(int) for applies in reasons.values()).max() == 1


def test_neighbour_between_the_fingers_is_foreign(library, hands):
    neighbour = lying_pipe(radius=0.012, position=(0.945, 0.0, 0.2))
    capture = capture_of([PIPE, neighbour])
    points = capture.cloud().points
    is_pipe = PIPE.signed_distance(points) < 0.005
    look = Inspector(scene_of(capture, is_pipe), hands)(
        good_pose(library).matrix[None],
        np.zeros(1, dtype=int),
    )
    assert look.foreign[0] > 5
    assert look.held[0] > 20


def test_the_rest_of_a_marked_object_is_neither_held_nor_foreign(library, hands):
    capture = capture_of([PIPE])
    points = capture.cloud().points
    is_pipe = PIPE.signed_distance(points) < 0.005
    scene = scene_of(capture, is_pipe & (points[:, 1] > 0.0), is_pipe.astype(float))
    poses = np.stack([good_pose(library, along).matrix for along in (0.1, -0.1)])
    look = Inspector(scene, hands)(poses, np.zeros(2, dtype=int))
    assert look.held[0] > 20
    assert look.held[1] == 0
    assert look.own[1] > 20
    assert look.foreign.tolist() == [0, 0]
    reasons = look.reasons(InspectionConfig())
    assert reasons["nothing is between the fingers"].tolist() == [False, True]


def test_flags_of_the_hand_agree_with_its_solids(library, hands, rng):
    prototype = next(iter(library))
    gripper = library.grippers[prototype.gripper]
    solids = gripper.solids(prototype.preshape, prototype.opening)
    points = rng.uniform([-0.15, -0.12, -0.14], [0.15, 0.12, 0.14], (20000, 3))
    depth = -np.min([s.signed_distance(points) for s in solids], axis=0)
    homogeneous = np.append(points, np.ones((len(points), 1)), axis=1)
    met, _, row = hands.spaces.marked(
        homogeneous.T.astype(np.float32),
        np.eye(4, dtype=np.float32)[None],
        np.zeros(1, int),
    )
    flags = np.zeros(len(points), dtype=np.uint8)
    flags[row] = met
    is_inside = (flags & (HandSpace.PALM | HandSpace.FINGER)) > 0
    half_diagonal = 0.0035
    assert is_inside[depth > 0.004 + half_diagonal].all()
    assert not is_inside[depth < 0.004 - half_diagonal].any()


def test_scene_without_a_point_of_the_object_is_refused():
    capture = capture_of([PIPE])
    cloud = capture.cloud()
    sight = DepthSight(capture.depth.astype(np.float32), CAMERA, capture.T_base_camera)
    nowhere = Bounds(np.array([5.0, 5.0, 5.0]), np.array([6.0, 6.0, 6.0]))
    everything = np.ones(len(cloud), dtype=bool)
    with pytest.raises(CaptureError, match="region"):
        GraspScene.build(cloud, everything, nowhere, sight, SceneConfig())
    region = Bounds.around(cloud.points)
    with pytest.raises(ShapeError, match="object mask"):
        GraspScene.build(cloud, everything[:-1], region, sight, SceneConfig())
    in_camera = cloud.in_frame(LOOKING_DOWN_AND_AHEAD.inverse(), "camera")
    with pytest.raises(FrameMismatchError):
        GraspScene.build(in_camera, everything, region, sight, SceneConfig())


def test_what_was_seen_of_an_object_may_go_beyond_the_region_and_the_object(capture):
    cloud = capture.cloud()
    sight = DepthSight(capture.depth.astype(np.float32), CAMERA, capture.T_base_camera)
    belongs = np.where(cloud.points[:, 2] > 0.02, 1.0, 0.0)
    is_left = (belongs > 0) & (cloud.points[:, 1] > 0.0)
    region = Bounds.around(cloud.points[is_left], 0.0)
    alone, wide, unsure = (
        GraspScene.build(cloud, is_left, region, sight, SceneConfig(), belongs=share)
        for share in (None, belongs, np.where(is_left, 1.0, 0.4 * belongs))
    )
    assert (alone.surface.belongs == 1.0).all()
    assert alone.surface.points[:, 1].min() >= 0.0
    for scene in (wide, unsure):
        assert scene.surface.points[:, 1].min() < -0.1
        assert np.array_equal(scene.cloud.points, alone.cloud.points)
        assert len(scene.surface.goes_on) == len(scene.surface.points)
    is_sure = unsure.surface.belongs == 1.0
    assert (unsure.surface.points[is_sure, 1] > 0.0).all()
    assert set(unsure.surface.belongs[~is_sure]) == {0.4}
    with pytest.raises(ShapeError, match="belongs"):
        GraspScene.build(
            cloud, is_left, region, sight, SceneConfig(), belongs=belongs[1:]
        )


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"truncation": 0.02}, "truncation: got 0.02, expected 0.03 to 0.07"),
        ({"spacing": 0.005}, "truncation: got 0.05, expected 0.03 to 0.035"),
        ({"spacing": 0.003, "truncation": 0.02}, "spacing: got 0.003, expected 0.0042"),
    ],
)
def test_distances_known_less_far_than_the_hands_spheres_reach_are_refused(
    fields, said
):
    with pytest.raises(ConfigError, match=said):
        SceneConfig(**fields)
    SceneConfig(spacing=0.005, truncation=0.035)


@pytest.mark.parametrize(
    ("name", "fields"),
    [
        ("clearance.approach", {"clearance": ClearanceConfig(approach=0.31)}),
        ("approach.longest", {"approach": ApproachConfig(longest=0.31)}),
        ("clearance.approach", {"scene": SceneConfig(hand_reach=0.1)}),
    ],
)
def test_ways_that_lead_out_of_the_scene_are_refused(name, fields):
    with pytest.raises(ConfigError, match=rf"{name}: got .*scene\.hand_reach"):
        PlannerConfig(**fields)
    PlannerConfig(**fields | {"scene": SceneConfig(hand_reach=0.4)})


def test_ground_of_endless_roughness_is_refused():
    with pytest.raises(ConfigError, match=r"SceneConfig\.ground_roughness"):
        SceneConfig(ground_roughness=np.inf)


@pytest.mark.parametrize(
    "fields",
    [
        {"search_points": 5},
        {"final_points": 5},
        {"similarity": SimilarityConfig(minimum_seen=25)},
    ],
)
def test_fewer_points_than_a_match_needs_are_refused(fields):
    with pytest.raises(ConfigError, match=r"_points: got .*similarity\.minimum_seen"):
        PlannerConfig(**fields)
    PlannerConfig(search_points=6, final_points=6)


def test_a_kernel_without_width_is_refused():
    with pytest.raises(ConfigError, match="sigma"):
        SimilarityConfig(sigma=0.0)


def test_mean_distance_is_that_of_equation_five(scene, library):
    """On the shape about zero, lifted by 2 cm about 2 cm, off it the truncation."""
    surfaces = VisibleSurfaces.pack(library.packed(), 80)
    similarity = ShapeSimilarity(scene, surfaces, SimilarityConfig())
    good = good_pose(library)
    lifted, away = (
        SE3.from_parts(good.R, good.p + np.array([0, 0, dz])).matrix
        for dz in (0.02, 0.5)
    )
    Ts = np.stack([good.matrix, lifted, away])
    exact, near, far = similarity.mean_distance(Ts, np.zeros(3, dtype=int))
    # The nearest thinned point is up to a cell away even on the surface.
    assert exact < 0.008
    assert 0.012 < near < 0.03
    assert far == pytest.approx(scene.field.truncation, abs=1e-6)


def test_equation_five_may_stand_for_the_evidence(scene, library):
    """The nearer the better; the coverage is told all the same."""
    surfaces = VisibleSurfaces.pack(library.packed(), 80)
    by_distance = SimilarityConfig(measure="distance", sigma=0.01)
    similarity = ShapeSimilarity(scene, surfaces, by_distance)
    good = good_pose(library)
    Ts = np.stack(
        [
            SE3.from_parts(good.R, good.p + np.array([0, 0, dz])).matrix
            for dz in (0.0, 0.01, 0.02, 0.5)
        ]
    )
    which = np.zeros(4, dtype=int)
    S, coverage = similarity(Ts, which)
    distance = similarity.mean_distance(Ts, which)
    np.testing.assert_allclose(S, np.exp(-0.5 * (distance / 0.01) ** 2), atol=1e-5)
    assert S[0] > 0.7
    assert S[3] < 1e-4
    assert (np.diff(S) < 0).all()
    evidence = ShapeSimilarity(scene, surfaces, SimilarityConfig(sigma=0.01))
    np.testing.assert_array_equal(coverage, evidence(Ts, which)[1])


def test_a_measure_of_ones_own_may_stand_for_the_evidence(scene, library):
    def on_surface(match, is_visible, sigma):
        is_on = (np.abs(match.along) < sigma) & (match.is_target > 0) & is_visible
        return is_on.sum(axis=1) / is_visible.sum(axis=1).clip(1)

    surfaces = VisibleSurfaces.pack(library.packed(), 80)
    good = good_pose(library)
    away = SE3.from_parts(good.R, good.p + np.array([0, 0, 0.5]))
    Ts, which = np.stack([good.matrix, away.matrix]), np.zeros(2, dtype=int)
    config = SimilarityConfig(measure=on_surface, sigma=0.01)
    S, coverage = ShapeSimilarity(scene, surfaces, config)(Ts, which)
    assert S[0] > 0.7
    assert S[1] == 0.0
    evidence = ShapeSimilarity(scene, surfaces, SimilarityConfig(sigma=0.01))
    np.testing.assert_array_equal(coverage, evidence(Ts, which)[1])
    wider, _ = blurred(PlannerConfig(similarity=config))
    assert wider.measure is on_surface
    assert wider.sigma > config.sigma


@pytest.mark.parametrize(
    ("S", "told"),
    [
        ([0.5, 1.5], r"0\.5 to 1\.5, expected numbers in \[0, 1\]"),
        ([0.5, np.nan], "1 of 2 values NaN"),
        ([0.5], r"shape of S of the measure: got \(1,\)"),
    ],
)
def test_a_measure_that_gives_no_share_of_each_pose_is_refused(scene, library, S, told):
    surfaces = VisibleSurfaces.pack(library.packed(), 80)
    config = SimilarityConfig(measure=lambda *_: S)
    with pytest.raises(InputError, match=told):
        ShapeSimilarity(scene, surfaces, config)(
            np.stack([good_pose(library).matrix] * 2), np.zeros(2, dtype=int)
        )


def test_a_measure_that_is_not_known_is_refused():
    with pytest.raises(ConfigError, match=r"measure: got 'eq5', expected evidence or"):
        SimilarityConfig(measure="eq5")


def test_alignment_draws_a_pose_onto_the_surface(scene, library, rng):
    surfaces = VisibleSurfaces.pack(library.packed(), 24)
    similarity = ShapeSimilarity(scene, surfaces, SimilarityConfig())
    twists = rng.uniform(-1, 1, (64, 6)) * np.repeat([0.012, 0.1], 3)
    Ts = (good_pose(library) @ SE3.exp(twists)).matrix
    which = np.zeros(64, dtype=int)
    before = similarity(Ts, which)[0]
    moved = Ts
    for _ in range(4):
        moved = similarity.aligned(moved, which)
    after = similarity(moved, which)[0]
    assert np.median(after) > np.median(before) + 0.1
    assert np.mean(after > before - 0.02) > 0.9
    R = moved[:, :3, :3]
    assert np.allclose(R @ R.transpose(0, 2, 1), np.eye(3), atol=1e-9)
