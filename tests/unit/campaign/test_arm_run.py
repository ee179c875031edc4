"""The whole task by a whole robot in physics, as a run of a campaign."""

from __future__ import annotations

import json
from types import SimpleNamespace

import pytest

from debrisgrasp.campaign import SUCCESS, RunRecord, RunSpec, arm_run, run_arm
from debrisgrasp.cli import main
from debrisgrasp.errors import ConfigError, UnknownNameError
from debrisgrasp.worlds import World, make_body

BOARD = make_body(
    "board", {"length": 0.6, "width": 0.2, "height": 0.025}, 1.5, name="board"
)


def test_a_spec_names_its_level():
    spec = RunSpec(name="a", seed=1, world="mujoco", tier="pile", level="arm")
    assert RunSpec.from_json(json.loads(json.dumps(spec.to_json()))) == spec
    with pytest.raises(UnknownNameError, match="level"):
        RunSpec(name="a", seed=1, world="mujoco", level="leg")


def test_no_whole_task_takes_the_marked_object_of_a_tier_alone():
    with pytest.raises(ConfigError, match=r"tier: got handle at level arm.*level hand"):
        RunSpec(name="a", seed=1, world="mujoco", tier="handle", level="arm")
    RunSpec(name="a", seed=1, world="mujoco", tier="handle")
    RunSpec(name="a", seed=1, tier="handle", level="arm")  # which has no levels


def test_a_robot_in_memory_has_no_levels(tmp_path, capsys):
    assert main(["campaign", "--level", "arm", "--out", str(tmp_path / "c")]) == 2
    assert "--world mujoco" in capsys.readouterr().err


@pytest.mark.parametrize("x", [1.0, 0.3])
def test_a_run_tells_what_the_robot_did(monkeypatch, x):
    # Where the robot stands, at 0.3 m, nothing can lie: the scene is moved ahead.
    pytest.importorskip("mujoco")
    lying = BOARD.at(type(BOARD.T_base_body).from_parts(p=[x, 0.0, 0.0126]))
    scene = SimpleNamespace(world=World((lying,)))
    monkeypatch.setattr(arm_run, "tier_scene", lambda *_: scene)
    record = run_arm(RunSpec(name="a", seed=1, world="mujoco", level="arm"))
    # What the tracks drive over is no obstacle: self test, calibration, and done.
    assert record.outcome == SUCCESS
    assert not any(record.checks.values())
    assert record.details["removable_kg"] == 0.0
    assert max(record.details["deepest_mm"].values()) < 2.0
    assert RunRecord.from_json(json.loads(record.to_json()), "x") == record
