"""Proposed poses: on shapes for which it is known how a hand must take them."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError, InputError, UnknownNameError
from debrisgrasp.geometry import SE3, fibonacci_sphere, random_rotations
from debrisgrasp.prototypes import (
    GraspPrototype,
    GripperModel,
    HandPose,
    SurfaceShape,
    around_grip,
    check,
    propose_hand_poses,
    prototype_of_shape,
)
from debrisgrasp.prototypes.shapes import BoxShape, CylinderShape, Shape
from debrisgrasp.prototypes.surfaces import sample

HAND = GripperModel.load("robotiq_3f")
JAW = Path(__file__).parents[3] / "examples" / "grippers" / "jaw_140.yaml"
PIPE = CylinderShape(diameter=0.06, length=0.4, ends="closed")


def surface(shape: Shape, T: SE3 | None = None) -> SurfaceShape:
    points, normals = sample(shape.patches(), shape.parts(), 2e5)
    found = SurfaceShape.thinned(points, normals, "all")
    return found if T is None else found.moved(T)


@cache
def on_pipe() -> tuple[HandPose, ...]:
    return propose_hand_poses(surface(PIPE), HAND, preshape="basic", limit=2)


def test_a_pipe_is_taken_across_its_axis():
    assert len(on_pipe()) == 2
    for pose in on_pipe():
        assert pose.findings == ()
        assert pose.width == pytest.approx(0.06, abs=0.004)
        assert pose.opening == pytest.approx(pose.width + 0.04, abs=1e-3)
        T = pose.T_surface_hand
        assert abs(T.R[1, 2]) < 0.02  # the approach is square to the axis
        assert abs(T.R[1, 0]) < 0.02  # and so is the closing
        axis_in_hand = T.inverse().apply(np.zeros(3))
        assert abs(axis_in_hand[0]) < 0.004  # centred between the fingers
        assert 0.03 < axis_in_hand[2] < HAND.fingertip_reach("basic", 0.06)


def test_moved_things_are_taken_in_the_same_way(rng):
    T = SE3.from_parts(random_rotations(1, rng=rng)[0], rng.normal(size=3))
    moved = propose_hand_poses(surface(PIPE, T), HAND, preshape="pinch", limit=1)
    for pose in moved:
        assert pose.findings == ()
        assert pose.width == pytest.approx(0.06, abs=0.004)
        axis = T.R[:, 1]
        assert abs(pose.T_surface_hand.R[:, 2] @ axis) < 0.05


def test_approaches_keep_to_the_side_that_is_asked_for():
    towards = np.array([0.0, 0.0, -1.0])
    poses = propose_hand_poses(
        surface(PIPE), HAND, preshape="basic", towards=towards, limit=1
    )
    assert poses
    for pose in poses:
        assert pose.T_surface_hand.R[:, 2] @ towards > np.cos(np.deg2rad(76))


def test_what_is_in_the_way_sends_the_hand_to_the_other_side():
    wall = np.stack(np.meshgrid(*[np.linspace(-0.3, 0.3, 100)] * 2), -1).reshape(-1, 2)
    wall = np.column_stack([wall, np.full(len(wall), 0.035)])  # right above the pipe
    poses = propose_hand_poses(
        surface(PIPE), HAND, preshape="basic", obstacles=wall, limit=2
    )
    for pose in poses:
        if not pose.findings:
            assert pose.T_surface_hand.R[2, 2] > -0.5  # not from above
    assert any(not pose.findings for pose in poses)
    below = [pose for pose in poses if pose.T_surface_hand.R[2, 2] > 0.5]
    assert below


def test_what_is_too_thick_gets_no_proposal():
    block = surface(BoxShape(width=0.25, length=0.3, height=0.25))
    assert propose_hand_poses(block, HAND) == ()


def test_an_unknown_preshape_is_named():
    with pytest.raises(UnknownNameError, match="basic"):
        propose_hand_poses(surface(PIPE), HAND, preshape="fist")


def test_a_hand_beside_the_surface_is_refused():
    with pytest.raises(InputError, match="between the fingers"):
        around_grip(surface(PIPE), SE3.from_parts(p=(0.0, 0.0, 2.0)), HAND, "basic")


@pytest.mark.parametrize(
    ("shape", "width"),
    [
        ({"type": "cylinder", "diameter": 0.065, "length": 0.14}, 0.065),
        ({"type": "edge", "thickness": 0.03, "length": 0.14, "depth": 0.06}, 0.03),
    ],
)
@pytest.mark.parametrize("grip", ["tip", "deep", "power"])
def test_a_shape_with_sizes_finds_its_place(shape, width, grip):
    definition = prototype_of_shape("new", shape, HAND, "basic", grip=grip)
    assert definition.width == pytest.approx(width, abs=0.01)
    assert not check(GraspPrototype.build(definition, fibonacci_sphere(1)), HAND)


def test_a_power_grasp_is_nearer_to_the_palm():
    shape = {"type": "cylinder", "diameter": 0.06, "length": 0.14}
    places = {
        grip: prototype_of_shape("new", shape, HAND, "basic", grip=grip).T_hand_shape.p
        for grip in ("tip", "power")
    }
    assert places["power"][2] < places["tip"][2] - 0.02


@pytest.mark.parametrize("grip", ["tip", "deep"])
def test_what_lies_on_the_ground_can_be_taken(grip):
    shape = {"type": "bar", "width": 0.06, "height": 0.05, "length": 0.14}
    definition = prototype_of_shape("new", shape, HAND, "basic", grip=grip)
    reach = HAND.fingertip_reach("basic", definition.width)
    assert definition.T_hand_shape.p[2] + 0.025 > reach


def test_fingertips_reach_over_an_edge():
    shape = {"type": "edge", "thickness": 0.03, "length": 0.14, "depth": 0.08}
    definition = prototype_of_shape("new", shape, HAND, "basic")
    pad = HAND.pad_positions("basic", definition.width)[:, 2].mean()
    assert 0.03 <= pad - definition.T_hand_shape.p[2] <= 0.045


def test_a_given_place_is_kept():
    shape = {"type": "cylinder", "diameter": 0.06, "length": 0.14}
    definition = prototype_of_shape(
        "new", shape | {"position": [0.0, 0.01, 0.09]}, HAND, "basic"
    )
    assert definition.T_hand_shape.p.tolist() == [0.0, 0.01, 0.09]


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64])
def test_sizes_and_places_may_be_numbers_of_numpy(kind):
    # Halves of halves, which every kind of number holds.
    shape = {"type": "cylinder", "diameter": 0.0625, "length": 0.125}
    shape["position"] = [0.0, 0.0, 0.125]
    own = shape | {name: kind(shape[name]) for name in ("diameter", "length")}
    own["position"] = np.array(shape["position"], dtype=kind)
    of_numpy, plain = (
        prototype_of_shape("new", each, HAND, "basic") for each in (own, shape)
    )
    assert of_numpy.width == plain.width
    assert of_numpy.T_hand_shape.p.tolist() == plain.T_hand_shape.p.tolist()


@pytest.mark.parametrize("shape", [None, "cylinder", [0.065, 0.14]])
def test_a_shape_that_is_no_mapping_is_named(shape):
    with pytest.raises(InputError, match="shape"):
        prototype_of_shape("new", shape, HAND, "basic")


@pytest.mark.parametrize(
    ("shape", "said"),
    [
        ({"type": "cylinder", "diameter": 65, "length": 0.14}, "metres"),
        ({"type": "cylinder", "length": 0.14}, "diameter"),
        ({"type": "surface", "file": "x.ply"}, "record"),
    ],
)
def test_sizes_that_make_no_shape_are_refused(shape, said):
    with pytest.raises(ConfigError, match=said):
        prototype_of_shape("new", shape, HAND, "basic")


def test_a_hand_turned_away_gets_a_prototype_that_check_refuses(tmp_path):
    text = JAW.read_text(encoding="utf-8")
    turned = "base: {position: [0, 0, 0], rpy: [3.14159265, 0, 0]}"
    file = tmp_path / "jaw.yaml"
    file.write_text(text.replace("base: {position: [0, 0, 0]}", turned))
    hand = GripperModel.load(file)
    shape = {"type": "cylinder", "diameter": 0.05, "length": 0.14}
    definition = prototype_of_shape("new", shape, hand, "parallel", grip="deep")
    findings = check(GraspPrototype.build(definition, fibonacci_sphere(1)), hand)
    assert "palm frame" in str(findings[0])


def test_lists_are_taken_for_arrays():
    pipe = surface(PIPE)
    there, none = [[0.0, 0.0, 0.3]], [[9.0, 9.0, 9.0]]
    assert propose_hand_poses(pipe, HAND, limit=1, obstacles=there)
    near = propose_hand_poses(pipe, HAND, limit=1, obstacles=none, towards=[0, 0, -1])
    assert near[0].T_surface_hand.R[2, 2] < -0.2


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"gripper": "robotiq_3f"}, r"gripper: got 'robotiq_3f'.*GripperModel\.load"),
        ({"surface": np.eye(3)}, "surface: got ndarray"),
        ({"limit": 0}, "limit: got 0"),
        ({"limit": -1}, "limit: got -1"),
        ({"towards": [0, 0, 0]}, "towards: got .*unit vector"),
        ({"towards": [0, 1]}, "towards"),
        ({"obstacles": [0, 0, 1]}, r"obstacles: got \(3,\), expected \(n, 3\)"),
        ({"obstacles": [[0, 0, np.nan]]}, "obstacles: got 1 of 3 values NaN"),
    ],
    ids=str,
)
def test_no_surface_hand_number_or_direction_is_refused(wrong, words):
    right = {"surface": surface(PIPE), "gripper": HAND}
    with pytest.raises(InputError, match=words):
        propose_hand_poses(**{**right, **wrong})
