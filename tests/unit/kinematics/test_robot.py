from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml
import yourdfpy
from scipy.optimize import minimize

from debrisgrasp._files import data_path
from debrisgrasp.errors import ConfigError, DebrisGraspError, UnknownNameError
from debrisgrasp.kinematics import ArmCollision, KinematicChain, RobotModel

from .robots import ROMAN_URDF


def test_the_urdf_loads_in_pinocchio_with_its_primitives() -> None:
    model = pin.buildModelFromUrdf(str(ROMAN_URDF))
    assert model.nq == 32
    assert sum(inertia.mass for inertia in model.inertias) == pytest.approx(
        131.6, abs=0.1
    )
    for kind in (pin.GeometryType.COLLISION, pin.GeometryType.VISUAL):
        geometry = pin.buildGeomFromUrdf(model, str(ROMAN_URDF), kind)
        assert len(geometry.geometryObjects) == 62


def test_the_urdf_loads_in_yourdfpy() -> None:
    robot = yourdfpy.URDF.load(str(ROMAN_URDF), load_collision_meshes=True)
    assert robot.num_actuated_joints == 32
    # 62 links of the platform, and a palm frame in our convention on each hand.
    assert len(robot.link_map) == 64


def test_at_zero_the_arms_point_forward(roman: RobotModel) -> None:
    zero = dict.fromkeys(roman.tree.joints, 0.0)
    poses = roman.link_poses(zero)
    for side, hand in (("right", "robotiq"), ("left", "camhand")):
        grasp = poses[f"{side}_{hand}_grasp"]
        assert grasp.p[2] == pytest.approx(0.29, abs=2e-3)
        np.testing.assert_allclose(grasp.R[:, 0], (1, 0, 0), atol=1e-9)
    np.testing.assert_allclose(
        poses["camera_depth_optical_frame"].p, (0.371, 0.018, 0.952), atol=1e-3
    )


def test_equal_joint_values_mirror_the_arms(rng: np.random.Generator) -> None:
    right, left = (
        KinematicChain.from_urdf(ROMAN_URDF, "base_link", f"{side}_tool_flange")
        for side in ("right", "left")
    )
    q = right.sampled(10, rng=rng)
    mirrored = q * np.array([-1.0, 1, 1, 1, 1, 1, 1, 1])
    np.testing.assert_allclose(
        right.fk(q).p * (1, -1, 1), left.fk(mirrored).p, atol=1e-9
    )


def test_ready_posture_reaches_where_it_should(roman: RobotModel) -> None:
    poses = roman.link_poses(roman.posture("right", "ready"))
    grasp = poses["right_robotiq_grasp"]
    np.testing.assert_allclose(grasp.p, (0.85, -0.35, 0.55), atol=1e-3)
    down_forward = np.array([1, 0, -1]) / np.sqrt(2)
    np.testing.assert_allclose(grasp.R[:, 0], down_forward, atol=1e-3)


def test_travel_posture_is_as_small_as_stated(roman: RobotModel) -> None:
    moved = roman.posture("right", "travel") | roman.posture("left", "travel")
    moved |= {"ptu_tilt_joint": 0.0}
    bounds = [solid.bounds for _, solid in roman.links_solids(moved)]
    lower = np.min([b.lower for b in bounds], axis=0)
    upper = np.max([b.upper for b in bounds], axis=0)
    length, width, _ = upper - lower
    assert upper[2] == pytest.approx(0.97, abs=0.01)
    assert width < 0.85
    assert length == pytest.approx(1.08, abs=0.02)


@pytest.mark.parametrize("posture", ["ready", "travel"])
@pytest.mark.parametrize("side", ["right", "left"])
def test_named_postures_are_free_of_self_collision(
    roman: RobotModel, side: str, posture: str
) -> None:
    other = "left" if side == "right" else "right"
    collision = ArmCollision.fit(roman, side, held=roman.posture(other, posture))
    chain = collision.body.chain
    q = chain.vector(roman.posture(side, posture))
    assert collision.self_contacts(q) == ()


@pytest.mark.parametrize(("side", "farthest"), [("right", 1.063), ("left", 1.149)])
def test_farthest_reach_is_as_stated(
    rng: np.random.Generator, side: str, farthest: float
) -> None:
    hand = {"right": "right_robotiq_grasp", "left": "left_camhand_grasp"}[side]
    chain = KinematicChain.from_urdf(ROMAN_URDF, "base_link", hand, {"torso_joint": 0})
    shoulder = np.array([0.43, -0.312 if side == "right" else 0.312, 0.64])

    def distance(q: np.ndarray) -> np.ndarray:
        return np.linalg.norm(chain.fk(q).p - shoulder, axis=-1)

    q = chain.sampled(20_000, rng=rng)
    starts = q[np.argsort(-distance(q))[:5]]
    best = max(-minimize(lambda x: -distance(x), start).fun for start in starts)
    assert best == pytest.approx(farthest, abs=1e-3)


def test_palm_frames_follow_the_hand_convention(roman: RobotModel) -> None:
    poses = roman.link_poses()
    for side, hand in (("right", "robotiq"), ("left", "camhand")):
        palm, ours = poses[f"{side}_{hand}_palm_frame"], poses[f"{side}_hand"]
        np.testing.assert_allclose(ours.p, palm.p, atol=1e-12)
        np.testing.assert_allclose(ours.R[:, 2], palm.R[:, 0], atol=1e-12)
        np.testing.assert_allclose(ours.R[:, 0], -palm.R[:, 1], atol=1e-12)


def test_the_camera_stands_where_the_tree_of_all_links_has_it(
    roman: RobotModel, rng: np.random.Generator
) -> None:
    above = roman.tree.joints_above(str(roman.camera))
    names = [joint.name for joint in above if joint.kind != "fixed"]
    assert len(names) >= 2  # the head pans and tilts
    for _ in range(5):
        moved = dict(zip(names, rng.uniform(-0.5, 0.5, len(names)), strict=True))
        found, expected = roman.T_base_camera(moved), roman.link_poses(moved)
        np.testing.assert_array_equal(found.matrix, expected[str(roman.camera)].matrix)


def test_the_torso_joint_adds_reach_and_can_be_locked(
    roman: RobotModel, rng: np.random.Generator
) -> None:
    free, locked = roman.chain("right"), roman.chain("right", {"torso_joint": 0.0})
    assert (free.n_joints, locked.n_joints) == (8, 7)
    reach = [
        np.linalg.norm(c.fk(c.sampled(20_000, rng=rng)).p[:, :2], axis=-1).max()
        for c in (free, locked)
    ]
    assert reach[0] > reach[1]


def test_a_trunk_that_one_arm_alone_moves_turns_the_other_all_the_same(
    roman: RobotModel,
) -> None:
    left = roman.arms["left"]
    still = replace(left, joints=left.joints[1:])
    robot = replace(roman, arms={**roman.arms, "left": still})
    assert robot.chain("right").shared == {"torso_joint"}
    assert robot.chain("left").shared == frozenset()
    alone = replace(roman, arms={"right": roman.arms["right"]})
    assert alone.chain("right").shared == frozenset()


def test_arms_are_found_by_gripper_and_unknown_names_list_the_known(
    roman: RobotModel,
) -> None:
    assert roman.arms_with("robotiq_3f") == ("right",)
    assert roman.arms_with("none") == ()
    with pytest.raises(UnknownNameError, match="right, left"):
        roman.chain("middle")
    with pytest.raises(UnknownNameError, match="zero, ready, travel"):
        roman.posture("right", "redy")
    with pytest.raises(UnknownNameError, match="torso_joint"):
        roman.links_solids({"torso": 0.0})
    with pytest.raises(UnknownNameError, match="roman"):
        RobotModel.load("romann")


def test_all_links_are_drawn_hands_included(roman: RobotModel) -> None:
    links = {link for link, _ in roman.links_solids(roman.posture("right", "ready"))}
    assert {"chassis_link", "right_robotiq_finger_a_link3", "camera_link"} <= links
    assert len(roman.links_solids()) == 62


def test_the_camera_looks_at_the_ground_ahead(roman: RobotModel) -> None:
    T_base_camera = roman.T_base_camera()
    ahead = T_base_camera.R[:, 2]
    assert ahead[0] > 0.5
    assert ahead[2] < -0.5


def _changed(tmp_path: Path, change: dict[str, object]) -> Path:
    content = yaml.safe_load(data_path("robots", "roman.yaml").read_text("utf-8"))
    content["urdf"] = str(ROMAN_URDF)
    content |= change
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


def test_another_robot_is_one_file(tmp_path: Path) -> None:
    path = _changed(tmp_path, {"name": "mine"})
    assert RobotModel.load(path).name == "mine"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"base": "base_lnk"}, "Did you mean 'base_link'"),
        ({"camera": "nose"}, "unknown camera"),
        ({"arms": {}}, "at least one"),
        ({"arms": {"right": {"tip": 3}}}, "arm right"),
        ({"wheels": 4}, "unknown field"),
        ({"name": " "}, "name in .*expected a name"),
        ({"arms": {"": {}}}, "arms in .*expected names"),
        ({"urfd": "row.urdf"}, "Did you mean 'urdf'"),
        ({"rest": {"ptu_tilt_joint": "low"}}, "finite number"),
        ({"rest": {"ptu_tild_joint": 0.1}}, "ptu_tilt_joint"),
        ({"drives": "no"}, "true or false"),
        ({"ignored_collisions": [["torso_link"]]}, r"\[link, link\]"),
        ({"ignored_collisions": [["torso_link", "leg"]]}, "ignored_collisions"),
        ({"urdf": "none.urdf"}, "none.urdf"),
    ],
)
def test_a_malformed_robot_file_is_refused_in_words(
    tmp_path: Path, change: dict[str, object], words: str
) -> None:
    with pytest.raises(DebrisGraspError, match=words):
        RobotModel.load(_changed(tmp_path, change))


def test_a_posture_that_is_not_defined_is_refused(tmp_path: Path) -> None:
    arms = yaml.safe_load(data_path("robots", "roman.yaml").read_text("utf-8"))["arms"]
    arms["left"]["idle"] = "asleep"
    with pytest.raises(ConfigError, match="one of its postures: ready, travel, zero"):
        RobotModel.load(_changed(tmp_path, {"arms": arms}))


def test_a_urdf_alone_is_no_robot(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="needs a YAML file that names it"):
        RobotModel.load(tmp_path / "own.urdf")


@pytest.mark.parametrize(
    ("speed", "told"), [(np.inf, "none"), (0.0, "0.0"), (180.0, "180.*up to 50")]
)
def test_a_joint_without_a_speed_that_can_be_is_named(
    roman: RobotModel, speed: float, told: str
) -> None:
    joint = replace(roman.tree.joints["left_arm_joint3"], velocity=speed)
    tree = replace(roman.tree, joints={**roman.tree.joints, joint.name: joint})
    with pytest.raises(ConfigError, match=rf"left_arm_joint3.*{told}.*velocity.*urdf"):
        replace(roman, tree=tree).limits("left")


def test_an_arm_that_stands_elsewhere_is_idle_there(roman: RobotModel) -> None:
    there = roman.standing({"left_arm_joint1": 0.9})
    idle = roman.joint_values()
    assert there.joint_values() == idle | {"left_arm_joint1": 0.9}
    assert there.arm("right") is roman.arm("right")


def test_others_are_held_against_an_arm_where_it_stands(
    roman: RobotModel, rng: np.random.Generator
) -> None:
    chain, aside = roman.chain("right"), roman.posture("left", "ready")
    aside = {name: q for name, q in aside.items() if name not in chain.joint_names}
    q = chain.sampled(500, rng=rng)
    hits = ArmCollision.fit(roman.standing(aside), "right", chain).hits_itself(q)
    held = ArmCollision.fit(roman, "right", chain, held=aside).hits_itself(q)
    np.testing.assert_array_equal(hits, held)
    assert (hits != ArmCollision.fit(roman, "right", chain).hits_itself(q)).any()


def test_a_joint_to_stand_at_must_be_known_and_a_number(roman: RobotModel) -> None:
    with pytest.raises(UnknownNameError, match="left_arm_joint1"):
        roman.standing({"left_arm_joint_1": 0.9})
    with pytest.raises(DebrisGraspError, match="left_arm_joint1"):
        roman.standing({"left_arm_joint1": float("nan")})
