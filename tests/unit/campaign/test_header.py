"""What is said of a campaign's header that is not one."""

from __future__ import annotations

import json

import pytest

from debrisgrasp.campaign import load_header, load_results
from debrisgrasp.errors import ConfigError

SCHEMA = {"schema": "debrisgrasp/campaign/1"}


@pytest.mark.parametrize(
    "content",
    [
        [],
        {"schema": "debrisgrasp/plan/1"},
        {**SCHEMA, "runs": "zz"},
        {**SCHEMA, "runs": None},
        {**SCHEMA, "runs": [3]},
        {**SCHEMA, "contents": "zz"},
        {**SCHEMA, "contents": {"site.yaml": None}},
    ],
)
def test_a_header_of_another_kind_is_named(tmp_path, content):
    (tmp_path / "campaign.json").write_text(json.dumps(content))
    for read in (load_header, load_results):
        with pytest.raises(ConfigError, match=r"campaign\.json"):
            read(tmp_path)


def test_a_header_of_an_older_version_lacks_the_names_of_its_runs(tmp_path):
    (tmp_path / "campaign.json").write_text(json.dumps({**SCHEMA, "tier": "few"}))
    assert load_header(tmp_path) == {"tier": "few"}
    assert load_results(tmp_path) == ()
