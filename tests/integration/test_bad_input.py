"""Input on which no honest result exists: one readable message, status 2, no loss."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import debrisgrasp
from debrisgrasp._files import data_path
from debrisgrasp.cli.program import build_parser
from tests.scenes import CAMERA, LOOKING_DOWN_AND_AHEAD

H, W = CAMERA.height, CAMERA.width
MIRRORED = np.diag([1.0, -1.0, 1.0, 1.0])
STRETCHED = np.diag([1.0, 1.0, 1.1, 1.0])


def arrays() -> dict[str, np.ndarray]:
    return {
        "depth": np.full((H, W), 1.2, np.float32),
        "K": CAMERA.matrix,
        "T_base_camera": LOOKING_DOWN_AND_AHEAD.matrix,
    }


BAD_ARRAYS = {
    "nothing measured": ({"depth": np.zeros((H, W))}, ["0 measured pixels", "camera"]),
    "only NaN": ({"depth": np.full((H, W), np.nan)}, ["0 measured pixels"]),
    "no pixels": ({"depth": np.zeros((0, 0))}, ["0 x 0 pixels"]),
    "millimetres": (
        {"depth": np.full((H, W), 1200.0)},
        ["1200 m", "at most 50 m", "divide by 1000", "by 100 "],
    ),
    "integer millimetres": (
        {"depth": np.full((H, W), 1200, np.uint16)},
        ["uint16", "millimetres", "Divide by 1000"],
    ),
    "K of a larger image": (
        {"K": np.diag([4.0, 4.0, 1.0]) @ CAMERA.matrix},
        ["cx 638", f"{W} x {H}", "Scale K"],
    ),
    "K without a focal length": ({"K": np.zeros((3, 3))}, ["K", "fx, fy > 0"]),
    "stretched pose": (
        {"T_base_camera": STRETCHED},
        ["T_base_camera", "rigid", "Remove scale"],
    ),
    "left-handed pose": (
        {"T_base_camera": MIRRORED},
        ["T_base_camera", "left-handed", "wrong way"],
    ),
    "pose with a NaN": (
        {"T_base_camera": np.full((4, 4), np.nan)},
        ["T_base_camera", "finite"],
    ),
    "pose in millimetres": (
        {"T_base_camera": np.diag([1.0, 1.0, 1.0, 1.0]) + 1200.0 * np.eye(4, k=3)},
        ["T_base_camera", "1200", "divide them by 1000"],
    ),
    "mask of another image": (
        {"mask": np.ones((4, 4), bool)},
        ["mask", "(4, 4)", f"({H}, {W})"],
    ),
}


@pytest.mark.parametrize("case", BAD_ARRAYS)
@pytest.mark.parametrize("command", ["plan", "segment"])
def test_arrays_that_cannot_be_used_are_refused(refused, tmp_path, case, command):
    change, words = BAD_ARRAYS[case]
    path = tmp_path / "bad.npz"
    np.savez(path, **(arrays() | change))
    message = refused(command, path)
    for word in (str(path), *words):
        assert word in message


def write_depth_folder(folder: Path) -> None:
    depth = np.full((H, W), 1200, np.uint16)
    Image.fromarray(depth).save(folder / "depth.png")
    camera = {"width": W, "height": H, "K": CAMERA.matrix.ravel().tolist()}
    camera["T_base_camera"] = LOOKING_DOWN_AND_AHEAD.matrix.tolist()
    (folder / "camera.json").write_text(json.dumps(camera))


PLY = """ply
format ascii 1.0
comment viewpoint 0 0 1
element vertex 3
property float x
property float y
property float z
end_header
1 0 0
1 0.1 0
1 0 0.1
"""


def cut(path: Path) -> None:
    content = path.read_bytes()
    path.write_bytes(content[: len(content) * 2 // 3])


def test_truncated_files_are_refused(refused, pipe_file, tmp_path):
    npz, ply = tmp_path / "cut.npz", tmp_path / "cut.ply"
    npz.write_bytes(pipe_file.read_bytes())
    ply.write_text(PLY.replace("vertex 3", "vertex 30"))
    folder = tmp_path / "folder"
    folder.mkdir()
    write_depth_folder(folder)
    cut(npz)
    cut(folder / "depth.png")
    for path in (npz, ply, folder):
        message = refused("segment", path)
        assert str(path) in message
        assert "expected" in message
    write_depth_folder(folder)
    cut(folder / "camera.json")
    message = refused("segment", folder)
    assert str(folder / "camera.json") in message
    assert "well-formed JSON" in message


@pytest.mark.parametrize("suffix", [".npz", ".png", ".ply", ".pcd"])
@pytest.mark.parametrize("content", [b"", b"\x00\xff no such format \n" * 40])
def test_files_that_are_no_captures_are_refused(refused, tmp_path, suffix, content):
    path = tmp_path / f"odd{suffix}"
    path.write_bytes(content)
    (tmp_path / "camera.json").write_text(json.dumps({"K": CAMERA.matrix.tolist()}))
    message = refused("segment", path)
    assert path.name in message
    assert "expected" in message


def test_a_capture_that_is_not_there_is_refused(refused, tmp_path):
    message = refused("plan", tmp_path / "none.npz")
    assert "none.npz" in message
    assert "no such file" in message
    assert ".npz" in refused("plan", __file__)


BAD_CHOICES = {
    "unknown object": (["--object", "99"], ["got 99", "one of 1."]),
    "object of the ground": (["--object", "0"], ["0", "1 or more"]),
    "region without points": (
        ["--region", "5", "5", "5", "6", "6", "6"],
        ["region", "no measured point", "Move or widen"],
    ),
    "inverted region": (
        ["--region", "1", "0", "0", "0.5", "1", "1"],
        ["region", "lower < upper", "x0 y0 z0 x1 y1 z1"],
    ),
    "region with a NaN": (
        ["--region", "nan", "0", "0", "1", "1", "1"],
        ["region", "finite"],
    ),
    "huge region": (
        ["--region", "-19", "-19", "-19", "19", "19", "19"],
        ["region", "38.6", "40000000 cells", "smaller region"],
    ),
    "region in millimetres": (
        ["--region", "500", "-300", "0", "900", "300", "400"],
        ["--region", "900", "millimetres, divide by 1000"],
    ),
    "unknown hand": (["--gripper", "robotik_3f"], ["camhand", "robotiq_3f", "mean"]),
    "deadline of zero": (["--deadline", "0"], ["deadline", "0.0", "positive"]),
    "negative deadline": (["--deadline", "-1"], ["deadline", "-1.0", "positive"]),
    "deadline that is no number": (["--deadline", "nan"], ["deadline", "nan"]),
    "negative seed": (["--seed", "-1"], ["--seed", "'-1'", "0 or more"]),
    "seed that is no number": (["--seed", "dice"], ["'dice'", "integer"]),
    "camera pose that is none": (["--camera-pose", "up"], ["'up'", "roll,pitch,yaw"]),
    "level pose that is not stored": (
        ["--camera-pose", "level"],
        ["T_level_camera", "Give the pose"],
    ),
}


@pytest.mark.parametrize("case", BAD_CHOICES)
def test_choices_that_mean_nothing_are_refused(refused, pipe_file, dictionary, case):
    options, words = BAD_CHOICES[case]
    message = refused(
        *("plan", pipe_file, "--robot", "none", "--prototypes", dictionary), *options
    )
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--robot", "romann"], ["'romann'", "roman", "Did you mean"]),
        (["--arm", "middle"], ["'middle'", "left", "right"]),
        (["--gripper", "claw"], ["'claw'", "camhand", "robotiq_3f"]),
        (["--robot", "none", "--arm", "right"], ["'right'", "none"]),
        (["--arm", "right", "--gripper", "camhand"], ["'camhand'", "'robotiq_3f'"]),
    ],
)
def test_names_that_are_unknown_list_those_that_are_not(
    refused, pipe_file, dictionary, options, words
):
    message = refused("plan", pipe_file, "--prototypes", dictionary, *options)
    for word in words:
        assert word in message


def test_unknown_prototypes_list_the_known(refused, dictionary):
    for action in ("show", "check"):
        message = refused(
            "prototype", action, "cylinder_006_tip", "--prototypes", dictionary
        )
        assert "handle_025" in message
        assert "Did you mean 'cylinder_060_tip'?" in message


def test_malformed_settings_name_file_and_place(refused, pipe_file, tmp_path):
    robot = tmp_path / "robot.yaml"
    robot.write_text("name: odd\narms: [1, 2\n")
    message = refused("plan", pipe_file, "--robot", robot)
    assert f"{robot}, line" in message
    assert "well-formed YAML" in message
    assert "readable file" in refused(
        "plan", pipe_file, "--robot", tmp_path / "no.yaml"
    )

    folder = tmp_path / "prototypes"
    message = refused("plan", pipe_file, "--prototypes", folder)
    assert "no such file or folder" in message
    folder.mkdir()
    assert "no .yaml file" in refused("prototype", "list", "--prototypes", folder)
    text = data_path("prototypes", "cylinder_060_tip.yaml").read_text()
    (folder / "odd.yaml").write_text(text.replace("width: 0.06", "width: wide"))
    message = refused("prototype", "check", "--prototypes", folder)
    assert "odd.yaml" in message
    assert "width" in message
    assert "wide" in message

    pose = tmp_path / "pose.json"
    pose.write_text("[[1, 0")
    message = refused("select", pipe_file, "--camera-pose", pose)
    assert f"{pose}, line 1" in message


@pytest.fixture
def no_work(monkeypatch):
    """Fail as soon as a capture is read."""

    def fail(*_args, **_kwargs):
        pytest.fail("work was begun before the request was checked")

    monkeypatch.setattr("debrisgrasp.io.Capture.load", fail)


@pytest.mark.usefixtures("no_work")
@pytest.mark.parametrize("command", ["plan", "segment", "select"])
def test_a_report_of_unknown_form_is_refused_before_the_work(
    refused, pipe_file, tmp_path, command
):
    message = refused(command, pipe_file, "--report", tmp_path / "report.pdf")
    assert "report.pdf" in message
    assert ".png" in message


@pytest.mark.usefixtures("no_work")
@pytest.mark.parametrize("option", ["--out", "--report"])
def test_a_place_that_is_not_there_is_refused_before_the_work(
    refused, pipe_file, tmp_path, option
):
    path = tmp_path / "nowhere" / "result.png"
    message = refused("plan", pipe_file, option, path)
    assert f"can't write {path}" in message
    assert "Nothing was changed" in message


def test_what_cannot_be_written_is_said_and_nothing_is_lost(
    refused, pipe_file, dictionary, tmp_path
):
    plan = ["plan", pipe_file, "--robot", "none", "--prototypes", dictionary]
    file = tmp_path / "file"
    file.write_text("precious")
    assert "can't write" in refused(*plan, "--out", file / "grasps.json")
    assert "can't write" in refused("demo", "--out-dir", file)
    assert "can't write" in refused("segment", pipe_file, "--out", file / "labels.npz")
    assert "folder" in refused(*plan, "--out", tmp_path)
    assert file.read_text() == "precious"
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]


def test_an_existing_result_stays_whole_when_the_run_fails(
    refused, pipe_file, dictionary, tmp_path
):
    out = tmp_path / "grasps.json"
    out.write_text("precious")
    refused(
        *("plan", pipe_file, "--robot", "none", "--prototypes", dictionary),
        *("--object", "99", "--out", out),
    )
    assert out.read_text() == "precious"
    assert [entry.name for entry in tmp_path.iterdir()] == [out.name]


def test_errors_are_json_where_json_was_asked_for(run, tmp_path):
    ended = run("plan", tmp_path / "none.npz", "--json")
    assert ended.status == 2
    assert ended.out == ""
    facts = json.loads(ended.err)
    assert facts["error"] == "CaptureError"
    assert "none.npz" in facts["message"]


def test_the_library_refuses_what_the_command_refuses(pipe_capture, dictionary):
    for limits in ({"seed": -1}, {"deadline": 0.0}, {"deadline": float("nan")}):
        with pytest.raises(debrisgrasp.DebrisGraspError, match=next(iter(limits))):
            debrisgrasp.plan(
                pipe_capture, robot="none", prototypes=dictionary, **limits
            )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--camera-pose=0,0,1.2,-129,0,-90"], ["129", "radians", "pi / 180"]),
        (["--camera-file", "camera.json"], ["camera file", "Omit it"]),
        (["--viewpoint", "0", "0", "1"], ["viewpoint", "Omit it"]),
    ],
)
def test_options_that_can_only_be_a_mistake_are_refused(
    refused, tmp_path, arguments, words
):
    path = tmp_path / "capture.npz"
    np.savez(path, **arrays())
    message = refused("segment", path, *arguments)
    for word in words:
        assert word in message


def test_two_ways_to_name_the_object_are_refused(refused, tmp_path):
    path = tmp_path / "capture.npz"
    np.savez(path, **arrays())
    assert "both --object and --pick" in refused(
        "plan", path, "--object", "1", "--pick", "2"
    )


def test_what_is_no_capture_is_refused_from_python():
    for call in (debrisgrasp.segment, debrisgrasp.Pipeline(robot="none").plan):
        with pytest.raises(debrisgrasp.DebrisGraspError, match=r"Capture\.load"):
            call("pile.npz")
    with pytest.raises(debrisgrasp.DebrisGraspError, match="robot"):
        debrisgrasp.Pipeline(robot=None)


@pytest.mark.parametrize("command", ["plan", "segment", "select", "motion", "view"])
def test_an_empty_path_is_not_the_working_folder(command, capsys):
    with pytest.raises(SystemExit) as ended:
        build_parser().parse_args([command, ""])
    assert ended.value.code == 2
    assert "it is empty" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["plan", "segment", "motion"])
def test_places_that_cannot_be_written_are_found_before_anything_is_read(
    refused, tmp_path, command
):
    (tmp_path / "file").write_text("mine")
    for out in (tmp_path, tmp_path / "file" / "x.json", tmp_path / "none" / "x.json"):
        message = refused(command, tmp_path / "none.npz", "--out", out)
        assert "can't write" in message
        assert str(out) in message
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_what_was_typed_wrong_is_found_before_anything_is_read(refused, tmp_path):
    plan = ("plan", tmp_path / "none.npz")
    assert "--mass" in refused(*plan, "--mass", "-1")
    assert "--object" in refused(*plan, "--object", "-1")
    assert "region" in refused(*plan, "--region", *"110001")
    assert "one with an arm" in refused("ik", *"100000", "--robot", "none")
    assert "path of a .yaml file" in refused("reach", "--robot", ".")


@pytest.mark.parametrize(
    ("words", "option"),
    [
        ("plan {} --deadline nan", "--deadline: 'nan' is not a finite number"),
        ("plan {} --deadline -1", "--deadline: got -1"),
        ("plan {} --camera-pose nan,0,0,0,0,0", "--camera-pose: got 'nan"),
        ("plan {} --camera-pose 100,0,1500,0,0,0", "--camera-pose: got a coordinate"),
        ("plan {} --priority-point 900 0 0", "--priority-point: got a coordinate"),
        ("clear --max-removals 0 --objects 1", "--max-removals: got 0"),
        ("clear --drive-over 7", "--drive-over: got 7"),
        ("clear --objects 99", "--objects: got 99"),
        ("clear --region 500 0 0 900 300 400", "--region: got a coordinate"),
    ],
)
def test_a_setting_is_called_by_the_option_that_gave_it(
    refused, pipe_file, words, option
):
    message = refused(*words.format(pipe_file).split())
    assert option in message
    assert "TaskSettings" not in message


@pytest.mark.parametrize(
    "words",
    [
        ("plan", "{}", "--prototypes", ""),
        ("plan", "{}", "--grippers", ""),
        ("plan", "{}", "--site", ""),
        ("plan", "{}", "--out", ""),
        ("segment", "{}", "--report", ""),
        ("clear", "--record", ""),
        ("replay", ""),
        ("prototype", "list", "--prototypes", ""),
    ],
)
def test_an_empty_option_is_not_the_working_folder_either(refused, pipe_file, words):
    message = refused(*(word.format(pipe_file) for word in words))
    assert "it is empty" in message
    assert len(message.splitlines()) == 1


def test_files_that_are_something_else_are_called_what_they_are(refused, tmp_path):
    text = tmp_path / "text.npz"
    text.write_text("these are words")
    assert "no arrays at all" in refused("segment", text)
    assert "clear --record DIR" in refused("replay", tmp_path)
    broken = tmp_path / "broken.obj"
    broken.write_text("v 1 2\nf 1 2 3\n")
    said = refused("prototype", "from-mesh", broken, "--name", "a")
    assert "nothing that can be read" in said
    assert "a whole .obj mesh" in said


def test_a_few_absurd_depths_are_counted(refused, tmp_path, pipe_capture):
    depth = pipe_capture.depth.copy()
    depth[:2, :3] = 1e30
    path = tmp_path / "far.npz"
    pipe_capture.save(path)
    arrays = dict(np.load(path))
    np.savez(path, **{**arrays, "depth": depth})
    message = refused("segment", path)
    for words in ("far.npz", "6 values", "1e+30 m"):
        assert words in message


def test_a_matrix_is_no_camera():
    with pytest.raises(debrisgrasp.DebrisGraspError, match=r"Intrinsics\.from_matrix"):
        debrisgrasp.Capture(depth=np.ones((4, 5)), intrinsics=np.eye(3))
