"""Two campaigns run by run."""

from __future__ import annotations

import pytest

from debrisgrasp.campaign import SUCCESS, same_scenes
from debrisgrasp.cli.campaign_text import same_scenes_text

from .records import record


def runs(outcomes: str, first: int = 0, **spec: object):
    """Runs of seeds from ``first`` on; ``+`` is a success."""
    return [
        record(
            f"{i:06d}",
            SUCCESS if outcome == "+" else "bad_grasp",
            spec={"tier": "pile", "seed": i, "name": f"{i:06d}", **spec},
        )
        for i, outcome in enumerate(outcomes, first)
    ]


def test_runs_that_only_one_of_two_did_are_named():
    same = same_scenes(runs("++--+"), runs("+-++", site="mine"))
    assert same.runs == 4
    assert same.gained == ("000002", "000003")
    assert same.lost == ("000001",)
    told = same_scenes_text(same)
    assert "of 4 runs" in told
    assert "2 succeed (000002, 000003) in the new" in told
    assert "1 succeed (000001) in the old" in told


def test_other_scenes_are_no_pairs():
    assert same_scenes(runs("++"), runs("++", first=2)).runs == 0
    assert same_scenes(runs("++"), runs("++", tier="stacked")).runs == 0
    struck = [{"fault": "slip"}]
    assert same_scenes(runs("++"), runs("++", faults=struck)).runs == 0


@pytest.mark.parametrize(
    ("n_gained", "n_lost", "chance"), [(0, 0, 1.0), (3, 3, 1.0), (5, 0, 2 / 32)]
)
def test_chance_is_that_of_the_sign_test(n_gained, n_lost, chance):
    old = runs("-" * n_gained + "+" * n_lost + "+++")
    new = runs("+" * n_gained + "-" * n_lost + "+++")
    assert same_scenes(old, new).chance == pytest.approx(chance)


def test_chance_is_told_in_percent():
    equal = same_scenes_text(same_scenes(runs("+"), runs("+")))
    assert equal.startswith("of 1 run of the same scenes")
    assert equal.endswith("in 100 % of all cases")
    better = same_scenes_text(same_scenes(runs("-----"), runs("+++++")))
    assert better.endswith("in 6.25 % of all cases")


def test_long_lists_of_names_are_cut():
    told = same_scenes_text(same_scenes(runs("-" * 30), runs("+" * 30)))
    assert "30 succeed" in told
    assert "000019, ..." in told
    assert "000020" not in told
