"""Runs on a Dask cluster: a scheduler and two workers, each a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import pytest

from debrisgrasp.campaign import Campaign, ClusterWorkers
from debrisgrasp.errors import InputError

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


def test_a_cluster_that_does_not_answer_is_named(tmp_path):
    out = tmp_path / "out"
    campaign = Campaign(specs=told(1, tmp_path), run_one=do, folder=out)
    with pytest.raises(
        InputError, match=r"cluster tcp://127.0.0.1:1: .*dask scheduler"
    ):
        campaign.run(ClusterWorkers("tcp://127.0.0.1:1", timeout=1.0))
    assert not out.exists()
