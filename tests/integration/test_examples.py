"""Every example runs as a script, without a screen, and says something telling."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from debrisgrasp.io import data_path
from debrisgrasp.kinematics.packages import package_folders

EXAMPLES = Path(__file__).parents[2] / "examples"

TELLING = {
    "01_segment_a_pile": "1. object",
    "02_plan_and_explain": "it looks like a",
    "03_plan_a_folder": "best Q",
    "04_another_hand": "grasps on object",
    "05_other_arms": "ur10: ",
    "10_lift_a_beam": "hand that turns: done",
    "11_guarded_approach": "guarded: touched something",
    "12_calibrate": "ptu_tilt_joint slipped by",
    "13_reach_a_grasp": "planned: ",
    "14_your_own_robot": "metres, not millimetres",
    "15_clear_a_pile": "really removed: ",
    "20_ros2_node": "",  # tested in test_embedding, as is the server
    "21_control_loop": "done after",
    "22_depth_camera": "grasps, Q",
    "23_plan_server": "",
    "30_record_a_prototype": "grips object 6 with grey_part: Q",
    "31_look_at_a_plan": "grasps; open http://localhost:",
}


def run(name: str, *arguments: str, cwd: Path) -> str:
    environment = {key: v for key, v in os.environ.items() if key != "DISPLAY"}
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / f"{name}.py"), *arguments],
        capture_output=True,
        text=True,
        cwd=cwd,
        env=environment | {"MPLCONFIGDIR": str(cwd)},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_example_is_tested():
    assert {path.stem for path in EXAMPLES.glob("*.py")} == set(TELLING)


@pytest.mark.parametrize(
    "name",
    [
        "01_segment_a_pile",
        "02_plan_and_explain",
        "04_another_hand",
        "12_calibrate",
        "21_control_loop",
        "22_depth_camera",
    ],
)
def test_runs_on_the_bundled_capture(name, tmp_path):
    assert TELLING[name] in run(name, cwd=tmp_path)


def test_records_a_prototype_and_grips_with_it(tmp_path):
    output = run("30_record_a_prototype", str(tmp_path / "p"), cwd=tmp_path)
    assert TELLING["30_record_a_prototype"] in output
    assert {path.name for path in (tmp_path / "p").iterdir()} == {
        "grey_part.ply",
        "grey_part.yaml",
        "prototypes.html",
    }


def test_serves_a_plan(tmp_path):
    pytest.importorskip("viser")
    output = run("31_look_at_a_plan", "--once", cwd=tmp_path)
    assert TELLING["31_look_at_a_plan"] in output


def test_clears_a_small_pile_and_draws_the_run(tmp_path):
    output = run("15_clear_a_pile", str(tmp_path), cwd=tmp_path)
    assert TELLING["15_clear_a_pile"] in output
    assert output.startswith("attempt 1: ")
    assert (tmp_path / "run.html").stat().st_size > 20_000


def test_plans_a_folder(tmp_path):
    folder = tmp_path / "captures"
    folder.mkdir()
    shutil.copy(data_path("captures", "pile.npz"), folder)
    output = run(
        "03_plan_a_folder", str(folder), "--reports", str(tmp_path / "r"), cwd=tmp_path
    )
    header, _, row = output.splitlines()
    assert TELLING["03_plan_a_folder"] in header
    capture, robot, _points, n_segments, _tried, n_grasps, *_ = row.split()
    assert (capture, robot) == ("pile", "roman")
    assert int(n_segments) > 1
    assert int(n_grasps) > 0
    assert {path.name for path in (tmp_path / "r").iterdir()} == {
        "pile.html",
        "pile.png",
    }


@pytest.mark.parametrize("name", ["10_lift_a_beam", "11_guarded_approach"])
def test_rehearses_a_leg_and_draws_it(name, tmp_path):
    output = run(name, str(tmp_path / "leg.png"), cwd=tmp_path)
    assert TELLING[name] in output
    assert "limit" in output
    assert (tmp_path / "leg.png").stat().st_size > 20_000


def test_draws_a_leg_beside_a_planned_motion(tmp_path):
    output = run("13_reach_a_grasp", str(tmp_path / "reach.png"), cwd=tmp_path)
    assert TELLING["13_reach_a_grasp"] in output
    assert "straight: something is in the way" in output
    assert (tmp_path / "reach.png").stat().st_size > 20_000


def test_other_arms_plan_on_the_same_capture(tmp_path):
    panda = "example-robot-data/robots/panda_description"
    if not any((folder / panda).is_dir() for folder in package_folders()):
        pytest.skip("example-robot-data is not installed")
    output = run("05_other_arms", cwd=tmp_path)
    for name in ("panda", "talos", "ur10"):
        (line,) = (line for line in output.splitlines() if line.startswith(name))
        assert int(line.split()[1]) > 0, line
