"""What flown grasps tell, and their pictures."""

from __future__ import annotations

import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image

from debrisgrasp.campaign import (
    Campaign,
    RunRecord,
    flight_of,
    grouped,
    load_flights,
    load_results,
    save_results,
    tabulate,
)
from debrisgrasp.cli import main
from debrisgrasp.cli.campaign_text import flights_text, tables_text
from debrisgrasp.errors import ConfigError
from debrisgrasp.trials import TrialRecord
from tests.benchmarks import success_fit

from .records import record

EXAMPLES = Path(__file__).parents[3] / "examples"
HELD = TrialRecord(
    tier="pile",
    seed=1,
    outcome="held",
    kind="pipe",
    is_as_intended=True,
    mass=2.0,
    n_bodies=4,
    prototype="pipe_040",
    gripper="claw",
    probability=0.93,
)
SLIPPED = replace(HELD, seed=2, outcome="slipped", mass=9.0, probability=0.55)
NOTHING = replace(HELD, seed=3, outcome="no_grasp", kind="board", prototype="")


def run_of(flight: TrialRecord) -> RunRecord:
    spec = {"world": "mujoco", "level": "hand", "seed": flight.seed, "name": "x"}
    return record(str(flight.seed), spec=spec, details=flight.as_dict())


def test_groups_count_each_flight_once_by_each_property():
    groups = grouped([HELD, HELD, SLIPPED, NOTHING])
    found = {(g.by, g.name): (g.held.count, g.held.total) for g in groups}
    assert found["object", "pipe"] == (2, 3)
    assert found["object", "board"] == (0, 1)
    assert found["prototype", ""] == (0, 1)
    assert found["forecast", "0.9"] == (2, 2)
    assert found["forecast", "0.5"] == (0, 1)
    assert found["mass", "heavy"] == (0, 1)
    for by in ("tier", "object", "prototype", "hand", "forecast", "mass"):
        assert sum(g.held.total for g in groups if g.by == by) == 4
    (tier,) = (g for g in groups if g.by == "tier")
    assert tier.failures == {"slipped": 1, "no_grasp": 1}
    assert "2/4" in flights_text(groups)


def test_what_was_pulled_clear_is_counted_apart():
    pulled = replace(HELD, seed=4, outcome="pulled_clear")
    (tier,) = (g for g in grouped([HELD, pulled, SLIPPED]) if g.by == "tier")
    assert (tier.held.count, tier.held.total, tier.pulled_clear) == (1, 3, 1)
    assert tier.failures == {"slipped": 1}


def test_only_flights_are_flights():
    assert flight_of(run_of(SLIPPED)) == SLIPPED
    assert flight_of(record("a", spec={"world": "fake", "level": "hand"})) is None
    assert flight_of(record("a", spec={"world": "mujoco", "level": "arm"})) is None


@pytest.mark.parametrize(
    "change", [{"mass": "heavy"}, {"probability": None}, {"lunch": 1}, {"terms": [[]]}]
)
def test_what_is_no_flight_makes_a_damaged_record(change):
    content = json.loads(run_of(HELD).to_json())
    assert flight_of(RunRecord.from_json(content, "here")) == HELD
    content["details"] |= change
    with pytest.raises(ConfigError, match=f"here.*{next(iter(change))}"):
        RunRecord.from_json(content, "here")


def test_flights_through_a_body_are_told(tmp_path, monkeypatch, capsys):
    pytest.importorskip("mujoco")
    deep = run_of(replace(HELD, is_through=True, deepest=0.0031))
    runs = (replace(deep, end="held"), run_of(replace(HELD, seed=2)))
    monkeypatch.setattr(Campaign, "run", lambda *_, **__: runs)
    out = tmp_path / "out"
    out.mkdir()
    assert main(["campaign", "--world", "mujoco", "--n", "2", "--out", str(out)]) == 0
    told = capsys.readouterr().out
    assert "run 1: held means little: the hand went 3.1 mm into it" in told
    assert "run 2" not in told
    flights = json.loads((out / "results.json").read_text())["flights"]
    assert [g["through"] for g in flights if g["by"] == "tier"] == [1]
    words = ["campaign", "--world", "mujoco", "--n", "2", "--out", str(out), "--json"]
    assert main(words) == 0
    assert json.loads(capsys.readouterr().out)["flights"] == flights


def test_what_no_flight_looks_at_is_not_told_to_be_0(tmp_path):
    tables = tabulate([run_of(HELD), run_of(SLIPPED)])
    assert tables.checks == ()
    assert "must be 0" not in tables_text(tables)
    looked = replace(run_of(HELD), checks={"uncaught": 0})
    assert tabulate([looked, run_of(SLIPPED)]).checks == (("uncaught", 0),)
    assert "must be 0" in tables_text(tabulate([looked]))
    _, path = save_results(tmp_path, [looked, run_of(HELD)], tables, {})
    rows = list(csv.DictReader(path.open()))
    assert [row["uncaught"] for row in rows] == ["0", ""]


def test_results_keep_the_groups(tmp_path):
    records = [run_of(HELD), run_of(SLIPPED)]
    path, _ = save_results(tmp_path, records, tabulate(records), {})
    flights = json.loads(path.read_text())["flights"]
    by_kind = [entry for entry in flights if entry["by"] == "object"]
    assert [(e["name"], e["held"]["count"], e["held"]["total"]) for e in by_kind] == [
        ("pipe", 1, 2)
    ]
    assert len(load_results(path)) == 2


def test_flights_are_compared_by_their_ends_and_properties(tmp_path, capsys):
    old = [run_of(HELD), run_of(SLIPPED), run_of(NOTHING)]
    pulled = replace(SLIPPED, outcome="pulled_clear", prototype="edge_012")
    new = [run_of(HELD), run_of(pulled)]
    old[1] = replace(old[1], outcome="bad_grasp", failed_stage="close", end="slipped")
    paths = []
    for name, records in (("old", old), ("new", new)):
        (tmp_path / name).mkdir()
        paths.append(save_results(tmp_path / name, records, tabulate(records), {})[0])
    assert load_flights(paths[1]) == grouped([HELD, pulled])
    assert main(["campaign", "--compare", *map(str, paths)]) == 0
    told = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert "pipe 1 of 2 50.0 2 of 2 100.0 +50.0 -27 to +91" in told
    assert "board 0 of 1 0.0 0 of 0 - - -" in told
    assert "edge_012 0 of 0 - 1 of 1 100.0 - -" in told
    assert any(line.startswith("slipped 1 of 3 33.3 0 of 2") for line in told)
    assert not any("gripper init" in line for line in told)


@pytest.mark.parametrize("flights", [3, [3], [{"by": "tier"}], [{"by": {}}], {"a": 1}])
def test_groups_that_were_edited_are_refused(tmp_path, flights):
    records = [run_of(HELD)]
    path, _ = save_results(tmp_path, records, tabulate(records), {})
    path.write_text(json.dumps(json.loads(path.read_text()) | {"flights": flights}))
    with pytest.raises(ConfigError, match=r"results\.json, flights"):
        load_flights(path)
    with pytest.raises(ConfigError, match=r"no\.json: got No such file"):
        load_flights(tmp_path / "no.json")


def test_the_fit_of_the_forecast_reads_folders_of_campaigns(tmp_path):
    flown = replace(HELD, terms=(0.5,) * 9)
    (tmp_path / "runs").mkdir()
    head = {"schema": "debrisgrasp/campaign/1", "runs": ["000000", "000001"]}
    (tmp_path / "campaign.json").write_text(json.dumps(head))
    for name, flight in (("000000", flown), ("000001", NOTHING)):
        record = replace(run_of(flight), name=name)
        (tmp_path / f"runs/{name}.json").write_text(record.to_json())
    lines = tmp_path / "lines"
    lines.write_text(json.dumps(flown.as_dict()) + "\n")
    rows = success_fit.read([tmp_path, lines])
    assert [(row["outcome"], tuple(row["terms"])) for row in rows] == [
        ("held", (0.5,) * 9)
    ] * 2


def test_a_failed_flight_is_drawn_once(tmp_path, capsys):
    pytest.importorskip("mujoco")
    out = tmp_path / "out"
    # A board lies alone, and all that is known are wide pipes.
    (tmp_path / "prototypes").mkdir()
    shutil.copy(EXAMPLES / "jaw_prototypes/pipe_100.yaml", tmp_path / "prototypes")
    site = (EXAMPLES / "jaw_site.yaml").read_text()
    site = site.replace("jaw_prototypes", str(tmp_path / "prototypes"))
    site = site.replace("grippers: grippers", f"grippers: {EXAMPLES / 'grippers'}")
    (tmp_path / "site.yaml").write_text(site)
    words = ["campaign", "--world", "mujoco", "--tier", "isolated", "--workers", "1"]
    words += ["--n", "1", "--seed", "3", "--out", str(out)]
    words += ["--site", str(tmp_path / "site.yaml")]
    assert main(words) == 0
    assert "no grasp" in capsys.readouterr().out
    path = out / "failures/000000.png"
    with Image.open(path) as picture:
        assert picture.width > 300
    before = path.stat().st_mtime_ns
    assert main(words) == 0
    assert path.stat().st_mtime_ns == before
