"""The file of a site on the command line, and the doctor that checks it."""

from __future__ import annotations

import json
import re
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from debrisgrasp._files import data_path
from debrisgrasp.cli import doctor_checks
from debrisgrasp.cli.doctor_checks import EXTRAS, Finding
from debrisgrasp.cli.doctor_command import table
from debrisgrasp.geometry import SE3
from debrisgrasp.io import Capture
from debrisgrasp.io.plan_json import load_plan

JAW = Path(__file__).parents[2] / "examples/jaw_site.yaml"
SITE = """
schema: debrisgrasp/site/1
robot: none
gripper: robotiq_3f
prototypes: {prototypes}
selection: {{policy: priority, priority_point: [0.8, 0.3, 0.2]}}
seed: 3
"""


@pytest.fixture
def site(tmp_path, dictionary) -> Path:
    path = tmp_path / "site.yaml"
    path.write_text(SITE.format(prototypes=dictionary), encoding="utf-8")
    return path


@pytest.fixture
def quick(monkeypatch) -> None:
    """Leave out the self-test, which another test runs."""
    monkeypatch.setattr(doctor_checks, "self_test", lambda _: [])


def test_plan_takes_robot_hand_dictionary_and_seed_from_the_site(
    run, site, dictionary, pipe_file
):
    plan = run("plan", pipe_file, "--site", site, "--json").json
    assert (plan["robot"], plan["seed"]) == ("none", 3)
    assert {grasp["gripper"] for grasp in plan["grasps"]} == {"robotiq_3f"}
    spelled = run(
        "plan", pipe_file, "--robot", "none", "--gripper", "robotiq_3f", "--seed", 3,
        "--prototypes", dictionary,
        "--policy", "priority", "--priority-point", 0.8, 0.3, 0.2, "--json",
    ).json  # fmt: skip
    assert plan == spelled


def test_arguments_go_before_the_site(run, site, pipe_file):
    plan = run("plan", pipe_file, "--site", site, "--seed", 4, "--json").json
    assert plan["seed"] == 4


def test_a_plan_is_scored_by_the_coefficients_of_the_site(
    run, refused, tmp_path, pipe_file, dictionary
):
    site, own = tmp_path / "site.yaml", tmp_path / "own.json"
    site.write_text("schema: debrisgrasp/site/1\nrobot: none\nsuccess: own.json\n")
    content = json.loads(data_path("planning", "success.json").read_text())
    own.write_text(json.dumps(content | {"campaign": "the same"}))
    command = ("plan", pipe_file, "--robot", "none", "--prototypes", dictionary)
    shipped = run(*command, "--json").json
    same = run(*command, "--site", site, "--json")
    assert same.json["grasps"] == shipped["grasps"]
    note = f"scores come from coefficients that were given: {content['date']}, the same"
    assert same.json["notes"] == [*shipped["notes"], note]
    assert f"note: {note}" in same.err
    own.write_text(json.dumps(content | {"intercept": content["intercept"] - 2.0}))
    gloomy = run(*command, "--site", site, "--json").json
    assert gloomy["grasps"][0]["score"] < shipped["grasps"][0]["score"]
    content["terms"]["lever"]["weight"] = -1.0
    own.write_text(json.dumps(content))
    assert "own.json, weight of lever" in refused(*command, "--site", site)


def test_select_takes_policy_and_point_from_the_site(run, site, block_file):
    order = run("select", block_file, "--site", site, "--json").json
    assert order[0]["reason"].endswith("from the priority point")
    given = ("--policy", "priority", "--priority-point", 0.8, 0.3, 0.2)
    assert order == run("select", block_file, *given, "--json").json


def test_select_judges_width_by_the_hands_of_the_site(run):
    pile = data_path("captures", "pile.npz")
    assert "hands open 18 cm" in run("select", pile).out
    ended = run("select", pile, "--site", JAW)
    assert "hands open 14 cm" in ended.out
    assert "hands open 18 cm" not in ended.out


def test_segment_takes_the_pose_of_the_camera_from_the_site(run, tmp_path, pipe_file):
    path = tmp_path / "site.yaml"
    pose = "schema: debrisgrasp/site/1\ncamera: {pose: [0.2, 0, 1.7, -2.2, 0, -1.57]}"
    path.write_text(pose, encoding="utf-8")
    before, after = (
        run("segment", pipe_file, *given, "--json").json["objects"]
        for given in ((), ("--site", path))
    )
    assert before != after


def test_a_pose_that_replaces_that_of_a_capture_is_told_of(run, tmp_path, pipe_file):
    path = tmp_path / "site.yaml"
    level = "schema: debrisgrasp/site/1\ncamera: {pose: [0.1, 0, 1.4, -2.2, 0, -1.57]}"
    path.write_text(level, encoding="utf-8")
    ended = run("segment", pipe_file, "--site", path, "--json")
    assert "has a camera pose of its own, which is not used" in ended.err
    assert "mm and" in ended.err
    assert json.loads(ended.out)["ground"]["pose_doubt"] in ended.err
    np.save(tmp_path / "own.npy", Capture.load(pipe_file).T_base_camera.matrix)
    same = run("segment", pipe_file, "--camera-pose", tmp_path / "own.npy")
    assert same.err == ""


def test_a_doubtful_pose_is_told_on_stderr_and_stays_with_the_plan(
    run, dictionary, tmp_path, pipe_capture
):
    raised = SE3.from_parts(p=[0.0, 0.0, 0.3]) @ pipe_capture.T_base_camera
    path, out = tmp_path / "raised.npz", tmp_path / "grasps.json"
    replace(pipe_capture, T_base_camera=raised).save(path)
    ended = run(
        "plan", path, "--robot", "none", "--prototypes", dictionary, "--out", out
    )
    assert ended.status == 0
    assert "note: camera pose in doubt" in ended.err
    assert "in doubt" not in ended.out
    assert any("camera pose in doubt" in note for note in load_plan(out).notes)


def test_a_wrong_site_is_refused_in_one_block(refused, site, pipe_file):
    site.write_text(site.read_text() + "arm: left\nwheels: 4\n", encoding="utf-8")
    assert "wheels" in refused("plan", pipe_file, "--site", site)
    assert "wheels" in refused("doctor", "--site", site)


def test_a_drop_off_of_an_arm_that_is_none_is_refused(refused, tmp_path, pipe_file):
    path = tmp_path / "site.yaml"
    path.write_text("schema: debrisgrasp/site/1\ndrop_off: {rigth: [0.6, 0]}\n")
    message = refused("plan", pipe_file, "--site", path)
    assert "arm in drop_off" in message
    assert "Did you mean 'right'" in message


@pytest.mark.usefixtures("quick")
def test_the_doctor_finds_a_sound_site_sound(run, site):
    ended = run("doctor", "--site", site)
    assert ended.status == 0, ended
    assert "4 for robotiq_3f" in ended.out
    assert "all is well" in ended.out


@pytest.mark.usefixtures("quick")
def test_the_doctor_reads_the_camera_file_of_a_site(run, refused, site, tmp_path):
    lens = tmp_path / "lens.json"
    site.write_text(site.read_text() + "camera: {file: lens.json}\n", encoding="utf-8")
    K = [600, 0, 319.5, 0, 600, 239.5, 0, 0, 1]
    lens.write_text(json.dumps({"K": K}), encoding="utf-8")
    ended = run("doctor", "--site", site)
    assert ended.status == 0, ended
    assert "fx 600" in ended.out
    for broken in ("{", json.dumps({"K": [0] * 9}), json.dumps({"width": 640})):
        lens.write_text(broken, encoding="utf-8")
        assert "lens.json" in refused("doctor", "--site", site)


def test_the_camera_file_of_a_site_is_not_for_captures_with_a_camera(
    run, refused, tmp_path, pipe_file
):
    site, lens = tmp_path / "site.yaml", tmp_path / "lens.json"
    site.write_text("schema: debrisgrasp/site/1\ncamera: {file: lens.json}\n")
    K = [600, 0, 319.5, 0, 600, 239.5, 0, 0, 1]
    lens.write_text(json.dumps({"K": K}), encoding="utf-8")
    assert run("segment", pipe_file, "--site", site).status == 0
    message = refused("segment", pipe_file, "--site", site, "--camera-file", lens)
    assert "camera file" in message


def test_motion_names_the_site_of_an_unknown_robot(refused, tmp_path, pipe_file):
    site, grasps = tmp_path / "site.yaml", tmp_path / "grasps.json"
    site.write_text("schema: debrisgrasp/site/1\nrobot: romam\n", encoding="utf-8")
    grasps.write_text("{}", encoding="utf-8")
    message = refused("motion", pipe_file, "--site", site, "--grasps", grasps)
    assert "site.yaml" in message


def test_clear_needs_a_robot_with_a_camera_before_it_writes(refused, tmp_path):
    robot, record = tmp_path / "blind.yaml", tmp_path / "run"
    shipped = data_path("robots") / "roman.yaml"
    text = shipped.read_text(encoding="utf-8")
    text = text.replace("camera: camera_depth_optical_frame\n", "")
    urdf = shipped.with_suffix(".urdf").as_posix()
    robot.write_text(text.replace("urdf: roman.urdf", f"urdf: {urdf}"))
    message = refused("clear", "--objects", 1, "--robot", robot, "--record", record)
    assert "camera of robot roman: got none" in message
    assert not record.exists()


@pytest.mark.parametrize("place", ["[3, 0]", "[0.0, 0.1]", "[0.9, 0.0]"])
def test_clear_names_the_field_of_a_drop_off_before_it_writes(refused, tmp_path, place):
    site, record = tmp_path / "site.yaml", tmp_path / "run"
    site.write_text(
        f"schema: debrisgrasp/site/1\narm: right\ndrop_off: {{right: {place}}}\n",
        encoding="utf-8",
    )
    message = refused("clear", "--objects", 1, "--site", site, "--record", record)
    assert "site.yaml, field drop_off.right: got" in message
    assert not record.exists()


@pytest.mark.usefixtures("quick")
def test_a_drop_off_on_the_other_side_is_no_surprise_to_the_doctor(
    run, refused, tmp_path
):
    path = tmp_path / "site.yaml"
    path.write_text(
        "schema: debrisgrasp/site/1\ndrop_off: {right: [0.25, 0.75]}\n",
        encoding="utf-8",
    )
    message = refused("clear", "--objects", 1, "--site", path)
    assert "beside the left arm" in message
    ended = run("doctor", "--site", path)
    assert ended.status == 1
    assert "beside the left arm" in ended.out
    found = _on_drop_off(run("doctor", "--site", path, "--json"))
    assert found["status"] == "fault"  # and no row beside it says otherwise


def test_the_doctor_keeps_to_the_width_of_a_terminal():
    text = " ".join(map(str, range(100)))
    findings = [Finding("drop-off", "ok", text), Finding("robot", "note", "")]
    lines = table("site", findings, 60).splitlines()
    assert max(map(len, lines)) <= 60
    assert " ".join(" ".join(lines).split()).endswith(f"ok {text} robot note")
    assert len(table("site", findings, None).splitlines()) == 4
    assert table("self-test", [], 60)


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(("name", "value"), [("force", 10), ("torque", 4.9)])
def test_limits_too_low_to_feel_a_touch_are_no_surprise_to_the_doctor(
    run, refused, tmp_path, name, value
):
    path, out = tmp_path / "site.yaml", tmp_path / "out"
    path.write_text(f"schema: debrisgrasp/site/1\nlimits: {{{name}: {value}}}\n")
    words = f"limits.{name}: got {value} N"
    for command in (("clear",), ("campaign", "--n", 1, "--out", out)):
        assert f"site.yaml, field {words}" in refused(*command, "--site", path)
    assert not out.exists()
    ended = run("doctor", "--site", path)
    assert ended.status == 1
    assert words in ended.out


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("limits", ["", "limits: {torque: 39}\n"])
def test_a_robot_too_weak_to_feel_a_touch_is_not_held_against_its_site(
    run, refused, tmp_path, limits
):
    own = data_path("robots", "roman.yaml").read_text().replace("150.0", "60.0")
    (tmp_path / "weak.yaml").write_text(own.replace("name: roman", "name: weak"))
    shutil.copy(data_path("robots", "roman.urdf"), tmp_path)
    site = tmp_path / "site.yaml"
    site.write_text(f"schema: debrisgrasp/site/1\nrobot: weak.yaml\n{limits}")
    message = refused("clear", "--site", site)
    assert "limits.force of the right arm of robot weak: got 60 N" in message
    assert "field" not in message
    checks = run("doctor", "--site", site, "--json").json["checks"]
    findings = [finding for some in checks.values() for finding in some]
    weak = [found["status"] for found in findings if "refuses that" in found["text"]]
    assert weak == ["note", "note"]


@pytest.mark.usefixtures("quick")
def test_the_doctor_names_what_must_be_mended(run, tmp_path):
    path = tmp_path / "site.yaml"
    path.write_text(
        "schema: debrisgrasp/site/1\narm: right\ndrop_off: {right: [3, 0]}\n",
        encoding="utf-8",
    )
    ended = run("doctor", "--site", path)
    assert ended.status == 1
    assert "that the hand reaches" in ended.out.splitlines()[-1]
    path.write_text(
        "schema: debrisgrasp/site/1\narm: right\n"
        "drop_off: {right: [0.6, -0.8], left: [0.6, 0.8]}\n",
        encoding="utf-8",
    )
    ended = run("doctor", "--site", path, "--json")
    assert ended.status == 0
    assert _on_drop_off(ended)["status"] == "ok"
    assert _on_drop_off(ended, "left")["status"] == "note"  # clear does without it
    for place, words in (
        ("[0.0, 0.1]", "the robot stands"),
        ("[0.9, 0.0]", "in the way"),
    ):
        path.write_text(
            f"schema: debrisgrasp/site/1\narm: right\ndrop_off: {{right: {place}}}\n",
            encoding="utf-8",
        )
        found = _on_drop_off(run("doctor", "--site", path, "--json"))
        assert found["status"] == "fault"
        assert words in found["text"]


def _on_drop_off(ended, arm="right"):
    (finding,) = (
        finding
        for findings in ended.json["checks"].values()
        for finding in findings
        if finding["what"] == f"drop-off of {arm} arm"
    )
    return finding


@pytest.mark.usefixtures("quick")
def test_the_doctor_tells_of_arms_without_bodies(run, tmp_path):
    text = data_path("robots", "roman.urdf").read_text(encoding="utf-8")
    bare = re.sub(r"<collision.*?</collision>", "", text, flags=re.DOTALL)
    (tmp_path / "roman.urdf").write_text(bare, encoding="utf-8")
    robot = data_path("robots", "roman.yaml").read_text(encoding="utf-8")
    (tmp_path / "bare.yaml").write_text(robot, encoding="utf-8")
    path = tmp_path / "site.yaml"
    path.write_text("schema: debrisgrasp/site/1\nrobot: bare.yaml\n", "utf-8")
    ended = run("doctor", "--site", path)
    assert ended.status == 1
    assert ended.out.count("none has a solid") >= 2


@pytest.mark.usefixtures("quick")
def test_the_doctor_tells_of_postures_in_which_the_robot_touches_itself(run, tmp_path):
    robot = yaml.safe_load(data_path("robots", "roman.yaml").read_text("utf-8"))
    robot["urdf"] = str(data_path("robots", "roman.urdf"))
    robot["arms"]["left"]["postures"]["ready"] = {"left_arm_joint1": 1.9}
    (tmp_path / "folded.yaml").write_text(yaml.safe_dump(robot), "utf-8")
    path = tmp_path / "site.yaml"
    path.write_text("schema: debrisgrasp/site/1\nrobot: folded.yaml\n", "utf-8")
    ended = run("doctor", "--site", path, "--json")
    assert ended.status == 1
    faults = {
        finding["what"]: finding["text"]
        for findings in ended.json["checks"].values()
        for finding in findings
        if finding["status"] == "fault"
    }
    assert list(faults) == ["posture ready of left arm"]
    assert " touches " in faults["posture ready of left arm"]


@pytest.mark.usefixtures("quick")
def test_the_doctor_lists_arms_without_a_place_as_the_robot_does(run, tmp_path):
    robot = yaml.safe_load(data_path("robots", "roman.yaml").read_text("utf-8"))
    robot["urdf"] = str(data_path("robots", "roman.urdf"))
    names = ["upper", "port", "third", "aft", "lower"]
    robot["arms"] = dict.fromkeys(names, robot["arms"]["left"])
    (tmp_path / "many.yaml").write_text(yaml.safe_dump(robot, sort_keys=False), "utf-8")
    path = tmp_path / "site.yaml"
    path.write_text("schema: debrisgrasp/site/1\nrobot: many.yaml\n", "utf-8")
    ended = run("doctor", "--site", path, "--json")
    told = [
        finding["what"]
        for findings in ended.json["checks"].values()
        for finding in findings
        if finding["what"].startswith("drop-off of")
    ]
    assert told == [f"drop-off of {name} arm" for name in names]


@pytest.mark.usefixtures("quick")
def test_the_doctor_tells_of_an_arm_that_rests_below_the_ground(run, tmp_path):
    robot = yaml.safe_load(data_path("robots", "roman.yaml").read_text("utf-8"))
    robot["urdf"] = str(data_path("robots", "roman.urdf"))
    high = {"parent": robot["base"], "position": [0.0, 0.0, 0.8]}
    robot |= {"base": "high", "frames": {"high": high}}
    (tmp_path / "high.yaml").write_text(yaml.safe_dump(robot), "utf-8")
    path = tmp_path / "site.yaml"
    path.write_text("schema: debrisgrasp/site/1\nrobot: high.yaml\n", "utf-8")
    notes = {
        finding["what"]: finding["text"]
        for findings in run("doctor", "--site", path, "--json").json["checks"].values()
        for finding in findings
        if finding["status"] == "note"
    }
    assert "one on the ground" in notes["rest of right arm"]


@pytest.mark.usefixtures("quick")
def test_the_doctor_tells_of_an_arm_that_is_present_at_a_limit(run, tmp_path):
    robot = yaml.safe_load(data_path("robots", "roman.yaml").read_text("utf-8"))
    robot["urdf"] = str(data_path("robots", "roman.urdf"))
    robot["arms"]["left"]["postures"]["ready"]["torso_joint"] = 1.57
    (tmp_path / "turned.yaml").write_text(yaml.safe_dump(robot), "utf-8")
    path = tmp_path / "site.yaml"
    path.write_text("schema: debrisgrasp/site/1\nrobot: turned.yaml\n", "utf-8")
    ended = run("doctor", "--site", path)
    (line,) = (line for line in ended.out.splitlines() if "can't begin there" in line)
    assert "posture ready of left arm" in line
    assert "torso_joint" in line


@pytest.mark.usefixtures("quick")
def test_the_doctor_tells_speeds_of_slides_in_metres(run, tmp_path):
    urdf = data_path("robots", "roman.urdf").read_text("utf-8")
    turning = 'name="torso_joint" type="revolute"'
    assert urdf.count(turning) == 1
    slides = urdf.replace(turning, turning.replace("revolute", "prismatic"))
    (tmp_path / "roman.urdf").write_text(slides, "utf-8")
    robot = data_path("robots", "roman.yaml").read_text("utf-8")
    (tmp_path / "lifted.yaml").write_text(robot, "utf-8")
    path = tmp_path / "site.yaml"
    path.write_text("schema: debrisgrasp/site/1\nrobot: lifted.yaml\n", "utf-8")
    ended = run("doctor", "--site", path)
    assert ended.out.count(" rad/s and 0.50 m/s, hand") == 2


@pytest.mark.usefixtures("quick")
def test_the_doctor_tells_of_a_hand_that_is_turned_back_into_its_arm(run, tmp_path):
    mounted = '<child link="right_robotiq_palm_link"/><origin xyz="0 0 0" rpy="0 0 '
    urdf = data_path("robots", "roman.urdf").read_text("utf-8")
    assert urdf.count(mounted + "0") == 1
    turned = urdf.replace(mounted + "0", mounted + "3.14")
    (tmp_path / "roman.urdf").write_text(turned, "utf-8")
    robot = data_path("robots", "roman.yaml").read_text("utf-8")
    (tmp_path / "turned.yaml").write_text(robot, "utf-8")
    path = tmp_path / "site.yaml"
    path.write_text("schema: debrisgrasp/site/1\nrobot: turned.yaml\n", "utf-8")
    ended = run("doctor", "--site", path)
    assert ended.status == 1
    assert "right_robotiq_finger_a_link1 and right_arm_link6" in ended.out
    assert "is the hand turned back?" in ended.out


def test_the_doctor_plans_on_the_shipped_capture(run):
    ended = run("doctor", "--json")
    assert ended.status == 0, ended
    found = {f["what"]: f for f in ended.json["checks"]["self-test"]}
    assert set(found) == {"loading", "segment", "plan"}
    assert "grasps in" in found["plan"]["text"]


def test_a_failing_self_test_is_a_fault(run, monkeypatch):
    faulty = [Finding("plan", "fault", "no grasp")]
    monkeypatch.setattr(doctor_checks, "self_test", lambda _: faulty)
    ended = run("doctor")
    assert ended.status == 1
    assert ended.out.endswith("to mend: plan: no grasp\n")


def test_missing_old_and_too_new_packages_are_told(monkeypatch):
    wanted = [
        "numpy>=99.1",
        "nosuchthing>=1; extra == 'viz'",
        "pyyaml<99,>=1.0; extra == 'sim'",
        "scipy<1,>=0.1; extra == 'motion'",
    ]
    monkeypatch.setattr(doctor_checks, "requires", lambda _: wanted)
    found = {finding.what: finding for finding in doctor_checks.installation()}
    assert found["numpy"].status == "fault"
    assert "at least 99.1" in found["numpy"].text
    assert "pip install 'debrisgrasp[viz]'" in found["extra viz"].text
    assert found["extra viz"].status == "note"
    assert found["extra sim"].status == "ok"
    assert "one below 1 is needed" in found["extra motion"].text


def test_a_cache_that_cannot_be_written_is_a_note(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("DEBRISGRASP_CACHE", str(tmp_path / "file" / "cache"))
    found = {finding.what: finding for finding in doctor_checks.installation()}
    assert found["cache"].status == "note"
    assert "cache: Not a directory; everything works" in found["cache"].text


def test_every_extra_has_a_use():
    pyproject = Path(__file__).parents[2] / "pyproject.toml"
    project = tomllib.loads(pyproject.read_text())["project"]
    assert set(EXTRAS) == set(project["optional-dependencies"])


def test_ik_and_reach_take_the_arm_of_the_site(run, tmp_path):
    path = tmp_path / "site.yaml"
    path.write_text("schema: debrisgrasp/site/1\narm: left\n", encoding="utf-8")
    (answer,) = run("ik", 0.8, 0.2, 0.5, 3.0, 0, 0, "--site", path, "--json").json
    assert answer["arm"] == "left"
    region = ("--region", 0.8, 0.2, 0.3, 0.9, 0.3, 0.4)
    assert set(run("reach", *region, "--site", path, "--json").json["arms"]) == {"left"}


def test_prototype_takes_hands_and_dictionary_from_the_site(run, tmp_path):
    listed = run("prototype", "list", "--site", JAW, "--json").json
    assert {prototype["gripper"] for prototype in listed} == {"jaw_140"}
    words = (
        "--shape",
        "cylinder",
        "--diameter",
        0.05,
        "--length",
        0.3,
        "--name",
        "rod",
    )
    folder = ("--gripper", "jaw_140", "--out", tmp_path / "own")
    assert run("prototype", "new", *words, *folder, "--site", JAW).status == 0


def test_calibrate_takes_the_robot_of_the_site_for_a_fiducial(run, tmp_path):
    site = tmp_path / "site.yaml"
    robot = data_path("robots", "roman.yaml")
    site.write_text(f"schema: debrisgrasp/site/1\nrobot: {robot}\n", encoding="utf-8")
    looks = tmp_path / "looks.json"
    fiducial = ("--fiducial", "right_robotiq_led_frame", "--site", site)
    assert run("calibrate", "choose", *fiducial, "-n", 5, "--out", looks).status == 0
    assert json.loads(looks.read_text())["robot"] == str(robot)
