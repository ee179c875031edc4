"""Runs on a Dask cluster: a scheduler and two workers, each a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import pytest

from debrisgrasp.campaign import (
    Campaign,
    ClusterWorkers,
    Progress,
    RunRecord,
    RunSpec,
    run_fake,
)
from debrisgrasp.errors import InputError
from debrisgrasp.robot import Injection

from .runs import begun, do, told

pytest.importorskip("distributed")


class Cluster(NamedTuple):
    address: str
    workers: list[subprocess.Popen[bytes]]


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    root = Path(__file__).parents[3]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    place = tmp_path / "scheduler.json"

    def start(*words: str) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            [sys.executable, "-m", "dask", *words, "--scheduler-file", str(place)],
            env=environment,
            cwd=tmp_path,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    with ExitStack() as stack:
        loopback = ("--host", "127.0.0.1", "--no-dashboard")
        scheduler = start("scheduler", *loopback, "--port", "0")
        stack.callback(_end, scheduler)
        deadline = time.monotonic() + 60
        while not place.exists() and time.monotonic() < deadline:
            time.sleep(0.05)
        workers = []
        for _ in range(2):
            workers.append(start("worker", *loopback, "--no-nanny", "--nthreads", "1"))
            stack.callback(_end, workers[-1])
        yield Cluster(json.loads(place.read_text())["address"], workers)


def _end(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.wait()


def test_no_run_is_lost_when_a_worker_of_the_cluster_is_killed(tmp_path, cluster):
    marks = tmp_path / "marks"
    marks.mkdir()
    campaign = Campaign(
        specs=told(30, marks, seconds=0.1), run_one=do, folder=tmp_path / "out"
    )
    killed = []

    def kill_one(_):
        pids = {int(path.name.split("+")[2]) for path in marks.glob("*+*")}
        alive = [w for w in cluster.workers if w.pid in pids]
        if len(alive) == 2 and not killed:
            killed.append(alive[0])
            alive[0].kill()

    records = campaign.run(ClusterWorkers(cluster.address), on_progress=kill_one)
    assert killed, "both workers were given runs"
    assert [record.outcome for record in records] == ["success"] * 30
    assert len(set(begun(marks))) == 30


def test_an_interruption_does_not_wait_for_the_runs_under_way(tmp_path, cluster):
    marks = tmp_path / "marks"
    marks.mkdir()
    first, *others = told(8, marks, seconds=60.0)
    specs = [replace(first, seconds=0.0), *others]
    campaign = Campaign(specs=specs, run_one=do, folder=tmp_path / "out")

    def interrupt(progress: Progress) -> None:
        if progress.latest is not None:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        campaign.run(ClusterWorkers(cluster.address), on_progress=interrupt)
    ended = time.time_ns()
    assert list(campaign.finished()) == [first.name]
    begins = [int(path.name.split("+")[1]) for path in marks.glob("*+*")]
    assert ended - min(begins) < 30e9
    assert len(begins) < len(specs)


def test_runs_of_the_whole_task_are_the_same_on_a_cluster(tmp_path, cluster):
    ends = (
        Injection(fault="limit_mismatch"),
        Injection(fault="wrench_nan", state="pregrasp"),
    )
    specs = [
        RunSpec(name=fault.fault, seed=4, tier="single", faults=(fault,))
        for fault in ends
    ]
    campaign = Campaign(specs=specs, run_one=run_fake, folder=tmp_path / "out")
    records = campaign.run(ClusterWorkers(cluster.address))
    assert [r.outcome for r in records] == ["operator_parameters", "driver"]
    stored = [RunRecord.load(tmp_path / "out/runs" / f"{s.name}.json") for s in specs]
    for spec, record in zip(specs, stored, strict=True):
        here = json.loads(run_fake(spec).to_json())
        there = json.loads(record.to_json())
        assert there == {**here, "seconds": record.seconds}


def test_a_cluster_that_does_not_answer_is_named(tmp_path):
    out = tmp_path / "out"
    campaign = Campaign(specs=told(1, tmp_path), run_one=do, folder=out)
    with pytest.raises(
        InputError, match=r"cluster tcp://127.0.0.1:1: .*dask scheduler"
    ):
        campaign.run(ClusterWorkers("tcp://127.0.0.1:1", timeout=1.0))
    assert not out.exists()
