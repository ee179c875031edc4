"""Every command as a user types it: what it says, writes and returns."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

import debrisgrasp
from debrisgrasp.geometry import SE3, Bounds
from debrisgrasp.io import Capture, data_path
from debrisgrasp.io.plan_json import load_plan
from debrisgrasp.kinematics import RobotModel
from tests.scenes import capture_of

from .conftest import PIPE


@pytest.fixture
def plan(run, dictionary):
    """Plan with a floating hand and four prototypes."""

    def call(capture, *argv):
        return run(
            "plan", capture, "--robot", "none", "--prototypes", dictionary, *argv
        )

    return call


@pytest.fixture(scope="session")
def unposed(pipe_capture, tmp_path_factory):
    """Return the pipe's capture with a pose in the level frame only."""
    path = tmp_path_factory.mktemp("captures") / "unposed.npz"
    pose = pipe_capture.T_base_camera
    replace(pipe_capture, T_base_camera=None, T_level_camera=pose).save(path)
    return path


def test_version_is_that_of_the_package(run):
    ended = run("--version")
    assert ended.status == 0
    assert debrisgrasp.__version__ in ended.out


@pytest.mark.parametrize("words", [["--help"], ["--help", "plan"]])
def test_all_commands_are_listed(run, words):
    ended = run(*words)
    assert ended.status == 0
    for command in ("plan", "view"):
        assert re.search(rf"\n    {command} +\w", ended.out)
    assert "invalid choice: 'x' (choose from " in run("x", "plan").err


def test_an_option_before_the_command_is_what_is_refused(run):
    assert "unrecognized arguments: --json. " in run("--json", "plan", "x.npz").err


def test_what_the_library_warns_of_is_a_note(run, monkeypatch, tmp_path):
    monkeypatch.setenv("DEBRISGRASP_CACHE", str(tmp_path))
    words = ("ik", 0.9, 0, 0.4, 3.14, 0, 0, "--arm", "right")
    first = run(*words)
    (kept,) = tmp_path.iterdir()
    kept.write_text("no map")
    again = run(*words)
    assert again.out == first.out
    (note,) = again.err.splitlines()
    assert note.startswith("note: reachability map ")


@pytest.mark.parametrize("command", ["demo", "plan", "segment", "select", "prototype"])
def test_every_command_explains_itself(run, command):
    ended = run(command, "--help")
    assert ended.status == 0
    assert "usage: debrisgrasp " + command in ended.out


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["plan", "x.npz", "--see", 3], r"--see 3 \(did you mean --seed\?\).*plan --h"),
        (["prototype", "list", "--gripper", "camhand"], "did you mean --grippers"),
        (["demo", "--out", "x"], r"--out x \(did you mean --out-dir\?\)"),
        (["segment", "x", "--seed", 1], r"--seed 1\. `debrisgrasp segment --help` te"),
        (["campaign", "--record", "x"], r"--record x\. `debrisgrasp campaign --help"),
        (["doctor", "x"], r"arguments: x\. `debrisgrasp doctor --help"),
    ],
)
def test_a_part_of_an_option_is_none_but_tells_which_was_meant(run, words, told):
    ended = run(*words)
    assert ended.status == 2
    assert re.search(told, ended.err)


def test_demo_prints_grasps_and_writes_three_files(run, tmp_path):
    out = tmp_path / "new" / "folder"
    ended = run("demo", "--out-dir", out)
    assert ended.status == 0
    assert ended.err == ""
    assert "best first" in ended.out
    found = load_plan(out / "grasps.json")
    assert len(found.grasps) >= 10
    assert found.robot == "roman"
    assert all(grasp.arm and grasp.joints for grasp in found.grasps)
    assert (out / "report.png").read_bytes()[:4] == b"\x89PNG"
    assert (out / "report.html").read_text().startswith("<!DOCTYPE html>")


def _heads(out: str) -> set[str]:
    """Column heads of the tables in what was printed."""
    lines = out.splitlines()
    rules = (k for k, line in enumerate(lines) if line.startswith("-"))
    return {head for k in rules for head in re.split(r"  +", lines[k - 1].strip())}


def test_plan_prints_a_table_and_writes_a_plan_that_loads(plan, pipe_file, tmp_path):
    out = tmp_path / "grasps.json"
    ended = plan(pipe_file, "--out", out)
    assert ended.status == 0
    assert ended.err == ""
    found = load_plan(out)
    assert f"{len(found.grasps)} grasps on object 1, best first" in ended.out
    assert "cylinder_060_tip" in ended.out
    assert {"opening [m]", "x [m]", "lever [m]"} <= _heads(ended.out)
    assert f"wrote {out}" in ended.out
    assert found.robot == "none"
    assert all(g.arm is None and g.joints is None for g in found.grasps)
    assert {g.object_label for g in found.grasps} == {found.object_label} == {1}


def test_plan_as_json_is_the_file_and_nothing_else(plan, pipe_file, tmp_path):
    out = tmp_path / "grasps.json"
    ended = plan(pipe_file, "--json", "--out", out, "--seed", 3)
    assert ended.status == 0
    assert ended.err == ""
    assert ended.json == json.loads(out.read_text())
    assert ended.json["seed"] == 3
    scores = [grasp["score"] for grasp in ended.json["grasps"]]
    assert scores == sorted(scores, reverse=True)


def test_same_seed_gives_the_same_bytes_whatever_ran_before(plan, pipe_file, tmp_path):
    written = []
    for turn, seed in enumerate((7, 8, 7)):
        out = tmp_path / f"{turn}.json"
        assert plan(pipe_file, "--seed", seed, "--out", out).status == 0
        written.append(out.read_bytes())
    assert written[0] == written[2]
    poses = [
        [grasp["pose"] for grasp in json.loads(text)["grasps"]] for text in written[:2]
    ]
    assert poses[0] != poses[1]


def test_region_keeps_the_held_part_inside(plan, pipe_file):
    box = [0.7, 0.05, 0.1, 1.1, 0.3, 0.4]
    ended = plan(pipe_file, "--json", "--region", *box)
    assert ended.status == 0
    assert ended.json["region"] == {"lower": box[:3], "upper": box[3:]}
    region = Bounds(np.array(box[:3]), np.array(box[3:])).grown(0.05)
    for grasp in ended.json["grasps"]:
        assert region.contains(held_point(grasp["pose"]))


def held_point(pose: object) -> np.ndarray:
    """Return the point of the pipe's axis that is beside the fingertips."""
    T_base_hand = np.array(pose)
    y = (T_base_hand @ np.array([0, 0, 0.1, 1]))[1]
    return np.array([PIPE.T_frame_solid.p[0], y, PIPE.T_frame_solid.p[2]])


def test_a_chosen_object_is_the_one_that_is_gripped(plan, run, block_file):
    first = run("select", block_file, "--json").json[0]["object"]
    objects = run("segment", block_file, "--json").json["objects"]
    pipe = next(entry["label"] for entry in objects if entry["centroid"][1] > 0.3)
    assert pipe != first
    ended = plan(block_file, "--json", "--object", pipe)
    assert ended.status == 0
    assert ended.json["object"] == pipe
    assert {grasp["object"] for grasp in ended.json["grasps"]} == {pipe}
    assert ended.json["passed_over"] == []


def test_a_plan_has_as_many_grasps_as_are_asked_for(run):
    command = ("plan", data_path("captures", "pile.npz"))
    assert re.search(r"^and \d+ more$", run(*command).out, re.MULTILINE)
    assert len(run(*command, "--n-best", 2, "--json").json["grasps"]) == 2
    for option, field in (("hand", "gripper"), ("prototype", "prototype")):
        found = run(*command, f"--n-per-{option}", 1, "--json").json["grasps"]
        names = [grasp[field] for grasp in found]
        assert len(names) == len(set(names)) > 1


def test_a_chosen_hand_is_the_only_one(run, pipe_file):
    ended = run("plan", pipe_file, "--json", "--robot", "none", "--gripper", "camhand")
    assert ended.status == 0
    assert {grasp["gripper"] for grasp in ended.json["grasps"]} == {"camhand"}


def test_a_chosen_arm_is_the_only_one(run, dictionary, pipe_file):
    ended = run(
        "plan", pipe_file, "--json", "--arm", "right", "--prototypes", dictionary
    )
    assert ended.status == 0
    assert ended.json["robot"] == "roman"
    assert {grasp["arm"] for grasp in ended.json["grasps"]} == {"right"}
    assert {grasp["R"] for grasp in ended.json["grasps"]} == {1.0}


def test_a_deadline_gives_an_answer_all_the_same(plan, pipe_file):
    ended = plan(pipe_file, "--json", "--deadline", 1e-6)
    assert ended.status in (0, 1)
    assert bool(ended.json["grasps"]) == (ended.status == 0)


def test_reports_are_written_in_the_form_of_their_suffix(plan, pipe_file, tmp_path):
    png, html = tmp_path / "a.PNG", tmp_path / "a.html"
    ended = plan(pipe_file, "--report", png, "--report", html)
    assert ended.status == 0
    assert png.read_bytes()[:4] == b"\x89PNG"
    assert "pipe" in html.read_text()
    assert str(png) in ended.out
    assert str(html) in ended.out


def test_nothing_to_grip_is_an_honest_no(plan, floor_file, tmp_path):
    out, report = tmp_path / "grasps.json", tmp_path / "report.png"
    ended = plan(floor_file, "--out", out, "--report", report)
    assert ended.status == 1
    assert ended.err == ""
    assert "no grasp: no object offers a grasp" in ended.out
    assert "it is the ground" in ended.out
    assert load_plan(out).why_empty
    assert report.exists()


def test_a_cloud_of_three_points_is_an_honest_no(plan, tmp_path):
    path = tmp_path / "three.npz"
    points = np.array([[0.9, 0.0, 0.2], [0.91, 0.0, 0.2], [0.9, 0.01, 0.2]])
    np.savez(path, points=points, viewpoint=np.zeros(3), T_base_camera=np.eye(4))
    ended = plan(path)
    assert ended.status == 1
    assert "no grasp: no object was found in the capture" in ended.out


def test_segment_lists_objects_and_writes_labels(run, block_file, tmp_path):
    out, report = tmp_path / "labels.npz", tmp_path / "segments.png"
    ended = run("segment", block_file, "--out", out, "--report", report)
    assert ended.status == 0
    assert "ground removed" in ended.out
    labels = np.load(out)["labels"]
    capture = Capture.load(block_file)
    assert labels.shape == capture.depth.shape
    facts = run("segment", block_file, "--json").json
    assert facts["ground"]["status"] == "removed"
    assert all(0.5 < entry["certainty"] <= 1.0 for entry in facts["objects"])
    counts = {entry["label"]: entry["points"] for entry in facts["objects"]}
    assert counts == {n: np.count_nonzero(labels == n) for n in counts}
    assert report.read_bytes()[:4] == b"\x89PNG"


def test_segment_divides_by_the_method_of_the_paper_on_demand(run):
    pile = data_path("captures", "pile.npz")

    def labels(*options):
        facts = run("segment", pile, "--json", *options).json
        return facts["method"], [entry["points"] for entry in facts["objects"]]

    assert "-0.00" not in run("segment", pile).out  # object 5 lies at y = -0.003
    default, paper = labels(), labels("--method", "lccp")
    assert default[0] == "singulation"
    assert paper[0] == "lccp"
    assert default[1] != paper[1]


def test_select_orders_objects_with_reasons(run, block_file, tmp_path):
    report = tmp_path / "order.png"
    ended = run("select", block_file, "--report", report)
    assert ended.status == 0
    assert "from the priority point" in ended.out
    order = run("select", block_file, "--json").json
    costs = [entry["cost"] for entry in order]
    assert costs == sorted(costs)
    objects = run("segment", block_file, "--json").json["objects"]
    assert {e["object"] for e in order} == {e["label"] for e in objects}
    assert report.read_bytes()[:4] == b"\x89PNG"
    page = tmp_path / "order.html"
    assert run("select", block_file, "--report", page).status == 0
    assert "weight [N]" in page.read_text()


def test_select_says_that_the_ground_is_among_the_objects(run, floor_file, block_file):
    assert "ground left in the scene: only" in run("select", floor_file).out
    assert "ground left" not in run("select", block_file).out


def test_the_json_of_select_warns_of_what_would_fall(run):
    pile = data_path("captures", "pile.npz")
    entries = run("select", pile, "--json").json
    warnings = [entry["warning"] for entry in entries if entry["warning"]]
    assert warnings
    assert all("may fall: " in warning for warning in warnings)
    assert len(warnings) < len(entries)


def test_select_takes_the_policy_and_the_pick_of_the_user(run, block_file):
    by_priority = run("select", block_file, "--json", "--policy", "priority").json
    assert "nearest point" in by_priority[0]["reason"]
    last = by_priority[-1]["object"]
    picked = run("select", block_file, "--json", "--pick", last).json
    assert picked[0]["object"] == last
    assert picked[0]["reason"].startswith("picked by the operator; ")


@pytest.mark.parametrize(
    ("pick", "expected"),
    [
        ("99", "unknown segment label"),
        ("0,0", "no object"),
        ("-1,-1", "picked pixel: got column -1"),
        ("9,9,9", "picked point"),
        ("-9,-9,.5", "picked point"),
    ],
)
def test_a_pick_of_nothing_is_refused(refused, block_file, pick, expected):
    assert expected in refused("select", block_file, "--pick", pick)


@pytest.mark.parametrize("option", ["--pick", "--object"])
def test_a_choice_beside_a_mask_is_refused(refused, block_capture, tmp_path, option):
    path = tmp_path / "marked.npz"
    replace(block_capture, mask=np.isfinite(block_capture.depth)).save(path)
    assert "a mask in the capture" in refused("plan", path, option, "1")


@pytest.mark.parametrize("pick", ["one", "1,2,3,4", "1.5,2"])
def test_a_pick_that_is_none_is_refused(refused, block_file, pick):
    assert "a label N, a pixel U,V or a point" in refused(
        "select", block_file, "--pick", pick
    )


def test_prototype_list_names_the_dictionary(run, dictionary):
    ended = run("prototype", "list")
    assert ended.status == 0
    n_files = len(list(data_path("prototypes").glob("*.yaml")))
    assert len(ended.out.splitlines()) == n_files + 2
    few = run("prototype", "list", "--prototypes", dictionary, "--json").json
    kinds = {entry["name"]: entry["kind"] for entry in few}
    assert kinds.pop("handle_025") == "object-specific"
    assert set(kinds.values()) == {"generic"}


def test_prototype_show_draws_the_named_ones(run, dictionary, tmp_path):
    out = tmp_path / "two.png"
    names = ["cylinder_060_tip", "handle_025"]
    ended = run(
        "prototype", "show", *names, "--prototypes", dictionary, "--out", out, "--json"
    )
    assert ended.status == 0
    assert ended.json == {"wrote": str(out)}
    assert out.read_bytes()[:4] == b"\x89PNG"


def test_prototype_check_passes_good_ones_and_tells_what_is_wrong(
    run, dictionary, tmp_path
):
    good = run(
        "prototype", "check", "cylinder_060_tip", "--prototypes", dictionary, "--json"
    )
    assert (good.status, good.json) == (0, {"cylinder_060_tip": []})
    text = (dictionary / "cylinder_060_tip.yaml").read_text()
    sunk = text.replace("position: [0.0, 0.0, 0.1]", "position: [0.0, 0.0, -0.02]")
    (tmp_path / "sunk.yaml").write_text(sunk)
    bad = run("prototype", "check", "--prototypes", tmp_path)
    assert bad.status == 1
    assert "cylinder_060_tip: " in bad.out
    assert "1 prototype checked" in bad.out


def test_a_capture_without_a_pose_takes_one_in_every_form(
    run, refused, unposed, pipe_capture, tmp_path
):
    message = refused("select", unposed)
    assert "T_base_camera" in message
    assert "--camera-pose" in message
    assert "level" in message
    matrix = pipe_capture.T_base_camera.matrix
    np.save(tmp_path / "pose.npy", matrix)
    np.savetxt(tmp_path / "pose.txt", matrix)
    (tmp_path / "pose.json").write_text(json.dumps({"T_base_camera": matrix.tolist()}))
    (tmp_path / "pose.yaml").write_text(f"T_base_camera: {matrix.tolist()}\n")
    files = [tmp_path / f"pose.{kind}" for kind in ("npy", "txt", "json", "yaml")]
    # Roll about the optical axes: 45 degrees down and ahead.
    numbers = f"0.1,0,1.1,{-0.75 * np.pi},0,{-0.5 * np.pi}"
    answers = [
        run("select", unposed, "--json", f"--camera-pose={form}").json
        for form in ("level", numbers, *files)
    ]
    assert all(answer == answers[0] for answer in answers)


def test_the_robot_may_come_from_a_file(run, dictionary, pipe_file, tmp_path):
    for name in ("roman.yaml", "roman.urdf"):
        shutil.copy(data_path("robots", name), tmp_path)
    ended = run(
        *("plan", pipe_file, "--robot", tmp_path / "roman.yaml", "--arm", "right"),
        *("--prototypes", dictionary, "--json"),
    )
    assert ended.status == 0
    assert ended.json["grasps"][0]["joints"]


@pytest.mark.parametrize("command", ["plan", "segment"])
def test_a_result_never_replaces_its_own_capture(run, command, tmp_path):
    path = tmp_path / "pipe.npz"
    capture_of([PIPE]).save(path)
    before = path.read_bytes()
    ended = run(command, path, "--out", path)
    assert ended.status == 2
    assert "it is what is read" in ended.err
    assert path.read_bytes() == before


def test_two_results_never_go_to_one_place(run, tmp_path):
    path, both = tmp_path / "pipe.npz", tmp_path / "both.png"
    capture_of([PIPE]).save(path)
    ended = run("plan", path, "--out", both, "--report", both)
    assert ended.status == 2
    assert not both.exists()


@pytest.mark.parametrize("command", ["segment", "select"])
def test_every_command_says_what_it_wrote(run, pipe_file, tmp_path, command):
    out = tmp_path / "report.png"
    assert run(command, pipe_file, "--report", out).out.endswith(f"wrote {out}\n")
    assert "wrote" not in run(command, pipe_file, "--report", out, "--json").out


@pytest.mark.parametrize("command", ["segment", "motion"])
def test_what_is_only_drawn_is_not_called_a_page(refused, pipe_file, command):
    message = refused(command, pipe_file, "--report", "report.html")
    assert "name of a picture: got report.html" in message


def test_a_plan_leaves_out_the_arm_in_the_picture(run, dictionary, tmp_path):
    """Where an arm would be that was held so, a thing of its size is no obstacle."""
    robot = RobotModel.load("roman")
    joints = {"right_arm_joint2": 0.4, "right_arm_joint4": -0.5}
    solids = dict(robot.links_solids(joints))
    wrist = solids["right_arm_link5"]
    low, high = wrist.bounds.lower, wrist.bounds.upper
    inside = np.random.default_rng(0).uniform(low, high, (200, 3))
    inside = inside[wrist.signed_distance(inside) < 0.0]
    pile = Capture.load(data_path("captures", "pile.npz")).cloud()
    points = np.concatenate([pile.points[::4], inside])
    path = tmp_path / "seen.npz"
    seen = Capture(
        points=points, T_base_camera=SE3.identity(), viewpoint=(0.3, 0.0, 1.0)
    )
    seen.save(path)
    given = [f"{name}={value}" for name, value in joints.items()]
    ended = run("plan", path, "--prototypes", dictionary, "--joints", *given)
    words = f"note: {len(inside)} points show the robot itself, and were left out"
    assert words in ended.err


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (("--joints", "elbow=0.1"), "unknown joint of robot roman: got 'elbow'"),
        (("--joints", "torso_joint"), "is not NAME=VALUE"),
        (("--joints", "torso_joint=nan"), "not a finite number"),
        (("--joints", "torso_joint=90"), "90 degrees are 1.571"),
        (("--joints", "right_arm_joint2=-72"), "-3.142 to 3.142 rad"),
        (("--joints", "torso_joint=1", "torso_joint=1.1"), "torso_joint twice"),
        (("--joints", "base_to_chassis=1"), "none, for it is fixed"),
        (("--robot", "none", "--joints", "torso_joint=0"), "a hand without a robot"),
    ],
)
def test_joints_that_are_none_are_refused(run, pipe_file, argv, words):
    ended = run("plan", pipe_file, *argv)
    assert ended.status == 2
    assert words in ended.err
    assert "Traceback" not in ended.err
