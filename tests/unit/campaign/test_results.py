"""Files of a campaign that are compared later."""

from __future__ import annotations

import csv
import json
from concurrent.futures import ThreadPoolExecutor

import pytest

from debrisgrasp.campaign import (
    Campaign,
    OwnWorkers,
    compare,
    comparison_to_json,
    load_header,
    load_results,
    save_results,
    tabulate,
)
from debrisgrasp.cli.campaign_text import header_text
from debrisgrasp.errors import ConfigError, OutputError

from .records import campaign
from .runs import do, told


def test_results_are_read_as_they_were_written(tmp_path):
    records = tuple(campaign(success=4, bad_grasp=2, early_driver=1))
    tables = tabulate(records)
    path, _ = save_results(tmp_path, records, tables, {"seed": 1})
    assert load_results(path) == records
    assert tabulate(load_results(path)) == tables


def test_both_files_of_the_results_are_of_the_same_runs(tmp_path):
    first, more = campaign(success=1), campaign(success=4)
    path, table = save_results(tmp_path, first, tabulate(first), {})
    table.unlink()
    table.mkdir()
    with pytest.raises(OutputError, match=r"results.csv: it is a folder"):
        save_results(tmp_path, more, tabulate(more), {})
    assert len(load_results(path)) == 1


def test_numbers_in_the_file_are_those_of_the_tables(tmp_path):
    records = campaign(success=19, bad_grasp=7, early_driver=17)
    path, _ = save_results(tmp_path, records, tabulate(records), {})
    tables = json.loads(path.read_text())["tables"]
    assert tables["all_runs"]["success"]["interval"] == pytest.approx(
        [0.304333098392, 0.588923855472], abs=1e-9
    )
    assert tables["runs_with_a_grasp"]["success"]["total"] == 26
    assert tables["system"] == pytest.approx(19 / 43)
    assert tables["if_never"]["driver"] == pytest.approx(19 / 26)
    assert tables["if_never"]["bad_grasp"] == pytest.approx(26 / 43)


def test_the_csv_has_a_row_for_each_run(tmp_path):
    records = campaign(success=2, early_driver=1)
    _, path = save_results(tmp_path, records, tabulate(records), {})
    rows = list(csv.DictReader(path.read_text().splitlines()))
    assert [row["outcome"] for row in rows] == ["success", "success", "driver"]
    assert [row["got_to_a_grasp"] for row in rows] == ["1", "1", "0"]
    assert rows[0]["failed_stage"] == ""


def test_a_folder_is_read_as_well(tmp_path):
    made = Campaign(specs=told(3, tmp_path), run_one=do, folder=tmp_path / "out")
    records = made.run(OwnWorkers(lambda: ThreadPoolExecutor(1)))
    assert load_results(tmp_path / "out") == records


def test_folder_and_file_say_what_the_runs_have_in_common(tmp_path):
    made = Campaign(
        specs=told(3, tmp_path), run_one=do, folder=tmp_path, header={"tier": "few"}
    )
    records = made.run(OwnWorkers(lambda: ThreadPoolExecutor(1)))
    path, _ = save_results(tmp_path, records, tabulate(records), made.header)
    for place in (tmp_path, path):
        assert load_header(place) == {"tier": "few", "runs": 3}
    path.write_text('{"campaign": 5, "runs": 3}')
    assert load_header(path) == {}


def test_what_mending_the_only_class_buys_may_be_unknown(tmp_path):
    records = campaign(early_driver=3)
    path, _ = save_results(tmp_path, records, tabulate(records), {})
    tables = json.loads(path.read_text())["tables"]
    assert tables["if_never"]["driver"] is None
    assert tables["runs_with_a_grasp"]["success"]["share"] is None


def test_comparisons_of_campaigns_without_grasps_are_plain_json():
    rows = compare(tabulate(campaign(early_driver=3)), tabulate(campaign(success=3)))
    content = json.loads(json.dumps(comparison_to_json(rows), allow_nan=False))
    (grasps,) = (row for row in content if row["name"] == "success of grasps")
    assert grasps["difference"] is None
    assert not grasps["is_clear"]


@pytest.mark.parametrize(
    "content",
    ["[]", "{}", '{"schema": "debrisgrasp/campaign-results/1", "runs": 3}',
     '{"schema": "debrisgrasp/campaign-results/1", "runs": [{}]}'],
)  # fmt: skip
def test_other_files_are_refused(tmp_path, content):
    path = tmp_path / "results.json"
    path.write_text(content)
    with pytest.raises(ConfigError, match=r"results\.json"):
        load_results(path)


HEADER = {
    "world": "mujoco",
    "level": "arm",
    "tier": "pile",
    "site": "/home/me/jaw_site.yaml",
    "faults": None,
    "recovery": False,
    "max_removals": 2,
    "seed": 7,
}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {},
            "1 run, tier pile, in physics with both arms, site jaw_site.yaml, "
            "no injected faults, no recovery, at most 2 removed, seed 7",
        ),
        (
            {"world": "fake", "site": None, "recovery": True, "max_removals": None}
            | {"faults": "a/long/way/to/rates.yaml"},
            "1 run, tier pile, faults rates.yaml, seed 7",
        ),
    ],
)
def test_the_picture_says_in_what_a_campaign_differs_from_others(changes, words):
    assert header_text(1, HEADER | changes) == words
