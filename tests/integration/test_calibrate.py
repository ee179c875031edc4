"""From observations to a verdict, a picture, and a pose that captures are read with."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

import debrisgrasp
from debrisgrasp._calibrating import CalibrationRig, View, choose_postures, rig_of
from debrisgrasp.errors import ConfigError, InputError, UnknownNameError
from debrisgrasp.geometry import SE3, Intrinsics, so3
from debrisgrasp.io import Capture, data_path
from debrisgrasp.io.observations_file import ObservationFile, load_observations
from debrisgrasp.kinematics import RobotModel
from tests.benchmarks.led_views import led_view

LOOKS = data_path("calibration", "roman_looks.yaml")
LATER = data_path("calibration", "roman_later.yaml")
LED = "right_robotiq_led_frame"


@pytest.fixture(scope="module")
def rig() -> CalibrationRig:
    return CalibrationRig(robot=RobotModel.load("roman"), fiducial=LED)


@pytest.fixture
def calibration_file(run, tmp_path):
    path = tmp_path / "camera.json"
    assert run("calibrate", LOOKS, "--out", path).status == 0
    return path


def test_the_bundled_looks_are_calibrated_and_the_wrong_pick_is_named(run, tmp_path):
    ended = run(
        "calibrate", LOOKS, "--out", tmp_path / "c.json", "--report", tmp_path / "c.png"
    )
    assert ended.status == 0
    assert ended.out.startswith("accepted")
    assert "wrong pick: look_5" in ended.out
    assert (tmp_path / "c.png").read_bytes().startswith(b"\x89PNG")
    facts = json.loads((tmp_path / "c.json").read_text())
    shoulder = np.array(facts["T_shoulder_camera"])
    base = np.array(facts["T_base_camera"])
    # RoMan's torso link stands at (0.33, 0, 0.25), unturned.
    assert base[:3, 3] - shoulder[:3, 3] == pytest.approx([0.33, 0.0, 0.25])
    assert [o["outlier"] for o in facts["observations"]].count(True) == 1


def test_the_facade_gives_what_the_command_writes(calibration_file):
    found = debrisgrasp.calibrate(LOOKS)
    facts = json.loads(calibration_file.read_text())
    assert found.T_base_camera.matrix == pytest.approx(np.array(facts["T_base_camera"]))


def test_too_few_looks_are_refused_with_what_to_do(run, tmp_path):
    content = json.loads(run("calibrate", LOOKS, "--json").out)
    rows = [
        {"name": o["name"], "position": o["position"], "point": o["point"]}
        for o in content["observations"][:4]
    ]
    path = tmp_path / "few.json"
    path.write_text(json.dumps({"observations": rows}))
    named = run("calibrate", path, "--robot", "roman", "--fiducial", LED)
    assert named.status == 1
    assert "REFUSED" in named.out
    assert "5 are needed" in named.out
    _, _, proposed = named.out.partition("measure next")
    assert "look_5" in proposed
    assert not any(row["name"] in proposed for row in rows)
    unnamed = run("calibrate", path)
    assert unnamed.status == 1
    assert "measure next" not in unnamed.out


def test_a_slip_is_seen_and_mended_with_few_looks(run, calibration_file):
    watched = run("calibrate", "watch", calibration_file, LATER)
    assert watched.status == 1
    assert "ptu_tilt_joint slipped by" in watched.out
    mended = run(
        "calibrate", LATER, "--previous", calibration_file, "--out", calibration_file
    )
    assert mended.status == 0
    assert "'slipped head'" in mended.out
    assert "against the one before" in mended.out
    assert len(list(calibration_file.parent.glob("camera*.json"))) == 2
    again = run("calibrate", "watch", calibration_file, LATER, "--json")
    assert again.status == 0
    assert {look["status"] for look in again.json} == {"steady"}


def test_what_is_of_another_robot_is_refused(calibration_file, run, refused, tmp_path):
    assert json.loads(calibration_file.read_text())["robot"] == "roman"
    shutil.copy(data_path("robots", "roman.urdf"), tmp_path)
    other = tmp_path / "other.yaml"
    text = data_path("robots", "roman.yaml").read_text("utf-8")
    other.write_text(text.replace("name: roman", "name: other"), "utf-8")
    for given in (
        ("watch", calibration_file, LATER),
        ("solve", LATER, "--previous", calibration_file),
        ("choose", "--known", calibration_file, "--fiducial", LED),
    ):
        words = refused("calibrate", *given, "--robot", other)
        assert "one of the robot 'roman', expected one of 'other'" in words
    pile = data_path("captures", "pile.npz")
    for command in (("plan", pile), ("motion", pile, "--grasps", tmp_path / "g.json")):
        ended = run(*command, "--calibration", calibration_file, "--robot", other)
        assert ended.status == 2
        assert "one of the robot 'roman', expected one of 'other'" in ended.err


def test_a_wrong_pick_is_no_drift(run, calibration_file):
    watched = run("calibrate", "watch", calibration_file, LOOKS)
    assert watched.status == 0
    assert "slipped" not in watched.out
    assert watched.out.rstrip().endswith("agree: look_5")
    facts = run("calibrate", "watch", calibration_file, LOOKS, "--json").json
    assert [f["look"] for f in facts if f["wrong_pick"]] == ["look_5"]


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ("size", "40 x 30 pixels"),
        ("camera", "intrinsics"),
        ("pose", "camera pose, 20 mm"),
        ("depth", "depth at 100 %"),
    ],
)
def test_an_off_picture_of_another_view_is_refused(refused, tmp_path, change, word):
    k = Intrinsics(fx=60.0, fy=60.0, cx=31.5, cy=23.5, width=64, height=48)
    pose = SE3.from_parts(p=[0.0, 0.0, 1.0])
    views = {"on": [np.full((48, 64), 1.0), k, pose]}
    views["off"] = list(views["on"])
    if change in ("size", "camera"):
        small = Intrinsics(fx=60.0, fy=60.0, cx=19.5, cy=14.5, width=40, height=30)
        other = Intrinsics(fx=61.0, fy=61.0, cx=31.5, cy=23.5, width=64, height=48)
        views["off"][1] = small if change == "size" else other
        if change == "size":
            views["off"][0] = np.full((30, 40), 1.0)
    if change == "pose":
        views["off"][2] = SE3.from_parts(p=[0.0, 0.02, 1.0])
    if change == "depth":
        views["off"][0] = np.full((48, 64), 1.2)
    for name, (depth, intrinsics, T) in views.items():
        rgb = np.zeros((*depth.shape, 3), dtype=np.uint8)
        Capture(depth=depth, intrinsics=intrinsics, rgb=rgb, T_base_camera=T).save(
            tmp_path / f"{name}.npz"
        )
    assert word in refused(
        "calibrate", "find", tmp_path / "on.npz", "--off", tmp_path / "off.npz",
        "--expected", 0, 0, 1,
    )  # fmt: skip


def test_the_option_that_is_wrong_is_named(refused):
    said = refused("calibrate", "choose", "--fiducial", LED, "-n", 0)
    assert "-n: got 0" in said
    assert "seed" not in said
    assert "--seed: got -1" in refused(
        "calibrate", "choose", "--fiducial", LED, "--seed", -1
    )


def test_a_capture_is_read_with_a_calibration(run, calibration_file, refused):
    capture = data_path("captures", "pile.npz")
    ended = run("segment", capture, "--calibration", calibration_file, "--json")
    own = run("segment", capture, "--json")
    assert ended.status == own.status == 0
    assert ended.json["objects"] != own.json["objects"]
    assert "one of them" in refused(
        "segment", capture, "--calibration", calibration_file, "--camera-pose", "level"
    )


def test_a_refused_calibration_is_not_taken(run, refused, tmp_path):
    content = json.loads(run("calibrate", LOOKS, "--json").out)
    content |= {"accepted": False, "findings": [{"problem": "bad", "remedy": "x"}]}
    path = tmp_path / "bad.json"
    path.write_text(json.dumps(content))
    capture = data_path("captures", "pile.npz")
    assert "refused: bad" in refused("segment", capture, "--calibration", path)


def test_postures_are_chosen_into_a_file_to_be_filled_in(run, tmp_path, refused):
    path = tmp_path / "todo.json"
    ended = run("calibrate", "choose", "--fiducial", LED, "-n", 6, "--out", path)
    assert ended.status == 0
    assert "bring the error below 4 mm" in ended.out
    given = load_observations(path)
    assert len(given.rows) == 6
    assert (given.robot, given.fiducial) == ("roman", LED)
    assert "no point for look_1" in refused("calibrate", path)
    few = run("calibrate", "choose", "--fiducial", LED, "-n", 3)
    assert "fewer than 5 different places are refused" in few.out
    assert "default" not in refused("calibrate", "choose")


def test_a_robots_file_is_found_from_where_its_postures_were_written_or_picked(
    run, refused, tmp_path, monkeypatch, pipe_file
):
    robots, looks = tmp_path / "robots", tmp_path / "looks"
    robots.mkdir()
    looks.mkdir()
    for suffix in (".yaml", ".urdf"):
        shutil.copy(data_path("robots", f"roman{suffix}"), robots)
    monkeypatch.chdir(robots)
    todo = looks / "todo.json"
    chosen = ("calibrate", "choose", "--robot", "roman.yaml", "--fiducial", LED)
    assert run(*chosen, "-n", 4, "--out", todo).status == 0
    assert "no point for look_1" in refused("calibrate", todo)
    page, picked = tmp_path / "pick.html", tmp_path / "observations.json"
    run("calibrate", "pick", pipe_file, "--into", todo, "--report", page)
    content = _data_of(page)
    rows = [view["observation"] for view in content["views"]]
    picked.write_text(json.dumps({**content["header"], "observations": rows}))
    assert "no point for look_1" in refused("calibrate", picked)
    moved = shutil.move(todo, tmp_path)
    said = refused("calibrate", moved)
    assert f"robot of {moved}: got no file there: {tmp_path}" in said
    assert "its path is relative to that one. Correct `robot` in it, or give" in said
    assert "no point for look_1" in refused("calibrate", moved, "--robot", "roman.yaml")


def test_the_camera_sees_what_was_chosen_and_nothing_is_touched(rig, rng):
    view = View()
    plan = choose_postures(rig, 8, rng=rng)
    assert len(plan.postures) == 8
    for posture in plan.postures:
        poses = rig.robot.link_poses(posture.joints)
        T_camera_led = poses[rig.camera].inverse() @ poses[LED]
        pixel, depth = view.intrinsics.project(T_camera_led.p)
        assert pixel == pytest.approx(posture.pixel, abs=1e-6)
        assert view.nearest < depth < view.farthest
        assert poses[LED].p == pytest.approx(posture.place, abs=1e-9)
        q = rig.chain.vector(posture.joints)
        assert not rig.collision.hits_itself(q)
        ray = poses[LED].p + np.linspace(0.04, 0.88, 60)[:, None] * (
            poses[rig.camera].p - poses[LED].p
        )
        for link, solid in rig.robot.links_solids(posture.joints):
            assert not solid.contains(ray).any(), link


@pytest.fixture
def site(tmp_path):
    """Of a camera with a narrow picture, and a workspace beside the usual one."""
    camera = {"K": [200.0, 0.0, 80.0, 0.0, 200.0, 60.0, 0.0, 0.0, 1.0]}
    camera |= {"width": 160, "height": 120}
    (tmp_path / "camera.json").write_text(json.dumps(camera))
    path = tmp_path / "site.yaml"
    path.write_text(
        "schema: debrisgrasp/site/1\nrobot: roman\n"
        "camera:\n  file: camera.json\n"
        "workspace: [1.5, 0.5, 0.0, 2.5, 1.5, 0.5]\n"
    )
    return path


def test_the_site_tells_what_its_camera_sees(run, site):
    ended = run("calibrate", "choose", "--site", site, "--fiducial", LED, "--json")
    pixels = np.array([posture["pixel"] for posture in json.loads(ended.out)])
    assert (pixels > 20.0).all()
    assert (pixels < [140.0, 100.0]).all()


def test_the_error_is_judged_over_the_workspace_of_the_site(run, site):
    usual = json.loads(run("calibrate", LOOKS, "--json").out)
    there = json.loads(run("calibrate", LOOKS, "--site", site, "--json").out)
    assert there["predicted_error"]["lower"] == [1.5, 0.5, 0.0]
    assert there["predicted_error"]["upper"] == [2.5, 1.5, 0.5]
    assert there["T_base_camera"] == usual["T_base_camera"]
    assert there["predicted_error"]["rms"] > 1.5 * usual["predicted_error"]["rms"]


def test_joints_that_turn_twice_are_not_wound_up(rng):
    rig = CalibrationRig(robot=RobotModel.load("roman"), fiducial=LED)
    chain = rig.chain
    wide = replace(chain, lower=2.0 * chain.lower, upper=2.0 * chain.upper)
    rig.__dict__["chain"] = wide
    values = rig.robot.joint_values()
    idle = np.array([values[name] for name in chain.joint_names])
    q = np.array(
        [wide.vector(p.joints) for p in choose_postures(rig, 6, rng=rng).postures]
    )
    nearer = q + 2.0 * np.pi * np.array([-1.0, 1.0])[:, None, None]
    is_possible = (nearer >= wide.lower) & (nearer <= wide.upper)
    assert is_possible.any()
    away = np.where(is_possible, np.abs(nearer - idle), np.inf)
    assert (np.abs(q - idle) <= away + 1e-9).all()


def test_the_torso_does_not_matter(rig):
    given = load_observations(LOOKS)
    turned = ObservationFile(
        rows=tuple(
            type(r)(name=r.name, point=r.point, joints={**r.joints, "torso_joint": 0.4})
            for r in given.rows
        )
    )
    a, b = rig.observations(given), rig.observations(turned)
    assert a.points_base == pytest.approx(b.points_base)


def test_the_rig_agrees_with_the_robot(rig):
    rest = rig.head.T_base_camera(rig.reference)
    assert rest.matrix == pytest.approx(rig.robot.T_base_camera().matrix)
    turned = {"ptu_pan_joint": 0.3, "ptu_tilt_joint": 0.1}
    moved = rig.head.T_base_camera([0.3, 0.1])
    assert moved.matrix == pytest.approx(rig.robot.T_base_camera(turned).matrix)
    led = rig.robot.link_poses(rig.robot.posture("right", "ready"))[LED]
    q = rig.chain.vector(rig.robot.posture("right", "ready"))
    assert rig.chain.fk(q).matrix == pytest.approx(led.matrix)
    # It looks out of the side of the palm.
    palm = rig.robot.link_poses()["right_robotiq_palm_link"].R
    assert np.linalg.norm(
        so3.log(palm.T @ rig.robot.link_poses()[LED].R)
    ) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("joints", "word"),
    [
        ({"right_arm_joint1": 45.0}, "degrees"),
        ({"right_arm_joint9": 0.1}, "right_arm_joint9"),
        ({}, "every joint"),
    ],
)
def test_joints_that_can_not_be_are_refused(rig, joints, word):
    row = load_observations(LOOKS).rows[0]
    merged = {**row.joints, **joints} if joints else {"ptu_pan_joint": 0.0}
    bad = type(row)(name="x", point=row.point, joints=merged)
    with pytest.raises(InputError, match=word):
        rig.observations(ObservationFile(rows=(bad,)))


@pytest.mark.parametrize(
    ("kind", "value", "word"),
    [("prismatic", 120.0, "millimetres"), ("continuous", -40.0, "degrees")],
)
def test_joints_of_any_kind_are_refused_in_another_unit(tmp_path, kind, value, word):
    text = data_path("robots", "roman.urdf").read_text()
    joint = re.search(
        r'<joint name="right_arm_joint1" type="revolute">.*?</joint>', text, re.S
    )
    changed = joint[0].replace("revolute", kind)
    if kind == "continuous":
        changed = re.sub(r' (lower|upper)="[^"]*"', "", changed)
    (tmp_path / "roman.urdf").write_text(text.replace(joint[0], changed))
    shutil.copy(data_path("robots", "roman.yaml"), tmp_path)
    robot = RobotModel.load(tmp_path / "roman.yaml")
    rig = CalibrationRig(robot=robot, fiducial=LED)
    row = load_observations(LOOKS).rows[0]
    row = replace(row, joints={**row.joints, "right_arm_joint1": value})
    with pytest.raises(InputError, match=word):
        rig.observations(ObservationFile(rows=(row,)))


def test_what_carries_no_fiducial_is_refused(tmp_path):
    with pytest.raises(UnknownNameError, match="led_fram"):
        CalibrationRig(robot=RobotModel.load("roman"), fiducial="led_fram")
    still = CalibrationRig(robot=RobotModel.load("roman"), fiducial="chassis_link")
    with pytest.raises(ConfigError, match="no arm moves") as refused:
        _ = still.arm
    assert "wrist" not in str(refused.value)
    on_wrist = replace(still.robot, camera="left_hand")
    with pytest.raises(ConfigError, match="camera that an arm carries"):
        _ = CalibrationRig(robot=on_wrist, fiducial="chassis_link").arm
    with pytest.raises(ConfigError, match="--fiducial"):
        rig_of(ObservationFile(rows=()), tmp_path, "roman")


def test_an_led_is_found_from_the_command_line(run, tmp_path):
    view = led_view(np.random.default_rng(4))
    # A window of a larger picture has no sound intrinsics of its own.
    side = view.intrinsics.width
    shift = np.array([side / 2 - view.pixel[0], side / 2 - view.pixel[1]]).round()
    assert np.abs(shift).max() < side
    k = view.intrinsics
    frames = {"on": view.on, "off": view.off}
    height, width = 480, 848
    u0, v0 = round(423.5 - k.cx), round(239.5 - k.cy)
    if not (0 <= u0 < width - side and 0 <= v0 < height - side):
        pytest.skip("this view lies across the border")
    depth = np.zeros((height, width))
    depth[v0 : v0 + side, u0 : u0 + side] = view.depth
    camera = Intrinsics(
        fx=k.fx, fy=k.fy, cx=k.cx + u0, cy=k.cy + v0, width=width, height=height
    )
    for name, frame in frames.items():
        rgb = np.zeros((height, width, 3), dtype=np.uint8)
        rgb[v0 : v0 + side, u0 : u0 + side] = frame
        Capture(depth=depth, intrinsics=camera, rgb=rgb).save(tmp_path / f"{name}.npz")
    where = [f"{x:.4f}" for x in view.expected]
    found = run(
        "calibrate", "find", tmp_path / "on.npz", "--off", tmp_path / "off.npz",
        "--expected", *where, "--json",
    )  # fmt: skip
    assert found.status == 0
    assert found.json["point"] == pytest.approx(view.point, abs=0.01)
    nothing = run("calibrate", "find", tmp_path / "off.npz", "--expected", *where)
    assert nothing.status == 1
    assert nothing.out.startswith("no marker: ")


def test_a_page_to_pick_in_is_written(run, tmp_path, pipe_file):
    todo = tmp_path / "todo.json"
    run("calibrate", "choose", "--fiducial", LED, "-n", 2, "--out", todo)
    page, other = tmp_path / "pick.html", tmp_path / "other.npz"
    one = Capture.load(pipe_file)
    assert one.depth is not None
    replace(one, depth=one.depth + 0.001).save(other)
    ended = run("calibrate", "pick", pipe_file, other, "--into", todo, "--report", page)
    assert ended.status == 0
    assert "{{" not in page.read_text()
    content = _data_of(page)
    assert content["header"]["fiducial"] == LED
    assert [v["observation"]["name"] for v in content["views"]] == ["look_1", "look_2"]
    assert content["views"][0]["camera"][:2] == [240.0, 240.0]
    assert "no capture for" not in ended.out
    ended = run("calibrate", "pick", pipe_file, "--into", todo, "--report", page)
    assert "no capture for look_2" in ended.out


def test_what_is_known_of_an_observation_stays_while_its_point_is_picked(
    run, tmp_path, pipe_file
):
    row = {"name": "a", "position": [0.8, 0.1, 0.3], "sigma": [0.001, 0.001, 0.004]}
    todo, page = tmp_path / "todo.json", tmp_path / "pick.html"
    header = {"sigma": 0.005, "kinematic_sigma": 0.002}
    todo.write_text(json.dumps({**header, "observations": [row]}))
    run("calibrate", "pick", pipe_file, "--into", todo, "--report", page)
    content = _data_of(page)
    assert header.items() <= content["header"].items()
    assert row.items() <= content["views"][0]["observation"].items()


def _data_of(page):
    text = page.read_text()
    start = text.index('id="data">') + len('id="data">')
    return json.loads(text[start : text.index("</script>", start)])


def test_one_capture_is_no_look_at_two_postures(refused, tmp_path, pipe_file):
    page, copied = tmp_path / "pick.html", tmp_path / "copied.npz"
    shutil.copy(pipe_file, copied)
    last = ("--report", page)
    said = refused("calibrate", "pick", pipe_file, pipe_file, *last)
    assert str(pipe_file) in said
    assert "twice" in said
    said = refused("calibrate", "pick", pipe_file, copied, *last)
    assert str(pipe_file) in said
    assert str(copied) in said
    assert not page.exists()
