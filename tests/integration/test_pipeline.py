"""Laws of the whole chain: what a plan promises, and what it says when it can't."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from debrisgrasp import plan, segment, select
from debrisgrasp._words import counted
from debrisgrasp.errors import (
    CaptureError,
    ConfigError,
    InputError,
    ShapeError,
    UnknownNameError,
)
from debrisgrasp.geometry import SE3, Box, Cylinder, Solid, so3, voxel_downsample
from debrisgrasp.io import Capture
from debrisgrasp.io.plan_json import plan_to_json
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.pipeline import Pipeline, PipelineConfig
from debrisgrasp.planning import ClearanceConfig, PlannerConfig, Rejections
from debrisgrasp.prototypes import GripperModel, PrototypeLibrary
from debrisgrasp.segmentation import PriorityPoint, segmentation_of_labels
from tests.scenes import capture_of, lying_pipe

from .conftest import BLOCK, PIPE

EXAMPLES = Path(__file__).parents[2] / "examples"
FAR_PIPE = lying_pipe(length=0.8, position=(2.0, 0.0, 0.3))


NEAR_PIPE = lying_pipe(length=0.4)


@pytest.fixture(scope="session")
def every_hand():
    """Return floating hands with the shipped dictionary."""
    return Pipeline(robot="none")


@pytest.fixture(scope="session")
def block_seen(every_hand, block_capture):
    return every_hand.perceive(block_capture)


@pytest.fixture(scope="session")
def pipes_only(dictionary, tmp_path_factory):
    """Return a floating hand that knows pipes, and is content with good fits only."""
    folder = tmp_path_factory.mktemp("pipes")
    for path in dictionary.glob("cylinder_*.yaml"):
        (folder / path.name).write_text(path.read_text())
    config = PipelineConfig(planner=PlannerConfig(minimum_score=0.75))
    return Pipeline(robot="none", prototypes=folder, config=config)


@pytest.fixture(scope="session")
def pipe_result(floating, pipe_capture):
    return floating.plan(pipe_capture)


@pytest.fixture(scope="session")
def roman_result(dictionary):
    """Return the plan of the whole robot, told to take the pipe out of reach first."""
    farthest_first = PriorityPoint.at(3.0, 0.0, 1.0)
    roman = Pipeline(robot="roman", prototypes=dictionary, policy=farthest_first)
    return roman.plan(capture_of([FAR_PIPE, NEAR_PIPE]))


def test_what_a_plan_is_made_of_shows_itself_in_a_line(floating, pipe_result):
    grasp = pipe_result.plan.grasps[0]
    assert repr(floating).startswith("<Pipeline for a floating hand; hands ")
    assert f"{grasp.prototype} by {grasp.gripper}" in repr(grasp)
    assert ", arm, at (" in repr(replace(grasp, arm="arm"))  # not "arm arm"
    assert repr(grasp) in repr(pipe_result.plan)
    assert repr(pipe_result.plan) in repr(pipe_result)
    assert len(repr(pipe_result)) < 300
    n_objects = len(pipe_result.segmentation.segments)
    objects = counted(n_objects, "object")
    assert f": {objects}, " in repr(pipe_result.segmentation)
    anywhere = replace(pipe_result.plan, object_label=0)
    assert f"<GraspPlan of {len(anywhere.grasps)} in a region," in repr(anywhere)
    empty = replace(pipe_result.plan, grasps=(), why_empty="too far")
    assert repr(empty) == "<GraspPlan without a grasp: too far>"


def test_what_holds_many_numbers_shows_itself_in_a_line(floating, pipe_capture):
    seen = floating.perceive(pipe_capture)
    plan = floating.plan(seen, mass=400.0).plan
    reason, n = next(iter(plan.rejections.items()))
    assert f"{reason} ({n})" in repr(plan.ruled_out)
    assert repr(Rejections()) == "<Rejections of 0 poses: none>"
    assert repr(seen) == f"<Perception of scene: {seen.segmentation!r}>"
    assert repr(seen.cloud) == f"<PointCloud of {len(seen.cloud)} points, frame base>"
    assert "4 prototypes for robotiq_3f" in repr(floating.library)
    prototype = floating.library["handle_025"]
    assert repr(prototype).startswith("<GraspPrototype handle_025 for robotiq_3f, ")
    hand = floating.grippers["robotiq_3f"]
    assert repr(hand) == "<GripperModel robotiq_3f: preshapes basic, wide, pinch>"
    robot = RobotModel.load("roman")
    told = "<RobotModel roman: arms right (robotiq_3f), left (camhand)>"
    assert repr(robot) == told


def test_equal_input_and_seed_give_an_equal_plan(floating, pipe_capture, pipe_result):
    floating.plan(pipe_capture, seed=1)
    again = floating.plan(pipe_capture)
    assert plan_to_json(again.plan) == plan_to_json(pipe_result.plan)


def test_a_dictionary_in_memory_plans_as_its_folder_does(
    floating, pipe_capture, pipe_result
):
    of_both_hands = PrototypeLibrary.load()
    library = of_both_hands.select(names=floating.library.names)
    found = plan(pipe_capture, robot="none", prototypes=library)
    assert plan_to_json(found.plan) == plan_to_json(pipe_result.plan)


def test_a_dictionary_in_memory_brings_its_hands_and_needs_them(pipe_capture):
    jaw = GripperModel.load(EXAMPLES / "grippers/jaw_140.yaml")
    hands = {jaw.name: jaw}
    library = PrototypeLibrary.load(EXAMPLES / "jaw_prototypes", grippers=hands)
    jaws = Pipeline(robot="none", prototypes=library)
    assert jaws.plan(pipe_capture).plan.grasps[0].gripper == "jaw_140"
    for arms in ({"robot": "none"}, {"robot": "roman"}):
        with pytest.raises(UnknownNameError, match=r"'jaw_140'.*--grippers"):
            Pipeline(**arms, prototypes=replace(library, grippers={}))
    with pytest.raises(ConfigError, match=r"prototypes: got none, .*--gripper HAND"):
        Pipeline(robot="none", prototypes=PrototypeLibrary((), {}))


def test_a_pipe_is_gripped_across_its_axis(pipe_result):
    assert len(pipe_result.plan.grasps) >= 10
    best = pipe_result.plan.grasps[0]
    assert best.prototype == "cylinder_060_tip"
    closing, axis = best.T_base_hand.R[:, 0], PIPE.T_frame_solid.R[:, 2]
    assert abs(closing @ axis) < 0.2
    middle = best.T_base_hand.apply([0.0, 0.0, 0.1])
    assert np.linalg.norm((middle - PIPE.T_frame_solid.p)[[0, 2]]) < 0.02


def test_numbers_of_every_grasp_agree_with_each_other(pipe_result):
    plan = pipe_result.plan
    assert plan.why_empty is None
    for grasp in plan.grasps:
        assert 0.0 < grasp.Q == grasp.S * grasp.C * grasp.R <= 1.0
        assert 0.0 < grasp.score <= 1.0
        assert grasp.S <= 1.0
        assert grasp.C <= 1.0
        assert grasp.object_label == plan.object_label
        T_hand_pregrasp = grasp.T_base_hand.inverse() @ grasp.T_base_pregrasp
        assert_allclose(T_hand_pregrasp.R, np.eye(3), atol=1e-9)
        retreat = [0.0, 0.0, -grasp.approach_distance]
        assert_allclose(T_hand_pregrasp.p, retreat, atol=1e-9)
        assert grasp.width < grasp.opening


def test_turning_scene_and_camera_together_turns_the_answer(
    floating, pipe_capture, pipe_result
):
    turn = SE3.from_parts(so3.from_rpy(np.array([0.0, 0.0, 0.6])))
    turned = floating.plan(pipe_capture.posed(turn @ pipe_capture.T_base_camera))
    assert len(turned.segmentation.segments) == len(pipe_result.segmentation.segments)
    # The grid stands still while the scene turns in it, and the dice fall otherwise.
    best, before = turned.plan.grasps[0], pipe_result.plan.grasps[0]
    assert abs(best.expected - before.expected) < 0.08
    axis = turn.rotate(PIPE.T_frame_solid.R[:, 2])
    assert abs(best.T_base_hand.R[:, 0] @ axis) < 0.2


@pytest.mark.parametrize(("cost", "evidence"), [(0.0, 0.0), (1.0, 1.0)])
def test_unseen_space_is_ignored_or_avoided_as_the_settings_say(
    pipe_capture, dictionary, cost, evidence
):
    planner = PlannerConfig(
        clearance=ClearanceConfig(unknown_cost=cost), minimum_evidence=evidence
    )
    config = PipelineConfig(planner=planner)
    pipeline = Pipeline(robot="none", prototypes=dictionary, config=config)
    found = pipeline.plan(pipe_capture).plan
    assert found.grasps
    # Nothing costs C: what is left lies clear of it, or it is free.
    assert all(grasp.C == 1.0 for grasp in found.grasps)
    has_guesses = any("thicker than what was seen" in why for why in found.rejections)
    assert has_guesses == (evidence == 1.0)


def test_an_object_that_does_not_fit_is_passed_over_with_a_reason(
    pipes_only, block_capture
):
    result = pipes_only.plan(block_capture)
    plan = result.plan
    first = plan.passed_over[0]
    assert first.label == result.order[0].label
    top = result.segmentation.segment(first.label)
    assert np.abs(BLOCK.signed_distance(top.centroid)) < 0.06
    assert first.reason.startswith(("of ", "no pose of any prototype"))
    assert plan.grasps
    assert plan.object_label == 2
    gripped = result.segmentation.segment(plan.object_label)
    assert gripped.centroid[:2] == pytest.approx([0.79, 0.35], abs=0.03)


def test_no_more_objects_are_tried_than_allowed(dictionary, block_capture):
    config = PipelineConfig(planner=PlannerConfig(minimum_score=1.0), max_objects=1)
    hands = Pipeline(robot="none", prototypes=dictionary, config=config)
    plan = hands.plan(block_capture).plan
    assert not plan.grasps
    first, *others = [passed.reason for passed in plan.passed_over]
    assert "not tried" not in first
    assert "not tried: the limit of 1 object was reached" in others


def test_a_chosen_object_is_the_only_one_tried(pipes_only, block_capture):
    plan = pipes_only.plan(block_capture, object_label=1).plan
    assert not plan.grasps
    assert plan.object_label == 1
    assert [passed.label for passed in plan.passed_over] == [1]
    assert plan.passed_over[0].reason in plan.why_empty


def test_a_plan_on_given_labels_is_that_on_the_same_objects(floating, block_capture):
    own = floating.plan(block_capture)
    labels = own.segmentation.labels
    given = segmentation_of_labels(own.cloud, labels)
    seen = floating.perceive(block_capture, segmentation=given)
    assert seen.segmentation is given
    result = floating.plan(seen)
    assert result.plan.object_label == own.plan.object_label
    assert len(result.plan.grasps) == len(own.plan.grasps)
    # Nothing of what is not labelled is an object.
    nothing = segmentation_of_labels(own.cloud, 0 * labels)
    empty = floating.plan(floating.perceive(block_capture, segmentation=nothing))
    assert "no object was found" in empty.plan.why_empty


def test_a_segmentation_of_another_capture_is_refused(floating, block_capture):
    other = segment(capture_of([PIPE]))
    with pytest.raises(ShapeError, match="that were measured"):
        floating.perceive(block_capture, segmentation=other)


def test_a_mask_counts_with_given_labels_too(floating, block_capture):
    labels = segment(block_capture).labels
    mask = np.zeros(block_capture.depth.shape, dtype=bool)
    mask[np.isfinite(block_capture.depth)] = labels == 1
    marked = replace(block_capture, mask=mask)
    given = segmentation_of_labels(marked.cloud(), labels)
    seen = floating.perceive(marked, segmentation=given)
    assert seen.segmentation.marked_shares.tolist() == [1.0]


def test_an_order_without_objects_is_told_as_the_reason(floating, block_capture):
    class Nothing:
        def order(self, _segmentation, _cloud):
            return ()

    pipeline = copy(floating)
    pipeline.policy = Nothing()
    result = pipeline.plan(block_capture)
    n = len(result.segmentation.segments)
    assert f"policy put none of {n} object" in result.plan.why_empty
    assert select(block_capture, result.segmentation, Nothing()) == ()


def test_labels_that_are_no_order_are_refused_by_plan(floating, block_capture):
    class Labels:
        def order(self, _segmentation, _cloud):
            return [1]

    pipeline = copy(floating)
    pipeline.policy = Labels()
    with pytest.raises(InputError, match=r"order of Labels: got \[1\]"):
        pipeline.plan(block_capture)


def test_a_bare_floor_offers_nothing_and_says_so(floating, floor_capture):
    result = floating.plan(floor_capture)
    assert not result.plan.grasps
    assert result.plan.object_label == 0
    assert result.plan.region is None
    assert "it is the ground" in result.plan.why_empty
    assert len(result.plan.passed_over) == len(result.segmentation.segments)


def test_an_object_of_a_few_points_is_not_searched(floating):
    points = np.array([[x, y, 0.5] for x in (0.90, 0.93) for y in (0.0, 0.03)])
    many = np.repeat(points, 40, axis=0) + 1e-4 * np.arange(160)[:, None] / 160
    crumb = Capture(
        points=many, viewpoint=np.array([0, 0, 1.0]), T_base_camera=SE3.identity()
    )
    plan = floating.plan(crumb).plan
    assert not plan.grasps
    assert "too small" in plan.why_empty or "no object was found" in plan.why_empty


def handle_on_a_plate() -> list[Solid]:
    """Return the solids of ``handle_025``: a bar on two posts, and its plate."""
    lying = so3.from_rpy(np.array([np.pi / 2, 0.0, 0.0]))
    T_base_handle = SE3.from_parts(
        so3.from_rpy(np.array([np.pi, -0.6, 0.0])), [0.9, 0.0, 0.4]
    )
    bar = Cylinder(0.0125, 0.185, SE3.from_parts(lying))
    posts = [
        Cylinder(0.0125, 0.06, SE3.from_parts(p=[0.0, y, 0.03])) for y in (-0.08, 0.08)
    ]
    plate = Box(np.array([0.06, 0.105, 0.01]), SE3.from_parts(p=[0.0, 0.0, 0.07]))
    return [solid.moved(T_base_handle) for solid in (bar, *posts, plate)]


def test_prototypes_of_one_object_are_tried_only_where_it_is_marked(floating):
    capture = capture_of(handle_on_a_plate(), has_floor=False)
    is_handle = np.isfinite(capture.depth)
    unmarked = floating.plan(capture).plan
    assert "handle_025" not in {grasp.prototype for grasp in unmarked.grasps}
    # Whatever segmentation makes of bar and plate, the mark makes one object of them.
    marked = floating.plan(replace(capture, mask=is_handle))
    labels = marked.segmentation.labels
    assert len(np.unique(labels[labels > 0])) == 1
    assert "handle_025" in {grasp.prototype for grasp in marked.plan.grasps[:5]}
    with pytest.raises(CaptureError, match="mask"):
        floating.plan(replace(capture, mask=np.zeros_like(is_handle)))


def test_an_object_out_of_reach_is_passed_over_for_one_within(roman_result):
    plan = roman_result.plan
    far = roman_result.segmentation.segment(plan.passed_over[0].label)
    near = roman_result.segmentation.segment(plan.object_label)
    assert far.centroid[0] > 1.8
    assert near.centroid[0] < 1.0
    assert "no arm gets that far" in plan.passed_over[0].reason
    assert len(plan.grasps) >= 5


def test_a_pile_out_of_reach_altogether_is_told_to_be_that_far(dictionary):
    """Also after the second look, which searches more widely."""
    roman = Pipeline(robot="roman", prototypes=dictionary)
    plan = roman.plan(capture_of([FAR_PIPE])).plan
    assert set(plan.rejections) == {"no arm gets that far"}
    assert "because no arm gets that far" in plan.why_empty


def test_an_arm_without_prototypes_is_told_of(roman_result):
    (note,) = (n for n in roman_result.plan.notes if "left arm" in n)
    assert note.startswith("no grasp is sought for the left arm: ")


def test_a_mass_beyond_every_arm_is_told_of_with_what_they_lift(dictionary):
    roman = Pipeline(robot="roman", prototypes=dictionary)
    plan = roman.plan(capture_of([NEAR_PIPE]), mass=400.0).plan
    force = roman.robot.limits("right").planner.force
    assert not plan.grasps
    assert f"the strongest lifts {force / 9.81:.3g} kg" in plan.notes[0]


def test_joints_of_every_grasp_bring_the_palm_there(roman_result):
    robot = RobotModel.load("roman")
    assert roman_result.plan.grasps
    for grasp in roman_result.plan.grasps:
        chain = robot.chain(grasp.arm)
        assert robot.arm(grasp.arm).gripper == grasp.gripper
        q = chain.vector(grasp.joints)
        assert (q >= chain.lower - 1e-9).all()
        assert (q <= chain.upper + 1e-9).all()
        T_base_hand = chain.fk(q)
        error = grasp.T_base_hand.inverse() @ T_base_hand
        assert np.linalg.norm(error.log()) < 1e-3


def test_kin_of_an_object_are_what_may_well_be_one_with_it(roman_result):
    segmentation = roman_result.segmentation
    labels, own = segmentation.labels, roman_result.plan.object_label
    other = next(s.label for s in segmentation.segments if s.label != own)
    for likely, is_kin in ((0.4, True), (0.3, False)):
        kinship = np.zeros((len(segmentation.segments),) * 2)
        kinship[own - 1, other - 1] = kinship[other - 1, own - 1] = likely
        result = replace(
            roman_result, segmentation=replace(segmentation, kinship=kinship)
        )
        expected = result.cloud.points[(labels == other) & is_kin & ~result.is_own]
        assert_allclose(result.kin_points, expected)


@pytest.mark.parametrize("fixture", ["pipe_result", "roman_result"])
def test_hands_stand_clear_with_the_object_between_the_fingers(fixture, request):
    result = request.getfixturevalue(fixture)
    points = result.cloud.points
    labels = result.segmentation.labels
    kept = voxel_downsample(points, 0.01)
    assert result.plan.grasps
    for grasp in result.plan.grasps:
        hand = result.grippers[grasp.gripper]
        local = grasp.T_base_hand.inverse().apply(points[kept])
        solids = hand.solids(grasp.preshape, grasp.opening)
        depth = -np.min([solid.signed_distance(local) for solid in solids], axis=0)
        assert np.count_nonzero(depth > 0.006) <= 1
        between = hand.closing_region(grasp.preshape, grasp.opening).contains(local)
        assert np.count_nonzero(labels[kept][between] == grasp.object_label) >= 4


@pytest.mark.parametrize("seed", range(4))
def test_no_finger_ends_inside_an_object_wider_than_the_hand(
    every_hand, block_seen, seed
):
    # One side of it is seen at a grazing angle: a few rows of points.
    result = every_hand.plan(block_seen, object_label=1, seed=seed)
    for grasp in result.plan.grasps:
        solids = result.grippers[grasp.gripper].solids(grasp.preshape, grasp.opening)
        corners = [solid.moved(grasp.T_base_hand).mesh()[0] for solid in solids]
        assert BLOCK.signed_distance(np.concatenate(corners)).min() > -0.02


def test_a_noisy_pile_offers_many_grasps_that_the_robot_can_take(shared_data):
    capture = Capture.load(shared_data / "piles" / "pile_01_noisy.npz")
    pipeline = Pipeline()
    plans = [pipeline.plan(capture, seed=seed).plan for seed in range(3)]
    assert min(len(plan.grasps) for plan in plans) >= 5
    grasps = [grasp for plan in plans for grasp in plan.grasps]
    assert len(grasps) >= 20
    assert all(grasp.R == 1.0 and grasp.joints for grasp in grasps)
