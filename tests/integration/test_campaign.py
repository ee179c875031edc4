"""Campaigns of the whole task: from the command line, and fault by fault."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from debrisgrasp import __version__
from debrisgrasp._files import data_path
from debrisgrasp.campaign import (
    Campaign,
    RunRecord,
    RunSpec,
    fake_world,
    load_header,
    run_fake,
)
from debrisgrasp.campaign.fake_run import handle_of
from debrisgrasp.robot import INJECTABLE, Injection

JAW = Path(__file__).parents[2] / "examples/jaw_site.yaml"
RATES = """
schema: debrisgrasp/fault-rates/1
rates:
  - {rate: 0.5, one_of: limit_mismatch}
  - {rate: 1.0, one_of: gripper_uninitialised}
"""


def struck(*faults: Injection, recovery: bool = False) -> RunSpec:
    return RunSpec(
        name="x",
        seed=4,
        tier="single",
        faults=faults,
        recovery=recovery,
        max_attempts=2,
    )


def test_a_crate_is_taken_by_its_handle():
    spec = RunSpec(name="x", seed=1, tier="handle", max_removals=1, max_attempts=4)
    record = run_fake(spec)
    assert (record.outcome, record.n_removed) == ("success", 1)
    assert not any(record.checks.values())


def test_the_region_of_a_handle_ends_above_the_rim():
    world = fake_world("handle", np.random.default_rng(3))
    (crate,) = world.bodies
    region, rim = handle_of(crate), crate.sizes["height"]
    tops = np.array([solid.bounds.upper for solid in crate.solids])
    assert region.contains(tops[tops[:, 2] > rim + 0.03]).all()
    assert region.lower[2] > rim - 0.03


@pytest.mark.parametrize(
    ("fault", "at", "outcome"),
    [
        ("limit_mismatch", 0.0, "operator_parameters"),
        ("gripper_uninitialised", 0.0, "operator_gripper_init"),
        ("controller_refuses", 0.0, "driver"),
        ("encoder_jump", 0.5, "mechanical"),
    ],
)
def test_a_run_ends_in_the_class_of_the_only_fault(fault, at, outcome):
    record = run_fake(struck(Injection(fault=fault, state="self_test", at=at)))
    assert record.outcome == outcome
    assert record.injected[0] == fault
    assert record.failed_stage == "self_test"
    assert not record.got_to_a_grasp
    assert not any(record.checks.values())


def test_without_recovery_the_first_fault_ends_a_run_with_the_arms_stopped():
    fault = Injection(fault="gripper_uninitialised")
    record = run_fake(struck(fault))
    assert record.end == "interrupted"
    assert record.faults == ("gripper_uninitialised",)
    assert record.checks["stops_not_latched"] == 0


def test_the_first_fault_is_kept_beside_the_one_that_ended_the_run():
    stop = Injection(fault="wrench_nan", state="pregrasp")
    record = run_fake(struck(Injection(fault="empty_cloud"), stop, recovery=True))
    assert record.faults == ("empty_cloud", "wrench_nan")
    assert (record.outcome, record.fault) == ("driver", "wrench_nan")
    assert record.first_fault == "empty_cloud"


def test_equal_specs_give_equal_records():
    spec = struck(Injection(fault="limit_mismatch"), Injection(fault="empty_cloud"))
    first, second = (run_fake(spec) for _ in range(2))
    assert first.outcome == second.outcome
    assert first.details == second.details


def test_a_campaign_from_the_command_line(run, tmp_path):
    rates = tmp_path / "rates.yaml"
    rates.write_text(RATES)
    out = tmp_path / "out"
    words = (
        "campaign",
        "--n",
        3,
        "--faults",
        rates,
        "--no-recovery",
        "--tier",
        "single",
    )
    words += ("--workers", 1, "--out", out)
    done = run(*words)
    assert done.status == 0, done.err
    assert "operator gripper init" in done.out
    assert "of 3" in done.out
    content = json.loads((out / "results.json").read_text())
    failed = {run["outcome"] for run in content["runs"]}
    assert failed <= {"operator_gripper_init", "operator_parameters"}
    assert Image.open(out / "campaign.png").size[0] == 1500
    before = {p: p.stat().st_mtime_ns for p in (out / "runs").iterdir()}
    again = run(*words, "--json")
    assert json.loads(again.out)["all_runs"]["success"]["total"] == 3
    assert {p: p.stat().st_mtime_ns for p in (out / "runs").iterdir()} == before
    compared = run("campaign", "--compare", out, out / "results.json")
    assert "+0.0" in compared.out
    assert "of 3 runs of the same scenes 0 succeed in the new one" in compared.out
    assert compared.err == ""
    (out / "campaign.json").write_text(
        (out / "campaign.json").read_text().replace('"single"', '"few"')
    )
    shutil.copytree(out, tmp_path / "begun")
    for path in (tmp_path / "begun/runs").iterdir():
        path.unlink()
    none = run("campaign", "--compare", out, tmp_path / "begun")
    assert f"runs of {tmp_path / 'begun'}: got none" in none.err
    first, second, _ = sorted((out / "runs").iterdir())
    first.unlink()
    whole = second.read_text()
    second.write_text("[1, 2]")
    unlike = run("campaign", "--compare", out, out / "results.json").err
    assert f"{out}: runs/{second.name} is damaged, and left out" in unlike
    second.write_text(whole)
    unlike = run("campaign", "--compare", out, out / "results.json").err
    assert "differ in tier: few in the old one, single in the new" in unlike
    assert f"{out} has 2 of 3 runs" in unlike
    (out / "campaign.json").write_text(
        (out / "campaign.json").read_text().replace('"few"', '"single"')
    )
    other = run(*words[:-1], out, "--seed", 5)
    assert other.status == 2
    assert "another folder" in other.err
    (out / "campaign.json").unlink()
    orphans = run(*words)
    assert orphans.status == 2
    assert "no campaign.json" in orphans.err


def test_a_run_of_a_campaign_is_done_again_from_its_record(run, tmp_path):
    path, other = tmp_path / "runs/000000.json", tmp_path / "other.json"
    path.parent.mkdir()
    record = run_fake(struck(Injection(fault="limit_mismatch")))
    path.write_text(record.to_json())
    done = run("replay", path)
    assert done.status == 0, done.err
    assert f"{__version__} before, {__version__} now" in done.out
    assert "the same: operator_parameters, aborted" in done.out
    faults = ("empty_cloud", *record.faults)
    older = replace(record, outcome="driver", faults=faults, version="")
    other.write_text(older.to_json())
    done = run("replay", other)
    assert done.status == 1
    assert f"an older version before, {__version__} now" in done.out
    assert "outcome: driver before, operator_parameters now" in done.out
    assert "faults: empty_cloud, limit_mismatch before, limit_mismatch now" in done.out
    told = json.loads(run("replay", path, "--against", other, "--json").out)
    assert told["same"] is False
    assert len(told["differences"]) == 2
    assert told["tasks"] == []
    spec = {**record.spec, "name": "000001", "seed": 7}
    other.write_text(replace(record, name="000001", spec=spec).to_json())
    done = run("replay", path, "--against", other)
    assert done.status == 1
    seeds = f"seed: {record.spec['seed']} before, 7 now"
    assert f"different tasks:\n  {seeds}\n" in done.out
    for words in ((path, "--against", tmp_path), (tmp_path, "--against", path)):
        done = run("replay", *words)
        assert done.status == 2
        assert f"the folder of a run ({tmp_path}) and a file ({path})" in done.err


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("faults", 5),
        ("tier", "singel"),
        ("site", 5),
        ("seed", 1.5),
        ("seed", None),
        ("max_removals", 1.5),
        ("recovery", "x"),
    ],
)
def test_a_spec_that_was_edited_into_none_is_not_replayed(run, tmp_path, field, value):
    spec = {**struck().to_json(), field: value}
    path = tmp_path / "000000.json"
    path.write_text(RunRecord.unclassified("000000", spec, "").to_json())
    done = run("replay", path)
    assert done.status == 2
    assert f"{path}, spec: " in done.err
    assert field in done.err


def test_a_run_whose_site_was_edited_since_says_so(run, tmp_path):
    site, out = tmp_path / "site.yaml", tmp_path / "out"
    rates = tmp_path / "rates.yaml"
    rates.write_text(RATES)
    site.write_text("schema: debrisgrasp/site/1\n")
    words = ("--n", 1, "--faults", rates, "--no-recovery", "--site", site)
    words += ("--tier", "single", "--workers", 1, "--out", out)
    assert run("campaign", *words).status == 0
    assert "not as before" not in run("replay", out / "runs/000000.json").out
    site.write_text("schema: debrisgrasp/site/1\nseed: 3\n")
    done = run("replay", out / "runs/000000.json")
    assert "not as before: " in done.out
    assert "site.yaml with another content" in done.out


@pytest.mark.parametrize("content", ["[]", "{}", "", '{"schema": "debrisgrasp/run/1"}'])
def test_a_file_that_is_no_record_of_a_run_is_not_replayed(run, tmp_path, content):
    path = tmp_path / "000000.json"
    path.write_text(content)
    done = run("replay", path)
    assert done.status == 2
    assert "000000.json" in done.err


def test_a_file_that_was_edited_since_is_named(run, tmp_path):
    rates, site, out = tmp_path / "rates.yaml", tmp_path / "site.yaml", tmp_path / "out"
    prototypes = tmp_path / "mine"
    shutil.copytree(data_path("prototypes"), prototypes)
    rates.write_text(RATES)
    own = Path(shutil.copy(data_path("planning", "success.json"), tmp_path))
    site.write_text(
        "schema: debrisgrasp/site/1\nprototypes: mine\nsuccess: success.json\n"
    )
    words = ("campaign", "--n", 1, "--faults", rates, "--no-recovery", "--site", site)
    words += ("--tier", "single", "--workers", 1, "--out", out)
    assert run(*words).status == 0
    some = next(path for path in prototypes.rglob("*") if path.is_file())
    for path in (rates, site, some, own):
        before = path.read_bytes()
        path.write_bytes(before + b"\n")
        done = run(*words)
        assert done.status == 2
        assert f"{path.name} with another content" in done.err
        path.write_bytes(before)
    assert run(*words).status == 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--n", 0), "runs of a campaign"),
        (("--tier", "heap"), "heap"),
        (("--tier", ""), "tier of world fake"),
        (("--world", "mujoco", "--tier", "single"), "tier of world mujoco"),
        (("--world", "mujoco", "--faults", "field"), "only the robot in memory"),
        (("--world", "mujoco", "--max-removals", 2), "given one object"),
        (("--faults", "no/such.yaml"), "no/such.yaml"),
        (("--faults", "fields"), "field, paper_handle"),
        (("--site", "no/such.yaml"), "no/such.yaml"),
        (("--site", JAW), "a robot with arms"),
        (("--workers", -1), "workers"),
        (("--max-removals", 0), "--max-removals"),
        (("--compare", "no", "such"), "such"),
    ],
)
def test_bad_input_is_named_before_anything_runs(run, tmp_path, words, message):
    done = run("campaign", *words, "--out", tmp_path / "out")
    assert done.status == 2
    assert message.lower() in done.err.lower()
    assert not (tmp_path / "out").exists()


def test_a_campaign_with_a_run_in_no_class_is_no_success(run, tmp_path, monkeypatch):
    lost = RunRecord.unclassified("000000", {}, "InputError: no such thing")
    monkeypatch.setattr(Campaign, "run", lambda *_, **__: (lost,))
    done = run("campaign", "--n", 1, "--out", tmp_path)
    assert done.status == 1
    assert "no such thing" in done.out


def test_no_more_workers_are_started_than_there_are_runs(run, tmp_path, monkeypatch):
    asked = []

    def told(_, workers, **__):
        asked.append(workers.count)
        return (RunRecord.unclassified("000000", {}, "InputError: no such thing"),)

    monkeypatch.setattr(Campaign, "run", told)
    for workers in (1024, 1, 0):
        run("campaign", "--n", 2, "--workers", workers, "--out", tmp_path)
    assert asked[:2] == [2, 1]
    assert 1 <= asked[2] <= 2


def test_a_drop_off_out_of_reach_is_named_before_anything_runs(run, tmp_path):
    site = tmp_path / "site.yaml"
    site.write_text("schema: debrisgrasp/site/1\ndrop_off: {left: [3.5, 3.0]}\n")
    done = run("campaign", "--site", site, "--n", 1, "--out", tmp_path / "out")
    assert done.status == 2
    assert "field drop_off.left" in done.err
    assert not (tmp_path / "out").exists()


def test_a_hand_of_ones_own_is_tried_in_physics(run, tmp_path):
    mujoco = pytest.importorskip("mujoco")
    out = tmp_path / "out"
    words = ("--world", "mujoco", "--tier", "isolated", "--n", 1, "--workers", 1)
    assert run("campaign", *words, "--site", JAW, "--out", out).status == 0
    record = RunRecord.load(out / "runs/000000.json")
    assert record.details["gripper"] == "jaw_140"
    assert RunSpec.from_json(record.spec).site == str(JAW)
    header = load_header(out)
    assert header["mujoco"] == mujoco.__version__
    content = (out / "campaign.json").read_text()
    (out / "campaign.json").write_text(content.replace(header["mujoco"], "4.99.0"))
    unlike = run("campaign", "--compare", out, out / "results.json").err
    assert "differ in mujoco: 4.99.0 in the old one" in unlike


def test_all_classes_of_the_table_can_be_reached():
    assert len({kind.device for kind in INJECTABLE.values()}) == 7
