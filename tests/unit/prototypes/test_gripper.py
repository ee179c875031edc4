"""Hands: geometry, opening table, and agreement with the robot description."""

from __future__ import annotations

from dataclasses import replace

import coal
import numpy as np
import pinocchio as pin
import pytest

from debrisgrasp._files import data_path
from debrisgrasp.errors import InputError, UnknownNameError
from debrisgrasp.geometry import SE3
from debrisgrasp.geometry.solids import Box, Cylinder, Solid
from debrisgrasp.prototypes import GripperModel, known_grippers


@pytest.fixture(scope="module", params=["robotiq_3f", "camhand"])
def gripper(request: pytest.FixtureRequest) -> GripperModel:
    return GripperModel.load(request.param)


@pytest.fixture(scope="module")
def robotiq() -> GripperModel:
    return GripperModel.load("robotiq_3f")


@pytest.fixture(scope="module")
def claw() -> GripperModel:
    return GripperModel.load("camhand")


def union_distance(solids: list[Solid], points: np.ndarray) -> np.ndarray:
    return np.min([solid.signed_distance(points) for solid in solids], axis=0)


def urdf_solids(prefix: str, hand: str, joints: dict[str, float]) -> list[Solid]:
    """Collision solids of the hand in the robot description, in its hand frame."""
    path = str(data_path("robots", "roman.urdf"))
    model = pin.buildModelFromUrdf(path)
    geometry = pin.buildGeomFromUrdf(model, path, pin.GeometryType.COLLISION)
    data, geometry_data = model.createData(), geometry.createData()
    q = pin.neutral(model)
    for name, value in joints.items():
        q[model.joints[model.getJointId(prefix + name)].idx_q] = value
    pin.framesForwardKinematics(model, data, q)
    pin.updateGeometryPlacements(model, data, geometry, geometry_data)
    T_hand_world = data.oMf[model.getFrameId(hand)].inverse()
    solids: list[Solid] = []
    for item, T_world_solid in zip(
        geometry.geometryObjects, geometry_data.oMg, strict=True
    ):
        if item.name.startswith(prefix):
            T = SE3((T_hand_world * T_world_solid).homogeneous)
            if isinstance(item.geometry, coal.Box):
                solids.append(Box(np.array(item.geometry.halfSide), T))
            else:
                shape = item.geometry
                solids.append(Cylinder(shape.radius, 2 * shape.halfLength, T))
    return solids


@pytest.mark.parametrize(
    ("name", "prefix", "hand"),
    [
        ("robotiq_3f", "right_robotiq_", "right_hand"),
        ("camhand", "left_camhand_", "left_hand"),
    ],
)
@pytest.mark.parametrize("opening", [0.0, 0.06, 0.15])
def test_solids_coincide_with_the_robot_description(
    name: str, prefix: str, hand: str, opening: float, rng: np.random.Generator
) -> None:
    gripper = GripperModel.load(name)
    points = rng.uniform([-0.15, -0.15, -0.25], [0.15, 0.15, 0.2], size=(2000, 3))
    for preshape in gripper.preshapes:
        joints = gripper.joint_values(preshape, opening)
        theirs = urdf_solids(prefix, hand, joints)
        ours = list(gripper.solids(preshape, opening))
        assert len(ours) == len(theirs)
        assert np.allclose(
            union_distance(ours, points), union_distance(theirs, points), atol=1e-6
        )


def test_a_preshape_shows_itself_in_a_line(robotiq: GripperModel) -> None:
    told = "<Preshape basic for objects of 0.02 to 0.15 m>"
    assert repr(robotiq.preshapes["basic"]) == told


def test_robotiq_openings_agree_with_the_published_table(robotiq: GripperModel) -> None:
    for command, opening in ((0, 0.155), (40, 0.106), (80, 0.044), (110, 0.0)):
        found = robotiq.command_to_opening("basic", command)
        assert found == pytest.approx(opening, abs=1.1e-3)


def test_robotiq_pads_stand_115_to_124_mm_in_front_of_the_palm(
    robotiq: GripperModel,
) -> None:
    for opening in np.linspace(0, robotiq.opening_range[1], 9):
        z = robotiq.pad_positions("basic", opening)[:, 2]
        assert (z > 0.114).all()
        assert (z < 0.1255).all()


def test_preshapes_spread_the_pair_as_published(robotiq: GripperModel) -> None:
    def spread(preshape: str, opening: float) -> float:
        _, b, c = robotiq.pad_positions(preshape, opening)
        return abs(float(b[1] - c[1]))

    for opening in (0.0, 0.08, 0.15):
        assert 0.017 < spread("pinch", opening) < 0.022
        assert 0.065 < spread("basic", opening) < 0.073
        assert 0.125 < spread("wide", opening) < 0.132


def test_claw_openings_agree_with_the_published_table(claw: GripperModel) -> None:
    for angle, opening in ((-0.6, 0.185), (-0.47, 0.162), (0.0, 0.072), (0.38, 0.0)):
        found = claw.command_to_opening("claw", angle)
        assert found == pytest.approx(opening, abs=1.1e-3)
    reach = [claw.pad_positions("claw", o)[0, 2] for o in np.linspace(0, 0.18, 19)]
    assert max(reach) == pytest.approx(0.083, abs=1e-3)


def gaps_of(gripper: GripperModel, preshape: str, heights: np.ndarray) -> np.ndarray:
    """Between both sides of the closed hand, none where they pass each other [m]."""
    faces = gripper.inner_faces(preshape, 0.0, heights)
    gaps: np.ndarray = np.maximum(faces.sum(axis=0), 0.0)
    return gaps


def test_closed_fingers_leave_a_gap_near_the_palm_and_none_at_their_tips(
    claw: GripperModel, robotiq: GripperModel
) -> None:
    """Measured on the solids: hooks that stand 8 cm out, 2 cm thick."""
    for gripper, preshape, tips in ((claw, "claw", 0.07), (robotiq, "basic", 0.10)):
        gaps = gaps_of(gripper, preshape, np.array([0.03, tips, 0.2]))
        assert gaps[0] > 0.02
        assert gaps[1] < 0.004
        assert gaps[2] == np.inf


def test_nothing_of_a_finger_is_in_the_gap_of_a_closed_hand(
    gripper: GripperModel,
) -> None:
    heights = np.linspace(0.0, 0.08, 9)
    for preshape in gripper.preshapes:
        gaps = gaps_of(gripper, preshape, heights)
        thumb, pair = (gripper.finger_solids(preshape, 0.0, side) for side in (-1, 1))
        for z, gap in zip(heights, gaps, strict=True):
            grid = np.meshgrid(np.linspace(-0.2, 0.2, 401), np.linspace(-0.1, 0.1, 21))
            points = np.stack([*map(np.ravel, grid), np.full(grid[0].size, z)], axis=1)
            inner = [
                max(
                    (side * points[s.contains(points), 0]).max(initial=-np.inf)
                    for s in solids
                )
                for side, solids in ((1, thumb), (-1, pair))
            ]
            # Between fingers that overlap there is no gap.
            assert gap == pytest.approx(max(-sum(inner), 0.0), abs=5e-3)


@pytest.mark.parametrize(("width", "apart"), [(0.008, 0.05), (0.002, 0.03)])
def test_narrow_fingers_far_apart_are_found_in_the_gap(width, apart, claw, monkeypatch):
    def fingers(_self, _preshape, _opening, side):
        return tuple(
            Box([0.004, width / 2, 0.04], SE3.from_parts(p=[side * 0.007, y, 0.04]))
            for y in (-apart, apart)
        )

    monkeypatch.setattr(GripperModel, "finger_solids", fingers)
    gaps = gaps_of(claw, "claw", np.array([0.02, 0.06, 0.1]))
    assert gaps[:2] == pytest.approx(0.006, abs=1.1e-3)
    assert gaps[2] == np.inf


def test_opening_survives_the_way_through_the_command(gripper: GripperModel) -> None:
    low, high = gripper.opening_range
    for preshape in gripper.preshapes:
        for opening in np.linspace(low, high, 23):
            command = gripper.opening_to_command(preshape, float(opening))
            back = gripper.command_to_opening(preshape, command)
            assert back == pytest.approx(opening, abs=2e-6)


def test_readings_beyond_the_commands_count_as_the_nearest(
    gripper: GripperModel,
) -> None:
    for name, shape in gripper.preshapes.items():
        for command, opening in (
            (shape.commands[0] - 1.0, shape.openings[0]),
            (shape.commands[-1] + 1.0, shape.openings[-1]),
            (np.inf, shape.openings[-1]),
        ):
            assert gripper.command_to_opening(name, command) == opening
        assert np.isnan(gripper.command_to_opening(name, np.nan))


def test_pads_are_as_far_apart_as_the_opening_says(gripper: GripperModel) -> None:
    sides = np.array([finger.side for finger in gripper.fingers])
    for opening in (0.0, 0.031, 0.12):
        for preshape in gripper.preshapes:
            x = gripper.pad_positions(preshape, opening)[:, 0]
            assert x[sides > 0].mean() - x[sides < 0].mean() == pytest.approx(
                opening, abs=2e-6
            )


def test_thumb_side_is_at_negative_x(gripper: GripperModel) -> None:
    for preshape in gripper.preshapes:
        for side in (-1, 1):
            solids = gripper.finger_solids(preshape, 0.1, side)
            assert all(
                np.sign(s.bounds.upper + s.bounds.lower)[0] == side for s in solids
            )


def test_nothing_of_the_palm_stands_in_front_of_its_face(gripper: GripperModel) -> None:
    assert max(solid.bounds.upper[2] for solid in gripper.palm) == pytest.approx(0.0)


def test_sphere_cover_contains_the_hand(
    gripper: GripperModel, rng: np.random.Generator
) -> None:
    preshape = next(iter(gripper.preshapes))
    centers, radii = gripper.sphere_cover(preshape, 0.1)
    points = rng.uniform([-0.15, -0.15, -0.25], [0.15, 0.15, 0.2], size=(4000, 3))
    inside = union_distance(list(gripper.solids(preshape, 0.1)), points) < 0
    gap = np.linalg.norm(points[:, None] - centers, axis=-1) - radii
    assert inside.sum() > 100
    assert (gap[inside].min(axis=1) <= 0).all()


def test_closing_region_lies_between_the_fingers(gripper: GripperModel) -> None:
    for preshape in gripper.preshapes:
        region = gripper.closing_region(preshape, 0.1)
        pads = gripper.pad_positions(preshape, 0.1)
        assert region.half_extents[0] == pytest.approx(0.05)
        assert (pads[:, 2] <= region.bounds.upper[2]).all()
        assert (np.abs(pads[:, 1]) <= region.half_extents[1]).all()
        assert region.bounds.upper[2] == pytest.approx(
            gripper.fingertip_reach(preshape, 0.1)
        )


def test_opening_beyond_the_hand_is_refused_with_its_range(
    robotiq: GripperModel,
) -> None:
    with pytest.raises(InputError, match=r"0 to 0.1555 m"):
        robotiq.solids("basic", 0.2)
    with pytest.raises(InputError, match="opening of robotiq_3f"):
        robotiq.solids("basic", float("nan"))


def test_unknown_names_list_the_known_ones(robotiq: GripperModel) -> None:
    with pytest.raises(UnknownNameError, match="camhand, robotiq_3f"):
        GripperModel.load("robotiq")
    with pytest.raises(UnknownNameError, match="basic, wide, pinch"):
        robotiq.preshape("scissor")
    assert known_grippers() == ("camhand", "robotiq_3f")


def moved(root, turned):
    return replace(root, T_parent_link=turned @ root.T_parent_link)


@pytest.mark.parametrize(
    ("turned", "said"),
    [
        (SE3.exp(np.array([0.0, 0.0, 0.0, np.pi, 0.0, 0.0])), "111 mm in front of"),
        (SE3.from_parts(p=[0.0, 0.0, 0.05]), "the palm reaches 50 mm in front of"),
        (SE3.from_parts(p=[0.0, 0.0, -0.2]), "all pads lie 85 mm behind"),
        (SE3.from_parts(p=[-0.03, 0.0, 0.0]), "the fingers close 30 mm beside"),
    ],
)
def test_a_palm_frame_that_is_turned_or_elsewhere_is_doubted(robotiq, turned, said):
    assert not robotiq.palm_doubt
    palm = tuple(solid.moved(turned) for solid in robotiq.palm)
    fingers = tuple(
        replace(finger, links=(moved(finger.links[0], turned), *finger.links[1:]))
        for finger in robotiq.fingers
    )
    assert said in replace(robotiq, palm=palm, fingers=fingers).palm_doubt
