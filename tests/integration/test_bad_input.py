"""Files on which no honest result exists: one readable message, status 2, no loss."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import debrisgrasp
from debrisgrasp import viz
from debrisgrasp._files import data_path
from debrisgrasp.errors import OutputError
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


def test_links_in_a_circle_and_pipes_are_refused(refused, tmp_path):
    loop, pipe = tmp_path / "loop.npz", tmp_path / "pipe.npz"
    loop.symlink_to(loop)
    os.mkfifo(pipe)
    assert "no such file" in refused("segment", loop)
    assert "a pipe" in refused("segment", pipe)


def test_what_was_found_is_told_before_a_picture_that_cannot_be_written(
    run, monkeypatch, pipe_file, tmp_path
):
    labels, picture = tmp_path / "labels.npz", tmp_path / "picture.png"

    def full(*_, order):
        assert order == ()
        raise OutputError(picture, "No space left on device", mend="Make room.")

    monkeypatch.setattr(viz, "segmentation_png", full)
    ended = run("segment", pipe_file, "--out", labels, "--report", picture)
    assert ended.status == 2
    assert "x [m]  y [m]  z [m]  extents [cm]" in ended.out
    assert labels.is_file()
    assert "Make room" in ended.err


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


@pytest.mark.parametrize("command", ["plan", "motion", "segment"])
def test_only_an_earlier_result_is_replaced_by_a_result(
    refused, pipe_file, command, tmp_path
):
    suffix = "npz" if command == "segment" else "json"
    texts = ["robot: none", '{"schema": "debrisgrasp/other/1"}', '{"fx": 600.0}']
    for number, text in enumerate(texts):
        mine = tmp_path / f"mine_{number}.{suffix}"
        mine.write_text(text)
        assert "would be lost" in refused(command, pipe_file, "--out", mine)
        assert mine.read_text() == text
    other = tmp_path / f"capture.{suffix}"
    other.write_bytes(Path(pipe_file).read_bytes())
    assert "would be lost" in refused(command, pipe_file, "--out", other)
    assert other.read_bytes() == Path(pipe_file).read_bytes()


def test_earlier_results_are_replaced(run, pipe_file, dictionary, tmp_path):
    plan = ["plan", pipe_file, "--robot", "none", "--prototypes", dictionary]
    out = tmp_path / "grasps.json"
    out.touch()
    for _ in range(2):
        assert run(*plan, "--out", out).status == 0
    labels = tmp_path / "labels.npz"
    for _ in range(2):
        assert run("segment", pipe_file, "--out", labels).status == 0


def test_an_existing_result_stays_whole_when_the_run_fails(
    refused, pipe_file, dictionary, tmp_path
):
    out = tmp_path / "grasps.json"
    out.write_text('{"schema": "debrisgrasp/grasps/1"}')
    refused(
        *("plan", pipe_file, "--robot", "none", "--prototypes", dictionary),
        *("--object", "99", "--out", out),
    )
    assert out.read_text() == '{"schema": "debrisgrasp/grasps/1"}'
    assert [entry.name for entry in tmp_path.iterdir()] == [out.name]


def test_what_is_no_capture_is_refused_from_python():
    for call in (debrisgrasp.segment, debrisgrasp.Pipeline(robot="none").plan):
        with pytest.raises(debrisgrasp.DebrisGraspError, match=r"Capture\.load"):
            call("pile.npz")
    with pytest.raises(debrisgrasp.DebrisGraspError, match="robot"):
        debrisgrasp.Pipeline(robot=None)


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


def test_a_cloud_without_a_pose_is_told_what_the_pose_of_base_is():
    points = np.array([[1.0, 0.0, 0.0], [1.0, 0.1, 0.0], [1.1, 0.0, 0.1]])
    cloud = debrisgrasp.Capture(points=points, viewpoint=np.zeros(3), name="lidar")
    with pytest.raises(debrisgrasp.errors.CaptureError) as caught:
        cloud.cloud()
    assert "0,0,0,0,0,0 if its points are in the base frame" in str(caught.value)
    assert "level" not in str(caught.value)
