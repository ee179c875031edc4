"""What `clear` and `replay` tell whoever reads it, and where that goes."""

from __future__ import annotations

import subprocess
import sys
from types import SimpleNamespace

import pytest

from debrisgrasp.cli.clear_command import _facts, _robot_of
from debrisgrasp.cli.program import run as debrisgrasp
from debrisgrasp.executive import RunEnd, RunRecord, SimulatedTask
from debrisgrasp.viz.run import _ending


def test_a_replay_that_is_interrupted_is_no_comparison(tmp_path, capsys, monkeypatch):
    record = RunRecord(tmp_path, {"seed": 3, "faults": ()})
    record.write("done", {"state": "select"})
    record.write("end", {"end": "cleared"})

    def interrupted(_task, told):
        told.write("end", {"end": "interrupted"})

    monkeypatch.setattr(SimulatedTask, "run", interrupted)
    with pytest.raises(KeyboardInterrupt):
        debrisgrasp(["replay", str(tmp_path)])
    assert capsys.readouterr().out == ""


def test_whoever_stops_reading_does_not_end_a_run():
    lines = (
        "import sys",
        "from debrisgrasp.cli.output import steady_output",
        "print('ready', flush=True); sys.stdin.read()",
        "with steady_output():",
        "    [print(words, flush=True) for words in ('one', 'two', 'three')]",
        "sys.exit(7)",
    )
    process = subprocess.Popen(
        [sys.executable, "-c", "\n".join(lines)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    with process:
        assert process.stdout.readline() == b"ready\n"
        process.stdout.close()
        process.stdin.close()
        assert process.stderr.read() == b""
    assert process.returncode == 7


def test_a_robot_file_is_recorded_with_its_place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert _robot_of("mine/robot.yaml") == str(tmp_path.resolve() / "mine/robot.yaml")
    assert _robot_of("roman") == "roman"
    assert _robot_of(None) is None


def test_what_is_still_held_is_told_to_machines_and_on_the_page():
    held = SimpleNamespace(
        end=RunEnd.INTERRUPTED, counted_as=None, attempts=(), faults=(), left={},
        holding="left", silent=("the left arm",), duration=3.0,
    )  # fmt: skip
    truth = SimpleNamespace(removed=())
    facts = _facts(SimpleNamespace(result=held, truth=truth, happened=(), missed=()))
    assert facts["still_held"] == "left"
    assert facts["not_stopped"] == ["the left arm"]
    end = {"end": "interrupted", "removed": 0, "class": None, "holding": "left"}
    words = "not counted; STILL HELD by the hand of the left arm"
    assert _ending(end, 3.0).endswith(words)
