"""Records: whole lines whatever happens, and two of them compared."""

from __future__ import annotations

import json
import subprocess
import sys
from subprocess import PIPE

import numpy as np
import pytest

from debrisgrasp.errors import ConfigError, OutputError
from debrisgrasp.executive import RunRecord, differences, load_run
from debrisgrasp.executive.simulated import SimulatedTask, injections_of
from debrisgrasp.geometry import SE3, Intrinsics
from debrisgrasp.io import Capture
from tests.disks import files_up_to


def test_what_was_written_is_read_again(tmp_path):
    record = RunRecord(tmp_path / "run", {"seed": 3})
    record.write("state", {"state": "capture", "time": np.float64(0.5)})
    record.write("end", {"end": "cleared", "values": np.array([1.0, np.nan])})
    run = load_run(tmp_path / "run")
    assert run.inputs["seed"] == 3
    assert run.is_whole
    assert run.events[0]["time"] == 0.5
    assert run.events[1]["values"] == [1.0, None]


def picture(**more) -> Capture:
    camera = Intrinsics(fx=10.0, fy=10.0, cx=3.5, cy=2.5, width=8, height=6)
    return Capture(
        depth=np.ones((6, 8)), intrinsics=camera, T_base_camera=SE3.identity(), **more
    )


def test_captures_are_kept_beside_the_events(tmp_path):
    capture = picture()
    record = RunRecord(tmp_path, {})
    record.keep(capture, "capture_001")
    stored = load_run(tmp_path).capture("capture_001")
    assert np.array_equal(stored.depth, capture.depth)
    assert load_run(tmp_path).capture("capture_002") is None


def test_a_folder_with_another_run_is_not_overwritten(tmp_path):
    # A run that was refused before it began has left nothing to lose.
    RunRecord(tmp_path, {})
    RunRecord(tmp_path, {}).write("state", {"state": "self_test"})
    with pytest.raises(OutputError, match="another run"):
        RunRecord(tmp_path, {})


def test_two_processes_do_not_begin_one_record(tmp_path):
    code = (
        "import sys; from debrisgrasp.executive import RunRecord; "
        "record = RunRecord(sys.argv[1], {}); print('begun', flush=True); input()"
    )
    other = [sys.executable, "-c", code, str(tmp_path)]
    with subprocess.Popen(other, stdin=PIPE, stdout=PIPE, text=True) as begun:
        assert begun.stdout.readline() == "begun\n"
        with pytest.raises(OutputError, match="another run is about to"):
            RunRecord(tmp_path, {})
        assert (tmp_path / "events.jsonl").exists()
        begun.kill()
    RunRecord(tmp_path, {}).write("state", {"state": "self_test"})


def test_a_record_that_is_written_and_still_held_is_called_one(tmp_path):
    record = RunRecord(tmp_path, {})
    record.write("state", {"state": "self_test"})
    with pytest.raises(OutputError, match="the record of another run"):
        RunRecord(tmp_path, {})
    record.write("end", {"end": "cleared"})
    assert load_run(tmp_path).is_whole


def test_a_record_cut_off_in_a_line_is_read_up_to_it(tmp_path):
    record = RunRecord(tmp_path, {})
    record.write("state", {"state": "capture"})
    with (tmp_path / "events.jsonl").open("a") as stream:
        stream.write('{"event": "sta')
    run = load_run(tmp_path)
    assert len(run.events) == 1
    assert not run.is_whole


def test_a_record_says_what_it_lacks(tmp_path):
    record = RunRecord(tmp_path, {})
    for number in (1, 2):
        record.write("done", {"state": "capture"})
        record.write("attempt", {"number": number})
    assert load_run(tmp_path).missing == (
        "the end of events.jsonl",
        "captures/capture_001.npz",
        "captures/capture_002.npz",
    )
    record.keep(picture(), "capture_001")
    record.write("end", {"end": "cleared"})
    assert load_run(tmp_path).missing == ("captures/capture_002.npz",)
    first = tmp_path / "captures" / "capture_001.npz"
    first.write_bytes(first.read_bytes()[:-100])
    assert len(load_run(tmp_path).missing) == 2


def test_of_all_captures_that_were_kept_a_record_says_which_are_gone(tmp_path):
    record = RunRecord(tmp_path, {})
    for name in ("hanging_001", "released_001", "rested_001"):
        record.keep(picture(), name)
    record.write("end", {"end": "cleared"})
    assert load_run(tmp_path).missing == ()
    (tmp_path / "captures" / "released_001.npz").unlink()
    cut = tmp_path / "captures" / "hanging_001.npz"
    cut.write_bytes(cut.read_bytes()[:100])
    run = load_run(tmp_path)
    assert run.missing == ("captures/hanging_001.npz", "captures/released_001.npz")
    assert run.capture("hanging_001") is run.capture("released_001") is None
    assert run.capture("rested_001") is not None


def test_two_looks_of_one_attempt_are_two_captures_of_a_record(tmp_path):
    record = RunRecord(tmp_path, {})
    for look in (1, 2):
        record.write("done", {"state": "capture", "look": look})
    record.keep(picture(), "capture_001")
    assert "captures/capture_002.npz" in load_run(tmp_path).missing


def test_a_damaged_line_in_the_middle_is_named(tmp_path):
    RunRecord(tmp_path, {})
    (tmp_path / "events.jsonl").write_text(
        '{"event": "done"}\n{oops\n{"event": "end"}\n'
    )
    with pytest.raises(ConfigError, match="line 2"):
        load_run(tmp_path)


@pytest.mark.parametrize(
    ("line", "match"),
    [
        ("5", "line 2: got 5"),
        ("[1]", "line 2"),
        ("null", "line 2"),
        ('{"event": 3}', "line 2, event"),
        ('{"event": "ende"}', 'line 2, event: got "ende", expected one of state, '),
        ('{"kind": 5}', "line 2, event: got null"),
        ('{"event": "attempt", "number": "two"}', 'line 2, number: got "two"'),
        ('{"event": "attempt", "number": null}', "line 2, number: got null"),
        ('{"event": "done", "state": "capture", "look": "2"}', "line 2, look"),
        ('{"event": "done", "state": "capture", "look": 1.5}', "line 2, look"),
        ('{"event": "state", "state": null, "time": 1.0}', "line 2, state"),
        ('{"event": "state", "state": "lift", "time": "now"}', "line 2, time"),
        ('{"event": "state", "state": "lift", "time": NaN}', "line 2: got NaN, which"),
        ('{"event": "trace", "rows": null}', "line 2, rows: got null"),
        ('{"event": "trace", "rows": [[1]]}', "line 2, rows"),
        ('{"event": "end", "left": [1]}', r"line 2, left: got \[1\]"),
        ('{"event": "kept", "capture": 1}', "line 2, capture: got 1"),
        (r'{"event": "kept", "capture": "a\u0000"}', "line 2, capture"),
        ("[" * 100_000, "line 2: got too many brackets"),
        ('{"event": "done", "a": %s}' % ("[" * 600 + "]" * 600), "line 2: got too"),
    ],
)
def test_a_line_that_is_no_event_is_named(tmp_path, line, match):
    RunRecord(tmp_path, {}).write("state", {"state": "capture"})
    with (tmp_path / "events.jsonl").open("a") as stream:
        stream.write(line + "\n")
    with pytest.raises(ConfigError, match=match) as caught:
        load_run(tmp_path)
    assert "events.jsonl" in str(caught.value)


def test_a_full_disk_leaves_the_last_line_whole_and_the_run_going(tmp_path, caplog):
    record = RunRecord(tmp_path, {})
    record.write("state", {"state": "capture"})
    with files_up_to((tmp_path / "events.jsonl").stat().st_size + 20):
        record.write("done", {"state": "capture", "words": "x" * 200})
        record.write("done", {"state": "segment"})
        record.fault = ""
        record.keep(picture(), "capture_001")
    assert "captures/capture_001.npz" in record.fault
    assert "can't write" not in record.fault
    # Whoever watches the run hears of it when it happens.
    assert "the run goes on" in caplog.text
    assert not list((tmp_path / "captures").iterdir())
    lines = (tmp_path / "events.jsonl").read_text().splitlines()
    assert [json.loads(line)["state"] for line in lines] == ["capture"]
    assert load_run(tmp_path).reached == "the run up to capture in attempt 1"


def test_a_disk_that_is_full_before_the_run_leaves_nothing_half_written(tmp_path):
    folder = tmp_path / "runs" / "one"
    with files_up_to(20), pytest.raises(OutputError, match=r"inputs\.json"):
        RunRecord(folder, {"seed": 3})
    assert not list(tmp_path.iterdir())
    folder.mkdir(parents=True)
    (folder / "notes.txt").write_text("mine")
    with files_up_to(20), pytest.raises(OutputError):
        RunRecord(folder, {"seed": 3})
    assert [path.name for path in folder.iterdir()] == ["notes.txt"]


def events(**changed):
    return [
        {"event": "state", "state": "select", "time": 1.0},
        {"event": "done", "state": "select", "object": 3, **changed},
        {"event": "end", "end": "cleared"},
    ]


def test_equal_decisions_have_no_differences_whatever_the_times():
    other = events()
    other[0] = {**other[0], "time": 2.0}
    assert differences(events(), other) == []
    assert differences(events(score=0.5), events(score=0.5 + 1e-9)) == []


def test_the_first_decision_that_differs_is_named_with_both_values():
    (found,) = differences(events(), events(object=4))
    assert (found.number, found.state, found.field) == (1, "select", "object")
    assert "3 before, 4 now" in str(found)


def test_a_run_that_ends_early_differs_in_length():
    (found,) = differences(events(), events()[:2])
    assert found.field == "length"


def test_a_task_survives_the_way_through_its_record():
    task = SimulatedTask(
        seed=4,
        objects=2,
        region=(0.8, -0.3, 0.2, 1.3, 0.3, 0.5),
        faults=("slip@lift", "wrench_nan"),
    )
    again = SimulatedTask.from_json(json.loads(json.dumps(task.to_json())))
    assert again == task


def test_faults_are_written_as_name_and_state():
    one, two = injections_of(["slip@lift", "wrench_nan"])
    assert (one.fault, one.state) == ("slip", "lift")
    assert (two.fault, two.state) == ("wrench_nan", None)


@pytest.mark.parametrize(
    "wrong",
    [
        {"scene": "wod_on_truss"},
        {"scene": "hedgehog", "objects": 3},
        {"seed": -1},
        {"faults": ("slip@lft",)},
        {"max_removals": 0},
        {"faults": ("sleep",)},
        {"faults": ("software_error",)},
        {"region": (0.0, 0.0, 0.0, 1.0, 1.0)},
        {"region": (1.0, 0.0, 0.0, 0.5, 1.0, 1.0)},
        {"region": ("a", "b", "c", "d", "e", "f")},
        {"region": (0.0,) * 3 + (1.0,) * 3, "mask": "capture.npz"},
    ],
)
def test_a_task_that_makes_no_sense_is_refused(wrong):
    with pytest.raises(ConfigError.__mro__[1]):
        SimulatedTask(**wrong)


@pytest.mark.parametrize(
    ("field", "value"),
    [("version", 5), ("contents", [1]), ("contents", {"site.yaml": 5})],
)
def test_what_replay_compares_is_of_its_kind(tmp_path, field, value):
    RunRecord(tmp_path, {"seed": 1, field: value})
    with pytest.raises(ConfigError, match=f"inputs.json, field {field}.*: got"):
        load_run(tmp_path)


def test_a_name_that_no_folder_can_have_is_no_record(tmp_path):
    for name, words in (("x" * 300, "File name too long"), ("none", "no folder")):
        with pytest.raises(ConfigError, match=f"got {words}.*the record of a run"):
            load_run(tmp_path / name)
    with pytest.raises(ConfigError, match=r"got no inputs\.json in it"):
        load_run(tmp_path)


def test_a_record_has_no_name_that_no_folder_can_have(tmp_path):
    with pytest.raises(OutputError, match="too long"):
        RunRecord(tmp_path / "new" / ("x" * 300), {"seed": 1})
    assert list(tmp_path.iterdir()) == []


def test_inputs_of_something_else_are_refused():
    with pytest.raises(ConfigError, match="robot in memory"):
        SimulatedTask.from_json({"seed": 1})


@pytest.mark.parametrize(
    ("field", "value"),
    [("objects", "abc"), ("seed", None), ("drive_over", "low"), ("objects", 2.5)],
)
def test_inputs_of_the_wrong_type_are_named(field, value):
    content = SimulatedTask(objects=2).to_json() | {field: value}
    with pytest.raises(ConfigError, match=f"{field} of a task"):
        SimulatedTask.from_json(content)
