"""The workbench on the command line, and the worked example of its document."""

from __future__ import annotations

import json
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

from debrisgrasp.cli.program import run
from debrisgrasp.io import data_path
from debrisgrasp.io.plan_json import load_plan
from debrisgrasp.prototypes import PrototypeLibrary

DOCUMENT = Path(__file__).parents[2] / "docs" / "prototypes.md"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def worked_example() -> list[list[str]]:
    """Commands of the section that leads from an unknown part to a grasp."""
    text = DOCUMENT.read_text()
    start = text.index("## Add one in minutes")
    section = text[start : text.index("\n## ", start + 3)]
    blocks = re.findall(r"^```sh\n(.*?)^```$", section, re.MULTILINE | re.DOTALL)
    return [shlex.split(line)[1:] for body in blocks for line in body.splitlines()]


def test_the_worked_example_ends_with_a_grasp(folder):
    shutil.copy(data_path("captures", "pile.npz"), "pile.npz")
    commands = worked_example()
    assert [words[0] for words in commands] == ["segment", *["prototype"] * 3, "plan"]
    for words in commands:
        assert run(words) == 0, words
    plan = load_plan(folder / "grasps.json")
    assert plan.grasps
    assert {grasp.prototype for grasp in plan.grasps} == {"grey_part"}
    assert plan.grasps[0].success_probability > 0.8
    assert max(grasp.Q for grasp in plan.grasps) > 0.5
    assert "grey_part" in Path("mine.html").read_text()


def test_new_makes_a_pipe_and_keeps_it(capsys):
    make = ["prototype", "new", "--shape", "cylinder", "--radius", "0.0325"]
    make += ["--length", "0.14", "--name", "pipe", "--preshape", "basic", "--out", "p"]
    assert run([*make, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["width"] == pytest.approx(0.065, abs=0.005)
    assert facts["findings"] == []
    before = Path("p/pipe.yaml").read_bytes()
    assert run(make) == 2
    assert "--force" in capsys.readouterr().err
    assert Path("p/pipe.yaml").read_bytes() == before
    assert run([*make, "--force"]) == 0
    assert run(["prototype", "check", "pipe", "--prototypes", "p"]) == 0
    assert "half turns that change nothing: x, y, z" in capsys.readouterr().out


@pytest.mark.parametrize("other", [["--choice", "2"], ["--joints", "a=1"]])
def test_the_hand_is_placed_in_one_way(other, capsys):
    make = ["prototype", "record", "pile.npz", "--name", "a", "--pose=1,0,0,0,0,0"]
    assert run([*make, *other]) == 2
    assert "not allowed with argument --pose" in capsys.readouterr().err


def test_no_folder_of_records_counts_twice(folder, capsys):
    (folder / "runs").mkdir()
    again = str(folder / "runs")
    assert run(["prototype", "learn", "runs", again, "--out", "learned"]) == 2
    assert "one twice" in capsys.readouterr().err


def test_a_prototype_is_made_beside_a_file_that_is_none(folder, capsys):
    make = ["prototype", "new", "--shape", "cylinder", "--diameter", "0.065"]
    make += ["--length", "0.14", "--name", "pipe", "--out", "p"]
    (folder / "p").mkdir()
    (folder / "p" / "odd.yaml").write_text("x: 1\n")
    assert run(make) == 0
    said = capsys.readouterr()
    assert "wrote p/pipe.yaml" in said.out
    assert "compared with none beside it: p/odd.yaml" in said.err


def test_a_dictionary_for_another_hand_plans(capsys):
    grippers = Path(__file__).parents[2] / "examples" / "grippers"
    hand = ["--gripper", "jaw_140", "--grippers", str(grippers)]
    few = PrototypeLibrary.load().select(names=["bar_2x4_flat", "bar_4x4", "edge_019"])
    few.save("few")
    make = ["prototype", "adapt", *hand, "--shapes", "few", "--out", "own"]
    assert run([*make, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert {Path(file).stem for file in Path("own").iterdir()} == set(
        facts["prototypes"]
    )
    assert facts["left_out"] == {}
    assert run(make) == 2
    assert "not empty" in capsys.readouterr().err
    shutil.copy(data_path("captures", "pile.npz"), "pile.npz")
    plan = ["plan", "pile.npz", "--robot", "none", *hand, "--prototypes", "own"]
    assert run([*plan, "--out", "grasps.json"]) == 0
    found = load_plan(Path("grasps.json"))
    assert {grasp.prototype for grasp in found.grasps} <= set(facts["prototypes"])


def test_a_hand_that_takes_no_shape_gets_no_folder(capsys):
    PrototypeLibrary.load().select(names=["edge_012", "rim_bucket"]).save("thin")
    make = ["prototype", "adapt", "--gripper", "camhand", "--shapes", "thin"]
    assert run([*make, "--out", "own"]) == 1
    said = capsys.readouterr().out
    assert "left out edge_012" in said
    assert "wrote nothing" in said
    assert not Path("own").exists()


def test_adapt_asks_for_the_hand(capsys):
    assert run(["prototype", "adapt", "--out", "own"]) == 2
    assert "--gripper: got nothing" in capsys.readouterr().err
    assert run(["prototype", "adapt", "--gripper", "none", "--out", "own"]) == 2
    assert "camhand" in capsys.readouterr().err


def test_a_mesh_with_a_given_pose_becomes_a_prototype(capsys):
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box((40.0, 200.0, 40.0)).export("bar.stl")
    pose = np.eye(4)
    pose[2, 3] = -0.09
    np.savetxt("pose.txt", pose)
    make = ["prototype", "from-mesh", "bar.stl", "--name", "bar", "--pose", "pose.txt"]
    make += ["--preshape", "basic", "--out", "p"]
    assert run(make) == 2
    assert "--scale 0.001" in capsys.readouterr().err
    assert not Path("p").exists()
    assert run([*make, "--scale", "0.001", "--kind", "generic"]) == 0
    (prototype,) = PrototypeLibrary.load("p")
    assert prototype.width == pytest.approx(0.04, abs=0.006)
    assert prototype.kind == "generic"


@pytest.mark.parametrize("z", [0.0, -0.05, -0.08])
def test_a_palm_inside_a_mesh_is_found_where_no_finger_reaches(capsys, folder, z):
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box((0.03, 0.06, 0.2)).export("bracket.stl")
    make = ["prototype", "from-mesh", "bracket.stl", "--name", "b", "--out", "m"]
    assert run([*make, f"--pose=0,0,{z},0,0,0"]) == 1
    assert "the open hand reaches" in capsys.readouterr().out
    assert not (folder / "m").exists()
    assert run([*make, "--pose=0,0,-0.13,0,0,0"]) == 0


@pytest.mark.parametrize("force", [(), ("--force",)])
def test_a_prototype_never_replaces_what_it_is_made_of(capsys, folder, force):
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.cylinder(radius=0.03, height=0.3).export("rod.ply")
    Path("link").symlink_to(folder)
    before = Path("rod.ply").read_bytes()
    make = ["prototype", "from-mesh", "rod.ply", "--name", "rod", *force]
    for out in (".", "link"):
        assert run([*make, "--out", out]) == 2
        assert "rod.ply: it is what is read" in capsys.readouterr().err
    assert Path("rod.ply").read_bytes() == before
    assert not Path("rod.yaml").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("new --shape cylinder --diameter 65 --length 0.14 --name a", "metres"),
        ("new --shape cylinder --diameter 0.1 --radius 0.1 --name a", "one of them"),
        ("new --shape box --name a --gripper tongs", "robotiq_3f"),
        ("new --shape box --name ../a", "lower-case"),
        ("from-mesh absent.stl --name a", "no such file"),
        ("record pile.npz --name a", "segment CAPTURE"),
        ("record pile.npz --name a --object 6 --pose 1,2", "pose of the hand"),
        ("record pile.npz --name a --object 6 --joints elbow", "NAME=VALUE"),
        (
            "record pile.npz --name a --object 6 --joints elbow=1",
            "joint of robot roman",
        ),
        (
            "record pile.npz --name a --object 6 --joints torso_joint=1,torso_joint=0",
            "torso_joint twice",
        ),
        ("record pile.npz --name a --object 6 --preshape fist", "basic"),
        ("new --shape handle --diameter 0.03 --name a", "--length with --shape handle"),
        (
            "new --shape cylinder --diameter 0.05 --length 0.2 --plate 1 --name a",
            "its sizes: --diameter, --ends, --length",
        ),
        (
            "new --shape bar --name a --grip deep --position 0 0 0.1",
            "--position: not allowed with argument --grip",
        ),
        ("new --shape rim --diameter 0.1 --name a", "--thickness with --shape rim"),
        (
            "record pile.npz --name a --object 6 --pose 500,0,300,0,0,0",
            "divide by 1000",
        ),
        ("coverage --out map.pdf", ".png"),
        ("show --out sheet.pdf", ".html"),
    ],
)
def test_bad_input_is_told_and_nothing_is_written(words, said, capsys, folder):
    shutil.copy(data_path("captures", "pile.npz"), "pile.npz")
    assert run(["prototype", *words.split()]) == 2
    assert said in capsys.readouterr().err
    assert [path.name for path in folder.iterdir()] == ["pile.npz"]


def test_coverage_names_the_gaps_and_draws_them(capsys):
    assert run(["prototype", "coverage", "--out", "map.png"]) == 0
    said = capsys.readouterr().out
    assert "gap: robotiq_3f, across a round piece: 15 cm" in said
    assert Path("map.png").stat().st_size > 10_000
    assert run(["prototype", "coverage", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert len(facts["sizes"]) == 17
    assert {row["hand"] for row in facts["rows"]} == {"robotiq_3f", "camhand"}


def test_check_tells_of_twins(capsys):
    shutil.copytree(data_path("prototypes"), "p")
    twin = Path("p/bar_4x4.yaml").read_text().replace("name: bar_4x4", "name: twin")
    Path("p/twin.yaml").write_text(twin)
    assert run(["prototype", "check", "twin", "--prototypes", "p"]) == 0
    assert "twin: like bar_4x4: 0.0 mm apart" in capsys.readouterr().out


def test_check_takes_a_folder_and_checks_all_in_it(capsys):
    Path("p").mkdir()
    for name in ("bar_4x4", "bar_2x4_flat"):
        shutil.copy(data_path("prototypes", f"{name}.yaml"), "p")
    assert run(["prototype", "check", "p"]) == 0
    assert capsys.readouterr().out.startswith("2 prototypes checked, 0 findings")


def test_a_taught_pose_of_a_capture_becomes_a_prototype_that_loads(capsys):
    shutil.copy(data_path("captures", "pile.npz"), "pile.npz")
    record = ["prototype", "record", "pile.npz", "--object", "6", "--out", "p"]
    good = "--pose=1.02,0.29,0.19,3.14,0.26,-1.71"
    assert run([*record, "--name", "taught", good]) == 0
    # Across the long way, which no finger spans.
    bad = "--pose=1.0,0.32,0.19,3.1416,0,0"
    assert run([*record, "--name", "too_wide", bad]) == 1
    assert "into the shape" in capsys.readouterr().out
    assert PrototypeLibrary.load("p").names == ("taught",)
    assert run([*record, "--name", "too_wide", bad, "--force"]) == 1
    assert PrototypeLibrary.load("p").names == ("taught", "too_wide")


@pytest.mark.parametrize("hand", ["my_jaw", "jaws/my_jaw.yaml"])
def test_a_hand_that_is_not_known_is_told_before_anything_is_written(
    capsys, folder, hand
):
    new = "prototype new --shape cylinder --diameter 0.06 --length 0.1 --name a --out p"
    assert run([*new.split(), "--gripper", hand]) == 2
    assert "--grippers" in capsys.readouterr().err
    assert not (folder / "p").exists()


def test_what_no_hand_spans_is_told_and_not_written(capsys, folder):
    new = (
        "prototype new --shape cylinder --diameter 0.3 --length 0.2 --name vat --out p"
    )
    assert run([*new.split(), "--preshape", "basic"]) == 1
    said = capsys.readouterr().out
    assert "too thick for the hand" in said
    assert "wrote nothing" in said
    assert not (folder / "p").exists()


@pytest.mark.parametrize(
    ("sizes", "option"),
    [
        ("box --width .05 --height .04", "--length with --shape box"),
        ("cylinder --diameter 50 --length .3", "--diameter with --shape cylinder"),
        ("edge --thickness -1", "--thickness with --shape edge"),
    ],
)
def test_a_missing_or_wrong_size_is_told_as_the_option_it_is(capsys, sizes, option):
    assert run(["prototype", "new", "--name", "a", "--shape", *sizes.split()]) == 2
    assert f"{option}: got" in capsys.readouterr().err
