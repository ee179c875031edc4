"""Campaigns: no run is lost, whatever dies or is interrupted."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest

from debrisgrasp.campaign import (
    UNCLASSIFIED,
    Campaign,
    LocalWorkers,
    OwnWorkers,
    Progress,
    damaged_runs,
    load_records,
)
from debrisgrasp.errors import ConfigError, InputError, OutputError
from tests.interrupts import take_interrupts

from .runs import Told, begun, do, told

THREADS = OwnWorkers(lambda: ThreadPoolExecutor(2), 3)


@pytest.fixture
def marks(tmp_path: Path) -> Path:
    folder = tmp_path / "marks"
    folder.mkdir()
    return folder


def test_every_run_has_a_record_in_the_order_of_the_specs(tmp_path, marks):
    specs = told(7, marks)[::-1]
    seen = []
    campaign = Campaign(specs=specs, run_one=do, folder=tmp_path / "out")
    records = campaign.run(THREADS, on_progress=seen.append)
    assert [record.name for record in records] == [spec.name for spec in specs]
    assert [progress.done for progress in seen] == list(range(8))
    assert begun(marks) == sorted(spec.name for spec in specs)
    assert sorted(records, key=lambda r: r.name) == list(load_records(tmp_path / "out"))


def test_what_a_run_raises_is_recorded_with_its_trace(tmp_path, marks):
    specs = [*told(3, marks), Told("bad", folder=str(marks), act="raise")]
    campaign = Campaign(specs=specs, run_one=do, folder=tmp_path)
    *good, bad = campaign.run(THREADS)
    assert all(record.is_success for record in good)
    assert bad.outcome == UNCLASSIFIED
    assert "ZeroDivisionError: told to" in bad.error


def test_a_campaign_goes_on_where_it_was(tmp_path, marks):
    specs = told(6, marks)
    first = Campaign(specs=specs[:4], run_one=do, folder=tmp_path)
    first.run(THREADS)
    (tmp_path / "runs" / "001.json").write_text('{"schema": "debr')
    (tmp_path / "runs" / "002.json").write_text("")
    whole = replace(first, specs=specs)
    assert len(whole.run(THREADS)) == 6
    assert begun(marks) == ["000", "001", "001", "002", "002", "003", "004", "005"]


def test_a_record_of_another_spec_is_not_kept(tmp_path, marks):
    first = Campaign(specs=told(2, marks), run_one=do, folder=tmp_path)
    first.run(THREADS)
    other = replace(first, specs=told(2, marks, outcome="driver"))
    assert [record.outcome for record in other.run(THREADS)] == ["driver", "driver"]


def test_the_folder_of_another_campaign_is_refused(tmp_path, marks):
    campaign = Campaign(
        specs=told(1, marks), run_one=do, folder=tmp_path, header={"seed": 1}
    )
    campaign.run(THREADS)
    with pytest.raises(InputError, match="seed 1 instead of 2"):
        replace(campaign, header={"seed": 2}).run(THREADS)


def test_the_record_of_a_single_run_is_no_folder_of_a_campaign(tmp_path, marks):
    (tmp_path / "events.jsonl").write_text("")
    campaign = Campaign(specs=told(1, marks), run_one=do, folder=tmp_path)
    with pytest.raises(InputError, match="record of a single run"):
        campaign.run(THREADS)
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("name", ["results.csv", "results.json", "campaign.png"])
def test_somebodys_own_results_are_not_written_over(tmp_path, marks, name):
    (tmp_path / name).write_text("mine")
    campaign = Campaign(specs=told(1, marks), run_one=do, folder=tmp_path)
    with pytest.raises(InputError, match=f"got {name}, but no campaign.json"):
        campaign.run(THREADS)
    assert begun(marks) == []
    assert (tmp_path / name).read_text() == "mine"


def test_a_folder_that_was_begun_with_other_files_is_refused_by_their_names(
    tmp_path, marks
):
    files = {"rates.yaml": "ab12", "site.yaml": "cd34"}
    campaign = Campaign(
        specs=told(1, marks), run_one=do, folder=tmp_path, contents=files
    )
    campaign.run(THREADS)
    assert len(campaign.run(THREADS)) == 1
    changes = [
        ({**files, "rates.yaml": "ef56"}, "got rates.yaml with another content"),
        ({**files, "hand.yaml": "ab12"}, "got no record of what hand.yaml held"),
        ({"site.yaml": "cd34"}, "got rates.yaml, which is not used any more"),
    ]
    for contents, message in changes:
        with pytest.raises(InputError, match=message) as caught:
            replace(campaign, contents=contents).run(THREADS)
        assert "site.yaml" not in str(caught.value)


def test_records_of_a_longer_campaign_that_was_there_before_are_not_read(
    tmp_path, marks
):
    longer = Campaign(specs=told(5, marks), run_one=do, folder=tmp_path)
    longer.run(THREADS)
    shorter = replace(longer, specs=told(3, marks))
    assert load_records(tmp_path) == longer.run(THREADS)
    assert shorter.run(THREADS) == load_records(tmp_path)
    longer.run(THREADS)
    assert len(load_records(tmp_path)) == 5
    assert len(begun(marks)) == 5


def test_a_copy_of_the_record_of_another_run_is_counted_as_damaged(tmp_path, marks):
    campaign = Campaign(specs=told(3, marks), run_one=do, folder=tmp_path)
    campaign.run(THREADS)
    runs = tmp_path / "runs"
    (runs / "002.json").write_bytes((runs / "000.json").read_bytes())
    assert [record.name for record in load_records(tmp_path)] == ["000", "001"]
    assert damaged_runs(tmp_path) == ("002",)


def test_the_folder_of_an_older_version_is_read_whole(tmp_path, marks):
    Campaign(specs=told(3, marks), run_one=do, folder=tmp_path).run(THREADS)
    path = tmp_path / "campaign.json"
    header = json.loads(path.read_text())
    del header["runs"], header["contents"]
    path.write_text(json.dumps(header))
    assert len(load_records(tmp_path)) == 3


def test_runs_that_end_their_workers_cost_no_other_run(tmp_path, marks):
    specs = told(8, marks)
    specs[2] = replace(specs[2], act="die once")
    specs[5] = replace(specs[5], act="die")
    specs[6] = replace(specs[6], act="hang")
    campaign = Campaign(specs=specs, run_one=do, folder=tmp_path)
    records = campaign.run(LocalWorkers(2, time_limit=1.0))
    assert [record.name for record in records] == [spec.name for spec in specs]
    bad = {r.name for r in records if r.outcome == UNCLASSIFIED}
    assert bad == {"005", "006"}
    assert {r.outcome for r in records if r.name not in bad} == {"success"}
    assert "its worker died 2 times" in records[5].error


def test_a_worker_killed_from_outside_costs_no_run(tmp_path, marks):
    specs = told(6, marks, seconds=0.1)
    killed = []

    def kill_first(progress):
        if progress.latest is not None and not killed:
            newest = max(marks.glob("*+*"), key=lambda path: path.name.split("+")[1])
            killed.append(int(newest.name.split("+")[2]))
            os.kill(killed[0], signal.SIGKILL)

    campaign = Campaign(specs=specs, run_one=do, folder=tmp_path)
    records = campaign.run(LocalWorkers(2), on_progress=kill_first)
    assert killed
    assert [record.outcome for record in records] == ["success"] * 6
    assert len(begun(marks)) > 6


def slept(seconds, mark):
    time.sleep(seconds)
    mark.touch()


def test_what_runs_beside_a_worker_that_died_is_ended(tmp_path):
    ended = tmp_path / "ended"
    with LocalWorkers(2).open() as crew:
        beside = crew.executor.submit(slept, 20.0, ended)
        crew.executor.submit(os._exit, 9)
        with pytest.raises(BrokenExecutor):
            beside.result()
    assert not ended.exists()


SCRIPT = """
import sys
from pathlib import Path
from debrisgrasp.campaign import Campaign, LocalWorkers
from tests.unit.campaign.runs import do, told

if __name__ == "__main__":
    out, marks = map(Path, sys.argv[1:])
    specs = told(200, marks, seconds=0.05)
    try:
        Campaign(specs=specs, run_one=do, folder=out).run(LocalWorkers(2))
    except KeyboardInterrupt:
        sys.exit(130)
"""


@pytest.mark.parametrize("way", [signal.SIGINT, signal.SIGKILL])
def test_after_an_interruption_the_finished_runs_are_whole(tmp_path, marks, way):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    out = tmp_path / "out"
    root = Path(__file__).parents[3]
    process = subprocess.Popen(
        [sys.executable, script, out, marks],
        env={**os.environ, "PYTHONPATH": str(root)},
        start_new_session=True,
        preexec_fn=take_interrupts,
    )
    deadline = time.monotonic() + 60
    while len(list(out.glob("runs/*.json"))) < 4 and time.monotonic() < deadline:
        time.sleep(0.02)
    # As a terminal does: to the whole group for Ctrl-C.
    if way == signal.SIGINT:
        os.killpg(process.pid, way)
        assert process.wait(30) == 130
    else:
        process.kill()
        process.wait(30)
    time.sleep(0.3)
    n_begun = len(begun(marks))
    time.sleep(0.3)
    assert len(begun(marks)) == n_begun, "workers went on without their parent"
    records = load_records(out)
    assert 4 <= len(records) < 200
    for path in out.glob("runs/*.json"):
        json.loads(path.read_text())


@pytest.mark.parametrize("wait", [0.0, 0.3, 0.8])
def test_ctrl_c_while_workers_start_says_nothing_of_them(tmp_path, marks, wait):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    out = tmp_path / "out"
    process = subprocess.Popen(
        [sys.executable, script, out, marks],
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])},
        start_new_session=True,
        preexec_fn=take_interrupts,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 60
    # The header is written just before workers are started.
    while not (out / "campaign.json").exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(wait)
    os.killpg(process.pid, signal.SIGINT)
    _, told = process.communicate(timeout=60)
    assert process.returncode == 130
    assert told == ""


def test_what_other_processes_can_not_be_sent_is_refused(tmp_path, marks):
    with pytest.raises(InputError, match="top of a module"):
        Campaign(specs=told(1, marks), run_one=lambda s: s, folder=tmp_path)


@pytest.mark.parametrize("names", [("a", "a"), ("../a",), ("",), ("a b",)])
def test_names_that_make_no_files_are_refused(tmp_path, names):
    with pytest.raises(InputError, match="names of the runs"):
        Campaign(specs=[Told(n) for n in names], run_one=do, folder=tmp_path)


def test_a_folder_may_be_named_by_a_text(tmp_path, marks):
    campaign = Campaign(specs=told(1, marks), run_one=do, folder=str(tmp_path / "out"))
    assert campaign.folder == tmp_path / "out"
    assert len(campaign.run(THREADS)) == 1


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"folder": 5}, "folder: got 5"),
        ({"run_one": "do"}, "run_one.*a function"),
        ({"specs": [1]}, r"specs\[0\].*a Spec"),
    ],
)
def test_what_makes_no_campaign_is_refused(tmp_path, marks, changed, words):
    given = {"specs": told(1, marks), "run_one": do, "folder": tmp_path}
    with pytest.raises(InputError, match=words):
        Campaign(**given | changed)


def test_an_executor_is_refused_with_the_way_to_give_one(tmp_path, marks):
    campaign = Campaign(specs=told(1, marks), run_one=do, folder=tmp_path / "out")
    with ThreadPoolExecutor(1) as executor:
        with pytest.raises(InputError, match=r"workers.*OwnWorkers\(lambda"):
            campaign.run(executor)
        with pytest.raises(InputError, match=r"a function.*OwnWorkers\(lambda"):
            OwnWorkers(executor)
    with pytest.raises(InputError, match="got int"):
        campaign.run(OwnWorkers(int))
    with pytest.raises(ConfigError, match="width"):
        OwnWorkers(lambda: executor, width=0)


def test_a_place_that_is_no_folder_is_refused(tmp_path, marks):
    (tmp_path / "out").write_text("a file")
    campaign = Campaign(specs=told(1, marks), run_one=do, folder=tmp_path / "out")
    with pytest.raises(OutputError):
        campaign.run(THREADS)
    with pytest.raises(ConfigError):
        load_records(tmp_path)


def test_a_folder_is_taken_only_once_there_are_workers(tmp_path, marks):
    def none() -> ThreadPoolExecutor:
        raise InputError("cluster", got="no answer", expected="one")

    out = tmp_path / "out"
    campaign = Campaign(specs=told(1, marks), run_one=do, folder=out)
    with pytest.raises(InputError, match="no answer"):
        campaign.run(OwnWorkers(none))
    assert not out.exists()
    replace(campaign, header={"seed": 1}).run(THREADS)
    assert len(load_records(out)) == 1


def test_a_folder_in_which_another_is_at_work_is_refused(tmp_path, marks):
    campaign = Campaign(specs=told(2, marks), run_one=do, folder=tmp_path / "out")
    refused = []

    def start_again(progress: Progress) -> None:
        with pytest.raises(InputError, match="another process that is at work"):
            campaign.run(THREADS)
        refused.append(progress.done)

    campaign.run(THREADS, on_progress=start_again)
    assert refused == [0, 1, 2]
    assert begun(marks) == ["000", "001"]
    campaign.run(THREADS)  # when it has ended, anyone may go on


class AtOnce(Executor):
    """Does everything as it is asked for."""

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        future.set_result(fn(*args, **kwargs))
        return future


def test_what_is_done_at_the_same_time_is_kept_in_the_order_of_the_specs(
    tmp_path, marks
):
    kept = []
    campaign = Campaign(specs=told(9, marks), run_one=do, folder=tmp_path / "out")
    campaign.run(
        OwnWorkers(AtOnce, 9),
        on_progress=lambda at: kept.append(at.latest and at.latest.name),
    )
    assert kept == [None, *(f"{i:03d}" for i in range(9))]


def test_a_full_disk_ends_a_campaign_whose_records_stay_whole(
    tmp_path, marks, monkeypatch
):
    flush, n_left = os.fsync, 4  # the header, and three records

    def full(descriptor: int) -> None:
        nonlocal n_left
        if n_left == 0:
            os.ftruncate(descriptor, 10)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        n_left -= 1
        flush(descriptor)

    out = tmp_path / "out"
    campaign = Campaign(specs=told(9, marks), run_one=do, folder=out)
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match=r"runs/00\d\.json: No space left on device"):
        campaign.run(THREADS)
    monkeypatch.undo()
    kept = {path: path.read_bytes() for path in (out / "runs").iterdir()}
    assert len(kept) == len(load_records(out)) == len(campaign.finished()) == 3
    assert len(campaign.run(THREADS)) == 9
    assert {path: path.read_bytes() for path in kept} == kept


LIMITED = """
import resource
import sys
from pathlib import Path
from debrisgrasp.campaign import Campaign, LocalWorkers
from debrisgrasp.errors import OutputError
from tests.unit.campaign.runs import Told, do, told

if __name__ == "__main__":
    out, marks = map(Path, sys.argv[1:])
    specs = [*told(3, marks), Told("long", folder=str(marks), act="x" * 4000)]
    # No file may become longer, as if the disk were full; the last record would.
    resource.setrlimit(resource.RLIMIT_FSIZE, (4000, 4000))
    try:
        Campaign(specs=specs, run_one=do, folder=out).run(LocalWorkers(1))
    except OutputError as error:
        sys.exit(str(error))
"""


def test_what_can_not_be_written_whole_is_not_written_at_all(tmp_path, marks):
    pytest.importorskip("resource")
    script, out = tmp_path / "script.py", tmp_path / "out"
    script.write_text(LIMITED)
    done = subprocess.run(
        [sys.executable, script, out, marks],
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 1
    assert "can't write" in done.stderr
    assert "long.json: File too large" in done.stderr
    names = [path.name for path in sorted((out / "runs").iterdir())]
    assert names == ["000.json", "001.json", "002.json"]
    assert len(load_records(out)) == 3


@pytest.mark.parametrize("count", [-1, 5000])
def test_a_count_of_workers_that_is_none_is_refused(count):
    with pytest.raises(ConfigError, match="workers"):
        LocalWorkers(count)
