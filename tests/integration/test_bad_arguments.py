"""Arguments on which no honest result exists: one readable message, status 2."""

from __future__ import annotations

import json

import numpy as np
import pytest

import debrisgrasp
from debrisgrasp.executive import State
from debrisgrasp.robot import INJECTABLE
from tests.integration.test_bad_input import arrays

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


def test_a_hand_that_no_arm_carries_is_told_to_float(refused, pipe_file):
    message = refused("plan", pipe_file, "--gripper", "jaw_140")
    assert "unknown gripper of roman: got 'jaw_140'" in message
    assert "planned for with the robot 'none'" in message


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


@pytest.mark.parametrize("command", ["plan", "segment", "select", "motion", "view"])
def test_an_empty_path_is_not_the_working_folder(command, refused):
    assert "it is empty" in refused(command, "")


def test_what_was_typed_wrong_is_found_before_anything_is_read(refused, tmp_path):
    plan = ("plan", tmp_path / "none.npz")
    assert "--mass" in refused(*plan, "--mass", "-1")
    assert "--object" in refused(*plan, "--object", "-1")
    assert "region" in refused(*plan, "--region", *"110001")
    for option in ("--n-best", "--n-per-hand", "--n-per-prototype"):
        for bad in ("0", "121"):
            words = f"{option}: got {bad}, expected 1 to 120"
            assert words in refused(*plan, option, bad)
        assert f"{option}: 'x' is not a whole number" in refused(*plan, option, "x")
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
        ("plan {} --pick 900,100,300", "--pick: got a coordinate"),
        ("clear --max-removals 0 --objects 1", "--max-removals: got 0"),
        ("clear --drive-over 7", "--drive-over [m]: got 7"),
        ("clear --pushes -1", "--pushes: got -1"),
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
        ("clear", "--seed", "x"),
        ("plan", "a.npz", "--nothing"),
        ("clear", "--faults", ","),
        ("clear", "--faults", ""),
    ],
)
def test_who_asks_for_json_is_refused_in_json(run, words):
    ended = run(*words, "--json")
    facts = json.loads(ended.err)
    assert ended.status == 2
    assert ended.out == ""
    assert facts["error"]
    assert facts["message"]


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


@pytest.mark.parametrize("command", ["clear", "plan", "reach"])
def test_the_help_says_what_the_numbers_of_a_region_are(run, command):
    said = " ".join(run(command, "--help").out.split())
    told = said[said.index("--region X0 Y0 Z0 X1 Y1 Z1 ", said.index("options:")) :]
    for words in ("lower corner", "metres", "base frame (x forward", "for instance 0."):
        assert words in told[:400]


@pytest.mark.parametrize("given", [["0.7,-0.2,0,1.2,0.2,0.3"], ["1", "2", "3"]])
def test_too_few_numbers_of_a_region_are_told_which(refused, given):
    assert "X0 Y0 Z0 X1 Y1 Z1, with spaces" in refused("clear", "--region", *given)


@pytest.mark.parametrize(
    "words",
    [("clear", "--record"), ("clear", "--mask"), ("replay",), ("plan",)],
)
def test_a_name_that_no_file_can_have_is_told(refused, tmp_path, words):
    message = refused(*words, tmp_path / ("x" * 300))
    assert "File name too long" in message
    assert len(message) < 400


@pytest.mark.parametrize(
    ("words", "value", "most"),
    [
        (("clear", "--objects"), "1e9", 50),
        (("clear", "--max-removals"), "nan", 10_000),
        (("clear", "--pushes"), "nan", 100),
        (("campaign", "--n"), "2.5", 1_000_000),
        (("campaign", "--max-removals"), "nan", 10_000),
        (("campaign", "--workers"), "two", 1024),
    ],
)
def test_a_number_that_is_not_whole_is_told_with_its_range(
    refused, tmp_path, words, value, most
):
    message = refused(*words, value)
    assert f"argument {words[-1]}: '{value}' is not a whole number" in message
    # The range is that of the numbers which are.
    out = ("--out", tmp_path / "out") if words[0] == "campaign" else ()
    for said in (message, refused(*words, most + 1, *out)):
        assert f"to {most}." in said


def test_a_record_is_not_scattered_among_other_files(refused, tmp_path):
    (tmp_path / "campaign.json").write_text("{}")
    message = refused("clear", "--objects", 1, "--record", tmp_path)
    assert "it holds other files, as campaign.json" in message
    assert [path.name for path in tmp_path.iterdir()] == ["campaign.json"]


def test_the_faults_are_listed_for_machines_too(run):
    listed = run("clear", "--faults", "list", "--json").json
    assert {fault["fault"] for fault in listed["faults"]} == set(INJECTABLE)
    assert listed["states"] == [state.value for state in State]
