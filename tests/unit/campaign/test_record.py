"""The record of one run on disk."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from debrisgrasp import __version__
from debrisgrasp.campaign import CLASSES, SUCCESS, RunRecord
from debrisgrasp.errors import ConfigError

from .records import record


@given(st.sampled_from([SUCCESS, *CLASSES]), st.text(max_size=20))
def test_reading_gives_what_was_written(outcome, error):
    written = record("x", outcome, error=error, checks={"false_cleared": 1})
    read = RunRecord.from_json(json.loads(written.to_json()), "here")
    assert read == written


@pytest.mark.parametrize(
    "changes",
    [
        {"outcome": "lunch"},
        {"outcome": "driver", "failed_stage": None},
        {"outcome": SUCCESS, "failed_stage": "close"},
        {"outcome": "driver", "failed_stage": "lunch"},
        {"checks": {"lunch": 1}},
        {"checks": {"uncaught": "1"}},
        {"checks": {"uncaught": -1}},
        {"reached": ("self_test", "lunch")},
        {"n_removed": 2},
    ],
)
def test_a_record_that_contradicts_itself_is_refused(changes):
    with pytest.raises(ConfigError, match="of run x"):
        record("x", **{"outcome": SUCCESS, **changes})


@pytest.mark.parametrize("content", ["", "{", "[]", "3", "{}", '{"schema": 1}'])
def test_a_damaged_file_is_named(tmp_path, content):
    path = tmp_path / "run.json"
    path.write_text(content)
    with pytest.raises(ConfigError, match=r"run\.json"):
        RunRecord.load(path)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("n_objects", "3"),
        ("n_removed", -1),
        ("seconds", None),
        ("checks", [1]),
        ("error", [{}]),
        ("faults", [{}]),
        ("injected", [3]),
        ("first_fault", [{}]),
        ("details", "zz"),
        ("end", {}),
    ],
)
def test_a_field_of_another_kind_is_refused(field, value):
    content = json.loads(record("x").to_json()) | {field: value}
    with pytest.raises(ConfigError, match=field):
        RunRecord.from_json(content, "here")


def test_a_record_of_an_older_version_can_be_read():
    written = record("x", first_fault="slip")
    content = json.loads(written.to_json())
    assert (content.pop("first_fault"), content.pop("version")) == ("slip", __version__)
    read = RunRecord.from_json(content, "here")
    assert (read.first_fault, read.version) == (None, "")
    assert read.outcome == written.outcome


def test_a_missing_field_is_named(tmp_path):
    content = json.loads(record("x").to_json())
    del content["reached"]
    (tmp_path / "run.json").write_text(json.dumps(content))
    with pytest.raises(ConfigError, match="reached"):
        RunRecord.load(tmp_path / "run.json")
