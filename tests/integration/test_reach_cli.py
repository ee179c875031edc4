"""The commands `ik` and `reach` as a user types them."""

from __future__ import annotations

import json

import numpy as np
import pytest

from debrisgrasp._files import data_path
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.kinematics import RobotModel

REGION = ("--region", 0.8, -0.4, 0.3, 1.0, -0.2, 0.4)


@pytest.mark.parametrize("command", ["ik", "reach"])
def test_every_command_explains_itself(run, command):
    ended = run(command, "--help")
    assert ended.status == 0
    assert "usage: debrisgrasp " + command in ended.out


def test_ik_prints_joints_that_lead_to_the_poses(run):
    poses = np.array([[0.9, -0.3, 0.4, 3.1, 0.1, 0.2], [0.8, 0.2, 0.5, 3.0, -0.3, 1.0]])
    ended = run("ik", *poses.ravel(), "--json")
    assert ended.status == 0
    assert ended.err == ""
    assert [(a["pose"], a["arm"]) for a in ended.json] == [
        (1, "right"),
        (1, "left"),
        (2, "right"),
        (2, "left"),
    ]
    robot = RobotModel.load("roman")
    T = SE3.from_parts(so3.from_rpy(poses[:, 3:]), poses[:, :3])
    for answer in ended.json:
        chain = robot.chain(answer["arm"])
        reached = chain.fk(chain.vector(answer["joints"])).matrix
        np.testing.assert_allclose(reached, T.matrix[answer["pose"] - 1], atol=2e-3)
        assert answer["status"] == "solved"
        assert answer["position_error"] < 1e-4


def test_ik_says_no_with_status_one_and_a_reason(run):
    ended = run("ik", 4, 0, 0.5, 3.14, 0, 0, "--arm", "right")
    assert ended.status == 1
    assert "unreachable" in ended.out
    assert "right_arm_joint7" in ended.out


def test_ik_takes_a_pose_with_commas_as_other_commands_do(run):
    apart = run("ik", 0.9, 0, 0.4, 3.14, 0, 0, "--arm", "right")
    assert apart.status == 0
    assert run("ik", "0.9,0,0.4,3.14,0,0", "--arm", "right").out == apart.out


def test_ik_reads_matrices_archives_and_plans(run, tmp_path):
    T = SE3.from_parts(so3.from_rpy([3.1, 0.1, 0.2]), (0.9, -0.3, 0.4)).matrix
    as_json, as_npz = tmp_path / "poses.json", tmp_path / "poses.npz"
    as_json.write_text(json.dumps({"poses": [T.tolist()]}))
    np.savez(as_npz, T_base_hand=T[None])
    one, other = (run("ik", p, "--json", "--arm", "right") for p in (as_json, as_npz))
    assert one.status == other.status == 0
    assert one.out == other.out


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("ik", 0.9, 0, 0.4), "six numbers a pose"),
        (("ik", 900, 0, 400, 0, 0, 0), "divide by 1000"),
        (("ik", "nan", 0, 0.4, 0, 0, 0), "finite"),
        (("ik", "none.json"), "none.json"),
        (("ik", "none.npz"), "none.npz"),
        (("ik", 0.9, 0, 0.4, 0, 0, 0, "--arm", "rigth"), "Did you mean 'right'"),
        (("reach", "--arm", "middle"), "right, left"),
        (("reach", "--robot", "romann"), "Did you mean 'roman'"),
        (("reach", "--gripper", "robotik_3f"), "Did you mean 'robotiq_3f'"),
        (("reach", "--region", 800, -400, 300, 1000, -200, 400), "divide by 1000"),
        (("reach", "--region", 1, 1, 1, 0, 0, 0), "lower < upper"),
        (("reach", "--report", "reach.pdf"), ".html or .png"),
        (("reach", "--grasps", "none.json"), "none.json"),
    ],
)
def test_bad_input_is_refused_in_words(run, words, told):
    ended = run(*words)
    assert ended.status == 2
    assert told in ended.err
    assert "Traceback" not in ended.err
    assert ended.out == ""


@pytest.mark.parametrize(
    "content", ["[]", "[[1, 2], [3]]", '{"poses": "x"}', "[[[1]]]"]
)
def test_a_file_without_matrices_is_refused(run, tmp_path, content):
    path = tmp_path / "poses.json"
    path.write_text(content)
    ended = run("ik", path)
    assert ended.status == 2
    assert "4x4" in ended.err or "no pose" in ended.err


def test_archives_without_poses_are_refused_in_our_words(run, tmp_path):
    path = tmp_path / "poses.npz"
    np.savez(path, T_base_camera=np.eye(4))
    assert (
        "poses.npz: got other arrays, expected a .npz with T_base"
        in run("ik", path).err
    )
    with path.open("wb") as file:
        np.save(file, np.eye(4))
    assert "poses.npz: got a single array, expected" in run("ik", path).err


def test_reach_tells_both_arms_the_base_and_draws(run, tmp_path):
    png, page = tmp_path / "reach.png", tmp_path / "reach.html"
    ended = run("reach", *REGION, "--report", png, "--report", page)
    assert ended.status == 0
    assert ended.err == ""
    for words in ("right or left", "top-down", "45 deg", "frontal", "where it stands"):
        assert words in ended.out
    assert png.read_bytes()[:4] == b"\x89PNG"
    assert "data:image/png;base64," in page.read_text()
    assert "<td>right or left</td>" in page.read_text()


def test_reach_as_json_holds_every_place(run):
    ended = run("reach", *REGION, "--json", "--gripper", "robotiq_3f")
    facts = ended.json
    assert list(facts["arms"]) == ["right"]
    top = facts["arms"]["right"]["top-down"]
    assert len(top["share"]) == len(facts["places"])
    assert top["free"] > 0.9
    shares = [p["share"] for p in facts["base"]]
    assert shares == sorted(shares, reverse=True)


def test_reach_says_no_with_status_one_and_where_to_go(run):
    ended = run("reach", "--region", 2.0, 0, 0.2, 2.3, 0.2, 0.4, "--json")
    assert ended.status == 1
    assert ended.json["base"][0]["share"] > 0.5
    assert ended.json["base"][0]["x"] > 0.4


def test_reach_ranks_places_for_the_grasps_of_a_plan(run, tmp_path):
    T = SE3.from_parts(so3.from_rpy([3.1, 0.1, 0.2]), (1.9, -0.3, 0.4)).matrix
    grasp = {
        "pose": T.tolist(),
        "gripper": "robotiq_3f",
        "preshape": "basic",
        "opening": 0.1,
        "width": 0.05,
        "prototype": "any",
        "Q": 0.5,
        "S": 0.5,
        "C": 1.0,
        "R": 1.0,
        "score": 0.5,
        "approach": {"pregrasp": T.tolist(), "distance": 0.1},
        "arm": None,
        "joints": None,
        "object": 1,
    }
    plan = {
        "schema": "debrisgrasp/grasps/1",
        "frame": "base",
        "robot": "none",
        "seed": 0,
        "object": 1,
        "region": None,
        "grasps": [grasp],
        "why_empty": None,
        "rejections": {},
        "passed_over": [],
    }
    path = tmp_path / "grasps.json"
    path.write_text(json.dumps(plan))
    ended = run("reach", *REGION, "--grasps", path, "--json")
    assert ended.status == 0
    assert ended.json["base"][0]["share"] == 1.0
    solved = run("ik", path, "--json")
    assert [a["arm"] for a in solved.json] == ["right"]
    grasp["gripper"] = "jaw_140"
    path.write_text(json.dumps(plan))
    for command in (("reach", *REGION, "--grasps", path), ("ik", path)):
        ended = run(*command)
        assert ended.status == 2
        assert "got jaw_140, expected camhand, robotiq_3f" in ended.err
    plan["grasps"] = []
    path.write_text(json.dumps(plan))
    assert run("reach", *REGION, "--grasps", path).status == 2


def test_ik_prefers_postures_in_which_the_robot_does_not_touch_itself(run):
    ended = run("ik", 0.9, -0.3, 0.5, 0, 1.57, 0, "--json")
    assert ended.status == 0
    robot = RobotModel.load("roman")
    T = SE3.from_parts(so3.from_rpy([0, 1.57, 0]), (0.9, -0.3, 0.5)).matrix
    for answer in ended.json:
        assert answer["touches"] == []
        chain = robot.chain(answer["arm"])
        reached = chain.fk(chain.vector(answer["joints"])).matrix
        np.testing.assert_allclose(reached, T, atol=2e-3)


def test_ik_tells_of_a_hand_that_it_has_no_file_of(run, tmp_path):
    own = tmp_path / "own.yaml"
    text = data_path("robots", "roman.yaml").read_text(encoding="utf-8")
    urdf = data_path("robots", "roman.urdf")
    text = text.replace("urdf: roman.urdf", f"urdf: {urdf}")
    own.write_text(text.replace("gripper: camhand", "gripper: my_claw"), "utf-8")
    ended = run("ik", 0.9, -0.3, 0.4, 3.1, 0.1, 0.2, "--robot", own)
    assert "'my_claw', of which there is no file" in ended.err
    assert "--grippers" in ended.err
    ended = run("ik", 0.9, -0.3, 0.4, 3.1, 0.1, 0.2)
    assert "no file" not in ended.err


def test_ik_takes_angles_in_radians_only(run):
    ended = run("ik", 0.9, -0.3, 0.5, 0, 90, 0)
    assert ended.status == 2
    assert "pi / 180" in ended.err
