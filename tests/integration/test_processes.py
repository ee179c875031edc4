"""What users hand to worker processes, and what comes back from them."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest

from debrisgrasp.errors import UnknownNameError
from debrisgrasp.io.plan_json import plan_to_json
from debrisgrasp.pipeline import Pipeline


@pytest.mark.parametrize("is_used", [False, True], ids=["fresh", "used"])
def test_a_pipeline_plans_the_same_in_another_process(
    dictionary, pipe_capture, is_used
):
    pipeline = Pipeline(arm="right", prototypes=dictionary)
    before = pipeline.plan(pipe_capture) if is_used else None
    other = pickle.loads(pickle.dumps(pipeline))
    result = before or pipeline.plan(pipe_capture)
    plans = [pickle.loads(pickle.dumps(result)).plan, other.plan(pipe_capture).plan]
    assert plans[0].grasps
    one, two = (plan_to_json(replace(plan, seconds={})) for plan in plans)
    assert one == two


def test_an_error_in_a_worker_process_arrives_as_it_is():
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        task = pool.submit(Pipeline, robot="no_such_robot")
        with pytest.raises(UnknownNameError, match="no_such_robot") as caught:
            task.result(timeout=120.0)
    assert "roman" in caught.value.known


FULL = Path("/dev/full")
SHORT = """\
schema: debrisgrasp/fault-rates/1
rates:
  - {rate: 1.0, one_of: [limit_mismatch]}
"""
"""So a run ends where it begins."""


@pytest.mark.parametrize(
    ("begun", "number"),
    [
        ("campaign.json", signal.SIGTERM),  # as services are ended
        ("runs/*.json", signal.SIGTERM),
        ("runs/*.json", signal.SIGHUP),  # as a lost terminal ends what runs in it
    ],
)
def test_what_is_ended_from_outside_ends_as_by_ctrl_c(tmp_path, begun, number):
    out, rates = tmp_path / "campaign", tmp_path / "rates.yaml"
    rates.write_text(SHORT)
    command = [sys.executable, "-m", "debrisgrasp", "campaign", "--tier", "single"]
    command += ["--faults", rates, "--n", "999", "--workers", "1"]
    # Under nohup, as tests may run, it would be ignored by all that is started.
    before = signal.signal(number, signal.SIG_DFL)
    try:
        process = subprocess.Popen(
            [*command, "--out", out],
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
    finally:
        signal.signal(number, before)
    deadline = time.monotonic() + 120.0
    while not list(out.glob(begun)) and time.monotonic() < deadline:
        time.sleep(0.1)
    os.killpg(process.pid, number)
    _, told = process.communicate(timeout=60.0)
    assert process.returncode == 130
    assert told.splitlines()[-1].startswith("interrupted: ")
    assert "Traceback" not in told
    assert "semaphore" not in told


@pytest.mark.skipif(not FULL.exists(), reason="no device that is full")
def test_a_run_goes_on_where_nothing_can_be_printed(tmp_path):
    """As on a full disk: the page is written, and then the failure is told."""
    page = tmp_path / "page.html"
    command = [sys.executable, "-m", "debrisgrasp", "clear", "--objects", "1"]
    command += ["--seed", "4", "--max-removals", "1", "--faults", "limit_mismatch"]
    with FULL.open("w") as full:
        ended = subprocess.run(
            [*command, "--report", page],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            timeout=300.0,
        )
    assert ended.returncode == 2
    assert page.exists()
    (line,) = ended.stderr.splitlines()
    assert line.startswith("debrisgrasp: error: can't write standard output: No space")


def test_a_reader_that_has_gone_is_no_failure():
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "debrisgrasp", "clear", "--faults", "list"]
    ended = subprocess.run(
        command, stdout=writer, stderr=subprocess.PIPE, text=True, timeout=120.0
    )
    os.close(writer)
    assert (ended.returncode, ended.stderr) == (0, "")
