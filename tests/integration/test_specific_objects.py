"""Object-specific prototypes find what they are made for, where an object is marked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from debrisgrasp import clear
from debrisgrasp._files import data_path
from debrisgrasp.errors import CaptureError, ChoiceError
from debrisgrasp.geometry import SE3, Bounds, Intrinsics, so3
from debrisgrasp.io import Capture
from debrisgrasp.pipeline import Passage, Pipeline, recall_plan
from debrisgrasp.worlds import World, look_at, make_body, render

CAMERA = Intrinsics(fx=240.0, fy=240.0, cx=127.5, cy=95.5, width=256, height=192)
VIEW = look_at([0.1, 0.0, 1.2], [0.95, 0.0, 0.2])
SIZES = {
    "ladder": {"length": 0.9, "width": 0.325, "rungs": 3.0},
    "cinder_block": {"length": 0.376, "width": 0.17, "height": 0.19, "wall": 0.032},
}
MASSES = {"ladder": 3.0, "cinder_block": 6.0}
NAMES = ("rung_028", "block_hole_pair", "block_hole_thumb", "corner_019")


@pytest.fixture(scope="module")
def few(tmp_path_factory):
    """Return a floating hand with three specific prototypes and a generic one."""
    folder = tmp_path_factory.mktemp("specific")
    for name in NAMES:
        path = data_path("prototypes", f"{name}.yaml")
        (folder / path.name).write_text(path.read_text())
    return Pipeline(robot="none", prototypes=folder)


def seen(kind: str, yaw: float = 1.2):
    """Return a capture of one body in the air, the same unmarked, and the body."""
    body = make_body(kind, SIZES[kind], MASSES[kind])
    turn = so3.from_rpy(np.array([0.0, 0.0, yaw]))
    body = body.at(SE3.from_parts(turn, [0.95, 0.0, 0.3]))
    picture = render(World((body,)), CAMERA, VIEW)
    facts = {"depth": picture.depth, "intrinsics": CAMERA, "T_base_camera": VIEW}
    return (
        Capture(**facts, mask=picture.labels == 1, name=kind),
        Capture(**facts, name=kind),
        body,
    )


def depth_in_body(result, grasp, body) -> float:
    """How deep the open hand reaches into the true body, hidden side too [m]."""
    hand = result.grippers[grasp.gripper].solids(grasp.preshape, grasp.opening)
    points = np.concatenate([solid.sphere_cover(0.004)[0] for solid in hand])
    placed = grasp.T_base_hand.apply(points)
    gap = np.min([part.signed_distance(placed) for part in body.solids], axis=0)
    return float(-gap.min())


@pytest.mark.parametrize(
    ("kind", "prototypes"),
    [
        ("ladder", {"rung_028"}),
        ("cinder_block", {"block_hole_pair", "block_hole_thumb"}),
    ],
)
def test_a_marked_object_is_gripped_by_its_own_prototype(few, kind, prototypes):
    capture, _, body = seen(kind)
    results = [few.plan(capture, seed=seed) for seed in range(3)]
    found = [[g for g in r.plan.grasps if g.prototype in prototypes] for r in results]
    assert max(grasp.S for own in found for grasp in own) > 0.55
    for result, own in zip(results, found, strict=True):
        for grasp in own:
            assert depth_in_body(result, grasp, body) < 0.008


def test_without_a_mark_specific_prototypes_are_not_tried(few):
    _, unmarked, _ = seen("cinder_block")
    names = {grasp.prototype for grasp in few.plan(unmarked).plan.grasps}
    assert names <= {"corner_019"}


def test_specific_prototypes_alone_are_enough_for_what_is_marked(tmp_path):
    name = "rung_028.yaml"
    (tmp_path / name).write_bytes(data_path("prototypes", name).read_bytes())
    alone = Pipeline(robot="none", prototypes=tmp_path)
    marked, unmarked, _ = seen("ladder")
    assert alone.plan(marked).plan.grasps
    said = "object-specific ones only.*Mark the object"
    with pytest.raises(ChoiceError, match=said):
        alone.plan(unmarked)
    with pytest.raises(ChoiceError, match=said):
        clear(pipeline=Pipeline(arm="right", prototypes=tmp_path))


def test_a_region_is_a_mark_too(few):
    _, unmarked, body = seen("cinder_block")
    box = Bounds.around(body.T_base_body.apply(body.mesh()[0]), 0.05)
    names = {grasp.prototype for grasp in few.plan(unmarked, region=box).plan.grasps}
    assert names & {"block_hole_pair", "block_hole_thumb"}


def test_supports_leave_a_cylinder_no_free_turn():
    library = Pipeline(robot="none", gripper="robotiq_3f").library
    assert library["cylinder_030_tip"].symmetry.spin is not None
    counts = {"rung_028": 4, "handle_025": 2, "block_hole_pair": 1}
    for name, n in counts.items():
        symmetry = library[name].symmetry
        assert symmetry.spin is None
        assert len(symmetry.turns.matrix) == n


def test_a_mark_on_a_part_says_where_to_grip_and_the_whole_is_lifted():
    body = make_body("lumber_4x4", {"length": 0.7, "width": 0.09, "height": 0.09}, 3.0)
    turn = so3.from_rpy(np.array([0.0, 0.0, 1.2]))
    body = body.at(SE3.from_parts(turn, [0.95, 0.0, 0.045]))
    picture = render(World((body,)), CAMERA, VIEW)
    points = VIEW.apply(CAMERA.deproject(picture.depth))
    along = (points - body.T_base_body.p) @ turn[:, 0]
    is_beam, is_end = picture.labels == 1, (picture.labels == 1) & (along > 0.1)
    facts = {"depth": picture.depth, "intrinsics": CAMERA, "T_base_camera": VIEW}
    pipeline = Pipeline(robot="none", gripper="robotiq_3f")

    whole = pipeline.plan(Capture(**facts, mask=is_beam))
    part = pipeline.plan(Capture(**facts, mask=is_end))
    cut = Bounds.around(points[is_end], 0.02)
    region = pipeline.plan(Capture(**facts), region=cut)
    heavy = whole.plan.grasps[0].load.mass
    for result, holder in ((part, "mask"), (region, "region")):
        plan = result.plan
        # Gripped at the marked end, but weighed and pulled out as one beam.
        ends = [
            (g.T_base_hand.p - body.T_base_body.p) @ turn[:, 0] for g in plan.grasps
        ]
        assert min(ends) > 0.0
        np.testing.assert_allclose(plan.grasps[0].load.mass, heavy, rtol=0.15)
        assert len(result.object_points) > 0.95 * np.count_nonzero(is_beam)
        assert plan.grasps[0].retreat.overlap < 0.1
        assert any(note.startswith(f"the {holder} holds") for note in plan.notes)
        assert not any("object" in advice.text for advice in plan.advice)
    assert not any("holds" in note for note in whole.plan.notes)


def test_all_that_is_marked_is_lifted_together_and_is_not_in_its_own_way(few, tmp_path):
    beam = make_body("lumber_4x4", {"length": 0.5, "width": 0.09, "height": 0.09}, 2.0)
    places = ([0.95, -0.1, 0.045], [0.95, 0.1, 0.045])
    beams = tuple(
        replace(beam, name=f"beam {i}").at(SE3.from_parts(p=place))
        for i, place in enumerate(places)
    )
    picture = render(World(beams), CAMERA, VIEW)
    is_beam = picture.labels > 0
    capture = Capture(
        depth=picture.depth, intrinsics=CAMERA, T_base_camera=VIEW, mask=is_beam
    )
    result = few.plan(capture)
    is_marked = is_beam[np.isfinite(picture.depth) & (picture.depth > 0)]
    assert len(np.unique(result.segmentation.labels[is_marked])) > 1
    assert result.is_own[is_marked].all()
    points = result.cloud.points[is_marked]
    passage = Passage(points, result.object_points, result.grippers)
    assert not len(passage._before.points)

    result.save(tmp_path / "grasps.json")
    again = recall_plan(tmp_path / "grasps.json", capture, None)
    np.testing.assert_array_equal(again.is_own, result.is_own)


def test_a_saved_plan_on_one_of_the_marked_objects_is_that_of_one(few, tmp_path):
    beam = make_body("lumber_4x4", {"length": 0.5, "width": 0.09, "height": 0.09}, 2.0)
    beams = tuple(
        replace(beam, name=f"beam {i}").at(SE3.from_parts(p=[0.95, y, 0.045]))
        for i, y in enumerate((-0.3, 0.3))
    )
    picture = render(World(beams), CAMERA, VIEW)
    capture = Capture(
        depth=picture.depth,
        intrinsics=CAMERA,
        T_base_camera=VIEW,
        mask=picture.labels > 0,
    )
    one = few.plan(capture, object_label=1)
    one.save(tmp_path / "grasps.json")
    again = recall_plan(tmp_path / "grasps.json", capture, None)
    is_other = one.segmentation.labels == 2
    assert is_other.any()
    assert not one.is_own[is_other].any()
    np.testing.assert_array_equal(again.is_own, one.is_own)


def test_a_saved_plan_is_refused_beside_a_mask_in_which_nothing_was_measured(
    few, tmp_path
):
    _, capture, _ = seen("ladder")
    few.plan(capture, deadline=0.1).save(tmp_path / "grasps.json")
    hole = np.zeros(capture.depth.shape, dtype=bool)
    hole[:4, :4] = True
    masked = replace(capture, depth=np.where(hole, 0.0, capture.depth), mask=hole)
    with pytest.raises(CaptureError, match="no measured point"):
        recall_plan(tmp_path / "grasps.json", masked, None)
