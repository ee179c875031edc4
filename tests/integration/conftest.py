"""Small captures and a small dictionary, made once; and a way to run commands."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from debrisgrasp._files import data_path
from debrisgrasp.cli import main
from debrisgrasp.geometry import SE3, Box
from debrisgrasp.io import Capture
from debrisgrasp.pipeline import Pipeline
from debrisgrasp.worlds import World
from tests.scenes import capture_of, lying_pipe
from tests.tasks import one_beam

PIPE = lying_pipe()
BLOCK = Box(np.array([0.2, 0.2, 0.15]), SE3.from_parts(p=[0.9, -0.25, 0.15]))
"""Wider than any hand, and nearer to the priority point than the pipe beside it."""
PIPE_BESIDE = lying_pipe(length=0.4, position=(0.8, 0.35, 0.1))
DICTIONARY = ("cylinder_060_tip", "cylinder_090_power", "bar_2x4_edge", "handle_025")


@pytest.fixture(scope="session")
def pipeline() -> Pipeline:
    """Plan for all tasks; it remembers nothing."""
    return Pipeline()


@pytest.fixture(scope="session")
def beam() -> World:
    """Put one sturdy beam straight ahead."""
    return one_beam()


@dataclass(frozen=True)
class Ended:
    """How a command ended, and what it said."""

    status: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        return json.loads(self.out)


Run = Callable[..., Ended]


@pytest.fixture
def run(capsys) -> Run:
    """Run a command in this process, as the installed script does."""

    def call(*argv: object) -> Ended:
        try:
            status = main([str(word) for word in argv])
        except SystemExit as end:  # argparse ends so
            status = int(end.code or 0)
        said = capsys.readouterr()
        return Ended(status, said.out, said.err)

    return call


@pytest.fixture
def refused(run) -> Callable[..., str]:
    """Run a command that must refuse its input; returns its one message."""

    def call(*argv: object) -> str:
        ended = run(*argv)
        assert ended.status == 2, ended
        assert ended.out == ""
        assert "Traceback" not in ended.err
        blocks = [line for line in ended.err.splitlines() if "error:" in line]
        assert len(blocks) == 1, ended.err
        assert ended.err.startswith(("debrisgrasp: error: ", "usage: "))
        return ended.err

    return call


@pytest.fixture(scope="session")
def dictionary(tmp_path_factory) -> Path:
    """Folder with four of the shipped prototypes, for a quick search."""
    folder = tmp_path_factory.mktemp("prototypes")
    for name in DICTIONARY:
        shutil.copy(data_path("prototypes", f"{name}.yaml"), folder)
    return folder


@pytest.fixture(scope="session")
def pipe_capture() -> Capture:
    """Return a capture of a pipe in the air over the floor."""
    return capture_of([PIPE])


@pytest.fixture(scope="session")
def block_capture() -> Capture:
    """Return a capture of a block too wide for any hand, and a pipe beside it."""
    return capture_of([BLOCK, PIPE_BESIDE])


@pytest.fixture(scope="session")
def floor_capture() -> Capture:
    """Return a capture of nothing but the floor."""
    return capture_of([])


@pytest.fixture(scope="session")
def pipe_file(pipe_capture, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("captures") / "pipe.npz"
    pipe_capture.save(path)
    return path


@pytest.fixture(scope="session")
def block_file(block_capture, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("captures") / "block.npz"
    block_capture.save(path)
    return path


@pytest.fixture(scope="session")
def floor_file(floor_capture, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("captures") / "floor.npz"
    floor_capture.save(path)
    return path


@pytest.fixture(scope="session")
def floating(dictionary):
    """Return a floating hand with three generic prototypes and one of a handle."""
    return Pipeline(robot="none", prototypes=dictionary)
