"""The whole task on the robot in memory: clear, record, page and replay."""

from __future__ import annotations

import json
import pickle
from copy import deepcopy

import numpy as np
import pytest

from debrisgrasp import api
from debrisgrasp.cli.commands import version
from debrisgrasp.cli.live import ToldRun
from debrisgrasp.cli.program import run as debrisgrasp
from debrisgrasp.errors import UnknownNameError
from debrisgrasp.executive import (
    Action,
    Executive,
    RunEnd,
    RunRecord,
    Simulated,
    SimulatedTask,
    State,
    TaskSettings,
    load_run,
    simulate,
)
from debrisgrasp.executive.record import MemoryRecord
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.robot import INJECTABLE, FakeConfig, Injection, fake_robot
from tests.disks import files_up_to
from tests.tasks import run_struck, trust_the_camera


def run_at(pipeline, beam, period, settings):
    """Take one beam at some period of the robot's loop; the run, and the robot."""
    config = FakeConfig(is_initialised=True, period=period)
    rng = np.random.default_rng(0)
    fake = fake_robot(pipeline.robot, beam, rng=rng, config=config)
    rng = np.random.default_rng(0)
    return Executive(fake.robot, settings, pipeline=pipeline, rng=rng).run(), fake


@pytest.fixture(scope="module")
def cleared(pipeline, beam):
    result, fake = run_at(pipeline, beam, 0.004, TaskSettings(drive_over=0.0))
    return result, fake.truth()


def test_what_clearing_a_pile_returns_comes_back_from_another_process(cleared):
    done = Simulated(*cleared, (), is_latched=False)
    for other in (deepcopy(done), pickle.loads(pickle.dumps(done))):
        assert other.result.n_removed == done.result.n_removed == 1
        assert [body.sizes for body in other.truth.world.bodies] == [
            body.sizes for body in done.truth.world.bodies
        ]


def test_an_arm_of_100_hz_clears_the_way_too(pipeline, beam):
    settings = TaskSettings(drive_over=0.02, period=0.01)
    result, fake = run_at(pipeline, beam, 0.01, settings)
    truth = fake.truth()
    assert result.end is RunEnd.CLEARED
    assert truth.removed == ("beam",)
    assert truth.violations == ()
    assert truth.overloads == ()


@pytest.mark.parametrize(("of_robot", "of_loop"), [(0.008, 0.004), (0.004, 0.0005)])
def test_a_loop_faster_than_the_robot_is_found_before_anything_moves(
    pipeline, beam, of_robot, of_loop
):
    settings = TaskSettings(period=of_loop)
    result, fake = run_at(pipeline, beam, of_robot, settings)
    (fault,) = result.faults
    assert fault.fault == "clock_disorder"
    assert f"takes {1e3 * of_robot:g} ms: set TaskSettings.period" in fault.message
    assert fake.truth().violations == ()
    assert not any(arm.is_engaged for arm in fake.arms.values())


@pytest.mark.parametrize("fault", ["foo", "software_error", "slip@foo"])
def test_an_unknown_fault_or_state_says_what_lists_them(fault):
    with pytest.raises(UnknownNameError, match="clear --faults list"):
        SimulatedTask(faults=(fault,))


def test_no_run_begins_with_a_fault_at_a_state_that_there_is_not(pipeline, beam, rng):
    fault = Injection(fault="slip", state="lfit")
    with pytest.raises(UnknownNameError, match="slip strikes"):
        simulate(beam, TaskSettings(), [fault], pipeline=pipeline, rng=rng)


def test_a_beam_is_carried_to_the_drop_off_and_the_way_is_clear(cleared):
    result, truth = cleared
    assert result.end is RunEnd.CLEARED
    assert result.fault_class is None
    assert truth.removed == ("beam",)
    place = truth.world.bodies[0].T_base_body.p
    arm = result.attempts[0].arm
    aim = TaskSettings().drop_off[arm]
    assert np.linalg.norm(place[:2] - aim) < 0.35


def test_no_command_and_no_wrench_was_beyond_the_limits(cleared):
    _, truth = cleared
    assert truth.violations == ()
    assert truth.overloads == ()


def test_what_is_low_is_driven_over_and_named(tmp_path, capsys):
    folder = tmp_path / "run"
    page = tmp_path / "run.html"
    arguments = ["clear", "--objects", "1", "--seed", "3", "--drive-over", "0.9"]
    arguments += ["--record", str(folder), "--report", str(page), "--json"]
    assert debrisgrasp(arguments) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["end"] == "cleared"
    assert all("drive over" in reason for reason in told["left"].values())
    assert load_run(folder).is_whole
    assert "Timeline" in page.read_text()
    assert "drop-off, right arm" in page.read_text()
    assert debrisgrasp(["replay", str(folder)]) == 0
    assert "the same" in capsys.readouterr().out


def test_each_attempt_is_told_as_it_ends_and_taken_down():
    said, record = [], MemoryRecord()
    told = ToldRun(record, said.append)
    told.write("state", {"state": "close"})
    told.write("fault", {"fault": "slip", "state": "lift"})
    assert not said
    failed = {"number": 1, "removed": False, "prototype": "bar", "arm": "left"}
    told.write("attempt", failed)
    told.write("attempt", {"number": 2, "removed": True, "prototype": None})
    told.write("done", {"state": "push", "pushed": 0.0, "why": "it came by 1 cm"})
    told.write("attempt", {"number": 3, "removed": False, "prototype": None})
    assert said == [
        "attempt 1: not removed, bar with the left arm, slip in lift",
        "attempt 2: removed",
        "attempt 3: not removed, can't be pushed: it came by 1 cm",
    ]
    kinds = [event["event"] for event in record.events]
    assert kinds == ["state", "fault", "attempt", "attempt", "done", "attempt"]


def test_what_ended_a_run_stands_below_its_attempts(capsys):
    arguments = ["clear", "--objects", "1", "--seed", "3"]
    assert debrisgrasp([*arguments, "--faults", "wrench_sign@self_test"]) == 1
    first, last = capsys.readouterr().out.splitlines()[:2]
    assert first == "attempt 1: not removed, wrench_sign in self_test"
    assert "0 removed; counts as driver" in last


def test_an_injected_fault_ends_the_run_in_its_class(pipeline):
    task = SimulatedTask(objects=1, seed=3, faults=("wrench_sign@self_test",))
    done = api.clear(task, pipeline=pipeline)
    assert done.happened == ("wrench_sign",)
    assert done.result.fault_class.value == "driver"
    assert done.result.faults[-1].fault == "wrench_sign"
    assert done.truth.violations == ()


def test_with_a_load_in_the_hand_a_sensor_that_lies_stops_the_robot(
    pipeline, beam, monkeypatch
):
    trust_the_camera(monkeypatch)
    lies = Injection(fault="wrench_sign", state="verify_hold")
    struck = run_struck(pipeline, beam, TaskSettings(drive_over=0.02), [lies])
    assert struck.result.end is RunEnd.STOPPED
    assert struck.result.faults[-1].fault == "wrench_sign"
    assert struck.result.faults[-1].action is Action.STOP
    assert struck.fake.truth().overloads == ()


def test_a_load_that_grows_on_an_open_hand_that_stands_stops_it(
    pipeline, beam, monkeypatch
):
    trust_the_camera(monkeypatch)
    grows = Injection(fault="ratchet", state="verify_release")
    struck = run_struck(pipeline, beam, TaskSettings(drive_over=0.02), [grows])
    assert struck.happened == ("ratchet",)
    assert struck.result.end is RunEnd.STOPPED
    # Before the hand is shaken, as if something hung on it; the sensor of the idle arm
    # lies too.
    arm = struck.result.attempts[0].arm
    assert [f.fault for f in struck.result.faults if f.arm == arm] == ["ratchet"]
    assert struck.fake.truth().overloads == ()


def test_an_empty_image_never_means_that_the_way_is_clear(pipeline, beam, monkeypatch):
    trust_the_camera(monkeypatch)
    empty = Injection(fault="empty_cloud", state="capture")
    struck = run_struck(pipeline, beam, TaskSettings(drive_over=0.9), [empty])
    assert struck.happened == ("empty_cloud",)
    assert {event.fault for event in struck.result.faults} == {"empty_cloud"}
    assert {event.action for event in struck.result.faults} == {Action.RETRY}
    # Only the image after those, with the ground in it, may say so.
    assert struck.result.end is RunEnd.CLEARED
    assert struck.result.left


@pytest.mark.parametrize(
    "wrong",
    [
        ["clear", "--scene", "nowhere"],
        ["clear", "--faults", "nothing_known"],
        ["clear", "--arm", "third"],
        ["clear", "--robot", "none"],
        ["clear", "--gripper", "claw"],
        ["clear", "--report", "/nonexistent/run.html"],
        ["clear", "--report", "run.pdf"],
        ["clear", "--record", "/proc/run"],
        ["clear", "--site", "nothing.yaml"],
        ["clear", "--mask", "nothing.npz"],
        ["clear", "--region", "1", "1", "1", "0", "0", "0"],
        ["replay", "/nonexistent/run"],
    ],
)
def test_bad_input_is_one_block_on_stderr(wrong, capsys):
    assert debrisgrasp(wrong) == 2
    error = capsys.readouterr().err
    assert error.startswith("debrisgrasp: error:")
    assert "Traceback" not in error


def test_the_faults_that_can_be_named_are_listed(capsys):
    assert debrisgrasp(["clear", "--faults", "list"]) == 0
    listed = capsys.readouterr().out
    assert {line.split()[0] for line in listed.splitlines()[2:-2]} == set(INJECTABLE)
    assert f"states: {State.SELF_TEST.value}, " in listed


SITE = """
schema: debrisgrasp/site/1
arm: left
drop_off: {left: [0.3, 0.8]}
limits: {force: 120, joint_speed: 0.5, hand_speed: 0.01}
"""


def test_the_workspace_of_a_site_is_that_of_the_task(tmp_path):
    site = tmp_path / "site.yaml"
    box = "workspace: [0.7, -0.5, -0.1, 1.2, 0.5, 1]"
    text = f"schema: debrisgrasp/site/1\nrobot: roman\n{box}\n"
    # In the usual way, but not in that one.
    site.write_text(text + "drop_off: {right: [0.55, -0.55]}\narm: right\n")
    task = SimulatedTask(site=str(site))
    settings = task.settings(task.pipeline())
    assert settings.workspace == ((0.7, -0.5, -0.1), (1.2, 0.5, 1.0))
    assert settings.drop_off["right"] == (0.55, -0.55)


def test_the_settings_of_a_site_hold_for_the_task(tmp_path):
    site = tmp_path / "site.yaml"
    site.write_text(SITE)
    task = SimulatedTask(site=str(site))
    pipeline = task.pipeline()
    settings = task.settings(pipeline)
    assert settings.arms == ("left",)
    assert settings.drop_off["left"] == (0.3, 0.8)
    assert settings.approach_speed == settings.lift_speed == 0.01
    usual = RobotModel.load("roman").limits("left").planner.velocity
    limits = pipeline.robot.limits("left").planner
    assert np.allclose(limits.velocity, 0.5 * usual)
    assert limits.force == 120.0
    both = SimulatedTask(site=str(site), arms=("right",))
    assert both.settings(both.pipeline()).arms == ("right",)


@pytest.mark.parametrize(("what", "limit"), [("force", 50), ("torque", 0.001)])
def test_a_limit_too_low_to_feel_a_touch_by_is_refused(tmp_path, capsys, what, limit):
    site = tmp_path / "site.yaml"
    site.write_text(f"schema: debrisgrasp/site/1\nlimits: {{{what}: {limit}}}\n")
    record = tmp_path / "run"
    words = ["clear", "--site", str(site), "--record", str(record)]
    assert debrisgrasp(words) == 2
    told = capsys.readouterr().err
    assert f"field limits.{what}: got {limit} N" in told
    assert "80 % are used, see TaskSettings.load_share" in " ".join(told.split())
    # What was refused leaves nothing that is in the way of the next try.
    assert RunRecord(record, {}).fault == ""


def test_on_a_full_disk_the_run_is_told_before_the_error(tmp_path, capsys):
    folder, page = tmp_path / "run", tmp_path / "run.html"
    words = ["clear", "--objects", "1", "--seed", "3", "--faults", "wrench_sign"]
    words += ["--record", str(folder), "--report", str(page)]
    with files_up_to(700):
        assert debrisgrasp(words) == 2
    told, error = capsys.readouterr()
    assert "0 removed; counts as driver" in told
    assert "wrote" not in told
    assert "the record in" in error
    assert f"can't write {page}" in error
    assert not page.exists()
    run = load_run(folder)
    assert run.reached == "the run up to self_test in attempt 1"
    assert not run.is_whole
    words = [*words[:-2], "--json"]
    words[words.index(str(folder))] = str(tmp_path / "again")
    with files_up_to(700):
        assert debrisgrasp(words) == 2
    told, error = capsys.readouterr()
    assert json.loads(told)["class"] == "driver"
    message = json.loads(error.splitlines()[-1])["message"]
    assert "It has the run up to self_test in attempt 1" in message
    assert "Nothing was changed" not in message


def test_a_disk_that_is_full_before_the_run_begins_is_told_at_once(tmp_path, capsys):
    folder = tmp_path / "run"
    with files_up_to(20):
        assert debrisgrasp(["clear", "--objects", "1", "--record", str(folder)]) == 2
    told, error = capsys.readouterr()
    assert told == ""
    assert f"can't write {folder / 'inputs.json'}" in error
    assert not folder.exists()


def test_a_page_that_can_not_be_written_leaves_no_record_behind(tmp_path, capsys):
    words = ["clear", "--record", str(tmp_path / "run")]
    assert debrisgrasp([*words, "--report", str(tmp_path / "no" / "run.html")]) == 2
    assert "there is no folder" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_a_record_that_lacks_something_is_replayed_and_says_what(tmp_path, capsys):
    folder = tmp_path / "run"
    words = ["clear", "--objects", "1", "--seed", "3", "--record", str(folder)]
    assert debrisgrasp([*words, "--faults", "wrench_sign"]) == 1
    capsys.readouterr()
    assert debrisgrasp(["replay", str(folder)]) == 0
    now = version()
    assert f"before: {now}, now: {now}\n" in capsys.readouterr().out
    lines = (folder / "events.jsonl").read_text().splitlines()
    (folder / "events.jsonl").write_text("\n".join(lines[:-3]) + '\n{"event": "att')
    assert debrisgrasp(["replay", str(folder)]) == 1
    assert "lacks the end of events.jsonl" in capsys.readouterr().out
    ends = [
        '{"event": "stop", "why": "interrupted"}',
        '{"event": "end", "end": "interrupted"}',
    ]
    (folder / "events.jsonl").write_text("\n".join([*lines[:-3], *ends]) + "\n")
    assert debrisgrasp(["replay", str(folder)]) == 0


def test_a_replay_tells_that_the_file_of_the_site_was_edited_since(tmp_path, capsys):
    site, folder = tmp_path / "site.yaml", tmp_path / "run"
    site.write_text("schema: debrisgrasp/site/1\n")
    words = ["clear", "--site", str(site), "--objects", "1", "--seed", "3"]
    words += ["--faults", "wrench_sign", "--record", str(folder)]
    assert debrisgrasp(words) == 1
    capsys.readouterr()
    assert debrisgrasp(["replay", str(folder)]) == 0
    assert "not as before" not in capsys.readouterr().out
    site.write_text("schema: debrisgrasp/site/1\nlimits: {hand_speed: 0.2}\n")
    debrisgrasp(["replay", str(folder)])
    told = capsys.readouterr().out
    assert f"not as before: {site} with another content" in told
    debrisgrasp(["replay", str(folder), "--json"])
    assert json.loads(capsys.readouterr().out)["edited"] == [
        f"{site} with another content"
    ]


def test_a_comparison_tells_which_versions_made_the_records(tmp_path, capsys):
    for name, made_by in (("old", {"version": "debrisgrasp 0.0.1"}), ("new", {})):
        record = RunRecord(tmp_path / name, {"seed": 3, "faults": (), **made_by})
        record.write("done", {"state": "capture"})
        record.write("end", {"end": "cleared"})
    words = ["replay", str(tmp_path / "old"), "--against", str(tmp_path / "new")]
    assert debrisgrasp([*words, "--json"]) == 1  # it has no capture
    told = json.loads(capsys.readouterr().out)
    made_by = {"before": "debrisgrasp 0.0.1", "now": "an unknown version"}
    assert told["versions"] == made_by
    assert told["same"]
    assert debrisgrasp(words) == 1
    told = capsys.readouterr().out
    assert told.startswith("before: debrisgrasp 0.0.1, now: an unknown version\n")


def test_replayed_records_of_different_tasks_are_not_the_same(tmp_path, capsys):
    for name, seed in (("one", 3), ("other", 4), ("cut", 3), ("nothing", 3)):
        record = RunRecord(tmp_path / name, {"seed": seed, "faults": ()})
        if name != "nothing":
            record.write("done", {"state": "select"})
        if name not in ("cut", "nothing"):
            record.write("end", {"end": "cleared"})
    one, other, cut, nothing = (
        str(tmp_path / name) for name in ("one", "other", "cut", "nothing")
    )
    assert debrisgrasp(["replay", one, "--against", one]) == 0
    assert "tasks" not in capsys.readouterr().out
    assert debrisgrasp(["replay", one, "--against", other]) == 1
    told = capsys.readouterr().out
    assert "different tasks:\n  seed: 3 before, 4 now\n" in told
    assert debrisgrasp(["replay", one, "--against", other, "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert not told["same"]
    assert told["tasks"] == ["seed: 3 before, 4 now"]
    assert debrisgrasp(["replay", one, "--against", cut]) == 1
    assert f"{cut} lacks the end of events.jsonl" in capsys.readouterr().out
    assert debrisgrasp(["replay", one, "--against", nothing]) == 2
    assert f"{nothing}: got no decision" in capsys.readouterr().err
    inputs = tmp_path / "other" / "inputs.json"
    inputs.write_text(inputs.read_text().replace('"seed": 4', '"sead": 4'))
    assert debrisgrasp(["replay", one, "--against", other]) == 2
    assert f"{other}: inputs of a run: got sead" in capsys.readouterr().err


def test_an_interrupted_record_is_compared_as_far_as_it_got(tmp_path, capsys):
    for name, end in (("whole", "cleared"), ("short", "interrupted")):
        record = RunRecord(tmp_path / name, {"seed": 3, "faults": ()})
        record.write("done", {"state": "select"})
        if end == "interrupted":
            record.write("stop", {"why": end})
        else:
            record.write("done", {"state": "plan_grasp"})
        record.write("end", {"end": end})
    places = [str(tmp_path / name) for name in ("whole", "short")]
    for one, other in (places, places[::-1]):
        assert debrisgrasp(["replay", one, "--against", other]) == 0
        assert "the same 1 decision\n" in capsys.readouterr().out


def test_a_record_from_python_has_the_version(tmp_path, pipeline):
    task = SimulatedTask(objects=1, seed=3, faults=("limit_mismatch",))
    api.clear(task, record=tmp_path / "run", pipeline=pipeline)
    assert load_run(tmp_path / "run").inputs["version"] == version()
