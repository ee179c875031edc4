"""Where results go: what they never replace, and what is told of those written."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

import debrisgrasp
from debrisgrasp._files import data_path
from debrisgrasp.errors import ConfigError, OutputError
from debrisgrasp.io.motion_json import load_motion
from debrisgrasp.pipeline import GraspMotions
from tests.disks import files_up_to

LED = "right_robotiq_led_frame"


@pytest.fixture
def folder(pipe_capture, tmp_path):
    """Return a capture as a folder, with its camera."""
    folder = tmp_path / "look"
    folder.mkdir()
    millimetres = np.nan_to_num(1e3 * pipe_capture.depth).astype(np.uint16)
    Image.fromarray(millimetres).save(folder / "depth.png")
    camera = {
        "K": pipe_capture.intrinsics.matrix.ravel().tolist(),
        "T_base_camera": pipe_capture.T_base_camera.matrix.tolist(),
    }
    (folder / "camera.json").write_text(json.dumps(camera))
    return folder


@pytest.mark.parametrize("command", ["plan", "segment", "select", "motion"])
def test_no_file_of_a_folder_that_is_read_is_replaced(
    refused, folder, tmp_path, command
):
    depth, colors = folder / "depth.png", folder / "rgb.png"
    Image.fromarray(np.zeros((4, 5, 3), np.uint8)).save(colors)
    link = tmp_path / "link.png"
    link.symlink_to(depth)
    before = depth.read_bytes(), colors.read_bytes()
    for report in (depth, colors, link, folder / "mask.png"):
        assert "it is what is read" in refused(command, folder, "--report", report)
    assert (depth.read_bytes(), colors.read_bytes()) == before
    assert not (folder / "mask.png").exists()


def test_the_camera_of_a_depth_image_is_not_replaced(refused, folder):
    camera = folder / "camera.json"
    before = camera.read_bytes()
    said = refused("plan", folder / "depth.png", "--out", camera)
    assert "it is what is read" in said
    assert camera.read_bytes() == before


def test_results_may_go_beside_what_is_read(run, folder):
    report = folder / "objects.png"
    assert run("segment", folder, "--report", report).status == 0
    assert run("segment", folder, "--report", report).status == 0


@pytest.mark.parametrize(
    "words",
    [
        ("segment", data_path("captures", "pile.npz"), "--report"),
        ("plan", data_path("captures", "pile.npz"), "--report"),
        ("prototype", "show", "--out"),
        ("prototype", "coverage", "--out"),
    ],
    ids=lambda words: words[0],
)
def test_a_depth_image_of_another_capture_is_not_replaced(refused, folder, words):
    depth = folder / "depth.png"
    before = depth.read_bytes()
    assert "a depth image, and would be lost" in refused(*words, depth)
    assert depth.read_bytes() == before


def test_observations_with_points_are_not_replaced(refused, run, tmp_path):
    file = tmp_path / "todo.json"
    choose = ("calibrate", "choose", "--fiducial", LED, "-n", 2, "--out")
    for _ in range(2):  # nothing is filled in yet
        assert run(*choose, file).status == 0
    content = json.loads(file.read_text())
    content["observations"][1]["point"] = [0.0, 0.1, 1.2]
    file.write_text(json.dumps(content))
    said = refused(*choose, file)
    assert "1 of the observations there have points" in said
    assert "another place" in said
    assert json.loads(file.read_text()) == content
    site = tmp_path / "site.yaml"
    site.write_text("robot: none\n")
    assert "would be lost" in refused(*choose, site)
    assert "ends in .json" in refused(*choose, tmp_path / "todo.csv")


@pytest.mark.parametrize("name", ["labels", "labels.txt", "labels.npy"])
def test_labels_of_another_suffix_are_refused_before_the_work(
    refused, pipe_file, tmp_path, monkeypatch, name
):
    monkeypatch.setattr("debrisgrasp.io.Capture.load", pytest.fail)
    assert "ends in .npz" in refused("segment", pipe_file, "--out", tmp_path / name)


def test_python_refuses_what_the_command_refuses(floating, pipe_capture, tmp_path):
    result = floating.plan(pipe_capture)
    own = tmp_path / "own.json"
    own.write_text('{"fx": 600.0}')
    with pytest.raises(OutputError, match="would be lost"):
        result.save(own)
    assert own.read_text() == '{"fx": 600.0}'
    capture = tmp_path / "capture.npz"
    pipe_capture.save(capture)
    before = capture.read_bytes()
    with pytest.raises(ConfigError, match=r"ends in \.json"):
        result.save(capture)
    assert capture.read_bytes() == before
    for _ in range(2):
        result.save(tmp_path / "grasps.json")


def test_what_was_written_before_a_failure_is_named(run, pipe_file, tmp_path):
    labels, picture = tmp_path / "labels.npz", tmp_path / "picture.png"
    with files_up_to(8000):
        ended = run("segment", pipe_file, "--out", labels, "--report", picture)
    assert ended.status == 2
    assert labels.is_file()
    assert f"can't write {picture}" in ended.err
    assert f"Written before it: {labels}." in ended.err


def test_motions_are_saved_from_python(tmp_path):
    found = GraspMotions(chosen=None, passed_over=((0, "too far"),), robot="roman")
    path = tmp_path / "motion.json"
    for _ in range(2):
        found.save(path)
    assert load_motion(path).trajectories == {}
    content = json.loads(path.read_text())
    assert content["robot"] == "roman"
    assert content["passed_over"] == [{"grasp": 1, "reason": "too far"}]
    with pytest.raises(ConfigError, match=r"ends in \.json"):
        found.save(tmp_path / "motion.npz")


def test_names_that_the_terminal_has_no_letters_for_are_told_in_codes(
    pipe_capture, tmp_path
):
    pipe_capture.save(tmp_path / "größe.npz")
    program = "import sys; from debrisgrasp.cli import main; sys.exit(main())"
    ended = subprocess.run(
        [sys.executable, "-c", program, "segment", "größe.npz", "--report", "ö.png"],
        cwd=tmp_path,
        env={"PYTHONIOENCODING": "ascii"},
        capture_output=True,
        check=False,
    )
    assert (ended.returncode, ended.stderr) == (0, b"")
    assert ended.stdout.endswith(b"wrote \\xf6.png\n")


def test_names_that_are_no_text_are_drawn(run, pipe_file, tmp_path):
    odd = tmp_path / "bad\udcff.npz"
    odd.write_bytes(pipe_file.read_bytes())
    assert debrisgrasp.Capture.load(odd).name == "bad?"
    for report in (tmp_path / "b.png", tmp_path / "b.html"):
        assert run("select", odd, "--report", report).status == 0
        assert report.is_file()


def test_the_home_folder_is_found_behind_an_option(
    run, pipe_file, tmp_path, monkeypatch
):
    monkeypatch.setenv("HOME", str(tmp_path))
    site = tmp_path / "site.yaml"
    site.write_text("schema: debrisgrasp/site/1\nprototypes: ~/mine\n")
    (tmp_path / "mine").mkdir()
    assert debrisgrasp.Settings.load(site).prototypes == tmp_path / "mine"
    assert run("segment", pipe_file, "--report=~/x.png").status == 0
    assert (tmp_path / "x.png").is_file()


def test_a_level_pose_that_is_not_there_is_an_error_alone(refused, folder):
    said = refused("plan", folder, "--camera-pose", "level")
    assert "T_level_camera" in said
    assert "note" not in said


def test_nothing_to_list_is_said(run, pipe_file, monkeypatch):
    empty = debrisgrasp.segment(debrisgrasp.Capture.load(pipe_file))
    object.__setattr__(empty, "segments", ())
    monkeypatch.setattr(debrisgrasp, "segment", lambda *_: empty)
    ended = run("segment", pipe_file)
    assert ended.status == 1
    assert ended.out.endswith("no object was found beside the ground and what else "
                              "was taken away\n")  # fmt: skip
