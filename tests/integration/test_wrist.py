"""A camera that an arm carries: from postures to a pose that captures are read with."""

from __future__ import annotations

import json
import shutil
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest

import debrisgrasp
from debrisgrasp._calibrating import View, WristRig, rig_of
from debrisgrasp.cli import main
from debrisgrasp.cli.doctor_checks import site
from debrisgrasp.errors import ConfigError, UnknownNameError
from debrisgrasp.geometry import SE3
from debrisgrasp.io import data_path
from debrisgrasp.io.observations_file import (
    ObservationFile,
    load_observations,
    save_observations,
)
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.settings import Settings

LINK = "right_arm_link7"
KNOCK = SE3.exp([0.012, -0.006, 0.008, 0.03, -0.02, 0.04])
"""From where the robot's file has the camera to where it is, in its frame."""
SAID = "1.0,-0.1,0.05"
PLACE = np.array([1.012, -0.108, 0.056])
"""Where the fiducial stands."""


@pytest.fixture(scope="module")
def robot_file(tmp_path_factory):
    """RoMan with a camera beside its right palm, ahead of which it looks."""
    folder = tmp_path_factory.mktemp("robot")
    shutil.copy(data_path("robots", "roman.urdf"), folder)
    eye = "{parent: right_robotiq_palm_link, position: [0, 0.09, 0.02], "
    eye += "rpy: [0, 1.5707963, 0]}"
    text = data_path("robots", "roman.yaml").read_text("utf-8")
    text = text.replace("name: roman", "name: eyed").replace(
        "camera: camera_depth_optical_frame", f"camera: eye\nframes:\n  eye: {eye}"
    )
    (folder / "eyed.yaml").write_text(text, "utf-8")
    return folder / "eyed.yaml"


@pytest.fixture(scope="module")
def robot(robot_file):
    return RobotModel.load(robot_file)


@pytest.fixture(scope="module")
def chosen(robot_file, tmp_path_factory):
    """File of postures that `calibrate choose` wrote, and what it printed."""
    path, said = tmp_path_factory.mktemp("looks") / "todo.json", StringIO()
    with redirect_stdout(said):
        words = ["--robot", robot_file, "--fiducial", SAID, "-n", 10, "--out", path]
        assert main(["calibrate", "choose", *map(str, words)]) == 0
    return path, said.getvalue()


@pytest.fixture(scope="module")
def measured(robot, chosen, tmp_path_factory):
    """Look at the fiducial in the postures; a function of seed and place."""
    folder = tmp_path_factory.mktemp("measured")

    def look(seed=0, place=PLACE, rows=slice(None), knock=KNOCK):
        rng = np.random.default_rng(seed)
        given = load_observations(chosen[0])
        seen = []
        for row in given.rows[rows]:
            T_base_camera = robot.T_base_camera(row.joints) @ knock
            point = T_base_camera.inverse().apply(place) + rng.normal(0.0, 0.0025, 3)
            seen.append(replace(row, point=tuple(point.tolist())))
        path = folder / f"looks_{len(list(folder.iterdir()))}.json"
        save_observations(replace(given, rows=tuple(seen)), path)
        return path

    return look


@pytest.fixture(scope="module")
def stored(measured, tmp_path_factory):
    """Accepted calibration."""
    path = tmp_path_factory.mktemp("stored") / "camera.json"
    with redirect_stdout(StringIO()):
        words = ["calibrate", str(measured()), "--out", str(path)]
        assert main(words) == 0
    return path


def test_the_camera_sees_what_was_chosen_and_what_it_tells_is_said(robot, chosen):
    path, said = chosen
    given, view = load_observations(path), View()
    assert given.fiducial == tuple(map(float, SAID.split(",")))
    assert "the first 8 bring the error below 4 mm" in said
    assert "x y z: in the frame of the camera" in said
    for row in given.rows:
        T_base_camera = robot.T_base_camera(row.joints)
        point = T_base_camera.inverse().apply(given.fiducial)
        (u, v), depth = view.intrinsics.project(point)
        assert 20 < u < 828
        assert 20 < v < 460
        assert view.nearest < depth < view.farthest
        # It faces up, and is seen from no lower than its largest angle.
        towards = T_base_camera.p - given.fiducial
        assert towards[2] > np.cos(view.max_angle) * np.linalg.norm(towards)


@pytest.mark.parametrize("seed", range(4))
def test_the_pose_in_the_link_is_found_within_the_predicted_error(
    robot, measured, seed
):
    found = debrisgrasp.calibrate(measured(seed))
    true = robot.link_pose(LINK).inverse() @ robot.T_base_camera() @ KNOCK
    assert found.decision.accepted, found.decision
    assert found.link == LINK
    twist = (found.T_link_camera.inverse() @ true).log()
    squared = twist @ np.linalg.solve(found.head_covariance[:6, :6], twist)
    assert squared < 22.5  # chi-square of 6 degrees of freedom: 1 in 1000
    assert found.error.rms < 0.003


def test_what_is_stored_poses_a_capture_by_the_joints(
    robot, robot_file, stored, chosen
):
    facts = json.loads(stored.read_text())
    assert facts["link"] == LINK
    assert "T_base_camera" not in facts
    assert facts["fiducial"] == [1.0, -0.1, 0.05]
    assert facts["fiducial_shift"] == pytest.approx(PLACE - [1, -0.1, 0.05], abs=0.01)
    joints = dict(load_observations(chosen[0]).rows[0].joints)
    settings = Settings(robot=str(robot_file), calibration=stored)
    T_link_camera = SE3.from_matrix(facts["T_link_camera"])
    expected = robot.link_pose(LINK, joints) @ T_link_camera
    pose = settings.pose_of_camera(joints)
    assert pose.matrix == pytest.approx(expected.matrix)
    # Within what the calibration knows of it.
    true = robot.T_base_camera(joints) @ KNOCK
    ahead = np.array([0.0, 0.0, 0.5])
    assert np.linalg.norm(pose.apply(ahead) - true.apply(ahead)) < 0.008
    capture = settings.capture(data_path("captures", "pile.npz"), joints=joints)
    assert capture.T_base_camera.matrix == pytest.approx(expected.matrix)


def test_a_calibration_of_another_link_than_the_camera_is_on_is_refused(
    robot_file, stored, chosen, tmp_path
):
    joints = load_observations(chosen[0]).rows[0].joints
    shutil.copy(data_path("robots", "roman.urdf"), tmp_path)
    text = robot_file.read_text("utf-8")
    for camera, link in (
        ("parent: left_camhand_palm_link", "left_arm_link7"),
        ("parent: ptu_tilt_link", "ptu_tilt_link"),
    ):
        other = tmp_path / "other.yaml"
        moved = text.replace("parent: right_robotiq_palm_link", camera)
        other.write_text(moved, "utf-8")
        settings = Settings(robot=str(other), calibration=stored)
        words = f"got one of a camera on link '{LINK}', expected .*'{link}'.*'eye'"
        with pytest.raises(ConfigError, match=words):
            settings.pose_of_camera(joints)


@pytest.fixture
def posed(robot, stored, pipe_capture, tmp_path):
    """Capture without a pose, a calibration that gives it its own, and the joints."""
    joints = dict.fromkeys(robot.arms["left"].joints, 0.0)
    joints |= robot.posture("right", robot.arms["right"].idle)
    T_link_base = robot.link_pose(LINK, joints).inverse()
    facts = json.loads(stored.read_text())
    facts["T_link_camera"] = (T_link_base @ pipe_capture.T_base_camera).matrix.tolist()
    (tmp_path / "camera.json").write_text(json.dumps(facts))
    replace(pipe_capture, T_base_camera=None).save(tmp_path / "seen.npz")
    words = [f"{name}={value}" for name, value in joints.items()]
    return tmp_path / "seen.npz", tmp_path / "camera.json", words


def test_plan_puts_the_capture_where_the_joints_have_the_camera(
    run, robot_file, posed, dictionary
):
    seen, camera, words = posed
    ended = run(
        "plan", seen, "--calibration", camera, "--robot", robot_file, "--arm", "right",
        "--prototypes", dictionary, "--joints", *words, "--json", "--deadline", 0.5,
    )  # fmt: skip
    assert ended.status == 0, ended.err
    best = np.array(ended.json["grasps"][0]["pose"])
    # The pipe lies along y at x 0.9, z 0.2; the palm is before it.
    assert np.linalg.norm(best[[0, 2], 3] - [0.9, 0.2]) < 0.2


def test_a_picture_without_the_joints_of_its_arm_is_refused(
    refused, robot_file, posed, dictionary
):
    seen, camera, words = posed
    plan = ("plan", seen, "--calibration", camera, "--prototypes", dictionary)
    here = (*plan, "--robot", robot_file)
    assert f"expected all that move link '{LINK}'" in refused(*here)
    less = [word for word in words if not word.startswith("right_arm_joint7")]
    assert "got none for right_arm_joint7" in refused(*here, "--joints", *less)
    degrees = [*less, "right_arm_joint7=90"]
    assert "90 degrees are 1.571" in refused(*here, "--joints", *degrees)
    assert "expected one of 'roman', the robot in use" in refused(
        *plan, "--joints", *words
    )
    hand = ("--robot", "none", "--gripper", "camhand", "--joints", *words)
    assert "expected one of no robot" in refused(*plan, *hand)
    assert "--joints NAME=VALUE" in refused("segment", seen, "--calibration", camera)
    assert "Give T_base_link @" in refused("segment", seen, "--camera-pose", camera)


def test_a_knock_is_seen_and_mended(run, refused, stored, measured, tmp_path):
    camera = tmp_path / "camera.json"
    shutil.copy(stored, camera)
    calm = run("calibrate", "watch", camera, measured(5, rows=slice(6)), "--json")
    assert calm.status == 0
    assert {look["status"] for look in calm.json} == {"steady"}
    knocked = measured(6, knock=KNOCK @ SE3.exp([0.02, 0, 0, 0, 0.03, 0]))
    assert run("calibrate", "watch", camera, knocked).status == 1
    same = run("calibrate", measured(7, rows=slice(4)), "--previous", camera)
    assert same.status == 0
    assert "'as before'" in same.out
    again = run("calibrate", knocked, "--previous", camera, "--out", camera)
    assert again.status == 0
    assert "'mount, fiducial'" in again.out
    assert "against the one before" in again.out
    assert len(list(tmp_path.glob("camera*.json"))) == 2
    assert run("calibrate", "watch", camera, knocked).status == 0
    elsewhere = ("watch", camera, knocked, "--fiducial", "0.9,0,0")
    assert "fiducial of the looks: got (0.9, 0.0, 0.0)" in refused(
        "calibrate", *elsewhere
    )


def test_a_refused_one_says_what_to_measure_and_is_drawn(run, measured, tmp_path):
    picture = tmp_path / "camera.png"
    ended = run("calibrate", measured(rows=slice(5)), "--report", picture)
    assert ended.status == 1
    assert "5 different places agree, 8 are needed" in ended.out
    assert "measure next" in ended.out
    assert "x y z: in the frame of the camera" in ended.out
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_how_well_the_place_is_known_can_be_stated(run, measured, tmp_path):
    far = measured(place=PLACE + np.array([0.2, 0.0, 0.0]))
    (finding,) = debrisgrasp.calibrate(far).decision.findings
    assert "which was to be right within 20 mm" in finding.problem
    assert run("calibrate", far, "--fiducial-sigma", 0.3).status == 0
    content = json.loads(far.read_text()) | {"fiducial_sigma": 0.3}
    stated = tmp_path / "stated.json"
    stated.write_text(json.dumps(content))
    assert debrisgrasp.calibrate(stated).decision.accepted
    assert load_observations(stated).fiducial_sigma == 0.3


def test_a_calibration_of_another_kind_of_camera_is_refused(
    refused, stored, measured, tmp_path
):
    fixed = tmp_path / "fixed.json"
    looks = data_path("calibration", "roman_looks.yaml")
    with redirect_stdout(StringIO()):
        assert main(["calibrate", str(looks), "--out", str(fixed)]) == 0
    facts = json.loads(fixed.read_text()) | {"robot": None}
    fixed.write_text(json.dumps(facts))
    one = "expected one of a camera on "
    assert f"{one}{LINK}" in refused("calibrate", measured(), "--previous", fixed)
    assert "robot 'eyed'" in refused("calibrate", looks, "--previous", stored)
    with pytest.raises(ConfigError, match=f"{one}{LINK}"):
        debrisgrasp.calibrate(measured(), previous=fixed)
    before = fixed.read_bytes()
    assert f"{one}{LINK}" in refused("calibrate", measured(), "--out", fixed)
    assert fixed.read_bytes() == before


def test_a_fiducial_that_the_camera_can_not_look_at_is_refused(robot_file, tmp_path):
    def rig(fiducial, robot=robot_file):
        return rig_of(ObservationFile(rows=()), tmp_path, robot, fiducial)

    assert isinstance(rig("chassis_link"), WristRig)
    with pytest.raises(ConfigError, match="joint left_arm_joint7 moves"):
        rig("left_hand")
    with pytest.raises(UnknownNameError, match="chassis_lin"):
        rig("chassis_lin")
    with pytest.raises(ConfigError, match="metres"):
        rig((900.0, 0.0, 50.0))
    with pytest.raises(ConfigError, match="which never moves, nor does the camera"):
        rig((0.9, 0.0, 0.05), "roman")


def test_a_look_that_gives_a_position_or_lacks_a_joint_is_refused(
    refused, measured, tmp_path
):
    content = json.loads(measured().read_text())
    rows, path = content["observations"], tmp_path / "looks.json"

    def said(**changes):
        rows[2] = json.loads(measured().read_text())["observations"][2] | changes
        path.write_text(json.dumps(content))
        return refused("calibrate", path)

    assert "position of observation look_3" in said(position=[1.0, 0.0, 0.0])
    less = {k: v for k, v in rows[1]["joints"].items() if k != "right_arm_joint3"}
    assert "got no right_arm_joint3, expected every joint between base and " in said(
        joints=less
    )
    assert "degrees" in said(joints={**less, "right_arm_joint3": 45.0})
    content["fiducial"] = [1.0, 0.0]
    assert "fiducial of" in said()


def first_of(what, settings):
    """First thing that the doctor says about something; it is not asked for more."""
    return next(found for found in site(settings) if what in found.what + found.text)


def test_the_doctor_tells_of_a_camera_that_an_arm_carries(
    robot_file, stored, dictionary
):
    usual = Settings(arm="right", prototypes=dictionary, calibration=stored)
    other = first_of("camera", usual)
    assert other.status == "fault"
    assert f"on link '{LINK}' of robot 'eyed', not of this one" in other.text
    findings = site(replace(usual, robot=str(robot_file)))
    mine = next(found for found in findings if found.what == "camera")
    assert mine.text.endswith(f"on link {LINK}: captures need --joints")
    camera = next(found for found in findings if found.what == "camera of eyed")
    assert camera.status == "note"
    assert "eye, which the right arm carries; `clear` expects" in camera.text


def test_the_doctor_tells_of_a_hand_that_is_held_where_it_rests(dictionary, tmp_path):
    shutil.copy(data_path("robots", "roman.urdf"), tmp_path)
    text = data_path("robots", "roman.yaml").read_text("utf-8")
    still = tmp_path / "still.yaml"
    still.write_text(text.replace("present: ready", "present: travel"), "utf-8")
    settings = Settings(robot=str(still), arm="right", prototypes=dictionary)
    told = first_of("whether the camera has moved", settings)
    assert told.status == "note"
    assert told.what == "posture travel of right arm"
